"""What all commands of the command line share: options, one-line errors, the lock, how a result is told."""

from __future__ import annotations

import errno
import functools
import os
import shlex
import sys
import warnings
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import click

from gesturegen import supervision
from gesturegen.errors import GesturegenError
from gesturegen.inputs import shown
from gesturegen.parallel import default_jobs, describe_bugs

if TYPE_CHECKING:
    from gesturegen.experiment.plan import Plan
    from gesturegen.pipeline import Summary
    from gesturegen.settings.models import Config

FOLDER = click.Path(path_type=Path, file_okay=False)
FILE = click.Path(path_type=Path, dir_okay=False)
# What to do after a command that keeps what it has done was stopped.
GOES_ON = "the same command goes on where it stopped"
_MOST_WARNINGS = 20
# They make no motion, but what they find depends on the settings.
_MEASURING = ("evaluate", "doctor")
# What to do after a command; {work} is its work folder.
_NEXT = {
    "preprocess": "gesturegen build-graph --work {work}",
    "build-graph": "gesturegen reenact --work {work}",
    "train-refiner": "gesturegen reenact --work {work} --set refine=true",
    "reenact": "gesturegen evaluate --work {work} (measures), gesturegen report --work {work} (a page to watch)",
    "evaluate": "gesturegen report --work {work} (a page to watch), gesturegen evaluate --work {work} --full (all figures)",
    "run": "gesturegen report --work {work} (a page to watch)",
    "report": "open the page in a browser; gesturegen render --work {work} (videos), gesturegen export --work {work} (glTF)",
    "check": "gesturegen pack --work {work}",
    "pack": "hand in the archive; gesturegen report --work {work} (a page to watch)",
    "render": "watch the videos; gesturegen export --work {work} (glTF)",
    "export": "open the files in your own program",
    "inspect": "gesturegen report --work {work} (a page to watch)",
    "ablate": "read the table in {work}/ablation; gesturegen ablate --keep leaves the motions, to be watched",
    "compare": "open the page in a browser",
    "demo-data": "gesturegen run --data {work} --work out",
}
# Of a disk that is full or fails; our own files are written elsewhere, so that it is what was printed that is lost.
_LOST = {getattr(errno, name) for name in ("ENOSPC", "EIO", "EFBIG", "EDQUOT") if hasattr(errno, name)}


class Program(click.Group):
    """The whole command line. Called as a function, as by a shell, it runs under supervision."""

    def __call__(self, *args: Any, **options: Any) -> None:
        supervision.supervise(lambda: self.main(*args, **options))

    def main(self, *args: Any, **options: Any) -> Any:
        try:
            return super().main(*args, **options)
        except OSError as error:
            if error.errno not in _LOST or error.filename is not None:
                raise
            _say_last(f"error: standard output cannot be written ({error.strerror}); send it elsewhere")


def _say_last(line: str) -> None:
    """Print a line on standard error, if that can be written, and exit with 1 without writing to standard output."""
    try:
        os.write(2, f"{line}\n".encode(errors="backslashreplace"))
    finally:
        os._exit(1)


def jobs_option(command: Callable) -> Callable:
    return click.option(
        "-j", "--jobs", type=click.IntRange(min=1), default=default_jobs, show_default="all processors",
        help="Worker processes; the results are the same for any number.",
    )(command)  # fmt: skip


def quiet_option(command: Callable) -> Callable:
    return click.option("--quiet", is_flag=True, help="Print errors only.")(command)


def wait_option(command: Callable) -> Callable:
    """Kept in the context, where `run_and_print` finds it: no command needs to know of it."""
    return click.option(
        "--wait", is_flag=True, expose_value=False, callback=lambda context, _, value: context.meta.update(wait=value),
        help="Wait for a command that is writing into the same folder.",
    )(command)  # fmt: skip


def force_option(command: Callable) -> Callable:
    """Kept in the context, where `run_and_print` finds it, with the settings that the work folder is to remember."""
    return click.option(
        "--force", is_flag=True, expose_value=False,
        callback=lambda context, _, value: context.meta.update(remember=True, force=value),
        help="Make results anew that are there: with other settings what depends on them, else everything.",
    )(command)  # fmt: skip


def common(command: Callable, load: Callable | None = None) -> Callable:
    """The options of every command that works on a dataset; it is called with `config`, `jobs` and `quiet`.

    load : what reads a plan for `config`, given its file, the overrides and the folders; without it, settings are read
    """

    @click.option(
        "--config", "config_path", type=FILE, metavar="FILE|NAME",
        help="YAML settings, or the name of some that come with gesturegen; without it, those that the work folder "
        "remembers, else the recommended ones.",
    )  # fmt: skip
    @click.option(
        "--set",
        "overrides",
        multiple=True,
        metavar="KEY=VALUE",
        help="Override one setting, such as continuity.l_pn=1.",
    )
    @click.option("--data", type=FOLDER, help="Dataset in GENEA layout (paths.data).")
    @click.option("--work", type=FOLDER, help="Folder for everything that is written (paths.work).")
    @click.option("--references", type=FOLDER, help="Any folder of BVH and WAV (and TSV) files, instead of --data.")
    @click.option("--tests", type=FOLDER, help="Any folder of WAV (and TSV) files, instead of --data.")
    @jobs_option
    @wait_option
    @quiet_option
    @functools.wraps(command)
    def with_config(config_path, overrides, data, work, references, tests, **options):
        from gesturegen import remembered

        folders = {"paths.data": data, "paths.work": work, "data.references": references, "data.tests": tests}
        given = {key: str(folder) for key, folder in folders.items() if folder is not None}
        meta, told = click.get_current_context().meta, None
        with one_line_errors():
            if load is not None:
                path = None if config_path is None else remembered.shipped(config_path)
                config = load(path, overrides, remembered.remembered_folders(overrides, given))
            else:
                config, told = remembered.load(config_path, overrides, given)
        if told and not options["quiet"] and (meta.get("remember") or command.__name__ in _MEASURING):
            click.echo(told, err=True)
        meta["work"] = work_folder(config)[0]
        if meta.get("remember"):
            meta["settings"] = config
        return command(config=config, **options)

    return with_config


class one_line_errors:
    """Turns our errors into one line and exit code 1, at the boundary only; bugs keep their traceback."""

    def __enter__(self):
        return self

    def __exit__(self, kind, error, _traceback):
        if isinstance(error, GesturegenError):
            raise click.ClickException(str(error)) from None
        return False


def run_and_print(
    quiet: bool, work: Callable[[ModuleType], Summary], writes: Iterable[Path] = (), hint: str = ""
) -> None:
    """Run a pipeline function, print its summary, exit with 1 when a clip failed.

    work : is given `gesturegen.pipeline`, which takes a while to load, when the folders are locked; writes : folders
    that are written, by this command alone; hint : what to do when it was stopped
    """
    supervision.set_hint(hint)
    from gesturegen import locks

    if quiet and supervision.is_watched():  # of libraries, here and in the workers
        warnings.simplefilter("ignore")
        os.environ["PYTHONWARNINGS"] = "ignore"
    context = click.get_current_context()
    say = (lambda line: None) if quiet else (lambda line: click.echo(line, err=True))
    with one_line_errors(), locks.locked(writes, _command_line(context), context.meta.get("wait", False), say):
        from gesturegen import pipeline

        with _remembering(context, say):
            summary = work(pipeline)
    if not quiet:
        for clip, note in summary.warnings[:_MOST_WARNINGS]:
            click.echo(f"warning: {shown(clip)}: {note}", err=True)
        if len(summary.warnings) > _MOST_WARNINGS:
            click.echo(f"warning: and {len(summary.warnings) - _MOST_WARNINGS} more", err=True)
        for line in summary.lines:
            click.echo(line)
        for path in summary.written:
            click.echo(f"written: {path}")
    outcome = summary.outcome
    for clip, trace in outcome.bugs.items():
        for text in describe_bugs({clip: trace}):
            click.echo(text, err=True)
    for clip, error in outcome.errors.items():
        for line in error.splitlines():
            click.echo(f"error: {shown(clip)}: {line}", err=True)
    if outcome.failed:
        click.echo(f"error: {outcome.failed} of {outcome.failed + len(outcome.done)} failed", err=True)
        sys.exit(1)
    if not quiet and not context.params.get("as_json") and (hint := _NEXT.get(context.info_name or "")):
        click.echo("next: " + hint.format(work=shlex.quote(str(_work_of(context)))), err=True)


def _work_of(context: click.Context) -> Path:
    return context.meta.get("work") or context.params.get("folder") or Path("out")


def _remembering(context: click.Context, say: Callable[[str], None]) -> AbstractContextManager[None]:
    """What makes the work folder remember the settings of a command that makes motion, as far as it does."""
    if "settings" not in context.meta:
        return nullcontext()
    from gesturegen import remembered

    return remembered.kept(context.meta["settings"], context.meta["force"], say)


def _command_line(context: click.Context) -> str:
    """What was typed, for others who find the folder locked."""
    typed = sys.argv[1:] if supervision.is_watched() else [context.info_name or ""]
    return shlex.join(["gesturegen", *typed])


def work_folder(config: Config | Plan) -> list[Path]:
    """The folder that most commands write into."""
    return [Path(getattr(config, "base", config).paths.work)]
