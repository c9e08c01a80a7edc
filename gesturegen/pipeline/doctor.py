"""The command `doctor`: report what is wrong with a dataset, and what can be done with it."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from gesturegen import files, inputs
from gesturegen.data import recordings
from gesturegen.data.recordings import Recording
from gesturegen.doctor import dataset, examination, page
from gesturegen.errors import DataError
from gesturegen.parallel import for_each
from gesturegen.pipeline.common import Summary, require_writable
from gesturegen.settings.models import Config
from gesturegen.workspace import work_path

# Splits of the challenges that are looked at where they are there, beside those of the config.
_SPLITS = ("trn", "val", "tst")


def doctor(config: Config, jobs: int, quiet: bool, out: Path | None = None, blacklist: Path | None = None) -> Summary:
    """Look through all recordings, print figures and findings, write a page; read the data and change none of it.

    out : the page, by default WORK/doctor.html; blacklist : a config file that leaves out what is unfit
    """
    parts = _parts(config)
    path = work_path(config, "doctor.html") if out is None else out
    for written in (path, *([blacklist] if blacklist else [])):
        require_writable(written.parent)
    tasks = {
        f"{part}/{one.name}": partial(examination.examine, one, f"{part}/{one.name}", config)
        for part, found in parts.items() for one in found
    }  # fmt: skip
    outcome = for_each(tasks, jobs, "doctor", quiet)
    dataset.compare(outcome.done, config)
    by_part = {
        part: [outcome.done[f"{part}/{one.name}"] for one in found if f"{part}/{one.name}" in outcome.done]
        for part, found in parts.items()
    }
    first, *others = by_part.values()
    references = [one for one in first if one.skeleton is not None or (one.fps is None and _has_motion(one, parts))]
    tests = by_part.get(config.data.test_split, others[0] if others else [one for one in first if one.seconds])
    named = {one.name: one for found in parts.values() for one in found}
    n_true = len(
        recordings.true_motions(config, {name: named[name] for name in (one.name.partition("/")[2] for one in tests)})
    )
    plain = {f"{part}/{one.name}": one.name for part, found in parts.items() for one in found}
    text = dataset.blacklist_yaml(references, plain, config)
    content = page.Content(
        ", ".join(map(str, _folders(config).values())),
        by_part,
        dataset.methods(references, tests, n_true, config),
        text,
    )
    files.write_text(path, page.render(content))
    summary = Summary(outcome, lines=page.lines(content), written=[path])
    if blacklist is not None:
        files.write_text(blacklist, text)
        summary.written.append(blacklist)
    if references and all(one.unfit for one in references):
        summary.warnings.append(("blacklist", "every reference is unfit, so no command would run with it"))
    return summary


def _has_motion(one: examination.Examined, parts: dict[str, list[Recording]]) -> bool:
    part, _, name = one.name.partition("/")
    return any(recording.name == name and recording.motion_path for recording in parts[part])


def _folders(config: Config) -> dict[str, Path]:
    """Map the names of the folders to look at to the folders, references first."""
    data = Path(config.paths.data)
    if config.data.references is not None or config.data.tests is not None:
        chosen = {"references": config.data.references, "tests": config.data.tests}
        return {name: Path(folder) for name, folder in chosen.items() if folder is not None}
    splits = dict.fromkeys([config.data.reference_split, config.data.test_split, *_SPLITS])
    found = {split: data / split for split in splits if inputs.is_dir(data / split)}
    return found or {data.name or "data": data}


def _parts(config: Config) -> dict[str, list[Recording]]:
    parts = {}
    for name, folder in _folders(config).items():
        if not inputs.is_dir(folder):
            raise DataError(f"{inputs.shown(folder)}: no such folder; give the data set to look at")
        parts[name] = recordings.list_recordings(folder)
    if not any(parts.values()):
        raise DataError(
            f"{', '.join(inputs.shown(folder) for folder in _folders(config).values())}: no recording in it; expected "
            "GENEA's layout, or BVH and audio files with matching names"
        )
    return parts
