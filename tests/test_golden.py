"""One tiny speaker through the commands gives what it gave before (`scripts/regenerate_golden.py`)."""

import csv
import json

import numpy as np
import pytest

from gesturegen.motion import bvh, rotation
from scripts.regenerate_golden import GOLDEN, run_commands

EXPECTED = GOLDEN / "expected"


@pytest.fixture(scope="module")
def work(tmp_path_factory):
    folder = tmp_path_factory.mktemp("golden")
    run_commands(folder)
    return folder


def test_the_trace(work):
    found, expected = (
        json.loads((folder / "tst_tiny.trace.json").read_text()) for folder in (work / "reenact", EXPECTED)
    )
    for piece, before in zip(found["pieces"], expected["pieces"], strict=True):
        assert piece == {**before, "cost": pytest.approx(before["cost"], abs=1e-4)}
    for join, before in zip(found["joins"], expected["joins"], strict=True):
        assert join == {**before, "distance": pytest.approx(before["distance"], abs=1e-3)}
    changing = {"pieces", "joins", "version", "inputs", "bvh_sha256", "checksum"}
    assert {k: v for k, v in found.items() if k not in changing} == {
        k: v for k, v in expected.items() if k not in changing
    }
    kinds = {piece["end_kind"] for piece in expected["pieces"]}
    assert kinds == {"onset", "keyword", "break"}, "the golden speaker no longer covers every kind of piece"


def test_the_motion(work):
    found, expected = bvh.read(work / "reenact/tst_tiny.bvh"), bvh.read(EXPECTED / "tst_tiny.bvh")
    assert found.skeleton.hierarchy == expected.skeleton.hierarchy
    assert found.n_frames == expected.n_frames
    assert rotation.angle_between(found.rotations, expected.rotations).max() < 1e-5
    assert np.abs(found.positions - expected.positions).max() < 1e-4


def test_the_figures(work):
    with (work / "evaluate/metrics.csv").open() as found, (EXPECTED / "metrics.csv").open() as expected:
        for row, before in zip(csv.DictReader(found), csv.DictReader(expected), strict=True):
            for key, value in before.items():
                if key == "version":
                    continue
                try:
                    assert float(row[key]) == pytest.approx(float(value), rel=1e-4, abs=1e-6), key
                except ValueError:
                    assert row[key] == value, key
