"""Random generators, one per purpose, so that no clip's draws depend on another's."""

from __future__ import annotations

import hashlib

import numpy as np


def generator(seed: int, purpose: str) -> np.random.Generator:
    """Create a generator seeded by the run seed and a name, such as a test clip's."""
    digest = hashlib.sha256(purpose.encode()).digest()
    return np.random.default_rng([seed, *np.frombuffer(digest[:16], dtype="<u4").tolist()])
