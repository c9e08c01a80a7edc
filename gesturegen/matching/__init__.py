"""Features of k-NN motion matching (Habibie et al. 2022)."""
