"""Skeletons, rotations, kinematics, BVH files, cleaning and blending."""
