"""What is written is true: every command has help, every YAML loads, every setting is explained.

The documents are README.md and the pages of docs/, taken together.
"""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import click
import pytest
import yaml
from click.testing import CliRunner

from gesturegen import __version__
from gesturegen.cli import main
from gesturegen.demo import dataset
from gesturegen.experiment.plan import load_plan
from gesturegen.settings.loading import load_config
from gesturegen.settings.models import Config

TOP = Path(__file__).parent.parent
README = (TOP / "README.md").read_text()
PAGES = {path.name: path.read_text() for path in sorted((TOP / "docs").glob("*.md"))}
DOCUMENTS = "\n".join([README, *PAGES.values()])
# Blocks of code by their language, and code within a line.
BLOCKS = re.findall(r"^```(\w*)\n(.*?)^```$", DOCUMENTS, re.M | re.S)
CODE = "\n".join([text for _, text in BLOCKS] + re.findall(r"(?<!`)`([^`]+)`(?!`)", DOCUMENTS))
PAPER = TOP / "configs/casia_go_2023.yaml"
GESTURE_MASTER = TOP / "configs/gesture_master_2022.yaml"
MOTION_MATCHING = TOP / "configs/motion_matching_2022.yaml"
# Settings that are spelled out in the config of the one method that has them.
OWN = {
    GESTURE_MASTER: ("gesture_master",),
    MOTION_MATCHING: ("acoustics", "motion_matching", "refine", "refiner"),
}


@pytest.mark.parametrize("name", sorted(main.commands))
def test_every_command_has_help_with_an_example_and_is_documented(name):
    result = CliRunner().invoke(main, [name, "--help"])
    assert result.exit_code == 0 and f"  gesturegen {name}" in result.output
    assert f"gesturegen {name}" in DOCUMENTS
    commands = README[README.index("## Commands") : README.index("## Documents")]
    assert f"`{name}`" in commands


def test_every_command_line_of_the_documents_parses():
    lines = [line for language, text in BLOCKS if language == "sh" for line in text.splitlines()]
    lines = [line for line in lines if line.startswith("gesturegen ")]
    assert len(lines) >= 40
    for line in lines:
        words = shlex.split(line, comments=True)[1:]
        command = main.commands[words[0]]
        with click.Context(command) as context:
            command.parse_args(context, words[1:])


def test_every_option_of_the_documents_exists():
    known = {option for command in main.commands.values() for parameter in command.params for option in parameter.opts}
    known |= set(main.context_settings["help_option_names"])
    scripts = "".join(path.read_text() for path in sorted((TOP / "scripts").glob("*.py")))
    used = set(re.findall(r"(?<![\w-])--[a-z][a-z-]+", DOCUMENTS))
    assert used - known <= set(re.findall(r'"(--[a-z-]+)"', scripts))
    assert not set(re.findall(r"(?<![\w-])--[a-z][a-z-]+", README)) - known


def test_every_make_target_of_the_documents_exists():
    makefile = (TOP / "Makefile").read_text()
    targets = set(re.findall(r"^make ([a-z-]+)", CODE + (TOP / "CONTRIBUTING.md").read_text(), re.M))
    assert len(targets) >= 8
    for target in targets:
        assert re.search(rf"^{target}:", makefile, re.M), target


@pytest.mark.parametrize("reader", ["participant", "animator", "researcher"])
@pytest.mark.slow
def test_the_recipes_of_the_readme_run_as_they_stand(reader, tmp_path):
    began = {"participant": "**You take part", "animator": "**You animate", "researcher": "**You do research"}[reader]
    recipe = README[README.index(began) :].partition("```sh\n")[2].partition("```")[0]
    lines = [shlex.split(line, comments=True) for line in recipe.splitlines()]
    assert len(lines) == 3
    lengths = {"trn": 15.0, "tst": 8.0}
    specs = [dataset.ClipSpec(split, k, lengths[split], seed=1, speaker=1) for split in lengths for k in range(2)]
    for spec in specs:
        dataset.write_clip(tmp_path / "genea", spec)
    dataset.write_metadata(tmp_path / "genea", specs)
    shutil.copytree(tmp_path / "genea/tst", tmp_path / "genea/val")
    shutil.copytree(tmp_path / "genea/truth", tmp_path / "genea/val", dirs_exist_ok=True)
    (tmp_path / "configs").symlink_to(TOP / "configs")
    for folder, split, name in (("takes", "trn", "a"), ("speeches", "tst", "b")):
        (tmp_path / folder).mkdir()
        for file in sorted((tmp_path / "genea" / split / "main-agent").glob(f"*/{split}_2023_v0_000*")):
            if file.suffix in (".bvh", ".wav"):
                shutil.copy(file, tmp_path / folder / f"{name}{file.suffix}")
    environment = os.environ | {"PYTHONPATH": str(TOP)}
    for line in lines:
        if "theirs" in line:  # what another system made
            shutil.copytree(tmp_path / "genea/val/main-agent/bvh", tmp_path / "theirs")
        result = subprocess.run(
            [sys.executable, "-m", *line], capture_output=True, text=True, cwd=tmp_path, env=environment
        )
        assert result.returncode == 0, f"{shlex.join(line)}\n{result.stdout}\n{result.stderr}"
    told = README[README.index(began) :].partition("\n**")[0]
    for name in re.findall(r"out/[\w./]+\.(?:html|zip|mp4|glb|bvh)", told):
        assert (tmp_path / name).is_file(), name


def test_the_readme_is_one_screen():
    assert len(README.split()) <= 600 and len(README.splitlines()) <= 110
    assert (TOP / "docs/picture.gif").stat().st_size < 600_000


def test_every_page_begins_with_a_question_and_is_in_the_contents():
    listed = re.findall(r"[\w-]+\.md", (TOP / "mkdocs.yml").read_text())
    assert sorted(listed) == sorted(PAGES)
    for name, text in PAGES.items():
        assert re.match(r"# .*\?\n", text), name
        if name != "index.md":
            assert f"]({name}" in PAGES["index.md"] and f"](docs/{name}" in README, name


def test_every_file_that_the_documents_name_exists():
    named = set(re.findall(r"(?<![\w/<-])(?:configs|scripts|tests|examples|gesturegen)/[\w./-]*\w", CODE))
    assert len(named) >= 40
    assert not [name for name in sorted(named) if not (TOP / name).exists()]


def test_the_notebook_has_no_outputs():
    cells = json.loads((TOP / "examples/gesturegen.ipynb").read_text())["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert len(code) >= 6 and not [cell for cell in code if cell["outputs"] or cell["execution_count"]]


def test_the_citation_is_of_this_version():
    assert yaml.safe_load((TOP / "CITATION.cff").read_text())["version"] == __version__


def test_every_promise_names_the_test_that_holds_it():
    rows = re.findall(r"^\| (?!promise )[A-Z].* \| (.*) \|$", PAGES["promises.md"], re.M)
    assert len(rows) >= 6
    for row in rows:
        named = re.findall(r"`((?:tests|scripts)/[^`]+)`", row)
        assert named and all((TOP / name).is_file() for name in named), row


@pytest.mark.parametrize("path", sorted((TOP / "configs").rglob("*.yaml")), ids=lambda path: path.name)
def test_every_yaml_loads(path):
    if path.name == "keywords.yaml":
        assert load_config(None, [f"keywords.file={path}"]).keywords.words == yaml.safe_load(path.read_text())
    elif path.name == "control.yaml":
        control = load_config(None, [f"control.file={path}", "search=global"]).control
        assert len(control.conditions) == len(yaml.safe_load(path.read_text())["conditions"])
    elif (plan := yaml.safe_load(path.read_text()) or {}).keys() & {"setups", "grid"}:
        listed = [Path(name).stem if isinstance(name, str) else next(iter(name)) for name in plan.get("setups", ())]
        assert list(load_plan(path).setups)[: len(listed)] == listed
    elif path.parent != TOP / "configs":
        plan = yaml.safe_load(path.parent.with_suffix(".yaml").read_text())
        assert plan["base"] == f"{path.parent.name}/{path.name}", "a config that no plan uses"
        assert isinstance(load_config(path), Config)
    else:
        assert isinstance(load_config(path), Config)


def test_the_papers_config_is_the_default():
    assert load_config(PAPER).signature() == load_config().signature()


def keys(model, prefix="") -> list[str]:
    found = []
    for name, field in model.model_fields.items():
        key = prefix + (field.alias or name)
        inner = field.annotation
        found += keys(inner, f"{key}.") if isinstance(inner, type) and hasattr(inner, "model_fields") else [key]
    return found


def values(sections, prefix="") -> dict:
    """The value of every setting in nested sections; a mapping that is a setting, such as words, is none."""
    found = {}
    for name, value in sections.items():
        key = prefix + name
        found |= values(value, f"{key}.") if key not in keys(Config) else {key: value}
    return found


def test_the_papers_configs_spell_out_every_setting():
    written = {path: values(yaml.safe_load(path.read_text())) for path in (PAPER, *OWN)}
    elsewhere = []
    for path, sections in OWN.items():
        own = [key for key in keys(Config) if key.split(".")[0] in sections]
        assert sorted(key for key in written[path] if key.split(".")[0] in sections) == sorted(own), path
        elsewhere += own
    assert [key for key in keys(Config) if key not in written[PAPER]] == sorted(elsewhere, key=keys(Config).index)


def test_the_gesture_master_config_changes_the_method_alone():
    written = values(yaml.safe_load(GESTURE_MASTER.read_text()))
    default = values(json.loads(Config().model_dump_json(by_alias=True)))
    assert {key: value for key, value in written.items() if value != default[key]} == {
        "method": "gesture_master",
        "references.mode": "all",
        "prosody.enabled": True,
        "blend.method": "overlap",
        "blend.l_blend": 4,
        "smoothing.enabled": True,
        "onsets.per_second": 2.0,
    }
    for section in ("prosody", "smoothing"):
        assert {key for key in keys(Config) if key.startswith(f"{section}.")} <= set(written)


def test_the_motion_matching_config_changes_the_method_alone():
    written = values(yaml.safe_load(MOTION_MATCHING.read_text()))
    default = values(json.loads(Config().model_dump_json(by_alias=True)))
    assert {key: value for key, value in written.items() if value != default[key]} == {
        "method": "motion_matching",
        "references.mode": "all",
        "acoustics.enabled": True,
        "blend.method": "inertialize",
        "onsets.per_second": 2.0,
    }


@pytest.mark.parametrize("path", [PAPER, *OWN], ids=lambda path: path.name)
def test_every_setting_has_a_comment(path):
    lines = path.read_text().splitlines()
    for number, line in enumerate(lines):
        if re.match(r" *[a-z_0-9]+: *[^# ]", line) and not line.startswith("joints:"):
            assert "#" in line, f"line {number + 1}: {line}"
        if line.startswith("joints:"):
            assert lines[number - 1].startswith("#")


def test_the_documents_name_every_measure_and_reference_mode():
    from gesturegen.evaluation import measures

    units = {"↓", "↑", "s", "cm/f", "cm/s", "cm/s²", "cm/s³", "cm²", "mean", "max", "30", "60", "90"}
    table = PAGES["measures.md"]
    for measure in measures(load_config()):
        words = measure.heading.split()
        bare = [word for word in words if word not in units] if words[0] not in units else words
        assert " ".join(bare) in table, measure.heading
    for mode in ("per_test_clip", "k", "speaker", "all", "list"):
        assert f"| `{mode}` |" in PAGES["config.md"]


def test_the_documents_name_every_array_of_a_matching_database():
    from gesturegen.methods.motion_matching.database import MatchingDatabase

    for name in MatchingDatabase.__dataclass_fields__:
        assert re.search(rf"`{name}[ `(]", PAGES["files.md"]) or name == "key_nodes", name


def test_help_is_quick_to_import():
    """Nothing heavy is imported before a command runs."""
    code = "import sys, gesturegen.cli; print([m for m in ('numpy', 'scipy', 'librosa', 'numba', 'pydantic') if m in sys.modules])"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"
