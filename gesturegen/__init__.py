"""Gesture reenactment from few recorded examples (see README.md)."""

__version__ = "0.1.0"
