"""The hook by which numba keeps the loops of gesturegen and librosa in `store`: two replaced cache classes.

numba's `Cache` asks a *locator* where a function's code belongs, and a *cache file* to save and load it. The locator
here answers for functions of gesturegen and librosa only; those of other programs stay where they are.
"""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from numba.core import caching
from numba.core.serialize import dumps

from gesturegen.compiled import store
from gesturegen.compiled.store import config

_PACKAGES = ("gesturegen", "librosa")
# What our locator gives as folder, by which the cache files of our functions are known.
_OURS = "store of gesturegen"


class Locator(caching._CacheLocator):
    """Cache locator of numba that puts a function's compiled code into our store, labelled with its source."""

    def __init__(self, line: int, stamp: str):
        self._line = line
        self._stamp = stamp

    def ensure_cache_path(self) -> None:
        """Do nothing: the store makes its folders when it first writes, and gets by without."""

    def get_cache_path(self) -> str:
        """Return the mark of our store in place of a folder."""
        return _OURS

    def get_source_stamp(self) -> str:
        """Return the digest of the source that the code was made from."""
        return self._stamp

    def get_disambiguator(self) -> str:
        """Return the line of the function, which tells functions of one name apart."""
        return str(self._line)

    @classmethod
    def from_function(cls, function: Callable, path: str) -> Locator | None:
        """Create the locator of a function; None for one of another package."""
        if (function.__module__ or "").partition(".")[0] not in _PACKAGES:
            return None
        try:
            return cls(function.__code__.co_firstlineno, f"{function.__module__} {source_digest(path)}")
        except OSError:
            return None  # such as a module within a zip archive, which numba knows how to handle


class Entries:
    """Cache file of numba for one function, with one entry in the store for each signature and processor."""

    def __init__(self, name: str, stamp: str):
        self._name = name
        self._stamp = stamp

    def save(self, key: Any, data: Any) -> None:
        """Store the compiled code of one signature."""
        # What was compiled stands first in a pickle of its own, so that it is compared before the code is unpickled.
        # The name is part of it: two functions of one file may have the same bytecode and differ in what they call.
        store.keep(self._entry(key), dumps((self._name, self._stamp, key)) + dumps(data))

    def load(self, key: Any) -> Any:
        """Load the compiled code of one signature; None where there is none."""
        entry = self._entry(key)
        for stored in store.read(entry):
            if pickle.load(stored) == (self._name, self._stamp, key):
                store.used.add(entry)
                return pickle.load(stored)
        return None

    def flush(self) -> None:
        """Do nothing: entries made from other sources are never read for this one."""

    def _entry(self, key: Any) -> str:
        return f"{self._name}-{hashlib.sha256(repr((self._stamp, key)).encode()).hexdigest()[:24]}"


def install() -> None:
    """Make numba keep the loops of gesturegen and librosa that are imported from now on in our store."""
    replaced: Any = caching
    numbas_own = caching.IndexDataCacheFile

    def cache_file(cache_path: str, filename_base: str, source_stamp: Any) -> Any:
        if cache_path == _OURS:
            return Entries(filename_base, source_stamp)
        return numbas_own(cache_path, filename_base, source_stamp)

    replaced.IndexDataCacheFile = cache_file
    caching.CacheImpl._locator_classes = [Locator, *caching.CacheImpl._locator_classes]
    if getattr(config, "CACHE_LOCATOR_CLASSES", ""):
        config.CACHE_LOCATOR_CLASSES = f"{__name__}.Locator,{config.CACHE_LOCATOR_CLASSES}"


def is_kept_elsewhere(loop: Any) -> bool:
    """Tell whether numba keeps the compiled code of `loop` outside of our store."""
    return isinstance(getattr(loop, "_cache", None), caching.FunctionCache) and loop._cache.cache_path != _OURS


@cache
def source_digest(path: str) -> str:
    """Hash a source file and all that its compiled code may include, since our kernels call each other."""
    sources = sorted(_package().rglob("*_kernels.py")) if Path(path).is_relative_to(_package()) else []
    digest = hashlib.sha256()
    for source in [Path(path), *sources]:
        digest.update(hashlib.sha256(source.read_bytes()).digest())
    return digest.hexdigest()


def _package() -> Path:
    return Path(__file__).parent.parent
