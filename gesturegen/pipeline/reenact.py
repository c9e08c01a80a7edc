"""The command `reenact`: generate motion for speeches (§4.2), in one variant or several to pick from."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from gesturegen import __version__, submission
from gesturegen.data import clips
from gesturegen.data.stored_clips import digests, stored_digest
from gesturegen.errors import DamagedError, DataError
from gesturegen.frames import ReferenceFrames
from gesturegen.manifest import ClipRow, Manifest
from gesturegen.methods import METHODS, libraries
from gesturegen.parallel import for_each
from gesturegen.path import Path as SearchPath
from gesturegen.pipeline import keyword_gestures, refiner
from gesturegen.pipeline.common import Summary, chosen_references, read_index, require_writable, share
from gesturegen.pipeline.gesturing import gesture, read_speech, title_of
from gesturegen.pipeline.memory import require_memory
from gesturegen.settings.models import Config
from gesturegen.stored import documents, sealing
from gesturegen.trace import Trace
from gesturegen.workspace import clip_path, library_name, library_path, work_path

# Frames of a reference that are further apart than this show another moment of it.
ELSEWHERE_FRAMES = 15
# Test clips that are searched for at once, by methods that can.
_TOGETHER = 70


@dataclass(frozen=True)
class _Made:
    """A clip that was written, or kept: its row of the manifest and its notes.

    new : share of its frames that no earlier variant shows, None for the first and where the search got stuck
    """

    row: ClipRow
    notes: tuple[str, ...]
    new: float | None = None


def reenact(config: Config, jobs: int, quiet: bool, reuse: bool = False, variants: int = 1) -> Summary:
    """Search and render every test clip; write BVH, trace and manifest (§4.2).

    reuse : keep written clips whose graph, speech and settings have not changed; not with several variants
    variants : results per clip. The first is in `WORK/reenact`, the others are in work folders of their own,
        `WORK/variants/2` and so on. Those of earlier runs are removed, with `reuse` only when this result changes.
    """
    index = read_index(config)
    chosen = chosen_references(config, index)
    _refuse_variant(config)
    jobs, warnings = require_memory(config, chosen, index, jobs)
    folders = [_folder(config, variant) for variant in range(1, variants + 1)]
    require_writable(folders[0])
    reuse = reuse and variants == 1
    if not reuse:
        _remove_variants(config)
    for folder in folders[1:]:
        require_writable(folder)
        share(config, folder.parent, "clips", "graphs")
    found = _search_together(config, chosen, jobs, quiet, reuse)
    tasks = {
        test: partial(_reenact_clip, test, names, config, reuse, variants, found.get(test))
        for test, names in chosen.items()
    }
    outcome = for_each(tasks, jobs, "reenact", quiet)
    outcome.errors |= {name: f"failed in preprocess: {error}" for name, error in index.failed.items()}
    failed = outcome.errors | dict.fromkeys(outcome.bugs, "a bug of gesturegen")
    for variant, folder in enumerate(folders, 1):
        rows = [results[variant - 1].row for results in outcome.done.values()]
        for name, error in failed.items():
            submission.remove_clip(folder, name)
            rows.append(submission.failed_row(name, chosen.get(name, ()), error))
        manifest = submission.manifest(rows, config, variant)
        lost = documents.damage(folder / "manifest.json", Manifest, "reenact") if reuse else []
        if variants == 1 and not _is_stored(manifest, folder):
            _remove_variants(config)
        documents.write(folder / "manifest.json", manifest)
    summary = Summary(outcome, written=[folders[0], *(folder.parent for folder in folders[1:])])
    _describe(summary, config)
    summary.warnings += [("manifest", note) for note in lost]
    summary.warnings += warnings
    if any(row.word is not None for row in config.control.gestures) and not outcome.failed:
        spoken = {test: clips.load(clip_path(config, test), config, with_motion=False).words for test in chosen}
        words = {test: {word.text for word in own} for test, own in spoken.items()}
        summary.warnings += [("control", line) for line in keyword_gestures.unsaid(config, words)]
    return summary


@lru_cache(maxsize=1)
def _library(
    config_json: str, names: tuple[str, ...], clip_digests: tuple[str, ...], _graph_digest: str
) -> tuple[Sequence[clips.Reference], ReferenceFrames]:
    """Load references and their graph; a worker keeps the last ones, since test clips often share them."""
    config = Config.model_validate_json(config_json)
    method = METHODS[config.method]
    graph = libraries.load(library_path(config, library_name(config, names)), method, config, clip_digests)
    return method.shown_clips(config, names), graph


def _graph_digest(config: Config, names: Sequence[str]) -> str:
    stored = library_path(config, library_name(config, names))
    return stored_digest(stored) if stored.is_file() else ""


def _made_of(test: str, names: Sequence[str], config: Config, variant: int) -> str:
    """Hash everything that a result depends on."""
    parts = (
        __version__, config.signature(), test, *digests(config, names), _graph_digest(config, names),
        *digests(config, [test]), *keyword_gestures.library_digests(config),
        *([stored_digest(refiner.require_trained(config))] if config.refine else []), f"variant {variant}",
    )  # fmt: skip
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def _search_together(
    config: Config, chosen: Mapping[str, tuple[str, ...]], jobs: int, quiet: bool, reuse: bool
) -> dict[str, SearchPath]:
    """Find the paths of test clips that share references, by methods that search for many clips at once.

    A clip that is missing here, whatever the reason, is searched for by itself and tells the reason.
    """
    if not METHODS[config.method].at_once:
        return {}
    groups: dict[tuple[str, ...], list[str]] = {}
    for test, names in chosen.items():
        groups.setdefault(names, []).append(test)
    tasks = {
        f"{library_name(config, names)}, clips from {first}": partial(
            _search_batch, tests[first : first + _TOGETHER], names, config, reuse
        )
        for names, tests in groups.items()
        for first in range(0, len(tests), _TOGETHER)
    }
    outcome = for_each(tasks, jobs, "reenact: search", quiet)
    return {test: path for found in outcome.done.values() for test, path in found.items()}


def _search_batch(tests: Sequence[str], names: tuple[str, ...], config: Config, reuse: bool) -> dict[str, SearchPath]:
    speeches = {}
    for test in tests:
        try:
            inputs = _made_of(test, names, config, 1)
            if not (reuse and _kept(test, inputs, config)[0]):
                speeches[test] = read_speech(test, config)
        except DataError:
            continue  # told by the clip's own task
    if len(speeches) < 2:
        return {}
    _, graph = _library(
        config.model_dump_json(by_alias=True), names, digests(config, names), _graph_digest(config, names)
    )
    found = METHODS[config.method].search_all(graph, speeches, config)
    return {test: path for test, path in found.items() if isinstance(path, SearchPath)}


def _reenact_clip(
    test: str, names: tuple[str, ...], config: Config, reuse: bool, variants: int, found: SearchPath | None
) -> list[_Made]:
    """Write all variants of a clip, one after the other: each is searched in view of the earlier ones.

    found : the path of the first one, where it has been searched for already
    """
    inputs = [_made_of(test, names, config, variant) for variant in range(1, variants + 1)]
    trace, lost = _kept(test, inputs[0], config) if reuse else (None, [])
    if trace is not None:
        return [_Made(submission.clip_row(trace, submission.kept_clip(_folder(config, 1), test, trace)), trace.notes)]
    references, graph = _library(
        config.model_dump_json(by_alias=True), names, digests(config, names), _graph_digest(config, names)
    )
    speech = read_speech(test, config)
    results: list[_Made] = []
    shown: list[np.ndarray] = []
    earlier: list[SearchPath] = []
    for variant, hashed in enumerate(inputs, 1):
        made = gesture(test, names, graph, references, speech, config, found if variant == 1 else None, earlier)
        earlier.append(made.found)
        told = made.trace.model_copy(update={"inputs": hashed})
        written = submission.write_clip(_folder(config, variant), test, made.motion, told)
        new = None
        if made.motion is not None:
            nodes = made.trace.shown_nodes()
            new = share_of_new_frames(nodes, shown, made.frames) if shown else None
            shown.append(nodes)
        results.append(_Made(submission.clip_row(made.trace, written), (*lost, *made.trace.notes), new))
    return results


def _kept(test: str, inputs: str, config: Config) -> tuple[Trace | None, list[str]]:
    """Read the trace of an earlier result of these inputs; None when there is none that is as it was written.

    Then the list says so.
    """
    try:
        return submission.read_trace_if_current(_folder(config, 1), test, inputs), []
    except DamagedError as error:
        return None, [sealing.remade(error)]


def share_of_new_frames(nodes: np.ndarray, earlier: Sequence[np.ndarray], graph: ReferenceFrames) -> float:
    """Compute the share of frames that show another moment of the references than each earlier variant does there.

    nodes : `[shape=(n_frames,)]`, shown; earlier : the same of other variants. Another moment is one of
    another clip, or over `ELSEWHERE_FRAMES` away in its recording.
    """

    names = np.array(graph.clip_names)

    def place(shown: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        # By name: a mirrored copy shows the same moment.
        return names[np.searchsorted(graph.clip_starts, shown, side="right") - 1], graph.source_frames[shown]

    clip, frame = place(nodes)
    new = np.ones(len(nodes), dtype=bool)
    for other_clip, other_frame in map(place, earlier):
        new &= (clip != other_clip) | (np.abs(frame - other_frame) > ELSEWHERE_FRAMES)
    return float(new.mean())


# --- folders of variants ------------------------------------------------------------------------------------


def _folder(config: Config, variant: int) -> Path:
    """Return the folder of the BVH files of a variant."""
    return work_path(config, *(() if variant == 1 else ("variants", str(variant))), "reenact")


def _refuse_variant(config: Config) -> None:
    """Refuse to reenact into a variant's work folder, whose results would pass for variants of its run."""
    work = work_path(config).resolve()
    if work.parent.name == "variants" and work.name.isdecimal() and (work / "clips").is_symlink():
        raise DataError(
            f"{work_path(config)}: holds a variant of {work.parent.parent}, so nothing is reenacted into it; "
            "give another folder with --work"
        )


def _remove_variants(config: Config) -> None:
    """Remove the variants of an earlier run, which must not pass for this one's; keep folders of other names."""
    folder = work_path(config, "variants")
    found = [path for path in sorted(folder.glob("*")) if path.name.isdecimal() and path.is_dir()]
    path = folder
    try:
        for path in found:  # without their manifests they are no results, should the removal be interrupted
            (path / "reenact" / "manifest.json").unlink(missing_ok=True)
        for path in found:
            shutil.rmtree(path)
        path = folder
        if folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()
    except OSError as error:
        raise DataError(
            f"{path}: variants of an earlier run cannot be removed ({error.strerror or error}); remove them by hand"
        ) from None


def _is_stored(manifest: Manifest, folder: Path) -> bool:
    """Tell whether an earlier run left the same manifest, and so the same result of the same inputs."""
    try:
        return documents.read(folder / "manifest.json", Manifest, "reenact") == manifest
    except DataError:
        return False


# --- the summary --------------------------------------------------------------------------------------------


def _describe(summary: Summary, config: Config) -> None:
    """Add lines, warnings and errors for each variant of each clip; variants that got stuck move to the errors."""
    outcome = summary.outcome
    hint = METHODS[config.method].advice(config)
    done, outcome.done = outcome.done, {}
    for test, results in done.items():
        said: set[str] = set()
        for variant, result in enumerate(results, 1):
            title, row = title_of(test, variant), result.row
            summary.warnings += [(title, note) for note in result.notes if note not in said]
            said.update(result.notes)
            if row.stuck:
                outcome.errors[title] = row.error
                continue
            if result.new == 0:
                summary.warnings.append((title, f"shows nothing that earlier variants do not; {hint}"))
            outcome.done[title] = result
            summary.lines.append(f"{title}: {_figures(row)}{_difference(result.new)}")


def _figures(row: ClipRow) -> str:
    return (
        f"{row.n_frames} frames, {row.pieces} pieces, {row.hard_joins} hard joins, {row.retries} retries, "
        f"fallbacks: {row.fallback_text}"
    )


def _difference(new: float | None) -> str:
    return "" if new is None else f"; {new:.0%} of the frames in no earlier variant"
