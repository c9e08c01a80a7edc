"""What a user asks of one graph or one trace: figures for JSON, lines for reading, pictures."""
