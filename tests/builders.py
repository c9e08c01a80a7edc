"""Small inputs for tests: skeletons, BVH text, audio, recordings in GENEA's layout, and the shape of a refusal."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

from gesturegen.motion import bvh
from gesturegen.motion.skeleton import Motion, Skeleton
from gesturegen.settings.loading import load_config
from gesturegen.settings.models import Config
from tests import tiny

POSITIONS = ("Xposition", "Yposition", "Zposition")
ZXY = ("Zrotation", "Xrotation", "Yrotation")
SMALL = settings(deadline=None, derandomize=True, max_examples=25)

# Fifteen lines; MOTION is line 16, `Frames` 17, `Frame Time` 18, the first row 19.
ARM = """HIERARCHY
ROOT upper
{
	OFFSET 0.0 10.0 0.0
	CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
	JOINT lower
	{
		OFFSET 30.0 0.0 0.0
		CHANNELS 3 Zrotation Xrotation Yrotation
		End Site
		{
			OFFSET 25.0 0.0 0.0
		}
	}
}
"""
ARM_ROW = "1.0 2.0 3.0 10.0 20.0 30.0 40.0 50.0 60.0"
ARM_CHANNELS = 9


def data_folder() -> Path:
    """The folder of real data, or a skip that says how to get it."""
    folder = os.environ.get("GESTUREGEN_TEST_DATA")
    if not folder:
        pytest.skip("GESTUREGEN_TEST_DATA is not set: no real data to test on")
    return Path(folder)


@contextmanager
def refused(kind: type[Exception], match: str, names: str | Path | None = None):
    """The block raises `kind` with one line that matches `match` and contains `names`."""
    with pytest.raises(kind, match=match) as caught:
        yield caught
    message = str(caught.value)
    assert "\n" not in message, f"more than one line: {message!r}"
    assert names is None or str(names) in message, f"{names} is not named: {message!r}"


# --- motion -------------------------------------------------------------------------------------------------


def make_skeleton(
    names: Sequence[str],
    parents: Sequence[int],
    offsets: Sequence[Sequence[float]] | None = None,
    channels: Sequence[Sequence[str]] | None = None,
    end_sites: Sequence[Sequence[float]] | None = None,
) -> Skeleton:
    """A skeleton whose joints stand 10 units apart along X and rotate ZXY; the root moves as well."""
    count = len(names)
    given = np.tile([10.0, 0.0, 0.0], (count, 1)) if offsets is None else np.array(offsets, dtype=float)
    ends = np.full((count, 3), np.nan) if end_sites is None else np.array(end_sites, dtype=float)
    if channels is None:
        channels = [POSITIONS + ZXY, *[ZXY] * (count - 1)]
    channels = [tuple(c) for c in channels]
    text = bvh.hierarchy_text(list(names), list(parents), given, ends, channels)
    return Skeleton(tuple(names), np.array(parents), given, ends, tuple(channels), text)


def chain(count: int, **options) -> Skeleton:
    """Joints `j0` to `j<count-1>`, each the child of the one before."""
    return make_skeleton([f"j{n}" for n in range(count)], list(range(-1, count - 1)), **options)


def random_quaternions(rng: np.random.Generator, *shape: int) -> np.ndarray:
    values = rng.normal(size=(*shape, 4))
    return values / np.linalg.norm(values, axis=-1, keepdims=True)


def random_motion(skeleton: Skeleton, frames: int, seed: int = 0, fps: float = 30.0) -> Motion:
    """Random rotations of every joint; only the root travels."""
    rng = np.random.default_rng(seed)
    positions = np.tile(skeleton.offsets, (frames, 1, 1))
    positions[:, 0] += rng.normal(scale=20.0, size=(frames, 3))
    return Motion(skeleton, random_quaternions(rng, frames, len(skeleton.names)), positions, fps)


def matrix(axis: str, degrees: float) -> np.ndarray:
    """The elementary rotation about one axis, written out."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array(
        {
            "X": [[1, 0, 0], [0, c, -s], [0, s, c]],
            "Y": [[c, 0, s], [0, 1, 0], [-s, 0, c]],
            "Z": [[c, -s, 0], [s, c, 0], [0, 0, 1]],
        }[axis]
    )


def product(order: str, degrees: Iterable[float]) -> np.ndarray:
    """The intrinsic rotation: for ZXY, Rz Rx Ry."""
    result = np.eye(3)
    for axis, angle in zip(order, degrees, strict=True):
        result = result @ matrix(axis, angle)
    return result


def bvh_text(
    rows: Sequence[str] = (ARM_ROW,) * 3,
    hierarchy: str = ARM,
    frames: object = None,
    frame_time: str = "0.033333",
) -> str:
    count = len(rows) if frames is None else frames
    return f"{hierarchy}MOTION\nFrames: {count}\nFrame Time: {frame_time}\n" + "".join(f"{row}\n" for row in rows)


# --- sound --------------------------------------------------------------------------------------------------


def write_audio(path: Path, samples: np.ndarray, rate: int = 16000, **options) -> Path:
    """A sound file by libsndfile; options as of `soundfile.write` (subtype, format)."""
    import soundfile

    path.parent.mkdir(parents=True, exist_ok=True)
    soundfile.write(path, samples, rate, **options)
    return path


def bursts(times: Iterable[float], seconds: float, rate: int = 16000, floor: float = 1e-3, seed: int = 0) -> np.ndarray:
    """Noise bursts of 60 ms with a sharp attack at `times`, over a noise floor."""
    rng = np.random.default_rng(seed)
    samples = floor * rng.standard_normal(round(seconds * rate))
    length = round(0.06 * rate)
    for time in times:
        start = min(round(time * rate), len(samples))
        stop = min(start + length, len(samples))
        samples[start:stop] += 0.2 * rng.standard_normal(stop - start) * np.linspace(1.0, 0.2, length)[: stop - start]
    return samples.clip(-1.0, 1.0)


# --- recordings ---------------------------------------------------------------------------------------------


def settings_for(folder: Path, *overrides: str) -> Config:
    """A config for tiny skeletons under `folder`: all joints, no wrists."""
    return load_config(None, (f"paths.data={folder}", "joints=all", "wrists.enabled=false", *overrides))


def write_clip(
    folder: Path,
    name: str,
    seconds: float = 2.0,
    onsets: Sequence[float] = (0.5, 1.2),
    words: Sequence[tuple[float, float, str]] | None = ((0.5, 0.8, "hello"), (1.2, 1.5, "there")),
    motion: Motion | None = None,
    with_motion: bool = True,
) -> None:
    """One recording in GENEA's layout: `folder`/main-agent/{bvh,wav,tsv}/`name`; words None for no TSV."""
    agent = folder / "main-agent"
    write_audio(agent / "wav" / f"{name}.wav", bursts(onsets, seconds))
    if with_motion:
        bvh.write(agent / "bvh" / f"{name}.bvh", motion or random_motion(chain(3), round(seconds * 30)))
    if words is not None:
        (agent / "tsv").mkdir(parents=True, exist_ok=True)
        lines = [f"{start}\t{end}\t{text}\n" for start, end, text in words]
        (agent / "tsv" / f"{name}.tsv").write_text("".join(lines))


def write_dataset(folder: Path) -> Path:
    """Two references and two tests of a few seconds, in GENEA layout."""
    rng = np.random.default_rng(0)
    for name in ("trn_a", "trn_b"):
        write_clip(folder / "trn", name, 3.0, (0.4, 0.9, 1.5, 2.2), motion=tiny.motion(rng, 90, chain(4)))
    for name in ("tst_a", "tst_b"):
        write_clip(folder / "tst", name, 2.0, (0.5, 1.1), with_motion=False)
    return folder


def literally(path: Path, line: int) -> str:
    """A pattern for `path:line: `."""
    return re.escape(f"{path}:{line}: ")
