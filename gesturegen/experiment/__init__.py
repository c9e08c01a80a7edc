"""Experiments: the same clips through several setups and seeds, in one table; `ablate` and `compare` are two presets."""
