"""Silence and rest, from files to figures: pauses cut into test speeches must show the reference's pauses."""

import itertools
from pathlib import Path

import numpy as np
import pytest
import soundfile

from gesturegen import demo, files
from tests.builders import data_folder
from tests.commands import succeed

# Seconds of silence that are cut into every test speech.
PAUSES = (2.0, 3.0, 4.0, 5.0, 6.0)
BEST = str(Path(__file__).parent.parent / "configs" / "best.yaml")


def cut_in(agent: Path, name: str) -> None:
    """Cut silences between words into a test clip's WAV and TSV, in place, evenly over the speech."""
    sound, transcript = agent / "wav" / f"{name}.wav", agent / "tsv" / f"{name}.tsv"
    samples, rate = soundfile.read(sound)
    rows = [line.split("\t") for line in transcript.read_text().splitlines()]
    words = [(float(start), float(end), text) for start, end, text in rows]
    between = [(a[1] + b[0]) / 2 for a, b in itertools.pairwise(words) if b[0] >= a[1]]
    wanted = np.arange(1, len(PAUSES) + 1) / (len(PAUSES) + 1) * len(samples) / rate
    places = [min(between, key=lambda place: abs(place - time)) for time in wanted]
    assert len(set(places)) == len(PAUSES)
    parts, last = [], 0
    for place, seconds in zip(places, PAUSES, strict=True):
        here = round(place * rate)
        parts += [samples[last:here], np.zeros(round(seconds * rate))]
        last = here
    soundfile.write(sound, np.concatenate([*parts, samples[last:]]), rate, subtype="PCM_16")

    def later(start: float, time: float) -> float:
        """A time of the word that starts at `start`: it stays on one side of every pause."""
        return time + sum(seconds for place, seconds in zip(places, PAUSES, strict=True) if start >= place)

    lines = [f"{later(start, start):.6f}\t{later(start, end):.6f}\t{text}\n" for start, end, text in words]
    transcript.write_text("".join(lines))


def rest(data: Path, work: Path) -> dict[str, dict[str, float]]:
    """The figures of every test clip of a dataset whose speeches got pauses, with the recommended settings."""
    agent = data / "tst" / "main-agent"
    names = sorted(path.stem for path in (agent / "wav").iterdir())
    for name in names:
        cut_in(agent, name)
    options = ["--config", BEST, "--data", data, "--work", work, "-j", "2", "--quiet"]
    for command in ("preprocess", "build-graph", "reenact", "evaluate"):
        succeed(command, *options)
    for name in names:
        trace = files.read_json(work / "reenact" / f"{name}.trace.json")
        longest = max(end - start for start, end in trace["pauses"])
        assert longest >= 6.0 * trace["fps"] - 1
    return files.read_json(work / "evaluate" / "summary.json")["clips"]


def check(figures: dict[str, dict[str, float]]) -> None:
    for name, row in figures.items():
        print(name, {key: row[key] for key in ("pause_share", "pause_speed_ratio", "seam_jerk", "wrist_speed_ratio")})
        assert row["pause_share"] >= 0.8, name
        assert row["pause_speed_ratio"] <= 1.2, name
        # Slow, but no statue.
        assert row["pause_speed"] > 1.0, name


@pytest.mark.slow
def test_hands_rest_in_the_pauses_of_the_demo(tmp_path):
    for spec in demo.clip_specs(references=2, tests=2, seed=0):
        demo.write_clip(tmp_path / "data", spec)
    check(rest(tmp_path / "data", tmp_path / "work"))


@pytest.mark.slow
def test_hands_rest_in_pauses_cut_into_the_real_sample(tmp_path):
    source = data_folder() / "genea_style_sample"
    for path in sorted(source.rglob("*")):
        if path.is_file():
            copy = tmp_path / "data" / path.relative_to(source)
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_bytes(path.read_bytes())
    check(rest(tmp_path / "data", tmp_path / "work"))
