"""Metrics: pure functions on arrays, one family per file.

| file | question |
|---|---|
| `synchrony` | does it move as fast as the recorded motion at the same moment (Syn)? |
| `beats` | do gestures peak where the speech does (BC)? |
| `diversity` | how often does the motion change direction (Div)? |
| `smoothness` | how fast and how smoothly does it move (acceleration, jerk)? |
| `genea` | how far are its speeds and poses from recorded ones (Hellinger, CCA, `genea_compat`)? |
| `frechet` | do short stretches look like recorded ones? |
| `seams` | can the joins be seen? |
| `detectability` | can a classifier find the joins? |
| `usage` | what of the reference is used, and how often? |
| `feet` | do the feet slide? |

Positions are world positions `(T, J, 3)` in cm, y up. A measure that is undefined (too few frames, no onset,
no truth) is NaN, never an error and never a warning.
"""
