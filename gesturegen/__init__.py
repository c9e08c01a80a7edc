"""Gesture reenactment from few recorded examples (see README.md)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"
__all__ = ["Gesture", "Gesturer", "__version__", "measure", "read_motion", "read_speech"]

if TYPE_CHECKING:
    from gesturegen.api import Gesture, Gesturer, measure, read_motion, read_speech


def __getattr__(name: str) -> Any:
    """Load what Python programs use when they use it: `import gesturegen` costs nothing."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from gesturegen import api

    return getattr(api, name)
