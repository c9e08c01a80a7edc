"""The command `report`: write a run as one HTML file in which every clip can be watched."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from gesturegen import evaluation, submission
from gesturegen import frames as reference_frames
from gesturegen.control import hands
from gesturegen.data.index import IndexedTest
from gesturegen.errors import DataError, GesturegenError
from gesturegen.manifest import Manifest
from gesturegen.motion import cleanup, space
from gesturegen.parallel import for_each
from gesturegen.pipeline.common import Summary, read_index, read_manifest, require_writable
from gesturegen.pipeline.gesturing import read_speech
from gesturegen.report import pack, page
from gesturegen.settings.models import Config
from gesturegen.speech import audio
from gesturegen.stored import documents, sealing
from gesturegen.workspace import work_path

_OWN_LABELS = ("generated", "truth")
# What tells in a graph where the hands of the references are.
_PLACES = ("positions", "joint_names", "hand_names", "segment_starts", "fps")


@dataclass(frozen=True)
class _Run:
    """Another work folder whose motions are shown beside ours, and the clips it has."""

    label: str
    work: Path
    names: frozenset[str]


def report(
    config: Config, jobs: int, quiet: bool, compare: Sequence[tuple[str, Path]] = (), out: Path | None = None
) -> Summary:
    """Write the report of the reenacted clips.

    compare : labels and work folders of other runs of the same clips; out : the file, by default WORK/report.html
    """
    index = read_index(config)
    manifest = read_manifest(work_path(config))
    others = _other_runs(compare)
    path = work_path(config, "report.html") if out is None else out
    require_writable(path.parent)
    shown = [row.clip for row in manifest.made]
    tasks = {name: partial(_pack_clip, name, index.tests.get(name), config, others) for name in shown}
    outcome = for_each(tasks, jobs, "report", quiet)
    failed = {row.clip: row.error for row in manifest.clips if row.error is not None}
    failed |= outcome.errors | dict.fromkeys(outcome.bugs, "a bug of gesturegen")
    packed = {name: done["text"] for name, done in outcome.done.items()}
    notices, figures = _evaluation(config, manifest)
    page.write(
        path,
        page.Content(
            manifest=manifest,
            figures=figures,
            compared=[run.label for run in others],
            notices=notices,
            failed=dict(sorted(failed.items())),
            ablation=_ablation(config),
            clips=packed,
            join_scale=max((done["largest_join"] for done in outcome.done.values()), default=0.0),
        ),
        config,
    )
    summary = Summary(outcome, written=[path])
    summary.warnings = [(name, note) for name, done in outcome.done.items() for note in done["notes"]]
    summary.warnings += [("evaluate", notice) for notice in notices]
    megabytes = path.stat().st_size / 1e6
    summary.lines = [f"{len(packed)} clips to watch, {len(failed)} failed ones listed, {megabytes:.1f} MB"]
    return summary


def _other_runs(compare: Sequence[tuple[str, Path]]) -> list[_Run]:
    runs: list[_Run] = []
    for label, work in compare:
        if label in (*_OWN_LABELS, *(run.label for run in runs)):
            raise DataError(f"{work}: the label {label!r} is taken; give every compared run one of its own")
        runs.append(_Run(label, work, frozenset(row.clip for row in read_manifest(work).made)))
    return runs


def _evaluation(config: Config, manifest: Manifest) -> tuple[list[str], documents.Summary | None]:
    """Read the figures of this run, None where there are none, and notices on them for the reader."""
    path = work_path(config, "evaluate", "summary.json")
    if not path.is_file():
        return ["This run has not been evaluated: run `gesturegen evaluate`, then `gesturegen report` again."], None
    figures = documents.read(path, documents.Summary, "evaluate")
    ours = [manifest.config_hash, manifest.seed]
    if [figures.signature.get(key) for key in ("config_hash", "seed")] != ours:
        return [
            "The figures in WORK/evaluate are of another configuration or seed than the clips and are left out: "
            "run `gesturegen evaluate`, then `gesturegen report` again."
        ], None
    return [], figures


def _ablation(config: Config) -> page.Ablation | None:
    """Read the results of `gesturegen ablate` in the same work folder, where there are any."""
    names = ("ablation.png", "ablation.json", "reference_length.json")
    plot, table, lengths = (
        path if path.is_file() else None for path in (work_path(config, "ablation", n) for n in names)
    )
    if plot is None and table is None:
        return None
    return page.Ablation(
        plot=None if plot is None else sealing.read_png(plot, "ablate"),
        results=None if table is None else documents.read(table, documents.Ablation, "ablate").model_dump(),
        lengths=None if lengths is None else documents.read(lengths, documents.Lengths, "ablate").model_dump(),
    )


def _pack_clip(name: str, indexed: IndexedTest | None, config: Config, others: Sequence[_Run]) -> dict:
    """Pack one clip as the text that goes into the page, with notes on what is missing."""
    if indexed is None:
        raise DataError(
            f"clip {name}: reenacted from other clips than are there now; run `gesturegen reenact` again"
        )  # fmt: skip
    notes: list[str] = []
    motions = [reenacted(name, work_path(config), config, "generated")]
    if indexed.truth:
        motions += optional("true motion", notes, partial(true_motion, Path(indexed.truth), config))
    for run in others:
        if name in run.names:
            motions.append(reenacted(name, run.work, config, run.label))
        else:
            notes.append(f"{run.label} has no motion of this clip")
    return pack_sounding(name, indexed, config, motions, notes)


def pack_sounding(name: str, indexed: IndexedTest, config: Config, motions: list[dict], notes: list[str]) -> dict:
    """Pack the motions of a clip with its speech as the text that goes into a page; `notes` say what is not there."""
    speech = read_speech(name, config)
    sounds: list[dict] = []
    if indexed.audio:
        sounds = optional("sound", notes, partial(_pack_sound, indexed.audio))
    else:
        notes.append("no sound: the index of clips names no audio file; run `gesturegen preprocess` again")
    packed = pack.pack_clip(speech, config.keywords.words or {}, motions, sounds[0] if sounds else None, notes)
    distances = [distance for motion in motions if motion["trace"] for _, distance, _ in motion["trace"]["joins"]]
    return {"text": pack.inert_json(packed), "notes": notes, "largest_join": max(distances, default=0.0)}


def _pack_sound(path: str) -> dict:
    """Pack the sound of an audio file."""
    return pack.pack_audio(*audio.read_samples(path))


def reenacted(name: str, work: Path, config: Config, label: str) -> dict:
    """Pack the motion of a run, with what its trace says."""
    folder = work / "reenact"
    for suffix in (".bvh", ".trace.json"):
        if not (folder / f"{name}{suffix}").is_file():
            raise DataError(f"{folder / (name + suffix)}: missing; run `gesturegen reenact` again")
    motion = cleanup.resample(space.read(folder / f"{name}.bvh", config), config.fps)
    trace = submission.read_trace(folder / f"{name}.trace.json")
    submission.require_unchanged(folder / f"{name}.bvh", trace)
    demands = evaluation.demands_of(trace)
    # Not the whole of it: a graph of all references can be as large as the memory.
    wanted = ("source_frames", *(_PLACES if demands else ()))
    stored = reference_frames.read_arrays(work / "graphs" / f"{trace.graph}.npz", wanted)
    control = []
    if demands:
        shown = evaluation.hand_curves(evaluation.locate(motion, config), config)
        names = stored["joint_names"].tolist()
        recorded = hands.of_positions(
            stored["positions"],
            names,
            stored["segment_starts"],
            float(stored["fps"]),
            config.hands,
            stored["hand_names"].tolist(),
        )
        control = pack.pack_control(demands, shown, recorded, motion.fps)
    return pack.pack_motion(motion, config, label, pack.pack_trace(trace, stored["source_frames"], control))


def true_motion(path: Path, config: Config) -> dict:
    """Pack the true motion of a clip."""
    return pack.pack_motion(cleanup.resample(space.read(path, config), config.fps), config, "truth")


def optional(what: str, notes: list[str], read: Callable[[], dict]) -> list[dict]:
    """Return what `read` gives, or nothing and a note: a clip can be watched without it."""
    try:
        return [read()]
    except GesturegenError as error:
        notes.append(f"no {what}: {error}")
        return []
