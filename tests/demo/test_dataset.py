"""The demo dataset on disk: layout, determinism, and files that our own readers accept."""

import hashlib

import numpy as np
import pytest
import soundfile

from gesturegen import demo
from gesturegen.demo.skeleton import CHANNELS
from gesturegen.errors import ConfigError
from gesturegen.motion import bvh

SECONDS = {"reference_seconds": (20.0, 24.0), "test_seconds": (20.0, 22.0)}


def digests(folder):
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.rglob("*.*")
        if path.is_file()
    }


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    folder = tmp_path_factory.mktemp("demo")
    specs = demo.clip_specs(references=2, tests=1, seed=7, **SECONDS)
    paths = [path for spec in specs for path in demo.write_clip(folder, spec)] + demo.write_metadata(folder, specs)
    return folder, paths, specs


def test_layout(dataset):
    folder, paths, specs = dataset
    assert (
        {str(path.relative_to(folder)) for path in paths}
        == set(digests(folder))
        == {
            "trn/metadata.csv",
            "tst/metadata.csv",
            *(
                f"trn/main-agent/{kind}/trn_2023_v0_{number}_main-agent.{kind}"
                for kind in ("bvh", "wav", "tsv")
                for number in ("000", "001")
            ),
            "tst/main-agent/wav/tst_2023_v0_000_main-agent.wav",
            "tst/main-agent/tsv/tst_2023_v0_000_main-agent.tsv",
            "truth/main-agent/bvh/tst_2023_v0_000_main-agent.bvh",
        }
    )
    rows = (folder / "trn" / "metadata.csv").read_text().splitlines()
    assert rows[0] == "prefix,main-agent_id,main-agent_has_fingers,interloctr_id,interloctr_has_fingers"
    assert [row.split(",")[:3] for row in rows[1:]] == [
        ["trn_2023_v0_000", "1", "fingers_incl"],
        ["trn_2023_v0_001", "2", "fingers_incl"],
    ]
    assert [spec.name for spec in specs] == [
        "trn_2023_v0_000_main-agent",
        "trn_2023_v0_001_main-agent",
        "tst_2023_v0_000_main-agent",
    ]


def test_motion_files(dataset):
    folder, _, _ = dataset
    for split, home in (("trn", "trn"), ("tst", "truth")):
        for wav in sorted((folder / split / "main-agent" / "wav").glob("*.wav")):
            info = soundfile.info(wav)
            assert (info.samplerate, info.channels, info.subtype) == (16000, 1, "PCM_16")
            motion = bvh.read(folder / home / "main-agent" / "bvh" / f"{wav.stem}.bvh")
            assert motion.fps == 30.0
            assert motion.n_frames == round(info.duration * 30)
            assert len(motion.skeleton.names) == 83
            assert motion.skeleton.n_channels == 498
            assert np.isfinite(motion.skeleton.end_sites).all(axis=1).sum() == 27
            assert all(channels == CHANNELS for channels in motion.skeleton.channels)
            # Only body_world travels; every other position channel repeats its OFFSET.
            assert np.array_equal(
                motion.positions[:, 1:], np.tile(motion.skeleton.offsets[1:], (motion.n_frames, 1, 1))
            )
            assert np.ptp(motion.positions[:, 0], axis=0).max() > 1.0


def test_words_are_in_the_clip_and_in_order(dataset):
    folder, _, _ = dataset
    for tsv in folder.glob("*/main-agent/tsv/*.tsv"):
        seconds = soundfile.info(tsv.parent.parent / "wav" / f"{tsv.stem}.wav").duration
        rows = [line.split("\t") for line in tsv.read_text().splitlines()]
        assert len(rows) > 20
        times = np.array([[float(start), float(end)] for start, end, _ in rows])
        assert times.min() >= 0.0 and times.max() <= seconds
        assert (times[:, 1] > times[:, 0]).all() and (times[1:, 0] >= times[:-1, 1]).all()


def test_clip_depends_only_on_its_spec(dataset, tmp_path):
    folder, _, _ = dataset
    for spec in demo.clip_specs(references=1, tests=1, seed=7, **SECONDS):
        demo.write_clip(tmp_path, spec)
    there, here = digests(folder), digests(tmp_path)
    assert len(here) == 6
    assert all(here[name] == there[name] for name in here)


def test_seed_changes_the_clip(dataset, tmp_path):
    folder, _, _ = dataset
    (spec,) = demo.clip_specs(references=1, tests=0, seed=8, **SECONDS)
    for path in demo.write_clip(tmp_path, spec):
        assert path.read_bytes() != (folder / path.relative_to(tmp_path)).read_bytes()


def test_challenge_sized_specs():
    specs = demo.clip_specs(references=70, tests=70, seed=0, **demo.CHALLENGE_SECONDS)
    references = np.array([spec.seconds for spec in specs if spec.split == "trn"])
    tests = np.array([spec.seconds for spec in specs if spec.split == "tst"])
    assert len(references) == len(tests) == 70
    assert references.min() >= 60.0 and references.max() <= 427.0 and 150.0 < references.mean() < 190.0
    assert tests.min() >= 60.0 and tests.max() <= 77.0 and 61.5 < tests.mean() < 63.5
    assert {spec.speaker for spec in specs} == {1, 2, 3, 4, 5, 6}


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"references": -1, "tests": 1, "seed": 0}, "none may be negative"),
        ({"references": 1, "tests": 1, "seed": 0, "test_seconds": (30.0, 20.0)}, "30 to 20 s"),
        ({"references": 1, "tests": 1, "seed": 0, "reference_seconds": (1.0, 20.0)}, "allowed are 10 to 3600"),
    ],
)
def test_bad_sizes_are_refused(values, message):
    with pytest.raises(ConfigError, match=message):
        demo.clip_specs(**values)
