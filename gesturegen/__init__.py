"""Gesture reenactment from few recorded examples (see README.md)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

__version__ = "0.2.0"
__all__ = ["Gesture", "Gesturer", "__version__", "measure", "read_motion", "read_speech"]

if TYPE_CHECKING:
    from gesturegen.api import Gesture, Gesturer, measure, read_motion, read_speech


def __getattr__(name: str) -> Any:
    """Import a public name on first use, so that `import gesturegen` itself stays fast."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from gesturegen import api

    return getattr(api, name)
