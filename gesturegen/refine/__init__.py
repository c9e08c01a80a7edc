"""The learned second stage of k-NN motion matching: a network that brings retrieved gestures into time with the voice.

Habibie et al., A motion matching-based framework for controllable gesture synthesis from speech, SIGGRAPH 2022,
section 3.2. Only `network` and `training` need torch; nothing here imports them, so import them where they are used.
"""
