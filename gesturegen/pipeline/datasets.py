"""The commands `init` and `demo-data`: write a config to start from, and a small dataset to try."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from gesturegen import demo, files, locks
from gesturegen.errors import ConfigError, DataError
from gesturegen.parallel import for_each
from gesturegen.pipeline.common import Summary
from gesturegen.settings.loading import configs_folder


def init(path: Path, force: bool) -> None:
    """Write a commented config to start from, and never over an existing file without `force`."""
    if path.exists() and not force:
        raise ConfigError(f"{path}: exists already; choose another name or add --force")
    files.write_text(path, (configs_folder() / "casia_go_2023.yaml").read_text())


def demo_data(folder: Path, references: int, tests: int, seed: int, challenge: bool, jobs: int, quiet: bool) -> Summary:
    """Write the embedded demo dataset in GENEA layout."""
    if folder.exists() and (not folder.is_dir() or any(path.name != locks.LOCK for path in folder.iterdir())):
        raise DataError(f"{folder}: exists already and is not empty; choose another folder or delete it")
    specs = demo.clip_specs(
        references=references, tests=tests, seed=seed, **(demo.CHALLENGE_SECONDS if challenge else {})
    )
    tasks = {spec.name: partial(demo.write_clip, folder, spec) for spec in specs}
    outcome = for_each(tasks, jobs, "demo data", quiet)
    demo.write_metadata(folder, specs)
    return Summary(outcome, written=[folder])
