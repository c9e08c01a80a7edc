"""The command line: parse, load the config, call one `pipeline` function, print what it says."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gesturegen import __version__
from gesturegen.errors import GesturegenError
from gesturegen.inputs import shown
from gesturegen.parallel import default_jobs

if TYPE_CHECKING:
    from gesturegen.ablation.plan import Plan
    from gesturegen.config import Config
    from gesturegen.pipeline import Summary

_FOLDER = click.Path(path_type=Path, file_okay=False)
_FILE = click.Path(path_type=Path, dir_okay=False)
_MOST_WARNINGS = 20


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="gesturegen")
def main() -> None:
    """Make a virtual speaker gesture to new speech, from very few recorded examples.

    \b
    Start here:
      gesturegen demo-data demo/data --references 2 --tests 2
      gesturegen run    --data demo/data --work demo/work   (preprocess, build-graph, reenact, evaluate, pack)
      gesturegen report --data demo/data --work demo/work   (a page to watch: demo/work/report.html)
    """


def _jobs_option(command: Callable) -> Callable:
    return click.option(
        "-j", "--jobs", type=click.IntRange(min=1), default=default_jobs, show_default="all processors",
        help="Worker processes; the results are the same for any number.",
    )(command)  # fmt: skip


def _quiet_option(command: Callable) -> Callable:
    return click.option("--quiet", is_flag=True, help="Print errors only.")(command)


def _common(command: Callable, load: Callable | None = None) -> Callable:
    """The options of every command that works on a dataset; it is called with `config`, `jobs` and `quiet`.

    load : what reads `config`, in place of `load_config`
    """

    @click.option("--config", "config_path", type=_FILE, help="YAML settings; without it, the paper's.")
    @click.option(
        "--set",
        "overrides",
        multiple=True,
        metavar="KEY=VALUE",
        help="Override one setting, such as continuity.l_pn=1.",
    )
    @click.option("--data", type=_FOLDER, help="Dataset in GENEA layout (paths.data).")
    @click.option("--work", type=_FOLDER, help="Folder for everything that is written (paths.work).")
    @click.option("--references", type=_FOLDER, help="Any folder of BVH and WAV (and TSV) files, instead of --data.")
    @click.option("--tests", type=_FOLDER, help="Any folder of WAV (and TSV) files, instead of --data.")
    @_jobs_option
    @_quiet_option
    @functools.wraps(command)
    def with_config(config_path, overrides, data, work, references, tests, **options):
        from gesturegen.config import load_config

        folders = {"paths.data": data, "paths.work": work, "data.references": references, "data.tests": tests}
        given = {key: str(folder) for key, folder in folders.items() if folder is not None}
        with _one_line_errors():
            config = (load or load_config)(config_path, overrides, given)
        return command(config=config, **options)

    return with_config


class _one_line_errors:
    """Turns our errors into one line and exit code 1, at the boundary only; bugs keep their traceback."""

    def __enter__(self):
        return self

    def __exit__(self, kind, error, _traceback):
        if isinstance(error, GesturegenError):
            raise click.ClickException(str(error)) from None
        return False


def _run(quiet: bool, work: Callable[[], Summary]) -> None:
    """Run a pipeline function, print its summary, exit with 1 when a clip failed."""
    with _one_line_errors():
        summary = work()
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
        click.echo(f"{trace}bug: {shown(clip)}: this is a fault of gesturegen; please report the lines above", err=True)
    for clip, error in outcome.errors.items():
        for line in error.splitlines():
            click.echo(f"error: {shown(clip)}: {line}", err=True)
    if outcome.failed:
        click.echo(f"error: {outcome.failed} of {outcome.failed + len(outcome.done)} failed", err=True)
        sys.exit(1)


@main.command()
@click.argument("path", type=_FILE, default=Path("gesturegen.yaml"))
@click.option("--force", is_flag=True, help="Write over an existing file.")
def init(path: Path, force: bool) -> None:
    """Write a commented config to start from.

    \b
    Example:
      gesturegen init my.yaml
    """
    from gesturegen import pipeline

    with _one_line_errors():
        pipeline.init(path, force)
    click.echo(f"written: {path}")


@main.command("demo-data")
@click.argument("folder", type=_FOLDER)
@click.option("--references", type=click.IntRange(min=1), default=2, show_default=True, help="Reference clips.")
@click.option("--tests", type=click.IntRange(min=1), default=2, show_default=True, help="Test clips.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@click.option(
    "--challenge",
    is_flag=True,
    help="Durations of the GENEA challenge: references of 60 to 427 s, tests of 60 to 77 s.",
)
@_jobs_option
@_quiet_option
def demo_data(folder: Path, references: int, tests: int, seed: int, challenge: bool, jobs: int, quiet: bool) -> None:
    """Write a synthetic dataset in GENEA layout to try things on.

    \b
    Examples:
      gesturegen demo-data demo/data --references 2 --tests 2 --seed 1
      gesturegen demo-data big/data --references 70 --tests 70 --challenge
    """
    from gesturegen import pipeline

    _run(quiet, lambda: pipeline.demo_data(folder, references, tests, seed, challenge, jobs, quiet))


@main.command()
@_common
@click.option("--export-bvh", type=_FOLDER, metavar="FOLDER", help="Also write the cleaned references as BVH files.")
@click.option(
    "--suggest-blacklist",
    is_flag=True,
    help="Only list near-motionless or glitching clips and ranges; exclude nothing.",
)
def preprocess(config: Config, jobs: int, quiet: bool, export_bvh: Path | None, suggest_blacklist: bool) -> None:
    """Read, check and clean the recordings into WORK/clips.

    \b
    Examples:
      gesturegen preprocess --config configs/casia_go_2023.yaml --data genea --work out
      gesturegen preprocess --references takes --tests speeches --work out
      gesturegen preprocess --data genea --suggest-blacklist
    """
    from gesturegen import pipeline

    if suggest_blacklist:
        _run(quiet, lambda: pipeline.suggest_blacklist(config, jobs, quiet))
    else:
        _run(quiet, lambda: pipeline.preprocess(config, jobs, quiet, export_bvh))


@main.command("build-graph")
@_common
def build_graph(config: Config, jobs: int, quiet: bool) -> None:
    """Build the motion graphs, or the gesture databases, of the references into WORK/graphs.

    \b
    Examples:
      gesturegen build-graph --data genea --work out
      gesturegen build-graph --work out --set references.mode=all
    """
    from gesturegen import pipeline

    _run(quiet, lambda: pipeline.build_graphs(config, jobs, quiet))


@main.command()
@_common
@click.option(
    "--variants", type=click.IntRange(min=1), default=1, show_default=True, metavar="N",
    help="Different results of every clip, to pick from: the first in WORK/reenact, each other in WORK/variants/2 to N.",
)  # fmt: skip
def reenact(config: Config, jobs: int, quiet: bool, variants: int) -> None:
    """Find gestures for every test speech; write BVH, traces and a manifest into WORK/reenact.

    The first variant is the same whatever N is. WORK/variants/2 is a work folder for the commands that come after
    this one, such as `evaluate --work WORK/variants/2`. What an earlier `reenact` left in WORK/variants is removed;
    `run` removes it when its own result changes.

    \b
    Examples:
      gesturegen reenact --config configs/casia_go_2023.yaml --data genea --work out -j 8
      gesturegen reenact --work out --set seed=1 --set blend.method=inertialize
      gesturegen reenact --work out --set search=global --variants 3
    """
    from gesturegen import pipeline

    _run(quiet, lambda: pipeline.reenact(config, jobs, quiet, variants=variants))


@main.command("train-refiner")
@_common
def train_refiner(config: Config, jobs: int, quiet: bool) -> None:
    """Train the network that refines what k-NN motion matching shows (needs the extra `torch`).

    It learns from the references of the test clips and is kept in WORK/refiner.pt. Training that was interrupted goes on
    where it stopped; refine=true then uses the network in `reenact`.

    \b
    Example:
      gesturegen train-refiner --config configs/motion_matching_2022.yaml --work out --set refiner.iterations=2000
    """
    from gesturegen import pipeline

    _run(quiet, lambda: pipeline.train_refiner(config, jobs, quiet))


@main.command()
@_common
@click.option("--bvh", "bvh_folder", type=_FOLDER, help="Measure these BVH files, made by any system.")
@click.option("--audio", "audio_folder", type=_FOLDER, help="With --bvh: the audio files, matched by name.")
@click.option("--truth", "truth_folder", type=_FOLDER, help="The true motion as BVH files, matched by name.")
@click.option("--genea-compat", is_flag=True, help="The figures of the published GENEA scripts, by their conventions.")
def evaluate(
    config: Config, jobs: int, quiet: bool,
    bvh_folder: Path | None, audio_folder: Path | None, truth_folder: Path | None, genea_compat: bool,
) -> None:  # fmt: skip
    """Measure the reenacted clips, or anybody's BVH files, into WORK/evaluate.

    \b
    Examples:
      gesturegen evaluate --data genea --work out
      gesturegen evaluate --bvh theirs --audio genea/val/main-agent/wav --truth genea/val/main-agent/bvh --work out
    """
    from gesturegen import pipeline

    if bvh_folder is None and audio_folder is not None:
        raise click.UsageError("--audio goes with --bvh; a run of gesturegen knows its own audio")
    _run(
        quiet,
        lambda: pipeline.evaluate(config, jobs, quiet, genea_compat, bvh_folder, audio_folder, truth_folder),
    )


@main.command()
@_common
@click.option("--force", is_flag=True, help="Redo everything.")
def run(config: Config, jobs: int, quiet: bool, force: bool) -> None:
    """All stages in order: preprocess, build-graph, reenact, evaluate, pack.

    Does only what is not yet done or has changed, so an interrupted run goes on where it stopped.

    
    Example:
      gesturegen run --config configs/casia_go_2023.yaml --data genea --work out
    """
    from gesturegen import pipeline

    _run(quiet, lambda: pipeline.run(config, jobs, quiet, force))


@main.command()
@_common
def pack(config: Config, jobs: int, quiet: bool) -> None:
    """Check the reenacted clips and write WORK/submission/ and WORK/submission.zip.

    
    Example:
      gesturegen pack --data genea --work out
    """
    from gesturegen import pipeline

    _run(quiet, lambda: pipeline.pack(config, jobs, quiet))


@main.command()
@click.argument("folder", type=_FOLDER, required=False)
@_common
@click.option("--strict", is_flag=True, help="Stretches of over 1 s without motion are errors, not warnings.")
def check(config: Config, jobs: int, quiet: bool, folder: Path | None, strict: bool) -> None:
    """Say of a folder of BVH files whether the challenge would accept it; without FOLDER, of WORK/reenact.

    
    Examples:
      gesturegen check --data genea --work out
      gesturegen check their/bvh --data genea --strict
    """
    from gesturegen import pipeline

    _run(quiet, lambda: pipeline.check(config, folder, strict, jobs, quiet))


def _load_plan(path: Path | None, overrides: tuple[str, ...], folders: dict[str, str]) -> Plan:
    from gesturegen.ablation.plan import load_plan

    return load_plan(path, overrides, folders)


@main.command()
@functools.partial(_common, load=_load_plan)
@click.option("--keep", is_flag=True, help="Also keep graphs, BVH files and traces, in WORK/ablation/<setup>/.")
def ablate(config: Plan, jobs: int, quiet: bool, keep: bool) -> None:
    """Compare setups over several seeds, as in the paper's Table 2, into WORK/ablation.

    --config is an ablation file: base config, seeds, and small config files that change it; without it, the
    paper's five setups. Run preprocess with the base config first.

    \b
    Example:
      gesturegen ablate --config configs/ablation.yaml --data genea --work out --set data.test_split=val
    """
    from gesturegen import pipeline

    _run(quiet, lambda: pipeline.ablate(config, jobs, quiet, keep))


def _load_comparison(path: Path | None, overrides: tuple[str, ...], folders: dict[str, str]) -> Plan:
    from gesturegen.ablation.plan import load_plan
    from gesturegen.config import configs_folder

    return load_plan(path or configs_folder() / "compare.yaml", overrides, folders)


@main.command()
@functools.partial(_common, load=_load_comparison)
@click.option("--out", type=_FILE, metavar="FILE", help="The page to write, instead of WORK/compare/report.html.")
def compare(config: Plan, jobs: int, quiet: bool, out: Path | None) -> None:
    """Compare all methods and the baselines over the same clips, in a table and on a page, into WORK/compare.

    --config is a file like those of `ablate`: base config, seeds, and small config files that change it; without
    it, the methods and baselines of configs/compare.yaml. Run preprocess with its base config first.
    WORK/compare/<setup> is a work folder for `evaluate`, `inspect` and `render`.

    \b
    Examples:
      gesturegen preprocess --config configs/compare/base.yaml --data genea --work out
      gesturegen compare --config configs/compare.yaml --data genea --work out
    """
    from gesturegen import pipeline

    _run(quiet, lambda: pipeline.compare(config, jobs, quiet, out))


def _read_compared(_context, parameter, values: tuple[str, ...]) -> list[tuple[str, Path]]:
    """Pairs of a label and a folder; a usage error for anything else."""
    pairs = []
    for value in values:
        label, sign, work = value.partition("=")
        if not (label.strip() and sign and work):
            raise click.BadParameter(f"{value!r} is not {parameter.metavar}, such as weak=out_weak")
        pairs.append((label.strip(), Path(work)))
    return pairs


@main.command()
@_common
@click.option(
    "--compare", multiple=True, metavar="LABEL=WORK", callback=_read_compared,
    help="Show the motions of another work folder beside this run's; may be repeated.",
)  # fmt: skip
@click.option("--out", type=_FILE, metavar="FILE", help="The file to write, instead of WORK/report.html.")
def report(config: Config, jobs: int, quiet: bool, compare: list[tuple[str, Path]], out: Path | None) -> None:
    """Put the reenacted clips into one HTML file to watch, WORK/report.html.

    \b
    Examples:
      gesturegen report --data genea --work out
      gesturegen report --work out --compare weak=out_weak --out report.html
    """
    from gesturegen import pipeline

    _run(quiet, lambda: pipeline.report(config, jobs, quiet, compare, out))


def _read_size(_context, _parameter, value: str) -> tuple[int, int]:
    width, sign, height = value.partition("x")
    if not (sign and width.isdecimal() and height.isdecimal()):
        raise click.BadParameter(f"{value!r} is not WIDTHxHEIGHT, such as 1280x720")
    return int(width), int(height)


@main.command()
@_common
@click.argument("path", type=click.Path(path_type=Path), required=False)
@click.option(
    "--audio", "sound", type=click.Path(path_type=Path), metavar="FILE|DIR",
    help="The sound, matched by name in a folder; without it, the run's own.",
)  # fmt: skip
@click.option(
    "--beside", multiple=True, metavar="LABEL=DIR", callback=_read_compared,
    help="Show BVH files of the same names beside them; may be repeated.",
)  # fmt: skip
@click.option("--out", type=_FOLDER, metavar="DIR", help="Where to write, instead of WORK/video.")
@click.option("--size", default="960x540", show_default=True, callback=_read_size, metavar="WIDTHxHEIGHT")
def render(
    config: Config, jobs: int, quiet: bool, path: Path | None, sound: Path | None,
    beside: list[tuple[str, Path]], out: Path | None, size: tuple[int, int],
) -> None:  # fmt: skip
    """Draw motions from the front and the side into MP4 videos with sound, in WORK/video.

    PATH is a BVH file or a folder of them; without it, WORK/reenact. Left is blue, right is orange.

    \b
    Examples:
      gesturegen render --data genea --work out
      gesturegen render out/reenact/clip.bvh --work out --beside truth=genea/val/main-agent/bvh
      gesturegen render theirs --audio genea/tst/main-agent/wav --out videos --size 1280x720
    """
    from gesturegen import pipeline

    _run(quiet, lambda: pipeline.render_videos(config, jobs, quiet, path, sound, beside, out, size))


@main.command()
@_common
@click.argument("target", metavar="PATH")
@click.option("--plot", type=_FILE, metavar="FILE.png", help="Also draw it: edges and degrees, or pieces and joins.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def inspect(config: Config, jobs: int, quiet: bool, target: str, plot: Path | None, as_json: bool) -> None:
    """Print the figures of a graph or gesture database, or every piece of a trace in one line.

    PATH is a graph or a database (.npz), a trace (.trace.json), or the name of a clip in WORK.

    \b
    Examples:
      gesturegen inspect out/graphs/clip.npz --plot graph.png
      gesturegen inspect clip --work out
      gesturegen inspect out/graphs/multi-1f05ae4d5c30-gestures.npz --json
    """
    from gesturegen import pipeline

    _run(quiet, lambda: pipeline.inspect(config, target, plot, as_json))


@main.command()
@_common
@click.argument("paths", nargs=-1, type=click.Path(path_type=Path), metavar="[PATH]...")
@click.option(
    "--format", "kinds", multiple=True, type=click.Choice(["glb", "csv", "npz"]), default=["glb"], show_default=True,
    help="glTF 2.0, joint positions, or arrays; may be repeated.",
)  # fmt: skip
@click.option("--out", type=_FOLDER, metavar="DIR", help="Where to write, instead of WORK/export.")
def export(
    config: Config, jobs: int, quiet: bool, paths: tuple[Path, ...], kinds: tuple[str, ...], out: Path | None
) -> None:
    """Write motions as glTF, CSV or NumPy arrays into WORK/export.

    PATHs are BVH files or folders of them; without any, WORK/reenact.

    \b
    Examples:
      gesturegen export --work out --format glb
      gesturegen export genea/trn/main-agent/bvh --format csv --format npz --out tables
    """
    from gesturegen import pipeline

    _run(quiet, lambda: pipeline.export(config, jobs, quiet, paths, kinds, out))


if __name__ == "__main__":
    main()
