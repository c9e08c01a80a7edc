"""Packages that only some commands need: imported when used, and what to install when one is missing."""

from __future__ import annotations

import importlib
from types import ModuleType

from gesturegen.errors import DataError


def need(module: str, extra: str) -> ModuleType:
    """The module `module`, which the extra `extra` of gesturegen installs; DataError when it is not there."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise DataError(f"{module} cannot be used ({error}); run: pip install 'gesturegen[{extra}]'") from None
