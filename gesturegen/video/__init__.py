"""From motions to a video: the figure, its picture, and the file with sound."""
