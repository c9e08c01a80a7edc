"""Optional packages, imported only when a command needs them; the error for a missing one says what to install."""

from __future__ import annotations

import importlib
from types import ModuleType

from gesturegen.errors import DataError


def need(module: str, extra: str) -> ModuleType:
    """Import the module `module`, which the extra `extra` of gesturegen installs; DataError when it is missing."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise DataError(f"{module} cannot be used ({error}); run: pip install 'gesturegen[{extra}]'") from None
