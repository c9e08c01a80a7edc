"""Compare the synthetic demo dataset with real recordings: measure both and hold the demo to stated ranges.

    python scripts/compare_demo.py DEMO_FOLDER REAL_FOLDER

Both folders have the GENEA layout (`trn/main-agent/bvh` and so on). Every reference clip is measured with
its speech, every test clip by its speech alone, and the means are printed with the range of each measure.
Exit code 1 when the demo leaves a range. Without REAL_FOLDER only the demo is measured.

The measures restate the definitions of the published system in plain numpy (the graph: at 25 joints,
positions relative to b_root, wrist cleaning off), so that they are also a check on the fast code.
"""

from __future__ import annotations

import sys
from itertools import pairwise
from pathlib import Path

import librosa
import numpy as np

from gesturegen.motion import bvh, kinematics
from gesturegen.motion.skeleton import Motion

_SIDED = ("shoulder", "arm", "arm_twist", "forearm", "wrist_twist", "wrist", "upleg", "leg", "foot")
JOINTS = (
    *("b_root", "b_spine0", "b_spine1", "b_spine2", "b_spine3", "b_neck0", "b_head"),
    *(f"b_{side}_{part}" for side in "rl" for part in _SIDED),
)
REST_SPEED = 5.0  # cm/s; both wrists slower than this: the frame is at rest

# measure: lowest, highest, meaning. The ranges hold for the mean over the clips of a
# demo set whose references last 60 to 120 s (longer ones have more edges per frame). They are wide
# enough to take in the real sample, a lively single speaker, except where the demo differs on purpose: it has
# long pauses with the hands at rest, which that speaker never makes.
RANGES: dict[str, tuple[float, float, str]] = {
    "onsets_per_second": (1.5, 2.4, "onset strength at least 5"),
    "peaks_per_second": (2.7, 4.8, "all onset peaks"),
    "words_per_second": (2.2, 3.5, "over the whole clip"),
    "word_share": (0.60, 0.92, "share of the time inside words"),
    "pauses_per_minute": (8.0, 18.0, "gaps between words over 0.2 s"),
    "long_pauses_per_minute": (2.0, 4.5, "gaps over 2 s; none in the real sample"),
    "wrist_speed_p10": (8.0, 20.0, "cm/s, both wrists, long pauses left out"),
    "wrist_speed_p50": (28.0, 55.0, "cm/s"),
    "wrist_speed_p90": (80.0, 130.0, "cm/s"),
    "rest_share": (0.02, 0.20, "share of all frames with both wrists below 5 cm/s; real sample 0.003"),
    "rest_share_in_pauses": (0.60, 1.0, "the same inside long pauses, from 1.2 s after to 0.5 s before a word"),
    "pause_speed": (0.0, 5.0, "cm/s, median wrist speed there"),
    "mean_acceleration": (90.0, 180.0, "cm/s^2, 25 joints"),
    "mean_jerk": (2000.0, 4000.0, "cm/s^3, 25 joints"),
    "head_speed": (8.0, 24.0, "cm/s, mean"),
    "foot_speed": (1.0, 13.0, "cm/s, mean; planted feet and steps"),
    "root_spread": (4.0, 30.0, "cm, standard deviation of b_root"),
    "candidates_per_frame": (3.0, 12.0, "graph candidates at l_cn = 5"),
    "edges_per_frame": (0.04, 0.16, "unnatural edges at l_pn = 10"),
}


def motion_measures(motion: Motion, words: np.ndarray) -> dict[str, float]:
    """Measure wrist speeds, rest, jerk and foot movement of one clip, from world positions by forward kinematics.

    words : start and end seconds of the words [shape=(W, 2)]
    """
    joints = [motion.skeleton.index(name) for name in JOINTS]
    positions = kinematics.joint_positions(motion, joints)
    speeds = np.linalg.norm(np.diff(positions, axis=0), axis=-1) * motion.fps
    wrists = speeds[:, [JOINTS.index("b_r_wrist"), JOINTS.index("b_l_wrist")]]
    feet = speeds[:, [JOINTS.index("b_r_foot"), JOINTS.index("b_l_foot")]]
    acceleration = np.linalg.norm(np.diff(positions, n=2, axis=0), axis=-1) * motion.fps**2
    jerk = np.linalg.norm(np.diff(positions, n=3, axis=0), axis=-1) * motion.fps**3
    times = (np.arange(len(speeds)) + 0.5) / motion.fps
    gaps = [(end, start) for (_, end), (start, _) in pairwise(words) if start - end > 2.0]
    speaking = (times > words[0, 0]) & (times < words[-1, 1])
    pausing = np.zeros(len(times), dtype=bool)
    for start, end in gaps:
        speaking &= (times < start) | (times > end)
        # A retraction takes its time, and the next preparation starts ahead of its word.
        pausing |= (times > start + 1.2) & (times < end - 0.5)
    p10, p50, p90 = np.percentile(wrists[speaking], (10, 50, 90))
    at_rest = (wrists < REST_SPEED).all(axis=1)
    measures = {
        "wrist_speed_p10": float(p10),
        "wrist_speed_p50": float(p50),
        "wrist_speed_p90": float(p90),
        "rest_share": float(at_rest.mean()),
        "mean_acceleration": float(acceleration.mean()),
        "mean_jerk": float(jerk.mean()),
        "head_speed": float(speeds[:, JOINTS.index("b_head")].mean()),
        "foot_speed": float(feet.mean()),
        "root_spread": float(np.linalg.norm(positions[:, 0].std(axis=0))),
    }
    if pausing.any():
        measures["rest_share_in_pauses"] = float(at_rest[pausing].mean())
        measures["pause_speed"] = float(np.median(wrists[pausing]))
    return measures


def graph_measures(motion: Motion, l_cn: int = 5, l_pn: int = 10) -> dict[str, float]:
    """Count candidates and unnatural edges per frame of the motion graph of one clip (§4.1.2), naively."""
    joints = [motion.skeleton.index(name) for name in JOINTS]
    positions = kinematics.relative_positions(motion, joints, joints[0], "root")
    p = positions.astype(np.float32).astype(np.float64).reshape(len(positions), -1)
    v = np.diff(p, axis=0, prepend=p[:1])
    v[0] = v[1]
    n = len(p)
    distances = _distances(p) + _distances(v)
    thresholds = np.array([distances[i, i + 1 : min(i + l_cn, n - 1) + 1].mean() for i in range(n - 1)])
    candidates = []
    for left in range(n - 1):
        found = np.flatnonzero(distances[left] < thresholds[left])
        candidates.append(found[(found != left) & (found != left + 1)])
    return {
        "candidates_per_frame": sum(map(len, candidates)) / n,
        "edges_per_frame": _count_pruned(candidates, n, l_pn) / n,
    }


def _distances(x: np.ndarray) -> np.ndarray:
    """Compute the Euclidean distances between all rows of `x`."""
    x = x - x.mean(axis=0)
    squares = (x * x).sum(axis=1)
    return np.sqrt(np.maximum(squares[:, None] + squares[None] - 2.0 * x @ x.T, 0.0))


def _count_pruned(candidates: list[np.ndarray], n: int, l_pn: int) -> int:
    """Count unnatural edges left by both prunings; `taken` marks cells within l_pn of an edge, roles swapped too."""
    taken = np.zeros((n, n), dtype=bool)

    def take(a: int, b: int) -> None:
        for i, j in ((a, b), (b, a)):
            taken[max(i - l_pn, 0) : i + l_pn + 1, max(j - l_pn, 0) : j + l_pn + 1] = True

    for frame in range(n - 1):
        take(frame, frame + 1)
    count = 0
    for left, found in enumerate(candidates):
        if not len(found):
            continue
        run_starts = np.flatnonzero(np.diff(found, prepend=found[0] - 2) != 1)
        place = np.arange(len(found)) - np.repeat(run_starts, np.diff(np.append(run_starts, len(found))))
        kept = [right for right in found[place % l_pn == 0] if not taken[left, right]]
        for right in kept:
            take(left, int(right))
        count += len(kept)
    return count


def read_words(path: Path) -> np.ndarray:
    """Read start and end seconds of the words `[shape=(W, 2)]`, a cell of several words split evenly."""
    spans = []
    for line in path.read_text().splitlines():
        start, end, text = line.split("\t")
        edges = np.linspace(float(start), float(end), len(text.split()) + 1)
        spans += list(pairwise(edges))
    return np.array(spans)


def speech_measures(wav: Path, words: np.ndarray) -> dict[str, float]:
    """Measure onsets and words per second of one clip, and its pauses."""
    samples, rate = librosa.load(wav, sr=22050)
    envelope = librosa.onset.onset_strength(y=samples, sr=rate, hop_length=512)
    peaks = librosa.onset.onset_detect(onset_envelope=envelope, sr=rate, hop_length=512)
    seconds = len(samples) / rate
    gaps = words[1:, 0] - words[:-1, 1]
    return {
        "onsets_per_second": float(np.sum(envelope[peaks] >= 5.0)) / seconds,
        "peaks_per_second": len(peaks) / seconds,
        "words_per_second": len(words) / seconds,
        "word_share": float(np.sum(words[:, 1] - words[:, 0])) / seconds,
        "pauses_per_minute": 60.0 * float(np.sum(gaps > 0.2)) / seconds,
        "long_pauses_per_minute": 60.0 * float(np.sum(gaps > 2.0)) / seconds,
    }


def measure(folder: Path, limit: int | None = None) -> dict[str, tuple[float, float, float]]:
    """Compute mean, lowest and highest of every measure over the clips of `folder`."""
    values: dict[str, list[float]] = {}
    for wav in sorted(folder.glob("*/main-agent/wav/*.wav"))[:limit]:
        split = wav.parent.parent
        words = read_words(split / "tsv" / f"{wav.stem}.tsv")
        found = speech_measures(wav, words)
        path = split / "bvh" / f"{wav.stem}.bvh"
        if path.exists():
            motion = bvh.read(path)
            found |= motion_measures(motion, words) | graph_measures(motion)
        for name, value in found.items():
            values.setdefault(name, []).append(value)
    return {name: (float(np.mean(v)), min(v), max(v)) for name, v in values.items()}


def main(arguments: list[str]) -> int:
    """Print the table; return 1 when the demo leaves a range, 2 for wrong arguments."""
    if not 1 <= len(arguments) <= 2:
        print(__doc__)
        return 2
    demo = measure(Path(arguments[0]))
    real = measure(Path(arguments[1])) if len(arguments) == 2 else {}
    print(f"{'measure':24}{'real':>9}{'demo':>9}{'demo low..high':>20}{'range':>14}  inside  meaning")
    outside = 0
    for name, (mean, low, high) in demo.items():
        least, most, meaning = RANGES[name]
        inside = least <= mean <= most
        outside += not inside
        reality = f"{real[name][0]:9.3f}" if name in real else f"{'-':>9}"
        spread = f"{low:.3f}..{high:.3f}"
        allowed = f"{least:g}..{most:g}"
        print(f"{name:24}{reality}{mean:9.3f}{spread:>20}{allowed:>14}  {'yes' if inside else 'NO':6}  {meaning}")
    return 1 if outside else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
