"""gesturegen as a library: the same bytes as the command line, and one-line errors."""

import doctest
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import gesturegen as gg
from gesturegen import api
from gesturegen.demo import dataset
from gesturegen.errors import ConfigError, DataError
from tests.builders import write_dataset
from tests.commands import succeed

SETTINGS = {"joints": "all", "wrists.enabled": False}
OPTIONS = [option for key, value in SETTINGS.items() for option in ("--set", f"{key}={json.dumps(value)}")]


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    return write_dataset(tmp_path_factory.mktemp("api") / "data")


def recording(data: Path, split: str, name: str, *kinds: str) -> tuple[Path, ...]:
    return tuple(data / split / "main-agent" / kind / f"{name}.{kind}" for kind in kinds)


def test_the_same_bytes_as_the_command_line(data, tmp_path):
    gesturer = gg.Gesturer("casia_go_2023", SETTINGS)
    gesturer.fit([recording(data, "trn", name, "bvh", "wav", "tsv") for name in ("trn_a", "trn_b")])
    options = ["--data", data, "--work", tmp_path / "work", "--set", "references.mode=all", *OPTIONS, "-j", 1]
    for command in ("preprocess", "build-graph", "reenact"):
        succeed(command, *options)
    for name in ("tst_a", "tst_b"):
        gesture = gesturer.gesture(*recording(data, "tst", name, "wav", "tsv"))
        gesture.save(tmp_path / "one.bvh")
        assert (tmp_path / "one.bvh").read_bytes() == (tmp_path / f"work/reenact/{name}.bvh").read_bytes()
        assert gesture.trace.clip == name and gesture.motion.n_frames == gesture.trace.n_frames == 60
        gesture.export(tmp_path / "one.csv")
        assert len((tmp_path / "one.csv").read_text().splitlines()) == 61
        again = gg.read_motion(tmp_path / "one.bvh")
        np.testing.assert_array_equal(again.rotations, gesture.motion.rotations)
    with pytest.raises(ConfigError, match=r"one\.fbx: motions are exported as"):
        gesture.export(tmp_path / "one.fbx")


def test_measures_are_those_of_evaluate(data, tmp_path):
    (bvh, wav) = recording(data, "trn", "trn_a", "bvh", "wav")
    folder = bvh.parent
    succeed(
        "evaluate", "--config", "best", "--bvh", folder, "--truth", folder, "--audio", wav.parent, "--work", tmp_path,
        *OPTIONS, "-j", 1,
    )  # fmt: skip
    written = json.loads((tmp_path / "evaluate/summary_files.json").read_text())["clips"]["trn_a"]
    found = gg.measure(gg.read_motion(bvh), wav, truth=bvh, config=_tiny(tmp_path))
    compared = [key for key in written if isinstance(written[key], float) and found.get(key) is not None]
    assert len(compared) > 10
    np.testing.assert_allclose([found[key] for key in compared], [written[key] for key in compared])


def _tiny(folder: Path) -> Path:
    (folder / "tiny.yaml").write_text("joints: all\nwrists: {enabled: false}\nsearch: global\n")
    return folder / "tiny.yaml"


def test_speech_is_on_the_frame_grid(data):
    speech = gg.read_speech(*recording(data, "tst", "tst_a", "wav", "tsv"))
    assert speech.n_frames == 60 and [word.text for word in speech.words] == ["hello", "there"]


def test_what_cannot_be_used_is_told_in_one_line(data, tmp_path):
    gesturer = gg.Gesturer("casia_go_2023", SETTINGS)
    with pytest.raises(DataError, match="call `fit` first"):
        gesturer.gesture(tmp_path / "a.wav")
    with pytest.raises(DataError, match=r"none\.bvh: no such file"):
        gesturer.fit([(tmp_path / "none.bvh", tmp_path / "none.wav")])
    with pytest.raises(DataError, match="two recordings are called trn_a"):
        gesturer.fit([recording(data, "trn", "trn_a", "bvh", "wav")] * 2)
    with pytest.raises(ConfigError, match="neither a file"):
        gg.Gesturer("bset")
    (tmp_path / "a.wav").write_bytes(b"RIFF")
    gesturer.fit([recording(data, "trn", "trn_a", "bvh", "wav")])
    with pytest.raises(DataError, match=re.escape(f"{tmp_path}/a.wav: ")):
        gesturer.gesture(tmp_path / "a.wav")


def test_the_examples_of_the_docstrings_do_what_they_say(tmp_path, monkeypatch):
    for split, seconds, name in (("trn", 12.0, "take"), ("tst", 8.0, "speech")):
        spec = dataset.ClipSpec(split, 0, seconds, seed=1, speaker=1)
        dataset.write_clip(tmp_path, spec)
        for kind in ("bvh", "wav", "tsv"):
            written = tmp_path / split / "main-agent" / kind / f"{spec.name}.{kind}"
            if written.exists():
                written.rename(tmp_path / f"{name}.{kind}")
    monkeypatch.chdir(tmp_path)
    result = doctest.testmod(api)
    assert result.failed == 0 and result.attempted >= 15


def test_importing_costs_nothing():
    code = "import sys, gesturegen; print([m for m in ('numpy', 'librosa', 'pydantic', 'click') if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"
