"""The command `evaluate`: measure motions (§5.2)."""

from __future__ import annotations

import csv
import hashlib
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache, partial
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from gesturegen import __version__, evaluation, files, inputs, submission, tables, viewer
from gesturegen.control import hands
from gesturegen.data import clips, keynodes
from gesturegen.data.index import Index
from gesturegen.data.stored_clips import digests
from gesturegen.errors import DamagedError, DataError
from gesturegen.frames import ReferenceFrames
from gesturegen.inspection import traces
from gesturegen.methods import METHODS, libraries
from gesturegen.metrics.feet import FootSkate
from gesturegen.metrics.measures import COMPAT_MEASURES
from gesturegen.metrics.usage import training_utilisation
from gesturegen.motion import cleanup, positions, space
from gesturegen.outcome import Outcome
from gesturegen.parallel import for_each
from gesturegen.pipeline.common import Summary, by_kind, read_index, read_manifest, require_names, require_writable
from gesturegen.pipeline.keyword_gestures import load_frames
from gesturegen.pipeline.motions import folder_motions, folder_sounds
from gesturegen.settings.models import Config
from gesturegen.speech import audio, voice
from gesturegen.speech.cutting import spoken
from gesturegen.stored import documents, sealing
from gesturegen.trace import Trace
from gesturegen.workspace import clip_path, library_path, work_path

_CONTROL_COLUMNS = ("clip", *evaluation.CONTROL_HEADINGS)
_CONTROL_FIGURES = range(5, len(_CONTROL_COLUMNS))
_CONTROL_KEYS = (
    "place", "measure", "hand", "hard", "from", "to", "at_least", "at_most", "mean", "deviation", "inside",
    "reference_mean", "reference_deviation",
)  # fmt: skip


@dataclass(frozen=True)
class _Evidence:
    """The files of one clip to be measured; None where there is none."""

    name: str
    motion: Path
    audio: Path | None = None
    truth: Path | None = None
    trace: Path | None = None


def evaluate(
    config: Config, jobs: int, quiet: bool, compat: bool = False,
    bvh_folder: Path | None = None, audio_folder: Path | None = None, truth_folder: Path | None = None,
    reuse: bool = False, full: bool = False,
) -> Summary:  # fmt: skip
    """Measure a run, or anybody's BVH files, per clip and in total (§5.2).

    full : print every figure of every clip, in place of those that tell most over all clips
    reuse : keep a run's figures when neither its clips, their truth nor the settings have changed
    """
    lost: list[tuple[str, str]] = []
    failed: list[str] = []
    index: Index | None = None
    if bvh_folder is not None:
        evidence = _foreign_evidence(bvh_folder, audio_folder, truth_folder)
        signature = {"method": "files", "config_hash": config.signature(), "seed": "-", "version": __version__}
    else:
        index = read_index(config)
        require_names(config, index.references, [*index.tests, *index.failed])
        evidence, failed, signature = _own_evidence(config, index, truth_folder)
        signature["inputs"] = _inputs(evidence, config)
        if reuse:
            try:
                if (kept := _kept_figures(config, signature, {*failed, *(item.name for item in evidence)})) is not None:
                    return kept
            except DamagedError as error:
                lost = [("evaluate", sealing.remade(error))]
    require_writable(work_path(config, "evaluate"))
    tasks = {item.name: partial(_measure, item, config, len(evidence)) for item in evidence}
    outcome = for_each(tasks, jobs, "evaluate", quiet)
    measured = outcome.done
    rows = {name: done["row"] for name, done in measured.items()} | {
        name: evaluation.failed_row(config) for name in failed
    }
    rows = dict(sorted(rows.items()))
    generated = {name: done["generated"] for name, done in measured.items()}
    truths = {name: done["truth"] for name, done in measured.items() if done["truth"] is not None}
    with threadpool_limits(limits=1):  # as in the workers, so that the figures depend on no number of threads
        total = evaluation.totals(
            list(rows.values()), [generated[name] for name in truths], list(truths.values()), config
        )
        for name in rows:
            rows[name]["seams"] = measured[name]["seams"] if name in measured else None
        add_detectability(rows, total, config)
    if index is not None:
        _add_utilisation(rows, total, {name: done["references"] for name, done in measured.items()}, index)
    columns = evaluation.measures(config)
    control = {name: done["control"] for name, done in sorted(measured.items()) if done["control"]}
    beside = viewer.beside_totals([done["beside"] for _, done in sorted(measured.items()) if done["beside"]])
    summary = Summary(outcome, lost + by_kind([note for _, done in sorted(measured.items()) for note in done["notes"]]))
    suffix = "" if bvh_folder is None else "_files"
    if compat:
        columns = list(COMPAT_MEASURES)
        rows, total = evaluation.genea_compat(generated, truths)
        control = beside = {}
        signature["conventions"] = "genea"
        suffix += "_genea"
    summary.lines = _lines(rows, total, columns, control, signature, beside, full or compat)
    summary.written = _write_tables(config, rows, total, columns, control, signature, suffix, beside)
    return summary


def _inputs(evidence: list[_Evidence], config: Config) -> str:
    """Hash everything that a run's figures depend on."""
    paths = [work_path(config, "reenact", "manifest.json"), *(item.truth for item in evidence if item.truth)]
    made_of = [__version__, config.signature(), *(files.sha256(path) for path in paths)]
    return hashlib.sha256("\n".join(made_of).encode()).hexdigest()[:12]


def _kept_figures(config: Config, signature: dict, names: set[str]) -> Summary | None:
    """Return the stored tables when they were made of the same inputs; DamagedError when one was changed since.

    names : of the clips, which must all be in them: one that could not be measured may have been mended since
    """
    csv_path, json_path = work_path(config, "evaluate", "metrics.csv"), work_path(config, "evaluate", "summary.json")
    if not csv_path.is_file() or not json_path.is_file():
        return None
    stored = documents.read(json_path, documents.Summary, "evaluate")
    if stored.signature != signature or stored.clips.keys() != names:
        return None
    rows = {name: tables.from_json(row) for name, row in stored.clips.items()}
    total, columns = tables.from_json(stored.total), evaluation.measures(config)
    control, control_path = stored.control, _control_path(config)
    beside = {name: tables.from_json(row) for name, row in stored.beside.items()}
    if control_path.is_file() != bool(control):
        return None
    try:
        texts = {csv_path: tables.format_csv(rows, total, columns, signature, beside)}
        if control:
            texts[control_path] = _control_csv(control, signature)
    except KeyError as error:
        raise sealing.damaged(json_path, f"no figure {error}", "evaluate") from None
    for path, text in texts.items():
        if path.read_bytes() != text.encode():
            raise sealing.damaged(path, "not what summary.json says", "evaluate")
    written = [csv_path, json_path, *([control_path] if control else [])]
    return Summary(
        Outcome(done=rows), lines=_lines(rows, total, columns, control, signature, beside, False), written=written
    )


def _write_tables(
    config: Config, rows: dict, total: dict, columns: list, control: dict, signature: dict, suffix: str,
    beside: dict,
) -> list[Path]:  # fmt: skip
    csv_path, json_path = (
        work_path(config, "evaluate", name) for name in (f"metrics{suffix}.csv", f"summary{suffix}.json")
    )
    files.write_text(csv_path, tables.format_csv(rows, total, columns, signature, beside))
    figures = {name: tables.json_figures(row) for name, row in rows.items()}
    told = {"signature": signature, "total": tables.json_figures(total), "clips": figures}
    told["beside"] = {name: tables.json_figures(row) for name, row in beside.items()}
    documents.write(json_path, told | ({"control": control} if control else {}))
    written = [csv_path, json_path]
    if control:
        files.write_text(_control_path(config), _control_csv(control, signature))
        written.append(_control_path(config))
    elif not suffix:  # what an earlier run of this folder achieved must not pass for this one's
        _control_path(config).unlink(missing_ok=True)
    return written


def _lines(
    rows: dict, total: dict, columns: list, control: dict, signature: dict, beside: dict, full: bool
) -> list[str]:  # fmt: skip
    """Format the tables for printing, with that of control where any clip is controlled."""
    if not full:
        blocks = [tables.format_summary(total, len(rows), columns, beside)]
    else:
        blocks = [tables.format_blocks(rows, total, columns, beside)]
    if control:
        cells = [[name, *evaluation.control_cells(row)] for name, own in control.items() for row in own]
        blocks.append("[control]\n" + "\n".join(traces.align([_CONTROL_COLUMNS, *cells], _CONTROL_FIGURES)))
    return ["\n\n".join(blocks), "", "  ".join(f"{key}: {value}" for key, value in signature.items())]


def _control_path(config: Config) -> Path:
    return work_path(config, "evaluate", "control.csv")


def _control_csv(control: Mapping[str, Sequence[Mapping]], signature: Mapping) -> str:
    """Format a CSV row per demand, in cm, cm/s and seconds, ending in what produced it; a cell without bound is empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["clip", *_CONTROL_KEYS, *signature])
    for name, rows in control.items():
        for row in rows:
            figures = ("" if row[key] is None else row[key] for key in _CONTROL_KEYS)
            writer.writerow([name, *figures, *signature.values()])
    return text.getvalue()


def _own_evidence(config: Config, index: Index, truth_folder: Path | None) -> tuple[list[_Evidence], list[str], dict]:
    folder = work_path(config, "reenact")
    manifest = read_manifest(work_path(config))
    truths = {name: Path(row.truth) for name, row in index.tests.items() if row.truth}
    if truth_folder is not None:
        truths = folder_motions(truth_folder, arrays=True)
    evidence, failed = [], []
    for row in manifest.clips:
        name = row.clip
        if row.stuck:
            failed.append(name)
        if row.error:
            continue
        evidence.append(
            _Evidence(
                name, folder / f"{name}.bvh", clip_path(config, name), truths.get(name), folder / f"{name}.trace.json"
            )
        )
    signature = {
        "method": f"{manifest.method}/{manifest.search}",
        "config_hash": manifest.config_hash,
        "seed": manifest.seed,
        "version": manifest.gesturegen,
    }
    return evidence, failed, signature


def _foreign_evidence(bvh_folder: Path, audio_folder: Path | None, truth_folder: Path | None) -> list[_Evidence]:
    motions = folder_motions(bvh_folder, arrays=True)
    sounds = folder_sounds(audio_folder) if audio_folder is not None else {}
    truths = folder_motions(truth_folder, arrays=True) if truth_folder is not None else {}
    for folder, found in ((audio_folder, sounds), (truth_folder, truths)):
        if folder is not None and not motions.keys() & found.keys():
            raise DataError(f"{folder}: no file in it has the name of a motion in {bvh_folder}; names must match")
    return [_Evidence(name, path, sounds.get(name), truths.get(name)) for name, path in motions.items()]


def _measure(evidence: _Evidence, config: Config, n_clips: int) -> dict:
    inputs.require_usable_name(evidence.motion)
    generated = locate_file(evidence.motion, config)
    truth = None
    # Our own motions are as their references are, of which `preprocess` tells.
    named = [(evidence.motion.stem, generated)]
    if evidence.truth is not None:
        truth = locate_file(evidence.truth, config)
        require_same_joints(evidence.truth, truth, generated)
        named.append((evidence.truth.stem, truth))
    notes = [(name, note) for name, joints in named for note in joints.notes] if evidence.trace is None else []
    trace = graph = seams = None
    references: list[str] = []
    recorded: list[viewer.Recorded] = []
    skate = evaluation.NAN
    if evidence.trace is not None:
        trace = submission.read_trace(evidence.trace)
        submission.require_unchanged(evidence.motion, trace)
        library = libraries.load(library_path(config, trace.graph), METHODS[trace.method])
        references = list(library.clip_names)
        graph = load_frames(library, trace, config)
        trace.require_nodes(graph.n_nodes)
        skate, recorded = reference_skate(config, trace.shown_clips()), recordings(config, trace)
        seams = evaluation.seam_evidence(generated, trace, graph, recorded, n_clips)
    heard = None if evidence.audio is None else read_heard(evidence.audio, config)
    row = evaluation.measure_clip(generated, config, heard, truth, trace, graph, skate, recorded)
    control = [] if trace is None or graph is None else _measure_control(generated, trace, graph, config)
    beside = measure_beside(evidence.name, len(generated.world), config, heard, truth, recorded)
    # There is one process that gathers all clips: the curves have served, and so have motions without truth.
    pooled: dict[str, evaluation.Joints | None] = {"generated": None, "truth": None}
    if truth is not None:
        pooled = {"generated": replace(generated, curves=None), "truth": replace(truth, curves=None)}
    return {
        "row": row, **pooled, "references": references, "control": control, "seams": seams, "beside": beside,
        "notes": notes,
    }  # fmt: skip


def measure_beside(
    name: str, n_frames: int, config: Config, heard: evaluation.Heard | None, truth: evaluation.Joints | None,
    recorded: Sequence[viewer.Recorded],
) -> viewer.Beside:  # fmt: skip
    """Measure what a clip is to be compared with, such as its true motion and its references."""
    onset_frames, paused = (None, None) if heard is None else (heard.onset_frames(float(config.fps)), heard.paused)
    true_curves = None if truth is None else truth.curves
    return viewer.beside(n_frames, recorded, true_curves, config, name, onset_frames, paused)


def add_detectability(rows: Mapping[str, dict], total: dict, config: Config) -> None:
    """Replace the `seams` of the clips of a run by how well a classifier finds them; also in its total."""
    seams = {name: row.pop("seams") for name, row in rows.items()}
    found, by_clip = viewer.detect_seams({name: one for name, one in seams.items() if one is not None}, config)
    total.update(found)
    for name, figures in by_clip.items():
        rows[name] |= figures


def _measure_control(
    generated: evaluation.Joints, trace: Trace, library: ReferenceFrames, config: Config
) -> list[dict]:
    demands = evaluation.demands_of(trace)
    if not demands:
        return []
    recorded = hands.of_nodes(library, config.hands)
    return evaluation.measure_control(demands, evaluation.hand_curves(generated, config), recorded, trace.fps)


def require_same_joints(path: str | Path, truth: evaluation.Joints, generated: evaluation.Joints) -> None:
    """Refuse a true motion, read from `path`, whose joints are not those of the generated one: DataError."""
    if truth.world.shape[1:] != generated.world.shape[1:]:
        raise DataError(f"{path}: {truth.world.shape[1]} joints, the generated motion has {generated.world.shape[1]}")


def locate_file(path: Path, config: Config) -> evaluation.Joints:
    """Locate the joints of a BVH file, or of an `.npz` file with `positions`."""
    if path.suffix.lower() == ".bvh":
        return evaluation.locate(cleanup.resample(space.read(path, config), config.fps), config)
    return evaluation.from_positions(positions.read(path), config)


def reference_skate(config: Config, names: Sequence[str]) -> float:
    """Average the foot skate of stored clips, cm/s; NaN where there are no feet or none is ever in contact."""
    settings = config.model_dump_json(by_alias=True)
    skates = [_clip_skate(str(clip_path(config, name)), digests(config, [name])[0], settings) for name in names]
    return evaluation.mean_foot_skate(skates)


@cache
def _clip_skate(path: str, digest: str, settings: str) -> tuple[FootSkate, int]:
    """Measure foot skate and length of a stored clip; remembered, so that a worker reads each reference once."""
    recorded, skate = _recording(path, digest, settings)
    return skate, recorded.curves.n_frames


def recordings(config: Config, trace: Trace) -> list[viewer.Recorded]:
    """Measure the references of which a clip shows anything."""
    names = trace.shown_clips()
    settings = config.model_dump_json(by_alias=True)
    return [_recording(str(clip_path(config, name)), digests(config, [name])[0], settings)[0] for name in names]


@lru_cache(maxsize=16)
def _recording(path: str, _digest: str, settings: str) -> tuple[viewer.Recorded, FootSkate]:
    """Measure a stored clip as a viewer sees it, with its speech, and its foot skate; a worker keeps the last ones."""
    config = Config.model_validate_json(settings)
    reference = clips.load(path, config).reference(config)
    joints = evaluation.locate(reference.motion, config)
    segments = np.split(np.arange(reference.motion.n_frames), reference.segment_starts[1:])
    parts = [joints] if len(segments) == 1 else [
        evaluation.locate(reference.motion.take(frames), config) for frames in segments
    ]  # fmt: skip
    curves = viewer.joined([part.curves for part in parts if part.curves is not None])
    onsets = reference.speech.onset_frames
    onset_frames = np.searchsorted(reference.source_frames, onsets[np.isin(onsets, reference.source_frames)])
    paused = ~keynodes.reference_speaking(reference, config.pauses)
    row = viewer.measure(curves, config, onset_frames, paused)
    return viewer.Recorded(reference.name, curves, row), evaluation.foot_skate(joints)


def read_heard(path: Path, config: Config) -> evaluation.Heard:
    """Read onsets, words and pauses of the speech of a stored clip, or the onsets of an audio file."""
    if path.suffix == ".npz":
        speech = clips.load(path, config, with_motion=False).test_speech(config)
        paused = ~keynodes.speaking(speech, config.pauses)
        return evaluation.Heard(speech.onset_times, spoken(speech.words, speech.onset_times, speech.voice), paused)
    sound = audio.read(path, config.audio.channel)
    peaks = audio.detect_onset_peaks(sound.samples, sound.rate, config.onsets)
    spans = voice.voiced(voice.measure(sound.samples, sound.rate), (), config.voice)
    return evaluation.Heard(
        peaks.times[peaks.are_onsets(peaks.threshold(config.onsets, spans), config.onsets.muted_max_share)]
    )


def _add_utilisation(rows: dict, total: dict, references: dict[str, list[str]], index: Index) -> None:
    """Add the share of the whole training set that served as references, per clip and for all together (§5.1.1)."""
    seconds = index.durations
    named = sorted(references)
    rest = index.training_seconds - sum(seconds.values())
    used = training_utilisation([references[name] for name in named], seconds | {"": max(rest, 0.0)})
    for name, share in zip(named, used.per_clip, strict=True):
        rows[name]["utilisation"] = float(share)
    total["utilisation"] = used.overall
