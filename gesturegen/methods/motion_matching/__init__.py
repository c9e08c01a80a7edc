"""k-NN motion matching (Habibie et al. 2022): features of every frame and the search for the nearest."""
