"""Recordings as they lie on disk, and what is stored of them."""
