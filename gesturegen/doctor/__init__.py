"""The examination of a data set: its faults, and what can be done with it.

`lag` measures whether sound and motion run together, `examination` looks at one recording, `dataset` at all of them
together, `page` shows the findings.
"""
