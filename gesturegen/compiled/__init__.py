"""Compiled loops: the only modules that import numba and librosa, with a crash-safe store of compiled code.

Compiling takes seconds, so numba keeps what it compiled. Its own files are an index and a data file for each
function, which two processes that compile at the same time tear apart: the index then names data of another signature,
and calling it ends the process by a signal. Whatever is imported through this room is kept in `store` instead.
"""

from __future__ import annotations

import os
import sys
from functools import cache
from pathlib import Path
from types import ModuleType

import numba
from numba.core.dispatcher import Dispatcher

from gesturegen.compiled import hook, store

hook.install()

njit = numba.njit


def is_switched_on() -> bool:
    """Tell whether loops are compiled at all, and not run as plain Python by NUMBA_DISABLE_JIT=1."""
    return not store.config.DISABLE_JIT


@cache
def load_librosa() -> ModuleType:
    """Import librosa, and keep its compiled loops in our store."""
    imported_before = "librosa" in sys.modules
    import librosa

    if not imported_before:
        _import_for_the_homeless()
    if imported_before and is_switched_on():
        adopt(librosa)
    return librosa


def _import_for_the_homeless() -> None:
    """Import the part of librosa that looks up the user's home, with a substitute for a user without one."""
    if store.home_folder() is not None or Path(os.environ.get("XDG_CACHE_HOME", "")).is_absolute():
        return
    before = os.environ.get("XDG_CACHE_HOME")
    # It is where examples would be downloaded to, and nothing of ours does that.
    os.environ["XDG_CACHE_HOME"] = str(store.folders()[-1].parent)
    try:
        import librosa.util.files  # noqa: F401
    finally:
        if before is None:
            del os.environ["XDG_CACHE_HOME"]
        else:
            os.environ["XDG_CACHE_HOME"] = before


def adopt(package: ModuleType) -> None:
    """Keep the loops of a package that was imported before gesturegen in our store from now on."""
    for name, module in list(sys.modules.items()):
        if name.partition(".")[0] != package.__name__:
            continue
        for loop in list(vars(module).values()):
            if isinstance(loop, Dispatcher) and hook.is_kept_elsewhere(loop):
                loop.enable_caching()
