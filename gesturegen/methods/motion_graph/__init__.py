"""Gesture motion graphs (Zhao et al. 2023): a graph of reference frames and two ways to search it."""
