"""Baselines: recorded motion without any search, to compare methods with."""
