"""Recordings on disk, and the clips that are stored of them."""
