"""Gesture clips and their signatures (GestureMaster, Zhou et al. 2022)."""
