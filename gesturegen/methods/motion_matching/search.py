"""k-NN motion matching (Habibie et al. 2022): every half second the piece of motion that goes on best and sounds best.

All test clips that share a database are searched for together: a step of all of them is one matrix product.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gesturegen.control import hands, schedule
from gesturegen.data.clips import Speech
from gesturegen.errors import DataError, GesturegenError
from gesturegen.methods.motion_matching import features, nearest
from gesturegen.methods.motion_matching.database import MatchingDatabase, step_frames
from gesturegen.path import Path, Piece, Target, Track
from gesturegen.randomness import generator
from gesturegen.settings.models import Config


def search(
    library: MatchingDatabase, speech: Speech, config: Config, rng: np.random.Generator, earlier: Sequence[Path] = ()
) -> Path:
    """Find the pieces for one test speech (`search_all`).

    earlier : other variants of this clip; the k-th best pieces are shown in the k-th variant
    """
    found = _search(library, {speech.name: speech}, config, {speech.name: rng}, len(earlier))
    result = found[speech.name]
    if isinstance(result, GesturegenError):
        raise result
    return result


def search_all(
    library: MatchingDatabase, speeches: Mapping[str, Speech], config: Config
) -> dict[str, Path | GesturegenError]:
    """Find the pieces for all test speeches at once (§3.1.2), by name; an error for an uncontrollable clip."""
    return _search(library, speeches, config, {name: generator(config.seed, name) for name in speeches}, 0)


def _search(
    library: MatchingDatabase, speeches: Mapping[str, Speech], config: Config,
    rngs: Mapping[str, np.random.Generator], later: int,
) -> dict[str, Path | GesturegenError]:  # fmt: skip
    step, asked = step_frames(config), {}
    results: dict[str, Path | GesturegenError] = {}
    for name, speech in speeches.items():
        try:
            asked[name] = _Asked(library, speech, config, rngs[name], step)
        except GesturegenError as error:
            results[name] = error
    settings = config.motion_matching.model_copy(update={"k": config.motion_matching.k + later})
    found = nearest.search(
        library.candidates,
        [one.audio for one in asked.values()],
        np.array([one.first_pose for one in asked.values()]).reshape(len(asked), -1),
        step,
        settings,
        [one.allowed for one in asked.values()],
        [one.prices for one in asked.values()],
    ) if asked else []  # fmt: skip
    for (name, one), match in zip(asked.items(), found, strict=True):
        results[name] = one.path(match)
    return results


class _Asked:
    """The inputs of the search for one test clip: sound, first pose, masks and prices."""

    def __init__(self, library: MatchingDatabase, speech: Speech, config: Config, rng: np.random.Generator, step: int):
        if speech.acoustics is None:
            raise DataError(f"clip {speech.name}: its sound was not measured; set acoustics.enabled: true")
        self.speech, self.step = speech, step
        settings = config.motion_matching
        self.starts = np.arange(0, speech.n_frames, step)
        sound = features.audio_features(speech.acoustics, self.starts / speech.fps, settings)
        self.audio = features.apply(library.audio_scaling, sound)
        self.first_pose = _first_pose(library, config, rng)
        self.allowed: list[np.ndarray | None] | None = None
        self.prices: list[np.ndarray | None] | None = None
        self.demands: tuple[schedule.Demand, ...] = ()
        if config.control.conditions:
            values = hands.of_nodes(library, config.hands)
            self.demands = schedule.demands(config.control, speech.name, speech.n_frames, speech.fps, values)
            self._restrict(values)

    def _restrict(self, values: schedule.Measures) -> None:
        """Set masks and prices of each step: demands where it begins or ends are looked up at both of its ends.

        Of demands on the same thing that follow one another within a step, the one that holds longer in it counts:
        together they may well contradict each other.
        """
        met, far = schedule.satisfied(self.demands, values), schedule.violations(self.demands, values)
        allowed: list[np.ndarray | None] = []
        prices: list[np.ndarray | None] = []
        for start in self.starts.tolist():
            end = min(start + self.step, self.speech.n_frames) - 1
            shares = {
                k: min(demand.end_frame, end + 1) - max(demand.start_frame, start)
                for k, demand in enumerate(self.demands)
                if any(demand.start_frame <= frame < demand.end_frame for frame in (start, end))
            }
            longest = {self.demands[k].key: k for k in sorted(shares, key=shares.__getitem__)}
            active = sorted(longest.values())
            hard = [k for k in active if self.demands[k].hard]
            soft = [k for k in active if not self.demands[k].hard]
            allowed.append(np.asarray(met[hard].all(axis=0)) if hard else None)
            prices.append(np.asarray(sum(self.demands[k].price * far[k] for k in soft)) if soft else None)
        self.allowed, self.prices = allowed, prices

    def path(self, match: nearest.Found) -> Path | GesturegenError:
        """Convert what the search found to a path, or to the error of a clip for which it found too little."""
        if match.failed is not None:
            seconds = self.starts[match.failed] / self.speech.fps
            return DataError(
                f"clip {self.speech.name}: from {seconds:.2f} s no sequence of its references has a stretch of "
                f"{self.step} frames that may be shown; ask for less (control), or give longer references"
            )
        pieces = []
        for k, start in enumerate(self.starts.tolist()):
            end = min(start + self.step, self.speech.n_frames)
            nodes = match.nodes[k * self.step : (k + 1) * self.step][: end - start]
            costs = {"pose": float(match.pose_distances[k]), "audio": float(match.audio_distances[k])}
            ranks = float(match.pose_ranks[k] + match.audio_ranks[k])
            pieces.append(Piece(Target(start, end, "step"), nodes, ranks, costs=costs))
        return Path((Track(tuple(pieces)),), demands=self.demands)


def _first_pose(library: MatchingDatabase, config: Config, rng: np.random.Generator) -> np.ndarray:
    """Choose the pose that the first step goes on from (§3.1.2): of a random frame, the mean, or of a given frame."""
    settings = config.motion_matching
    if settings.start == "mean":
        return np.zeros(library.pose.shape[1], dtype=np.float32)
    if settings.start == "random":
        return library.pose[rng.integers(library.n_nodes)]
    assert settings.start_pose is not None  # the settings are refused without it
    clip, _, seconds = settings.start_pose.rpartition("@")
    if clip not in library.clip_names or not _is_number(seconds):
        raise DataError(
            f"motion_matching.start_pose: {settings.start_pose!r} is no frame of the references; give one of "
            f"{', '.join(library.clip_names[:3])} and a time, such as {library.clip_names[0]}@1.50"
        )
    number = library.clip_names.index(clip)
    last = np.append(library.clip_starts[1:], library.n_nodes)[number]
    own = slice(library.clip_starts[number], last)
    node = library.clip_starts[number] + np.argmin(np.abs(library.source_frames[own] - float(seconds) * library.fps))
    return library.pose[node]


def _is_number(text: str) -> bool:
    try:
        return np.isfinite(float(text))
    except ValueError:
        return False
