"""The report: one HTML file that shows every clip of a run, from disk, without a network.

`figure` says which joints are drawn and how, `sound` makes compact audio, `pack` puts one clip into text,
`page` puts all of it into one file. The scripts and the style beside them are what the file runs.
"""
