"""What is written is true: every command has help, every YAML loads, every setting is explained."""

import json
import re
import shlex
from pathlib import Path

import click
import pytest
import yaml
from click.testing import CliRunner

from gesturegen.cli import main
from gesturegen.experiment.plan import load_plan
from gesturegen.settings.loading import load_config
from gesturegen.settings.models import Config

TOP = Path(__file__).parent.parent
README = (TOP / "README.md").read_text()
PAPER = TOP / "configs/casia_go_2023.yaml"
GESTURE_MASTER = TOP / "configs/gesture_master_2022.yaml"
MOTION_MATCHING = TOP / "configs/motion_matching_2022.yaml"
# Settings that are spelled out in the config of the one method that has them.
OWN = {
    GESTURE_MASTER: ("gesture_master",),
    MOTION_MATCHING: ("acoustics", "motion_matching", "refine", "refiner"),
}


@pytest.mark.parametrize("name", sorted(main.commands))
def test_every_command_has_help_with_an_example_and_is_in_the_readme(name):
    result = CliRunner().invoke(main, [name, "--help"])
    assert result.exit_code == 0 and f"  gesturegen {name}" in result.output
    assert f"gesturegen {name}" in README


def test_every_command_line_of_the_readme_parses():
    lines = re.findall(r"^    (gesturegen .*?)(?: {2,}#.*)?$", README, re.M)
    assert len(lines) >= 6
    for line in lines:
        words = shlex.split(line)[1:]
        command = main.commands[words[0]]
        with click.Context(command) as context:
            command.parse_args(context, words[1:])


def test_every_option_of_the_readme_exists():
    known = {option for command in main.commands.values() for parameter in command.params for option in parameter.opts}
    used = set(re.findall(r"(?<![\w-])--[a-z][a-z-]+", README))
    assert used <= known


def test_every_make_target_of_the_readme_exists():
    makefile = (TOP / "Makefile").read_text()
    for target in re.findall(r"make ([a-z-]+)", README):
        assert re.search(rf"^{target}:", makefile, re.M), target


def test_every_promise_names_the_test_that_holds_it():
    promises = README.partition("## What is promised\n")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| (?!promise )[A-Z].* \| (.*) \|$", promises, re.M)
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


def test_the_readme_names_every_measure_and_reference_mode():
    from gesturegen.evaluation import measures

    units = {"↓", "↑", "s", "cm/f", "cm/s", "cm/s²", "cm/s³", "cm²", "mean", "max", "30", "60", "90"}
    table = README[README.index("## What the figures mean") : README.index("## Files")]
    for measure in measures(load_config()):
        words = measure.heading.split()
        bare = [word for word in words if word not in units] if words[0] not in units else words
        assert " ".join(bare) in table, measure.heading
    for mode in ("per_test_clip", "k", "speaker", "all", "list"):
        assert f"| `{mode}` |" in README


def test_the_readme_names_every_array_of_a_matching_database():
    from gesturegen.methods.motion_matching.database import MatchingDatabase

    for name in MatchingDatabase.__dataclass_fields__:
        assert re.search(rf"`{name}[ `(]", README) or name == "key_nodes", name


def test_help_is_quick_to_import():
    """Nothing heavy is imported before a command runs."""
    import subprocess
    import sys

    code = "import sys, gesturegen.cli; print([m for m in ('numpy', 'scipy', 'librosa', 'numba', 'pydantic') if m in sys.modules])"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"
