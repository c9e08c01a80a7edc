"""One function per subcommand: files in, files out. The only home of work over many clips.

Each returns what the command line shows; errors of single clips are in its `Outcome`, so that the other
clips are unharmed. An error that concerns the whole command is raised.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from gesturegen import __version__, clips, evaluation, files, keynodes, render, submission, tables
from gesturegen.config import Config, configs_folder
from gesturegen.errors import ConfigError, DataError
from gesturegen.graph import motion_graph
from gesturegen.methods import METHODS
from gesturegen.metrics.usage import training_utilisation
from gesturegen.motion import bvh, cleanup, screening
from gesturegen.parallel import Outcome, for_each
from gesturegen.randomness import generator
from gesturegen.speech import audio

INDEX_VERSION = 1


@dataclass
class Summary:
    """What a command did: per-clip outcome, warnings `(clip, text)`, lines and the files to look at."""

    outcome: Outcome
    warnings: list[tuple[str, str]] = field(default_factory=list)
    lines: list[str] = field(default_factory=list)
    written: list[Path] = field(default_factory=list)


def _work(config: Config, *parts: str) -> Path:
    return Path(config.paths.work, *parts)


# --- init, demo-data ----------------------------------------------------------------------------------------


def init(path: Path, force: bool) -> None:
    """Write a commented config to start from, and never over an existing file without `force`."""
    if path.exists() and not force:
        raise ConfigError(f"{path}: exists already; choose another name or add --force")
    files.write_text(path, (configs_folder() / "casia_go_2023.yaml").read_text())


def demo_data(folder: Path, references: int, tests: int, seed: int, challenge: bool, jobs: int, quiet: bool) -> Summary:
    """Write the embedded demo dataset in GENEA layout."""
    from gesturegen import demo

    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise DataError(f"{folder}: exists already and is not empty; choose another folder or delete it")
    specs = demo.clip_specs(
        references=references, tests=tests, seed=seed, **(demo.CHALLENGE_SECONDS if challenge else {})
    )
    tasks = {spec.name: partial(demo.write_clip, folder, spec) for spec in specs}
    outcome = for_each(tasks, jobs, "demo data", quiet)
    demo.write_metadata(folder, specs)
    return Summary(outcome, written=[folder])


# --- preprocess ---------------------------------------------------------------------------------------------


def preprocess(config: Config, jobs: int, quiet: bool, export_bvh: Path | None = None) -> Summary:
    """Read, check and clean every reference and test recording into `clips/<clip>.npz` (§3)."""
    references = {recording.name: recording for recording in clips.reference_recordings(config)}
    tests = {recording.name: recording for recording in clips.test_recordings(config)}
    _refuse_twins(references, tests)
    _folder_is_writable(_work(config, "clips"))
    tasks = {
        name: partial(_preprocess_clip, recording, config, name in references, export_bvh)
        for name, recording in {**tests, **references}.items()
    }
    outcome = for_each(tasks, jobs, "preprocess", quiet)
    for name in outcome.errors | outcome.bugs:
        _clip_path(config, name).unlink(missing_ok=True)
    if not any(name in outcome.done for name in references):
        raise DataError(
            "\n".join([*outcome.errors.values(), "no reference clip could be read, so there is nothing to build from"])
        )
    files.write_json(_work(config, "clips", "index.json"), _index(config, references, tests, outcome))
    summary = Summary(outcome, [(name, note) for name, done in outcome.done.items() for note in done["notes"]])
    summary.warnings += _unmatched_patterns(config, references)
    summary.warnings += [
        (recording.name, "no BVH file, so it is no reference") for recording in clips.recordings_without_motion(config)
    ]
    if config.keywords.words == {}:
        summary.warnings.append(("keywords", "the keyword list is empty, so no piece ends at a keyword"))
    summary.lines.append(
        f"{len(outcome.done)} of {len(tasks)} clips ready: {sum(n in outcome.done for n in references)} references, "
        f"{sum(n in outcome.done for n in tests)} tests"
    )
    summary.written = [_work(config, "clips")] + ([export_bvh] if export_bvh else [])
    return summary


def _preprocess_clip(recording: clips.Recording, config: Config, with_motion: bool, export_bvh: Path | None) -> dict:
    clip = clips.prepare(recording, config, with_motion)
    clips.save(_clip_path(config, clip.name), clip, config)
    if export_bvh is not None and clip.motion is not None:
        bvh.write(export_bvh / f"{clip.name}.bvh", clip.motion)
    return {"notes": clip.notes, "speaker": clip.speaker, "seconds": clip.duration}


def _clip_path(config: Config, name: str) -> Path:
    return _work(config, "clips", f"{name}.npz")


def _refuse_twins(references: dict[str, clips.Recording], tests: dict[str, clips.Recording]) -> None:
    for name in sorted(references.keys() & tests.keys()):
        if references[name].audio_path != tests[name].audio_path:
            raise DataError(
                f"{tests[name].audio_path}: clip {name} is a reference and a test with different files; rename one of them"
            )


def _folder_is_writable(folder: Path) -> None:
    """Say so before the work starts, not after."""
    probe = folder / ".gesturegen"
    files.write_text(probe, "")
    probe.unlink()


def _index(
    config: Config, references: dict[str, clips.Recording], tests: dict[str, clips.Recording], outcome: Outcome
) -> dict:
    """What later commands need to know of the data, so that they need not look at it again."""
    truths = _truths(config, tests)
    done = outcome.done
    return {
        "format_version": INDEX_VERSION,
        "settings": config.section_json("data", "blacklist"),
        "references": {
            name: {key: done[name][key] for key in ("speaker", "seconds")} for name in references if name in done
        },
        "tests": {
            name: {**{key: done[name][key] for key in ("speaker", "seconds")}, "truth": truths.get(name)}
            for name in tests
            if name in done
        },
        "training_seconds": sum(_training_seconds(config, references, outcome)),
        "failed": {name: outcome.errors.get(name, "a bug of gesturegen") for name in tests if name not in done},
    }


def _truths(config: Config, tests: dict[str, clips.Recording]) -> dict[str, str]:
    """The true motion of test clips: beside their audio, or in `data.truth_split`."""
    found = {name: recording.motion_path for name, recording in tests.items() if recording.motion_path}
    if config.data.truth_split is not None:
        folder = Path(config.paths.data) / config.data.truth_split
        if not folder.is_dir():
            raise DataError(f"{folder}: no such folder of true motion; check data.truth_split")
        found |= {r.name: r.motion_path for r in clips.list_recordings(folder) if r.motion_path and r.name in tests}
    return {name: str(path.resolve()) for name, path in found.items()}


def _training_seconds(config: Config, references: dict[str, clips.Recording], outcome: Outcome) -> list[float]:
    """Durations of the whole training set, the blacklist included: what utilisation is a share of."""
    seconds = [outcome.done[name]["seconds"] for name in references if name in outcome.done]
    for recording in clips.blacklisted_recordings(config):
        try:
            samples, rate = audio.read_samples(recording.audio_path) if recording.audio_path else ((), 1)
        except DataError:
            continue
        seconds.append(len(samples) / rate)
    return seconds


def _unmatched_patterns(config: Config, references: dict[str, clips.Recording]) -> list[tuple[str, str]]:
    blacklisted = [recording.name for recording in clips.blacklisted_recordings(config)]
    warnings = [
        ("blacklist", f"{pattern!r} matches no reference clip; check its spelling")
        for pattern in config.blacklist
        if not any(clips.is_listed(name, (pattern,)) for name in blacklisted)
    ]
    return warnings + [
        ("exclude", f"clip {range_.clip!r} is no reference clip; check its spelling")
        for range_ in config.exclude
        if not any(clips.is_listed(name, (range_.clip,)) for name in [*references, *blacklisted])
    ]


def suggest_blacklist(config: Config, jobs: int, quiet: bool) -> Summary:
    """List near-motionless or glitching clips and ranges with the reason and the figure; exclude nothing."""
    recordings = {recording.name: recording for recording in clips.reference_recordings(config)}
    outcome = for_each(
        {name: partial(_screen_clip, recording, config) for name, recording in recordings.items()},
        jobs,
        "screen",
        quiet,
    )
    lines = [line for found in outcome.done.values() for line in found]
    return Summary(outcome, lines=lines or [f"nothing to suggest in {len(outcome.done)} clips"])


def _screen_clip(recording: clips.Recording, config: Config) -> list[str]:
    motion = cleanup.resample(bvh.read(recording.motion_path), config.fps)
    joints, _ = clips.select_joints(motion.skeleton, config)
    return [finding.describe(recording.name) for finding in screening.screen(motion, joints, config.wrists.joints)]


def _read_index(config: Config) -> dict:
    path = _work(config, "clips", "index.json")
    if not path.is_file():
        raise DataError(f"{path}: nothing has been preprocessed there; run `gesturegen preprocess` first")
    index = files.read_json(path)
    if index.get("format_version") != INDEX_VERSION:
        raise DataError(f"{path}: written by another version; run `gesturegen preprocess` again")
    clips.check_settings(path, index["settings"], config.section_json("data", "blacklist"), "preprocess")
    return index


# --- build-graph --------------------------------------------------------------------------------------------


def build_graphs(config: Config, jobs: int, quiet: bool) -> Summary:
    """Build the graph of every group of references that a test clip is given (§4.1)."""
    chosen = _chosen_references(config, _read_index(config))
    groups = {graph_name(names): names for names in chosen.values()}
    _folder_is_writable(_work(config, "graphs"))
    outcome = for_each(
        {name: partial(_build_graph, names, config) for name, names in groups.items()}, jobs, "build-graph", quiet
    )
    summary = Summary(outcome, written=[_work(config, "graphs")])
    summary.lines = [f"{name}: {line}" for name, line in outcome.done.items()]
    return summary


def _chosen_references(config: Config, index: dict) -> dict[str, tuple[str, ...]]:
    if not index["tests"]:
        raise DataError("no test clip could be preprocessed; mend the errors that `gesturegen preprocess` lists")
    references = {name: row["speaker"] for name, row in index["references"].items()}
    speakers = {name: row["speaker"] for name, row in index["tests"].items()}
    return clips.choose_references(sorted(speakers), references, speakers, config)


def graph_name(names: Sequence[str]) -> str:
    """The name of the graph of one clip or of several."""
    if len(names) == 1:
        return names[0]
    return "multi-" + hashlib.sha256("\n".join(names).encode()).hexdigest()[:12]


def _graph_path(config: Config, name: str) -> Path:
    return _work(config, "graphs", f"{name}.npz")


def _references(config: Config, names: Sequence[str]) -> list[clips.Reference]:
    return [clips.load(_clip_path(config, name), config).reference(config) for name in names]


def _digests(config: Config, names: Sequence[str]) -> tuple[str, ...]:
    """What the stored clips hold, so that a graph knows when they changed."""
    return tuple(files.sha256(_clip_path(config, name)) for name in names)


def _build_graph(names: Sequence[str], config: Config) -> str:
    graph = METHODS[config.method].build(_references(config, names), config)
    motion_graph.save(_graph_path(config, graph_name(names)), graph, config, _digests(config, names))
    kinds = ", ".join(f"{int(np.sum(graph.key_nodes.kinds == kind))} {kind}" for kind in ("onset", "keyword", "break"))
    return (
        f"{graph.n_nodes} nodes, {int(np.sum(graph.natural))} natural and {int(np.sum(~graph.natural))} unnatural edges, "
        f"key nodes: {kinds}"
    )


# --- reenact ------------------------------------------------------------------------------------------------


def reenact(config: Config, jobs: int, quiet: bool) -> Summary:
    """Search and render every test clip; write BVH, trace and manifest (§4.2)."""
    index = _read_index(config)
    chosen = _chosen_references(config, index)
    folder = _work(config, "reenact")
    _folder_is_writable(folder)
    outcome = for_each(
        {test: partial(_reenact_clip, test, names, config) for test, names in chosen.items()}, jobs, "reenact", quiet
    )
    rows = [done["row"] for done in outcome.done.values()]
    outcome.errors |= {name: f"failed in preprocess: {error}" for name, error in index["failed"].items()}
    for name, error in (outcome.errors | dict.fromkeys(outcome.bugs, "a bug of gesturegen")).items():
        _remove_results(folder, name)
        rows.append({"clip": name, "references": list(chosen.get(name, ())), "stuck": False, "error": error})
    files.write_json(folder / "manifest.json", submission.manifest(rows, config, folder))
    summary = Summary(outcome, written=[folder])
    summary.warnings = [(name, note) for name, done in outcome.done.items() for note in done["notes"]]
    for row in rows:
        if row["stuck"]:
            del outcome.done[row["clip"]]
            outcome.errors[row["clip"]] = row["error"]
    summary.lines = [_describe_row(done["row"]) for done in outcome.done.values()]
    return summary


@lru_cache(maxsize=1)
def _library(
    config_json: str, names: tuple[str, ...], clip_digests: tuple[str, ...], _graph_digest: str
) -> tuple[list[clips.Reference], motion_graph.MotionGraph]:
    """References and graph; a worker keeps the last ones, since test clips often share them."""
    config = Config.model_validate_json(config_json)
    graph = motion_graph.load(_graph_path(config, graph_name(names)), config, clip_digests)
    return _references(config, names), graph


def _reenact_clip(test: str, names: tuple[str, ...], config: Config) -> dict:
    folder = _work(config, "reenact")
    graph_path = _graph_path(config, graph_name(names))
    graph_digest = files.sha256(graph_path) if graph_path.is_file() else ""
    references, graph = _library(config.model_dump_json(by_alias=True), names, _digests(config, names), graph_digest)
    speech = clips.load(_clip_path(config, test), config, with_motion=False).test_speech(config)
    key_nodes = keynodes.of_speech(speech, config.keywords.words)
    path = METHODS[config.method].search(graph, speech, config, generator(config.seed, test))
    trace = submission.make_trace(path, graph, graph_name(names), speech, key_nodes, config)
    if path.failure is None:
        bvh.write(folder / f"{test}.bvh", render.render(path, references, graph, config))
    else:
        _remove_results(folder, test)
    files.write_text(folder / f"{test}.trace.json", submission.format_trace(trace))
    lacking = sorted(set(key_nodes.keywords.tolist()) - set(graph.key_nodes.keywords.tolist()))
    row = submission.clip_row(trace)
    notes = []
    if lacking and config.termination.fallbacks:
        notes.append(f"keywords that its references lack, so those pieces end at onsets: {', '.join(lacking)}")
    repeats = row["fallbacks"].get("repeat", 0)
    if repeats:
        notes.append(f"{repeats} of {row['pieces']} pieces hold one pose, because no path fits; give longer references")
    return {"row": row, "notes": notes}


def _remove_results(folder: Path, name: str) -> None:
    """Results of an earlier run must not pass for this one's."""
    for suffix in (".bvh", ".trace.json"):
        (folder / f"{name}{suffix}").unlink(missing_ok=True)


def _describe_row(row: dict) -> str:
    fallbacks = ", ".join(f"{count} {kind}" for kind, count in row["fallbacks"].items()) or "none"
    return (
        f"{row['clip']}: {row['n_frames']} frames, {row['pieces']} pieces, {row['hard_joins']} hard joins, "
        f"{row['retries']} retries, fallbacks: {fallbacks}"
    )


# --- evaluate -----------------------------------------------------------------------------------------------


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
) -> Summary:  # fmt: skip
    """Measure a run, or anybody's BVH files, per clip and in total (§5.2)."""
    if bvh_folder is not None:
        evidence, failed, index = _foreign_evidence(bvh_folder, audio_folder, truth_folder), {}, None
        signature = {"method": "files", "config_hash": config.signature(), "seed": "-", "version": __version__}
    else:
        index = _read_index(config)
        evidence, failed, signature = _own_evidence(config, index, truth_folder)
    _folder_is_writable(_work(config, "evaluate"))
    outcome = for_each({item.name: partial(_measure, item, config) for item in evidence}, jobs, "evaluate", quiet)
    measured = outcome.done
    rows = {name: done["row"] for name, done in measured.items()} | {
        name: evaluation.failed_row(config) for name in failed
    }
    rows = dict(sorted(rows.items()))
    generated = {name: done["generated"] for name, done in measured.items()}
    truths = {name: done["truth"] for name, done in measured.items() if done["truth"] is not None}
    with threadpool_limits(limits=1):
        total = evaluation.totals(
            list(rows.values()), [generated[name] for name in truths], list(truths.values()), config
        )
    if index is not None:
        _add_utilisation(rows, total, {name: done["references"] for name, done in measured.items()}, index)
    columns = evaluation.measures(config)
    summary = Summary(outcome)
    suffix = "" if bvh_folder is None else "_files"
    if compat:
        columns = list(evaluation.COMPAT_MEASURES)
        rows, total = evaluation.genea_compat(generated, truths)
        signature["conventions"] = "genea"
        suffix += "_genea"
    summary.lines = [tables.format_blocks(rows, total, columns), "", _signature_line(signature)]
    summary.written = _write_tables(config, rows, total, columns, signature, suffix)
    return summary


def _write_tables(config: Config, rows: dict, total: dict, columns: list, signature: dict, suffix: str) -> list[Path]:
    csv_path, json_path = (
        _work(config, "evaluate", name) for name in (f"metrics{suffix}.csv", f"summary{suffix}.json")
    )
    files.write_text(csv_path, tables.format_csv(rows, total, columns, signature))
    figures = {name: tables.json_figures(row) for name, row in rows.items()}
    files.write_json(json_path, {"signature": signature, "total": tables.json_figures(total), "clips": figures})
    return [csv_path, json_path]


def _signature_line(signature: dict) -> str:
    return "  ".join(f"{key}: {value}" for key, value in signature.items())


def _own_evidence(config: Config, index: dict, truth_folder: Path | None) -> tuple[list[_Evidence], list[str], dict]:
    folder = _work(config, "reenact")
    if not (folder / "manifest.json").is_file():
        raise DataError(f"{folder}: nothing has been reenacted there; run `gesturegen reenact` first")
    manifest = files.read_json(folder / "manifest.json")
    truths = {name: Path(row["truth"]) for name, row in index["tests"].items() if row["truth"]}
    if truth_folder is not None:
        truths = _motions(truth_folder)
    evidence, failed = [], []
    for row in manifest["clips"]:
        name = row["clip"]
        if row["stuck"]:
            failed.append(name)
        if row["error"]:
            continue
        evidence.append(
            _Evidence(
                name, folder / f"{name}.bvh", _clip_path(config, name), truths.get(name), folder / f"{name}.trace.json"
            )
        )
    signature = {
        "method": f"{manifest['method']}/{manifest['search']}",
        "config_hash": manifest["config_hash"],
        "seed": manifest["seed"],
        "version": manifest["gesturegen"],
    }
    return evidence, failed, signature


def _foreign_evidence(bvh_folder: Path, audio_folder: Path | None, truth_folder: Path | None) -> list[_Evidence]:
    motions = _motions(bvh_folder)
    sounds = {}
    if audio_folder is not None:
        sounds = {r.name: r.audio_path for r in clips.list_recordings(_existing(audio_folder)) if r.audio_path}
    truths = _motions(truth_folder) if truth_folder is not None else {}
    for folder, found in ((audio_folder, sounds), (truth_folder, truths)):
        if folder is not None and not motions.keys() & found.keys():
            raise DataError(f"{folder}: no file in it has the name of a motion in {bvh_folder}; names must match")
    return [_Evidence(name, path, sounds.get(name), truths.get(name)) for name, path in motions.items()]


def _motions(folder: Path) -> dict[str, Path]:
    """BVH files, or `.npz` files with `positions`, by clip name."""
    found = {r.name: r.motion_path for r in clips.list_recordings(_existing(folder)) if r.motion_path}
    found = found or {path.stem: path for path in sorted(folder.glob("*.npz"))}
    if not found:
        raise DataError(f"{folder}: no BVH file in it")
    return found


def _existing(folder: Path) -> Path:
    if not folder.is_dir():
        raise DataError(f"{folder}: no such folder")
    return folder


def _measure(evidence: _Evidence, config: Config) -> dict:
    generated = _locate(evidence.motion, config)
    truth = _locate(evidence.truth, config) if evidence.truth else None
    if truth is not None and truth.world.shape[1:] != generated.world.shape[1:]:
        raise DataError(
            f"{evidence.truth}: {truth.world.shape[1]} joints, the generated motion has {generated.world.shape[1]}"
        )
    trace = graph = None
    references: list[str] = []
    if evidence.trace is not None:
        trace = files.read_json(evidence.trace)
        references = [reference["clip"] for reference in trace["references"]]
        graph = motion_graph.load(_graph_path(config, trace["graph"]))
    onset_times = _onset_times(evidence.audio, config)
    # The last digits of a matrix product depend on its threads, and those on the number of workers.
    with threadpool_limits(limits=1):
        row = evaluation.measure_clip(generated, config, onset_times, truth, trace, graph)
    return {"row": row, "generated": generated, "truth": truth, "references": references}


def _locate(path: Path, config: Config) -> evaluation.Joints:
    if path.suffix.lower() == ".bvh":
        return evaluation.locate(cleanup.resample(bvh.read(path), config.fps), config)
    stored = files.read_arrays(path)
    if "positions" not in stored or stored["positions"].ndim != 3 or stored["positions"].shape[-1] != 3:
        raise DataError(f"{path}: expected an array `positions` of shape (frames, joints, 3)")
    return evaluation.from_positions(stored["positions"].astype(np.float64), config)


def _onset_times(path: Path | None, config: Config) -> np.ndarray | None:
    if path is None:
        return None
    if path.suffix == ".npz":
        return clips.load(path, config, with_motion=False).test_speech(config).onset_times
    samples, rate = audio.read_samples(path)
    peaks = audio.detect_onset_peaks(samples, rate, config.onsets)
    return peaks.select(config.onsets.min_strength, config.onsets.muted_max_share)


def _add_utilisation(rows: dict, total: dict, references: dict[str, list[str]], index: dict) -> None:
    """The share of the whole training set that served as references, per clip and for all together (§5.1.1)."""
    seconds = {name: row["seconds"] for name, row in index["references"].items()}
    named = sorted(references)
    rest = index["training_seconds"] - sum(seconds.values())
    used = training_utilisation([references[name] for name in named], seconds | {"": max(rest, 0.0)})
    for name, share in zip(named, used.per_clip, strict=True):
        rows[name]["utilisation"] = float(share)
    total["utilisation"] = used.overall
