"""Descriptions of one graph, trace or skeleton for the user: figures for JSON, lines for reading, pictures."""
