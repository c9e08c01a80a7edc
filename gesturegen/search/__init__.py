"""Searching a motion graph for a test speech (§4.2)."""
