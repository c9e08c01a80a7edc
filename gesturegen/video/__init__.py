"""Video of motions: the figure, its picture, and the file with sound."""
