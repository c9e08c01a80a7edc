"""The file in which training keeps its networks, checked on reading."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import torch
from pydantic import ValidationError
from torch import Tensor

from gesturegen.errors import DamagedError, DataError
from gesturegen.stored.documents import Checkpoint, first_problem
from gesturegen.stored.sealing import checksum, seal_archive

# Raised when what a checkpoint holds changes.
FORMAT = 2


def store(state: dict[str, Any], file: BinaryIO) -> None:
    """Write the state of a run, of numbers, texts and tensors only, with a checksum."""
    torch.save(state, file)
    seal_archive(file)


def load(path: str | Path) -> dict[str, Any]:
    """Load what `store` wrote; raises DataError for a missing file, DamagedError for a damaged one or another kind."""
    try:
        checksum(path, "train-refiner")
        with Path(path).open("rb") as file:
            state = torch.load(file, map_location="cpu", weights_only=True)
        if state["format"] != FORMAT:
            raise ValueError(f"format {state['format']}, expected {FORMAT}")
        Checkpoint.model_validate(state)
        _require_finite({name: state[name] for name in ("generator", "critic", "best")})
    except DamagedError as error:
        raise _damaged(path, str(error).partition("damaged (")[2].rpartition(");")[0]) from None
    except DataError:
        raise
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror}); train a refiner first") from None
    except ValidationError as error:
        raise _damaged(path, first_problem(error)) from None
    except Exception as error:
        # zipfile, pickle and torch each have their own word for a damaged file, some of many lines.
        raise _damaged(path, (str(error).splitlines() or [type(error).__name__])[0]) from None
    return state


@contextmanager
def fitting(path: str | Path) -> Iterator[None]:
    """Raise DamagedError where the block finds weights of the file at `path` that do not fit the networks."""
    try:
        yield
    except (RuntimeError, KeyError, TypeError, ValueError) as error:
        raise _damaged(path, (str(error).splitlines() or [type(error).__name__])[0]) from None


def _damaged(path: str | Path, reason: str) -> DamagedError:
    """Return the error for a damaged checkpoint."""
    return DamagedError(f"{path}: not a refiner, or damaged ({reason}); delete it and train again")


def _require_finite(value: Any, name: str = "state") -> None:
    """Raise ValueError for a tensor, at any depth, that is not of finite numbers."""
    if isinstance(value, dict):
        for key, inner in value.items():
            _require_finite(inner, str(key)[:40])
    elif isinstance(value, Tensor) and not bool(torch.isfinite(value).all()):
        raise ValueError(f"{name} is not finite")
