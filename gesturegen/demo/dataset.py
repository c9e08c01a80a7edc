"""The demo dataset in the GENEA layout: its list of clips, and writing them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import soundfile

from gesturegen.demo.body import FPS, make_motion
from gesturegen.demo.speaker import SPEAKERS, speaker
from gesturegen.demo.speech import format_tsv, write_script
from gesturegen.demo.voice import SAMPLE_RATE, synthesize
from gesturegen.errors import ConfigError
from gesturegen.files import write_bytes, write_text
from gesturegen.motion import bvh

# Lengths in seconds of the GENEA 2023 challenge's chosen references and tests, for 70 of each.
CHALLENGE_SECONDS = {"reference_seconds": (60.0, 427.0), "test_seconds": (60.0, 77.0)}

_SPLIT_NUMBERS = {"trn": 0, "tst": 1}


@dataclass(frozen=True)
class ClipSpec:
    """The specification of one clip, which depends on these five values alone.

    split : "trn" or "tst"; index : number within the split; seconds : length, a whole number of samples
    seed : of the dataset; speaker : 1 to SPEAKERS
    """

    split: Literal["trn", "tst"]
    index: int
    seconds: float
    seed: int
    speaker: int

    @property
    def prefix(self) -> str:
        """The clip's name in metadata.csv."""
        return f"{self.split}_2023_v0_{self.index:03d}"

    @property
    def name(self) -> str:
        """The stem of the clip's files."""
        return f"{self.prefix}_main-agent"


def clip_specs(
    *,
    references: int,
    tests: int,
    seed: int,
    reference_seconds: tuple[float, float] = (60.0, 120.0),
    test_seconds: tuple[float, float] = (60.0, 77.0),
) -> list[ClipSpec]:
    """List all clips of a dataset, references first; a clip's spec does not depend on how many others there are.

    Lengths are skewed to the short end, as in the challenge: the mean lies 30 % (references) or 15 % (tests)
    into the range.
    """
    if references < 0 or tests < 0 or seed < 0:
        raise ConfigError(f"references {references}, tests {tests}, seed {seed}: none may be negative")
    specs = []
    ranges: tuple[tuple[Literal["trn", "tst"], int, tuple[float, float], float], ...]
    ranges = (("trn", references, reference_seconds, 0.30), ("tst", tests, test_seconds, 0.15))
    for split, count, (shortest, longest), mean in ranges:
        if not 10.0 <= shortest <= longest <= 3600.0:
            raise ConfigError(f"clip lengths {shortest:g} to {longest:g} s: allowed are 10 to 3600 s, shortest first")
        for index in range(count):
            rng = np.random.default_rng([seed, _SPLIT_NUMBERS[split], index, 0])
            seconds = shortest + (longest - shortest) * rng.beta(1.0, 1.0 / mean - 1.0)
            seconds = round(seconds * SAMPLE_RATE) / SAMPLE_RATE
            specs.append(ClipSpec(split, index, seconds, seed, 1 + index % SPEAKERS))
    return specs


def write_clip(folder: str | Path, spec: ClipSpec) -> list[Path]:
    """Make one clip and write its WAV, TSV and BVH; the motion of a test goes to `truth`. Returns the paths."""
    folder = Path(folder)
    script_rng, voice_rng, motion_rng = (
        np.random.default_rng([spec.seed, _SPLIT_NUMBERS[spec.split], spec.index, stream]) for stream in (1, 2, 3)
    )
    who = speaker(spec.speaker, spec.seed)
    script = write_script(script_rng, who, spec.seconds)
    samples = synthesize(voice_rng, who, script)
    motion = make_motion(motion_rng, who, script, round(len(samples) / SAMPLE_RATE * FPS))
    home = folder / spec.split / "main-agent"
    truth = home if spec.split == "trn" else folder / "truth" / "main-agent"
    paths = [home / "wav" / f"{spec.name}.wav", home / "tsv" / f"{spec.name}.tsv", truth / "bvh" / f"{spec.name}.bvh"]
    write_bytes(paths[0], lambda file: soundfile.write(file, samples, SAMPLE_RATE, format="WAV", subtype="PCM_16"))
    write_text(paths[1], format_tsv(script))
    bvh.write(paths[2], motion)
    return paths


def write_metadata(folder: str | Path, specs: list[ClipSpec]) -> list[Path]:
    """Write `metadata.csv` of both splits, in the challenge's columns. Returns the paths."""
    paths = []
    for split in _SPLIT_NUMBERS:
        rows = ["prefix,main-agent_id,main-agent_has_fingers,interloctr_id,interloctr_has_fingers"]
        for spec in specs:
            if spec.split == split:
                listener = 1 + spec.speaker % SPEAKERS
                rows.append(f"{spec.prefix},{spec.speaker},fingers_incl,{listener},fingers_incl")
        path = Path(folder) / split / "metadata.csv"
        write_text(path, "\n".join(rows) + "\n")
        paths.append(path)
    return paths
