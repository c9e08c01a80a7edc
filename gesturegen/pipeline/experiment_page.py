"""The page of an experiment: every clip with the motions of all setups side by side."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path

from gesturegen import __version__
from gesturegen.data.index import Index, IndexedTest
from gesturegen.experiment.figures import Result
from gesturegen.experiment.plan import Plan, seeded
from gesturegen.manifest import ClipRow, Manifest
from gesturegen.parallel import for_each
from gesturegen.pipeline.common import Summary, read_manifest
from gesturegen.pipeline.report import optional, pack_sounding, reenacted, true_motion
from gesturegen.report import page
from gesturegen.settings.models import Config
from gesturegen.stored import documents
from gesturegen.tables import format_figure, json_figures


def write_page(
    path: Path, result: Result, plan: Plan, folders: Mapping[str, Path], index: Index, jobs: int, quiet: bool
) -> Summary:
    """Write every clip with the motions of all setups at the first seed, and this seed's row of each setup.

    folders : the work folder of each setup
    """
    command = result.preset.command
    packed = {name: partial(_pack_clip, name, row, plan.base, folders) for name, row in index.tests.items()}
    outcome = for_each(packed, jobs, f"{command}: page", quiet)
    done = outcome.done
    failed = outcome.errors | dict.fromkeys(outcome.bugs, "a bug of gesturegen")
    seed = plan.seeds[0]
    manifest = Manifest(
        gesturegen=__version__,
        method=command,
        search=f"{len(folders)} setups",
        seed=seed,
        config_hash=seeded(plan.base, seed).signature(),
        config={"fps": plan.base.fps},
        clips=tuple(_total_row(setup, read_manifest(folder)) for setup, folder in folders.items()),
    )
    figures = documents.Summary(
        signature={},
        clips={_title(name): json_figures(setup.by_seed[seed]) for name, setup in result.setups.items()},
        total={},
        beside={name: json_figures(row) for name, row in result.beside.items()},
    )
    content = page.Content(
        manifest=manifest,
        figures=figures,
        compared=list(folders),
        notices=[_machine_notice(result)],
        failed=dict(sorted(failed.items())),
        ablation=None,
        clips={name: one["text"] for name, one in done.items()},
        join_scale=max((one["largest_join"] for one in done.values()), default=0.0),
    )
    page.write(path, content, plan.base)
    summary = Summary(outcome)
    summary.warnings = [(name, note) for name, one in done.items() for note in one["notes"]]
    summary.lines = [f"{len(done)} clips to watch, {path.stat().st_size / 1e6:.1f} MB"]
    return summary


def _title(setup: str) -> str:
    return f"all clips, {setup}"


def _total_row(setup: str, manifest: Manifest) -> ClipRow:
    """Sum up a setup in a row of the page's table, over its clips that have a motion."""
    rows = [row for row in manifest.clips if not row.stuck]
    fallbacks: dict[str, int] = {}
    for row in rows:
        for kind, count in row.fallbacks.items():
            fallbacks[kind] = fallbacks.get(kind, 0) + count
    counts = {key: sum(getattr(row, key) for row in rows) for key in ("n_frames", "pieces", "hard_joins", "retries")}
    return ClipRow(
        clip=_title(setup), references=(), **counts, fallbacks=dict(sorted(fallbacks.items())), stuck=False, error=None,
        files={},
    )  # fmt: skip


def _machine_notice(result: Result) -> str:
    """Say in a sentence what time and memory searches took, which have no column in the page's table."""
    said = []
    for name, setup in result.setups.items():
        seconds, memory = (setup.mean[key] for key in ("search_seconds", "search_memory"))
        said.append(f"{name} {seconds:.3f} s, {format_figure(memory)} MB")
    return "Search of one clip on this machine, time and peak memory with its library: " + "; ".join(said) + "."


def _pack_clip(name: str, indexed: IndexedTest, base: Config, folders: Mapping[str, Path]) -> dict:
    """Pack one clip as the text that goes into the page, with notes on what is missing."""
    notes: list[str] = []
    motions = []
    for setup, folder in folders.items():
        if (folder / "reenact" / f"{name}.bvh").is_file():
            motions.append(reenacted(name, folder, base, setup))
        else:
            notes.append(f"{setup} found no path for this clip")
    if indexed.truth:  # among those that are shown at first
        motions[1:1] = optional("true motion", notes, partial(true_motion, Path(indexed.truth), base))
    return pack_sounding(name, indexed, base, motions, notes)
