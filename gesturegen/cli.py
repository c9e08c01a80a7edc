"""The command line: parse, load the config, call one `pipeline` function, print what it says."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gesturegen import __version__
from gesturegen.console import (
    FILE,
    FOLDER,
    GOES_ON,
    Program,
    common,
    force_option,
    jobs_option,
    one_line_errors,
    quiet_option,
    run_and_print,
    wait_option,
    work_folder,
)
from gesturegen.inputs import control_character

if TYPE_CHECKING:
    from gesturegen.experiment.plan import Plan
    from gesturegen.settings.models import Config


@click.group(cls=Program, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="gesturegen")
def main() -> None:
    """Make a virtual speaker gesture to new speech, from very few recorded examples.

    \b
    Start here:
      gesturegen demo-data demo/data --references 2 --tests 2
      gesturegen run    --data demo/data --work demo/work   (preprocess, build-graph, reenact, evaluate, pack)
      gesturegen report --data demo/data --work demo/work   (a page to watch: demo/work/report.html)
    """


@main.command()
@click.argument("path", type=FILE, default=Path("gesturegen.yaml"))
@click.option("--force", is_flag=True, help="Write over an existing file.")
@quiet_option
def init(path: Path, force: bool, quiet: bool) -> None:
    """Write a commented config to start from.

    \b
    Example:
      gesturegen init my.yaml
    """
    from gesturegen import pipeline

    with one_line_errors():
        pipeline.init(path, force)
    if not quiet:
        click.echo(f"written: {path}")


@main.command()
def configs() -> None:
    """List the configs that come with gesturegen; --config takes them by name.

    \b
    Example:
      gesturegen configs
    """
    from gesturegen import remembered

    for kind, found in remembered.listing().items():
        click.echo(f"{kind}:")
        for name, sentence in found:
            click.echo(f"  {name:24}{sentence}")


@main.command("demo-data")
@click.argument("folder", type=FOLDER)
@click.option("--references", type=click.IntRange(min=1), default=2, show_default=True, help="Reference clips.")
@click.option("--tests", type=click.IntRange(min=1), default=2, show_default=True, help="Test clips.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@click.option(
    "--challenge",
    is_flag=True,
    help="Durations of the GENEA challenge: references of 60 to 427 s, tests of 60 to 77 s.",
)
@jobs_option
@wait_option
@quiet_option
def demo_data(folder: Path, references: int, tests: int, seed: int, challenge: bool, jobs: int, quiet: bool) -> None:
    """Write a synthetic dataset in GENEA layout to try things on.

    \b
    Examples:
      gesturegen demo-data demo/data --references 2 --tests 2 --seed 1
      gesturegen demo-data big/data --references 70 --tests 70 --challenge
    """
    run_and_print(
        quiet, lambda pipeline: pipeline.demo_data(folder, references, tests, seed, challenge, jobs, quiet), [folder]
    )


def _moved_to_doctor(_context, _parameter, asked: bool) -> None:
    if asked:
        raise click.UsageError(
            "--suggest-blacklist is now `gesturegen doctor DATA --blacklist FILE`, which looks at more"
        )


@main.command()
@click.argument("folder", metavar="[DATA]", type=FOLDER, required=False)
@common
@click.option("--blacklist", type=FILE, metavar="FILE", help="Also write a config that leaves out what is unfit.")
@click.option("--out", type=FILE, metavar="FILE", help="The page to write, instead of WORK/doctor.html.")
def doctor(
    config: Config, jobs: int, quiet: bool, folder: Path | None, blacklist: Path | None, out: Path | None
) -> None:
    """Look through a data set: what is broken, odd or out of step, and what each method could do with it.

    Measures every recording (units, frame rates, still or torn takes, silent or clipped audio, transcripts that do not
    fit the sound, sound and motion that are apart), prints a table and writes a page. The data are only read.

    \b
    Examples:
      gesturegen doctor genea --work out
      gesturegen doctor genea --blacklist blacklist.yaml --out doctor.html
      gesturegen doctor --references takes --tests speeches
    """
    if folder is not None:
        config = config.model_copy(update={"paths": config.paths.model_copy(update={"data": str(folder)})})
    run_and_print(
        quiet,
        lambda pipeline: pipeline.doctor(config, jobs, quiet, out, blacklist),
        [] if out else work_folder(config),
    )


@main.command()
@common
@force_option
@click.option("--export-bvh", type=FOLDER, metavar="FOLDER", help="Also write the cleaned references as BVH files.")
@click.option(
    "--suggest-blacklist", is_flag=True, hidden=True, is_eager=True, expose_value=False, callback=_moved_to_doctor
)
def preprocess(config: Config, jobs: int, quiet: bool, export_bvh: Path | None) -> None:
    """Read, check and clean the recordings into WORK/clips.

    \b
    Examples:
      gesturegen preprocess --config configs/casia_go_2023.yaml --data genea --work out
      gesturegen preprocess --references takes --tests speeches --work out
    """
    writes = [*work_folder(config), *([export_bvh] if export_bvh else [])]
    run_and_print(quiet, lambda pipeline: pipeline.preprocess(config, jobs, quiet, export_bvh), writes)


@main.command("build-graph")
@common
@force_option
def build_graph(config: Config, jobs: int, quiet: bool) -> None:
    """Build the motion graphs, or the gesture databases, of the references into WORK/graphs.

    \b
    Examples:
      gesturegen build-graph --data genea --work out
      gesturegen build-graph --work out --set references.mode=all
    """
    run_and_print(quiet, lambda pipeline: pipeline.build_graphs(config, jobs, quiet), work_folder(config))


@main.command()
@common
@force_option
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
    run_and_print(quiet, lambda pipeline: pipeline.reenact(config, jobs, quiet, variants=variants), work_folder(config))


@main.command("train-refiner")
@common
@force_option
def train_refiner(config: Config, jobs: int, quiet: bool) -> None:
    """Train the network that refines what k-NN motion matching shows (needs the extra `torch`).

    It learns from the references of the test clips and is kept in WORK/refiner.pt. Training that was interrupted goes on
    where it stopped; refine=true then uses the network in `reenact`.

    \b
    Example:
      gesturegen train-refiner --config configs/motion_matching_2022.yaml --work out --set refiner.iterations=2000
    """
    run_and_print(quiet, lambda pipeline: pipeline.train_refiner(config, jobs, quiet), work_folder(config), GOES_ON)


@main.command()
@common
@click.option("--bvh", "bvh_folder", type=FOLDER, help="Measure these BVH files, made by any system.")
@click.option("--audio", "audio_folder", type=FOLDER, help="With --bvh: the audio files, matched by name.")
@click.option("--truth", "truth_folder", type=FOLDER, help="The true motion as BVH files, matched by name.")
@click.option("--genea-compat", is_flag=True, help="The figures of the published GENEA scripts, by their conventions.")
@click.option("--full", is_flag=True, help="Print every figure of every clip; the files always hold them.")
def evaluate(
    config: Config, jobs: int, quiet: bool,
    bvh_folder: Path | None, audio_folder: Path | None, truth_folder: Path | None, genea_compat: bool,
    full: bool,
) -> None:  # fmt: skip
    """Measure the reenacted clips, or anybody's BVH files, into WORK/evaluate.

    \b
    Examples:
      gesturegen evaluate --data genea --work out
      gesturegen evaluate --bvh theirs --audio genea/val/main-agent/wav --truth genea/val/main-agent/bvh --work out
    """
    if bvh_folder is None and audio_folder is not None:
        raise click.UsageError("--audio goes with --bvh; a run of gesturegen knows its own audio")
    run_and_print(
        quiet,
        lambda pipeline: pipeline.evaluate(
            config, jobs, quiet, genea_compat, bvh_folder, audio_folder, truth_folder, full=full
        ),
        work_folder(config),
    )


@main.command()
@common
@force_option
def run(config: Config, jobs: int, quiet: bool) -> None:
    """All stages in order: preprocess, build-graph, reenact, evaluate, pack.

    Does only what is not yet done or has changed, so an interrupted run goes on where it stopped.

    
    Example:
      gesturegen run --config configs/casia_go_2023.yaml --data genea --work out
    """
    from gesturegen import remembered

    with one_line_errors():
        force = click.get_current_context().meta["force"] and not remembered.differences(config)
    run_and_print(
        quiet, lambda pipeline: pipeline.run(config, jobs, quiet, force), work_folder(config), "" if force else GOES_ON
    )


@main.command()
@common
def pack(config: Config, jobs: int, quiet: bool) -> None:
    """Check the reenacted clips and write WORK/submission/ and WORK/submission.zip.

    
    Example:
      gesturegen pack --data genea --work out
    """
    run_and_print(quiet, lambda pipeline: pipeline.pack(config, jobs, quiet), work_folder(config))


@main.command()
@click.argument("folder", type=FOLDER, required=False)
@common
@click.option("--strict", is_flag=True, help="Stretches of over 1 s without motion are errors, not warnings.")
def check(config: Config, jobs: int, quiet: bool, folder: Path | None, strict: bool) -> None:
    """Say of a folder of BVH files whether the challenge would accept it; without FOLDER, of WORK/reenact.

    
    Examples:
      gesturegen check --data genea --work out
      gesturegen check their/bvh --data genea --strict
    """
    run_and_print(quiet, lambda pipeline: pipeline.check(config, folder, strict, jobs, quiet))


def _load_plan(path: Path | None, overrides: tuple[str, ...], folders: dict[str, str]) -> Plan:
    from gesturegen.experiment.plan import load_plan

    return load_plan(path, overrides, folders)


@main.command()
@functools.partial(common, load=_load_plan)
@click.option("--keep", is_flag=True, help="Also keep graphs, BVH files and traces, in WORK/ablation/<setup>/.")
def ablate(config: Plan, jobs: int, quiet: bool, keep: bool) -> None:
    """Compare setups over several seeds, as in the paper's Table 2, into WORK/ablation.

    --config is a plan: base config, seeds, and setups or a grid of settings that change it; without it, the
    paper's five setups. Run preprocess with the base config first.

    \b
    Example:
      gesturegen ablate --config configs/ablation.yaml --data genea --work out --set data.test_split=val
    """
    run_and_print(quiet, lambda pipeline: pipeline.ablate(config, jobs, quiet, keep), work_folder(config))


def _load_comparison(path: Path | None, overrides: tuple[str, ...], folders: dict[str, str]) -> Plan:
    from gesturegen.experiment.plan import load_plan
    from gesturegen.settings.loading import configs_folder

    return load_plan(path or configs_folder() / "compare.yaml", overrides, folders)


@main.command()
@functools.partial(common, load=_load_comparison)
@click.option("--out", type=FILE, metavar="FILE", help="The page to write, instead of WORK/compare/report.html.")
def compare(config: Plan, jobs: int, quiet: bool, out: Path | None) -> None:
    """Compare all methods and the baselines over the same clips, in a table and on a page, into WORK/compare.

    --config is a plan like those of `ablate`: base config, seeds, and setups that change it; without it, the
    methods and baselines of configs/compare.yaml. Run preprocess with its base config first.
    WORK/compare/<setup> is a work folder for `evaluate`, `inspect` and `render`.

    \b
    Examples:
      gesturegen preprocess --config configs/compare/base.yaml --data genea --work out
      gesturegen compare --config configs/compare.yaml --data genea --work out
    """
    run_and_print(quiet, lambda pipeline: pipeline.compare(config, jobs, quiet, out), work_folder(config))


def _read_compared(_context, parameter, values: tuple[str, ...]) -> list[tuple[str, Path]]:
    """Pairs of a label and a folder; a usage error for anything else."""
    pairs = []
    for value in values:
        label, sign, work = value.partition("=")
        if not (label.strip() and sign and work):
            raise click.BadParameter(f"{value!r} is not {parameter.metavar}, such as weak=out_weak")
        if (control := control_character(label)) is not None:
            raise click.BadParameter(f"{value!r}: the label holds {control}; give another one")
        pairs.append((label.strip(), Path(work)))
    return pairs


@main.command()
@common
@click.option(
    "--compare", multiple=True, metavar="LABEL=WORK", callback=_read_compared,
    help="Show the motions of another work folder beside this run's; may be repeated.",
)  # fmt: skip
@click.option("--out", type=FILE, metavar="FILE", help="The file to write, instead of WORK/report.html.")
def report(config: Config, jobs: int, quiet: bool, compare: list[tuple[str, Path]], out: Path | None) -> None:
    """Put the reenacted clips into one HTML file to watch, WORK/report.html.

    \b
    Examples:
      gesturegen report --data genea --work out
      gesturegen report --work out --compare weak=out_weak --out report.html
    """
    run_and_print(
        quiet, lambda pipeline: pipeline.report(config, jobs, quiet, compare, out), [] if out else work_folder(config)
    )


def _read_size(_context, _parameter, value: str) -> tuple[int, int]:
    width, sign, height = value.partition("x")
    if not (sign and width.isdecimal() and height.isdecimal()):
        raise click.BadParameter(f"{value!r} is not WIDTHxHEIGHT, such as 1280x720")
    return int(width), int(height)


@main.command()
@common
@click.argument("path", type=click.Path(path_type=Path), required=False)
@click.option(
    "--audio", "sound", type=click.Path(path_type=Path), metavar="FILE|DIR",
    help="The sound, matched by name in a folder; without it, the run's own.",
)  # fmt: skip
@click.option(
    "--beside", multiple=True, metavar="LABEL=DIR", callback=_read_compared,
    help="Show BVH files of the same names beside them; may be repeated.",
)  # fmt: skip
@click.option("--out", type=FOLDER, metavar="DIR", help="Where to write, instead of WORK/video.")
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
    writes = [out] if out else work_folder(config)
    run_and_print(
        quiet, lambda pipeline: pipeline.render_videos(config, jobs, quiet, path, sound, beside, out, size), writes
    )


@main.command()
@common
@click.argument("target", metavar="PATH")
@click.option("--plot", type=FILE, metavar="FILE.png", help="Also draw it: edges and degrees, or pieces and joins.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def inspect(config: Config, jobs: int, quiet: bool, target: str, plot: Path | None, as_json: bool) -> None:
    """Print the figures of a graph or gesture database, every piece of a trace in one line, or the roles of joints.

    PATH is a graph or a database (.npz), a trace (.trace.json), the name of a clip in WORK, or a BVH file, of which its
    unit, its vertical and the joint of each role are told: pelvis, spine, head, wrists, ankles ...

    \b
    Examples:
      gesturegen inspect out/graphs/clip.npz --plot graph.png
      gesturegen inspect clip --work out
      gesturegen inspect take.bvh
      gesturegen inspect out/graphs/multi-1f05ae4d5c30-gestures.npz --json
    """
    run_and_print(quiet, lambda pipeline: pipeline.inspect(config, target, plot, as_json))


@main.command()
@common
@click.argument("paths", nargs=-1, type=click.Path(path_type=Path), metavar="[PATH]...")
@click.option(
    "--format", "kinds", multiple=True, type=click.Choice(["glb", "csv", "npz"]), default=["glb"], show_default=True,
    help="glTF 2.0, joint positions, or arrays; may be repeated.",
)  # fmt: skip
@click.option("--out", type=FOLDER, metavar="DIR", help="Where to write, instead of WORK/export.")
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
    run_and_print(
        quiet,
        lambda pipeline: pipeline.export(config, jobs, quiet, paths, kinds, out),
        [out] if out else work_folder(config),
    )


def _of_recordings(command):
    """The arguments of commands that write transcripts of recordings, whatever their dataset."""

    @click.argument("paths", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="PATH...")
    @click.option("--output", type=FOLDER, metavar="DIR", help="Where to write, instead of beside what is read.")
    @click.option("--force", is_flag=True, help="Write over TSV files that are there.")
    @jobs_option
    @wait_option
    @quiet_option
    @functools.wraps(command)
    def with_options(**options):
        return command(**options)

    return with_options


@main.command()
@_of_recordings
def align(paths: tuple[Path, ...], output: Path | None, force: bool, jobs: int, quiet: bool) -> None:
    """Find when each word of a text is said: a TSV for every a.txt beside an a.wav (needs the extra `align`).

    PATHs are folders of recordings, or files. English only, word for word as it is said. `preprocess` does the same
    for clips that have nothing but a text.

    \b
    Examples:
      gesturegen align talks
      gesturegen align talks/a.wav --output tsv
    """
    writes = [output] if output else []
    run_and_print(quiet, lambda pipeline: pipeline.align(paths, output, force, jobs, quiet), writes)


@main.command()
@_of_recordings
def transcribe(paths: tuple[Path, ...], output: Path | None, force: bool, jobs: int, quiet: bool) -> None:
    """Recognise English words without a text, badly: a TSV for every sound (needs the extra `align`).

    Better is a text that somebody corrected, with `align`, or the JSON, SRT or TSV of a better recogniser, such as
    Whisper, which `preprocess` reads.

    \b
    Example:
      gesturegen transcribe talks --output tsv
    """
    writes = [output] if output else []
    run_and_print(quiet, lambda pipeline: pipeline.transcribe(paths, output, force, jobs, quiet), writes)


if __name__ == "__main__":
    main()
