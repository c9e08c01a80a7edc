"""The command `export`: write motions in the formats of other programs."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from gesturegen import export as formats
from gesturegen import inputs
from gesturegen.errors import ConfigError
from gesturegen.extras import need
from gesturegen.joints import settings_for
from gesturegen.motion import space
from gesturegen.parallel import for_each
from gesturegen.pipeline.common import Summary, require_writable
from gesturegen.pipeline.motions import motion_files
from gesturegen.settings.models import Config
from gesturegen.workspace import work_path


def export(
    config: Config, jobs: int, quiet: bool, paths: Sequence[Path] = (), kinds: Sequence[str] = ("glb",),
    out: Path | None = None,
) -> Summary:  # fmt: skip
    """Write every motion of `paths` (`WORK/reenact` by default) in each of `kinds`: glb, csv, npz.

    Motions keep their own frame rate.
    """
    for kind in kinds:
        if kind not in formats.FORMATS:
            raise ConfigError(
                f"--format {inputs.shown(kind)}: no format of motions; there are {', '.join(formats.FORMATS)}"
            )
        if (needs := formats.FORMATS[kind].needs) is not None:
            need(*needs)
    motions = motion_files(config, paths)
    folder = out or work_path(config, "export")
    require_writable(folder)
    tasks = {name: partial(_export_clip, name, path, tuple(kinds), folder, config) for name, path in motions.items()}
    outcome = for_each(tasks, jobs, "export", quiet)
    count = len(outcome.done)
    lines = [f"{count} {'motion' if count == 1 else 'motions'} as {', '.join(kinds)}"]
    return Summary(outcome, lines=lines, written=[folder])


def _export_clip(name: str, path: Path, kinds: tuple[str, ...], folder: Path, config: Config) -> None:
    inputs.require_usable_name(path)
    motion = space.read(path, config)
    pelvis = settings_for(motion.skeleton, config).positions.root_joint
    for kind in kinds:
        formats.write(folder / f"{name}.{kind}", motion, name, pelvis)
