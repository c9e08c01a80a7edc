"""Which recordings there are on disk, which may be used, and which reference serves which test clip (§3)."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

from gesturegen import inputs, strict_csv, strict_yaml
from gesturegen.config import Config
from gesturegen.errors import ConfigError, DataError
from gesturegen.randomness import generator
from gesturegen.speech import audio

AGENT = "main-agent"


@dataclass(frozen=True)
class Recording:
    """The files of one clip; None where there is no such file.

    problem : why it cannot be used whatever the files hold, None for no reason
    """

    name: str
    motion_path: Path | None
    audio_path: Path | None
    transcript_path: Path | None
    speaker: str | None = None
    problem: str | None = None


def reference_recordings(config: Config) -> list[Recording]:
    """The recordings that may become references, without the blacklist; DataError when none is left."""
    folder = _reference_folder(config)
    found = [recording for recording in list_recordings(folder) if recording.motion_path]
    if not found:
        raise DataError(
            f"{inputs.shown(folder)}: no BVH file in it; expected GENEA's {AGENT}/bvh, or BVH and WAV files side by side"
        )
    left = [recording for recording in found if not is_listed(recording.name, config.blacklist)]
    if not left:
        raise DataError(
            f"{inputs.shown(folder)}: no reference is left of {len(found)} after the blacklist; shorten `blacklist`"
        )
    return left


def blacklisted_recordings(config: Config) -> list[Recording]:
    """The recordings that the blacklist keeps from becoming references."""
    recordings = list_recordings(_reference_folder(config))
    return [r for r in recordings if r.motion_path and is_listed(r.name, config.blacklist)]


def recordings_without_motion(config: Config) -> list[Recording]:
    """Recordings among the references that lack a BVH file; none where tests lie in the same folder."""
    folder = _reference_folder(config)
    if folder == _test_folder(config):
        return []
    return [recording for recording in list_recordings(folder) if not recording.motion_path]


def test_recordings(config: Config) -> list[Recording]:
    """The recordings whose speech is to be gestured; DataError when there is none."""
    folder = _test_folder(config)
    found = [recording for recording in list_recordings(folder) if recording.audio_path or recording.transcript_path]
    if not found:
        raise DataError(
            f"{inputs.shown(folder)}: no audio file in it; expected GENEA's {AGENT}/wav, or WAV, FLAC, OGG, MP3 or M4A files"
        )
    return found


def _reference_folder(config: Config) -> Path:
    return _folder(config.data.references, config.paths.data, config.data.reference_split, "reference")


def _test_folder(config: Config) -> Path:
    return _folder(config.data.tests, config.paths.data, config.data.test_split, "test")


def _folder(chosen: str | None, data: str, split: str, what: str) -> Path:
    folder = Path(chosen) if chosen is not None else Path(data) / split
    if not inputs.is_dir(folder):
        key = f"data.{what}s" if chosen is not None else f"paths.data and data.{what}_split"
        raise DataError(f"{inputs.shown(folder)}: no such folder of {what} clips; check {key}")
    return folder


def list_recordings(folder: str | Path) -> list[Recording]:
    """All recordings of a folder, sorted by name: GENEA's layout, `bvh`/`wav`/`tsv` folders, or files side by side."""
    folder = Path(folder)
    agent = folder / AGENT if inputs.is_dir(folder / AGENT) else folder
    problems: dict[str, str] = {}
    motions = _stems(agent, "bvh", (".bvh",), problems)
    audios = _stems(agent, "wav", audio.EXTENSIONS, problems)
    transcripts = _stems(agent, "tsv", (".tsv",), problems)
    speakers = _speakers(folder / "metadata.csv")
    names = sorted({*motions, *audios, *transcripts})
    return [
        Recording(
            name, motions.get(name), audios.get(name), transcripts.get(name),
            speakers.get(name) or speakers.get(name.removesuffix(f"_{AGENT}")), problems.get(name),
        )
        for name in names
    ]  # fmt: skip


def _stems(folder: Path, kind: str, extensions: tuple[str, ...], problems: dict[str, str]) -> dict[str, Path]:
    """Files of one kind by clip name; a clip with two of them is noted in `problems`."""
    inside = folder / kind
    try:
        paths = sorted((inside if inputs.is_dir(inside) else folder).iterdir())
    except OSError as error:
        raise DataError(
            f"{inputs.shown(error.filename or folder)}: cannot be listed ({error.strerror}); {inputs.PERMISSIONS}"
        ) from None
    found: dict[str, Path] = {}
    for path in paths:
        if path.suffix.lower() not in extensions or path.name.startswith("."):
            continue
        name = inputs.shown(path.stem)
        if (problem := inputs.name_problem(path)) is not None:
            problems[name] = problem
        elif name in found and _is_copy(found[name], path):
            continue
        elif name in found and _is_copy(path, found[name]):
            problems.pop(name, None)
        elif name in found:
            problems[name] = f"{inputs.shown(path)}: clip {name} has a second file {found[name].name}; keep one"
        found[name] = path
    return found


def _is_copy(lossless: Path, path: Path) -> bool:
    """Whether a sound file is the compressed copy of another, which is then taken."""
    return lossless.suffix.lower() in audio.LOSSLESS and path.suffix.lower() in audio.COPIES


def _speakers(path: Path) -> dict[str, str]:
    """The speaker of each recording that `metadata.csv` tells of; none where there is no such file."""
    if not os.path.lexists(path):
        return {}
    wanted = {"prefix": False, f"{AGENT}_id": False}
    speakers: dict[str, str] = {}
    lines: dict[str, int] = {}
    for line, row in strict_csv.read_rows(path, wanted, inputs.PERMISSIONS, others=True, error=DataError):
        prefix, speaker = (row[name] for name in wanted)
        if not prefix or not speaker:
            continue
        if prefix in lines:
            raise DataError(
                f"{inputs.shown(path)}:{line}: {prefix!r} stands twice, first in line {lines[prefix]}; keep one of the lines"
            )
        speakers[prefix], lines[prefix] = speaker, line
    return speakers


def is_listed(name: str, patterns: Sequence[str]) -> bool:
    """Whether a clip's name, with or without `_main-agent`, is one of `patterns` (names or globs)."""
    names = (name, name.removesuffix(f"_{AGENT}"))
    return any(fnmatchcase(n, pattern) for n in names for pattern in patterns)


# --- which references for which test clip -------------------------------------------------------------------


def choose_references(
    tests: Sequence[str],
    references: Mapping[str, str | None],
    speakers: Mapping[str, str | None],
    config: Config,
    durations: Mapping[str, float] | None = None,
) -> dict[str, tuple[str, ...]]:
    """The reference clips of each test clip, by `references.mode`, and no more than `references.seconds` asks for.

    references : name -> speaker; speakers : test name -> speaker. `per_test_clip` (the paper's) and `k` draw
    without replacement from the run seed over the sorted test names, reshuffling when the clips run out.
    durations : seconds of each reference clip, which only `references.seconds` needs. Of the clips it stops at
    the first that makes them last as long; `k` then keeps the order in which they were drawn.
    """
    chosen = _choose_by_mode(tests, references, speakers, config)
    limit = config.references.seconds
    if limit is None:
        return chosen
    return {test: _until(limit, hand, durations, config.fps) for test, hand in chosen.items()}


def _until(limit: float, names: Sequence[str], durations: Mapping[str, float], fps: int) -> tuple[str, ...]:
    """The first of `names` that together last `limit` seconds, to half a frame."""
    taken, left = [], limit
    for name in names:
        if left <= 0.5 / fps:
            break
        taken.append(name)
        left -= durations[name]
    return tuple(taken or names[:1])  # a limit below half a frame still leaves one


def _choose_by_mode(
    tests: Sequence[str], references: Mapping[str, str | None], speakers: Mapping[str, str | None], config: Config
) -> dict[str, tuple[str, ...]]:
    names = sorted(references)
    mode = config.references.mode
    if mode == "all":
        return {test: tuple(names) for test in sorted(tests)}
    if mode == "list":
        return _pinned(tests, names, Path(config.references.list_file))
    if mode == "speaker":
        return {test: _of_speaker(test, speakers.get(test), references) for test in sorted(tests)}
    k = config.references.k if mode == "k" else 1
    if k > len(names):
        raise ConfigError(f"references.k: found {k}, but there are only {len(names)} reference clips")
    rng = generator(config.seed, "references")
    deck: list[str] = []
    chosen = {}
    for test in sorted(tests):
        hand: list[str] = []
        while len(hand) < k:
            if not any(name not in hand for name in deck):
                deck = [names[n] for n in rng.permutation(len(names))]
            hand.append(deck.pop(next(n for n, name in enumerate(deck) if name not in hand)))
        chosen[test] = tuple(sorted(hand) if config.references.seconds is None else hand)
    return chosen


def _of_speaker(test: str, speaker: str | None, references: Mapping[str, str | None]) -> tuple[str, ...]:
    if speaker is None:
        raise DataError(
            f"clip {test}: no speaker in metadata.csv, which references.mode `speaker` needs; use another mode"
        )
    same = tuple(sorted(name for name, other in references.items() if other == speaker))
    if not same:
        raise DataError(f"clip {test}: no reference clip of speaker {speaker}; use another references.mode")
    return same


def _pinned(tests: Sequence[str], names: Sequence[str], path: Path) -> dict[str, tuple[str, ...]]:
    pins = strict_yaml.read(path, "check references.list")
    if not isinstance(pins, dict):
        raise ConfigError(f"{inputs.shown(path)}: expected `test clip: reference clip` lines")
    chosen = {}
    for test in sorted(tests):
        pinned = pins.get(test, pins.get(test.removesuffix(f"_{AGENT}")))
        pinned = [pinned] if isinstance(pinned, str) else pinned
        if not isinstance(pinned, list) or not pinned or not all(isinstance(name, str) for name in pinned):
            raise ConfigError(
                f"{inputs.shown(path)}: test clip {test} is given no reference; add a line `{test}: reference clip`"
            )
        hand = []
        for name in pinned:
            full = name if name in names else f"{name}_{AGENT}"
            if full not in names:
                raise ConfigError(
                    f"{inputs.shown(path)}: {inputs.shown(name)!r}, pinned to {test}, is no reference clip (missing or blacklisted)"
                )
            hand.append(full)
        chosen[test] = tuple(dict.fromkeys(hand))
    return chosen


def true_motions(config: Config, tests: Mapping[str, Recording]) -> dict[str, Path]:
    """The BVH files of the true motion of test clips: beside their audio, or in `data.truth_split`."""
    found = {name: recording.motion_path for name, recording in tests.items() if recording.motion_path}
    if config.data.truth_split is not None:
        folder = Path(config.paths.data) / config.data.truth_split
        if not inputs.is_dir(folder):
            raise DataError(f"{inputs.shown(folder)}: no such folder of true motion; check data.truth_split")
        found |= {r.name: r.motion_path for r in list_recordings(folder) if r.motion_path and r.name in tests}
    return found
