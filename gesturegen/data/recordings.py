"""Recordings on disk: which may be used, and which reference serves which test clip (§3)."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from fnmatch import fnmatchcase
from pathlib import Path

from gesturegen import inputs, strict_csv, strict_yaml
from gesturegen.errors import ConfigError, DataError
from gesturegen.randomness import generator
from gesturegen.settings.models import Config
from gesturegen.speech import audio, transcripts

AGENT = "main-agent"


@dataclass(frozen=True)
class Recording:
    """The files of one clip; None where there is no such file.

    problem : why it cannot be used whatever the files hold, None for no reason
    other_transcripts : more of them, in the order in which they would be read
    unread_path : sound of a kind that is not read, where there is no other
    """

    name: str
    motion_path: Path | None
    audio_path: Path | None
    transcript_path: Path | None
    speaker: str | None = None
    problem: str | None = None
    other_transcripts: tuple[Path, ...] = ()
    unread_path: Path | None = None


def reference_recordings(config: Config) -> list[Recording]:
    """List the recordings that may become references, without the blacklist; raises DataError when none is left."""
    folder = _reference_folder(config)
    found = [recording for recording in list_recordings(folder) if recording.motion_path]
    if not found:
        raise DataError(
            f"{inputs.shown(folder)}: no BVH file in it; expected GENEA's {AGENT}/bvh, or BVH and WAV files side by side"
        )
    barred = _blacklisted(config, [recording.name for recording in found])
    left = [recording for recording in found if recording.name not in barred]
    if not left:
        raise DataError(
            f"{inputs.shown(folder)}: no reference is left of {len(found)} after the blacklist; shorten `blacklist`"
        )
    return left


def blacklisted_recordings(config: Config) -> list[Recording]:
    """List the recordings that the blacklist keeps from becoming references."""
    recordings = [r for r in list_recordings(_reference_folder(config)) if r.motion_path]
    barred = _blacklisted(config, [recording.name for recording in recordings])
    return [recording for recording in recordings if recording.name in barred]


def _blacklisted(config: Config, names: Sequence[str]) -> set[str]:
    """Collect the names that the patterns of the blacklist match."""
    return {name for pattern in config.blacklist for name in matching(pattern, names)}


def recordings_without_motion(config: Config) -> list[Recording]:
    """List recordings among the references that lack a BVH file; none where tests lie in the same folder."""
    folder = _reference_folder(config)
    if folder == _test_folder(config):
        return []
    return [recording for recording in list_recordings(folder) if not recording.motion_path]


def test_recordings(config: Config) -> list[Recording]:
    """List the recordings whose speech is to be gestured; raises DataError when there is none."""
    folder = _test_folder(config)
    found = [r for r in list_recordings(folder) if r.audio_path or r.transcript_path or r.unread_path]
    if not found:
        raise DataError(
            f"{inputs.shown(folder)}: no audio file in it; expected GENEA's {AGENT}/wav, or WAV, FLAC, OGG, MP3 or M4A files"
        )
    return found


def folders(config: Config) -> list[Path]:
    """List the folders of references and tests, each once."""
    return list(dict.fromkeys((_reference_folder(config), _test_folder(config))))


def _reference_folder(config: Config) -> Path:
    """Locate the folder of the references."""
    return _folder(config.data.references, config.paths.data, config.data.reference_split, "reference")


def _test_folder(config: Config) -> Path:
    """Locate the folder of the tests."""
    return _folder(config.data.tests, config.paths.data, config.data.test_split, "test")


def _folder(chosen: str | None, data: str, split: str, what: str) -> Path:
    """Locate a folder of clips; raises DataError where it does not exist."""
    folder = Path(chosen) if chosen is not None else Path(data) / split
    if not inputs.is_dir(folder):
        key = f"data.{what}s" if chosen is not None else f"paths.data and data.{what}_split"
        raise DataError(f"{inputs.shown(folder)}: no such folder of {what} clips; check {key}")
    return folder


def list_recordings(folder: str | Path) -> list[Recording]:
    """List the recordings of a folder by name: GENEA's layout, `bvh`/`wav`/`tsv` folders, or files side by side."""
    return _look_into(folder)[0]


def unused_files(folder: str | Path) -> list[Path]:
    """List the files beside the recordings that no recording is made of, sorted."""
    return _look_into(folder)[1]


# Sound, or pictures with sound, that is not read as it is: a clip that has nothing else fails.
_OTHER_SOUND = {
    ".mp3": "MPEG audio (MP3)", ".m4a": "MPEG-4 audio", ".mp4": "MPEG-4 video", ".m4v": "MPEG-4 video", ".aac": "AAC audio",
    ".opus": "Opus audio", ".wma": "Windows Media audio", ".aif": "AIFF audio", ".aiff": "AIFF audio", ".aifc": "AIFF audio",
    ".au": "Sun audio", ".caf": "Core Audio", ".amr": "AMR audio", ".webm": "WebM", ".mkv": "Matroska video",
    ".mov": "QuickTime video", ".avi": "AVI video", ".oga": "Ogg audio", ".sph": "NIST SPHERE audio",
}  # fmt: skip


def _look_into(folder: str | Path) -> tuple[list[Recording], list[Path]]:
    """List the recordings of a folder, and the files that no recording is made of."""
    folder = Path(folder)
    agent = folder / AGENT if inputs.is_dir(folder / AGENT) else folder
    problems: dict[str, str] = {}
    listed: dict[Path, list[Path]] = {}
    motions = _stems(_place(agent, "bvh"), (".bvh",), problems, listed)
    audios = _stems(_place(agent, "wav"), audio.EXTENSIONS, problems, listed)
    others = tuple(extension for extension in _OTHER_SOUND if extension not in audio.EXTENSIONS)
    unread = _stems(_place(agent, "wav"), others, {}, listed)
    unread = {name: path for name, path in unread.items() if name not in audios}
    found = _transcripts(agent, problems, listed)
    clips = {*motions, *audios, *unread}
    found = {
        name: paths for name, paths in found.items() if name in clips or paths[0].suffix.lower() in transcripts.CERTAIN
    }
    for name, path in unread.items():
        if name not in problems:
            kind = _OTHER_SOUND[path.suffix.lower()]
            problems[name] = (
                f"{inputs.shown(path)}: {kind} is not read; convert it to WAV, such as by `ffmpeg -i FILE {name}.wav`"
            )
    speakers = _speakers(folder / "metadata.csv")
    recordings = [
        Recording(
            name, motions.get(name), audios.get(name), next(iter(found.get(name, ())), None),
            speakers.get(name) or speakers.get(name.removesuffix(f"_{AGENT}")), problems.get(name), found.get(name, ())[1:],
            unread.get(name),
        )
        for name in sorted({*clips, *found})
    ]  # fmt: skip
    used = {
        path for one in recordings for path in (one.motion_path, one.audio_path, one.transcript_path, one.unread_path)
    }
    used |= {path for one in recordings for path in one.other_transcripts} | {folder / "metadata.csv"}
    beside = {path for paths in listed.values() for path in paths if _is_for_us(path)} - used
    # Where there is a problem, its clip tells of it.
    return recordings, sorted(path for path in beside if inputs.shown(path.stem) not in problems)


def _is_for_us(path: Path) -> bool:
    """Tell whether somebody may expect that a file is used: not README, LICENSE and their like."""
    stem = path.stem.lower()
    return inputs.is_file(path) and not stem.startswith(("readme", "license", "licence", "copying", "changelog"))


def _place(folder: Path, kind: str) -> Path:
    """Locate the files of one kind: in a folder of that name, or in `folder` itself."""
    return folder / kind if inputs.is_dir(folder / kind) else folder


def _listing(folder: Path, listed: dict[Path, list[Path]]) -> list[Path]:
    """List what a folder holds but for hidden files, kept in `listed`; raises DataError where it cannot be listed."""
    if folder not in listed:
        try:
            listed[folder] = sorted(path for path in folder.iterdir() if not path.name.startswith("."))
        except OSError as error:
            raise DataError(
                f"{inputs.shown(error.filename or folder)}: cannot be listed ({error.strerror}); {inputs.PERMISSIONS}"
            ) from None
    return listed[folder]


def _stems(
    folder: Path, extensions: tuple[str, ...], problems: dict[str, str], listed: dict[Path, list[Path]]
) -> dict[str, Path]:
    """Map clip names to the files of one kind; a clip with two of them is noted in `problems`."""
    found: dict[str, Path] = {}
    for path in _listing(folder, listed):
        if path.suffix.lower() not in extensions:
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


def _transcripts(agent: Path, problems: dict[str, str], listed: dict[Path, list[Path]]) -> dict[str, tuple[Path, ...]]:
    """Map clip names to transcripts, the preferred one first, of folders named after their kind or beside the sound."""
    kinds = {extension.removeprefix(".") for extension in transcripts.EXTENSIONS} | {"transcripts"}
    places = [path for path in _listing(agent, listed) if path.name.lower() in kinds and inputs.is_dir(path)]
    # A folder `tsv` means that transcripts are there.
    places += [] if any(path.name == "tsv" for path in places) else [_place(agent, "wav"), agent]
    found: dict[str, list[Path]] = {}
    for extension in transcripts.EXTENSIONS:
        of_kind: dict[str, Path] = {}
        for place in dict.fromkeys(places):
            own = _stems(place, (extension,), problems, listed)
            of_kind |= {name: path for name, path in own.items() if name not in of_kind}
        for name, path in of_kind.items():
            found.setdefault(name, []).append(path)
    return {name: tuple(paths) for name, paths in found.items()}


def _is_copy(lossless: Path, path: Path) -> bool:
    """Tell whether a sound file is the compressed copy of another, which is then preferred."""
    return lossless.suffix.lower() in audio.LOSSLESS and path.suffix.lower() in audio.COPIES


def _speakers(path: Path) -> dict[str, str]:
    """Read the speaker of each recording from `metadata.csv`; empty where there is no such file."""
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
    """Tell whether a clip's name, with or without `_main-agent`, is one of `patterns` (names or globs)."""
    return any(is_named(name, pattern) or any(fnmatchcase(n, pattern) for n in _names(name)) for pattern in patterns)


def is_named(name: str, pattern: str) -> bool:
    """Tell whether a pattern, taken to the letter, is a clip's name, with or without `_main-agent`."""
    return pattern in _names(name)


def _names(name: str) -> tuple[str, str]:
    """Return the two forms of a clip's name: with and without `_main-agent`."""
    return name, name.removesuffix(f"_{AGENT}")


def matching(pattern: str, names: Iterable[str]) -> list[str]:
    """List the clips that a pattern means: those of that very name, else those that it matches as a glob."""
    names = sorted(names)
    return [n for n in names if is_named(n, pattern)] or [n for n in names if is_listed(n, (pattern,))]


def without_match(key: str, pattern: str, names: Iterable[str], what: str) -> str | None:
    """Describe a name or pattern of the config that matches none of `names`, and the nearest; None if it matches.

    key : where it stands; what : what the names are of, such as `reference clip`
    """
    names = sorted(names)
    if matching(pattern, names):
        return None
    return f"{key}: {inputs.shown(pattern)!r} matches no {what}; {_nearest(pattern, names)}"


def _nearest(name: str, names: Sequence[str]) -> str:
    """Suggest which of `names` may be meant, as the end of an error message."""
    near = get_close_matches(name[:200], sorted({form for other in names for form in _names(other)}), n=1, cutoff=0.5)
    if near:
        return f"did you mean {near[0]!r}?"
    more = f" and {len(names) - 5} more" if len(names) > 5 else ""
    return f"there are: {inputs.shown(', '.join(sorted(names)[:5]))}{more}" if names else "there are none"


# --- which references for which test clip -------------------------------------------------------------------


def choose_references(
    tests: Sequence[str],
    references: Mapping[str, str | None],
    speakers: Mapping[str, str | None],
    config: Config,
    durations: Mapping[str, float] | None = None,
    failed: Sequence[str] = (),
) -> dict[str, tuple[str, ...]]:
    """Choose the reference clips of each test clip by `references.mode`, cut to `references.seconds`.

    references : name -> speaker; speakers : test name -> speaker. `per_test_clip` (the paper's) and `k` draw
    without replacement from the run seed over the sorted test names, reshuffling when the clips run out.
    durations : seconds of each reference clip, which only `references.seconds` needs. Of the clips it stops at
    the first that makes them last as long; `k` then keeps the order in which they were drawn.
    failed : test clips that could not be read, to which references may be pinned as well
    """
    chosen = _choose_by_mode(tests, references, speakers, config, failed)
    limit = config.references.seconds
    if limit is None:
        return chosen
    if durations is None:
        raise ValueError("references.seconds needs the durations of the references")
    return {test: _until(limit, hand, durations, config.fps) for test, hand in chosen.items()}


def _until(limit: float, names: Sequence[str], durations: Mapping[str, float], fps: int) -> tuple[str, ...]:
    """Take names in order until their clips together last `limit` seconds, to half a frame."""
    taken, left = [], limit
    for name in names:
        if left <= 0.5 / fps:
            break
        taken.append(name)
        left -= durations[name]
    return tuple(taken or names[:1])  # a limit below half a frame still leaves one


def _choose_by_mode(
    tests: Sequence[str],
    references: Mapping[str, str | None],
    speakers: Mapping[str, str | None],
    config: Config,
    failed: Sequence[str],
) -> dict[str, tuple[str, ...]]:
    """Choose the reference clips of each test clip by `references.mode`, without a limit of their length."""
    names = sorted(references)
    mode = config.references.mode
    if mode == "all":
        return {test: tuple(names) for test in sorted(tests)}
    if mode == "list":
        assert config.references.list_file is not None  # the settings demand it in this mode
        return _pinned(tests, names, Path(config.references.list_file), failed)
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
    """List the references of the speaker of a test clip."""
    if speaker is None:
        raise DataError(
            f"clip {test}: no speaker in metadata.csv, which references.mode `speaker` needs; use another mode"
        )
    same = tuple(sorted(name for name, other in references.items() if other == speaker))
    if not same:
        raise DataError(f"clip {test}: no reference clip of speaker {speaker}; use another references.mode")
    return same


def _pinned(
    tests: Sequence[str], names: Sequence[str], path: Path, failed: Sequence[str]
) -> dict[str, tuple[str, ...]]:
    """Read the references that a file pins to each test clip."""
    pins = strict_yaml.read(path, "check references.list")
    if not isinstance(pins, dict):
        raise ConfigError(f"{inputs.shown(path)}: expected `test clip: reference clip` lines")
    known = [*tests, *failed]
    for test in pins:
        if not any(is_named(name, str(test)) for name in known):
            near = _nearest(str(test), known)
            raise ConfigError(f"{inputs.shown(path)}: {inputs.shown(test)!r} is no test clip; {near}")
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
                    f"{inputs.shown(path)}: {inputs.shown(name)!r}, pinned to {test}, is no reference clip (missing or blacklisted); "
                    f"{_nearest(name, names)}"
                )
            hand.append(full)
        chosen[test] = tuple(dict.fromkeys(hand))
    return chosen


def true_motions(config: Config, tests: Mapping[str, Recording]) -> dict[str, Path]:
    """Map test clips to the BVH files of their true motion: beside their audio, or in `data.truth_split`.

    Without one, in a folder `truth` of the dataset, where there is one, as `demo-data` writes it.
    """
    found = {name: recording.motion_path for name, recording in tests.items() if recording.motion_path}
    split = config.data.truth_split
    folder = Path(config.paths.data) / (split or "truth")
    if split is not None or inputs.is_dir(folder):
        if not inputs.is_dir(folder):
            raise DataError(f"{inputs.shown(folder)}: no such folder of true motion; check data.truth_split")
        found |= {r.name: r.motion_path for r in list_recordings(folder) if r.motion_path and r.name in tests}
    return found
