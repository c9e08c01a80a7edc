"""Adversarial training of the refiner's two networks, and the use of a trained refiner.

Habibie et al. 2022, sections 3.2 and 3.3: a Wasserstein GAN with gradient penalty whose generator is also held near
the k-NN's gesture. On a CPU a run is a function of its pairs, settings and seed alone, bit by bit, whether it was
interrupted or not.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from gesturegen import randomness
from gesturegen.errors import DataError
from gesturegen.files import write_bytes
from gesturegen.motion.skeleton import read_only
from gesturegen.refine import checkpoints
from gesturegen.refine.network import Critic, Generator
from gesturegen.refine.representation import Description, Normalisation
from gesturegen.settings.models import Refiner

# Settings that a run may be taken up with when they have changed: they say how long, not how.
_MAY_CHANGE = frozenset({"enabled", "checkpoint", "iterations", "patience", "device", "stride_seconds", "furthest_k"})
# Held-out windows that a check looks at, spread over all of them.
_CHECKED_WINDOWS = 256
_CHECKED_AT_ONCE = 64


@dataclass(frozen=True, eq=False)
class Pairs:
    """Windows of speech, each with the gesture that the k-NN retrieved and the recorded one.

    audio : float32 [shape=(K, A, T)]
    fake, real : float32 [shape=(K, C, T)], `representation.to_channels` transposed, not normalised
    groups : int [shape=(K,)], the recording each window is of
    """

    audio: np.ndarray
    fake: np.ndarray
    real: np.ndarray
    groups: np.ndarray

    def __post_init__(self) -> None:
        for name in ("audio", "fake", "real", "groups"):
            object.__setattr__(self, name, read_only(getattr(self, name)))
        windows, _, frames = self.audio.shape
        if self.fake.shape != self.real.shape or (len(self.fake), self.fake.shape[2]) != (windows, frames):
            raise ValueError(f"audio {self.audio.shape}, fake {self.fake.shape}, real {self.real.shape} do not fit")
        if self.groups.shape != (windows,):
            raise ValueError(f"groups has shape {self.groups.shape}, expected {(windows,)}")

    def take(self, windows: np.ndarray) -> Pairs:
        """Select windows by number."""
        return Pairs(self.audio[windows], self.fake[windows], self.real[windows], self.groups[windows])


@dataclass(eq=False)
class History:
    """The course of training; channels count in standard deviations of the training data.

    reconstruction : [shape=(n,)], per iteration the mean |G_syn - G_kNN| over windows, channels and frames
    distance : [shape=(n,)], per iteration D(real) - D(G_syn), the critic's estimate of the Wasserstein distance
    gradient_norm : [shape=(n,)], per iteration the mean norm of the critic's gradient where it is penalised
    checks, figures : iterations after which held-out windows were looked at, and what `held_out_figure` said;
        the k-NN's gestures as they are would have 1
    stopped : whether training ended because the figures no longer fell
    """

    reconstruction: list[float] = field(default_factory=list)
    distance: list[float] = field(default_factory=list)
    gradient_norm: list[float] = field(default_factory=list)
    checks: list[int] = field(default_factory=list)
    figures: list[float] = field(default_factory=list)
    stopped: bool = False

    @property
    def iterations(self) -> int:
        """Number of iterations so far."""
        return len(self.reconstruction)

    @property
    def best(self) -> int:
        """Number of the check with the lowest figure; the first of equals."""
        return int(np.argmin(self.figures))


# --- losses -------------------------------------------------------------------------------------------------


def scores_and_slopes(critic: torch.nn.Module, audio: Tensor, gesture: Tensor) -> tuple[Tensor, Tensor]:
    """Compute per window the critic's score and the norm of its gradient by the gesture.

    The norm is over all channels and frames.

    Both `[shape=(B,)]`, both differentiable by the critic's weights.
    """
    gesture = gesture.detach().requires_grad_()
    scores = critic(audio, gesture)
    (gradient,) = torch.autograd.grad(scores.sum(), gesture, create_graph=True)
    return scores, gradient.flatten(1).norm(dim=1)


def gradient_penalty(norms: Tensor) -> Tensor:
    """Compute the mean of (norm - 1)^2, as in equation 2; `_Run.step` says where the norms are taken."""
    return ((norms - 1.0) ** 2).mean()


def reconstruction(gesture: Tensor, refined: Tensor) -> Tensor:
    """Compute the L1 distance of two poses, summed over channels, as a mean over frames and windows.

    The text writes L1 and no more. The gradient penalty holds the adversarial gradient of a window at length 1; a
    mean over channels as well would pull with a thousandth of that, a sum over frames as well with ten times that.
    """
    return (refined - gesture).abs().sum(dim=1).mean()


def critic_loss(real_scores: Tensor, refined_scores: Tensor, norms: Tensor, settings: Refiner) -> Tensor:
    """Compute the loss of the critic, which raises D(real) - D(syn).

    The paper prints D(real) - D(syn) for both players.
    """
    adversarial = refined_scores.mean() - real_scores.mean()
    return settings.w_adversarial * adversarial + settings.w_penalty * gradient_penalty(norms)


def generator_loss(refined_scores: Tensor, gesture: Tensor, refined: Tensor, settings: Refiner) -> Tensor:
    """Compute the loss of the generator, which lowers D(real) - D(syn), of which only -D(syn) depends on it."""
    near = settings.w_reconstruction * reconstruction(gesture, refined)
    return near - settings.w_adversarial * refined_scores.mean()


# --- training -----------------------------------------------------------------------------------------------


def train(
    pairs: Pairs,
    settings: Refiner,
    seed: int,
    checkpoint_path: str | Path,
    description: Description,
    resume: bool = True,
    progress: Callable[[int, History], Any] | None = None,
) -> History:
    """Train for `settings.iterations`, or until the held-out figure has not fallen for `settings.patience` checks.

    An iteration is one step of the critic and one of the generator on the same windows: the text alternates, and on
    one core the five critic steps of Gulrajani et al. 2017 would leave a fifth of the generator's. Every
    `check_every` iterations, and at the end, everything is written to `checkpoint_path`, all or nothing; with
    `resume` a run goes on from what is there. `progress` is called after every iteration.
    """
    checkpoint_path = Path(checkpoint_path)
    if pairs.fake.shape[1] != description.channels:
        raise ValueError(f"{pairs.fake.shape[1]} channels for {len(description.joints)} joints")
    with _one_thread():
        run = _Run(pairs, settings, seed, description)
        if resume and checkpoint_path.exists():
            run.restore(checkpoints.load(checkpoint_path), checkpoint_path)
        while not run.finished():
            run.step()
            if run.history.iterations % settings.check_every == 0 or run.history.iterations == settings.iterations:
                run.check()
                write_bytes(checkpoint_path, partial(checkpoints.store, run.state()))
            if progress is not None:
                progress(run.history.iterations, run.history)
        return run.history


class _Run:
    """The state of a training run."""

    def __init__(self, pairs: Pairs, settings: Refiner, seed: int, description: Description):
        self.settings, self.seed, self.description = settings, seed, description
        self.device = _device(settings)
        train, held_out = _split(pairs.groups, settings.held_out_share, seed)
        self.audio_scale = Normalisation.of(pairs.audio[train])
        self.gesture_scale = Normalisation.of(pairs.real[train])
        self.digest = _digest(pairs)
        self.train = self._tensors(pairs.take(train))
        self.held_out = self._tensors(pairs.take(_spread(held_out, _CHECKED_WINDOWS)))
        # Torch draws nothing after this: the networks have no dropout, and batches come from numpy.
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.generator = Generator(pairs.audio.shape[1], pairs.fake.shape[1]).to(self.device)
            self.critic = Critic(pairs.audio.shape[1], pairs.fake.shape[1]).to(self.device)
        self._start_at_slope_one()
        # Adam's own betas: the text names none.
        self.generator_adam = torch.optim.Adam(self.generator.parameters(), lr=settings.learning_rate)
        self.critic_adam = torch.optim.Adam(self.critic.parameters(), lr=settings.learning_rate)
        self.rng = randomness.generator(seed, "refine batches")
        self.history = History()
        self.best: dict[str, Any] = {}

    def _start_at_slope_one(self) -> None:
        """Scale the critic's last layer so that the norms of its gradients are 1 on average before training.

        Untrained, they are about 0.05. At the text's learning rate many steps would go into nothing but making the
        scores steeper, and meanwhile the generator would learn from the reconstruction alone.
        """
        audio, fake, _ = (part[: self.settings.batch] for part in self.train)
        with torch.no_grad():
            refined = self.generator.eval()(audio, fake)
        self.generator.train()
        norm = float(scores_and_slopes(self.critic, audio, refined)[1].detach().mean())
        if norm > 0:
            with torch.no_grad():
                self.critic.last.weight.div_(norm)

    def _tensors(self, pairs: Pairs) -> tuple[Tensor, Tensor, Tensor]:
        """Normalise pairs and move them to the device."""
        audio, fake, real = (
            torch.from_numpy(array).to(self.device)
            for array in (
                self.audio_scale.apply(pairs.audio),
                self.gesture_scale.apply(pairs.fake),
                self.gesture_scale.apply(pairs.real),
            )
        )
        return audio, fake, real

    def finished(self) -> bool:
        """Tell whether training ends, by its length or because the figures no longer fall."""
        history = self.history
        history.stopped = bool(history.figures) and (len(history.figures) - 1 - history.best >= self.settings.patience)
        return history.stopped or history.iterations >= self.settings.iterations

    def step(self) -> None:
        """Train the critic and then the generator by one step each."""
        windows = torch.from_numpy(self.rng.integers(len(self.train[0]), size=self.settings.batch)).to(self.device)
        # Real and refined gestures to the same audio: what differs is the gesture, and how it fits the audio.
        audio, fake, real = (part[windows] for part in self.train)
        refined = self.generator(audio, fake)

        # Equation 2 takes the gradient at G_syn, Gulrajani et al. at points between G_syn and real, as here. At G_syn
        # alone nothing holds the critic elsewhere: its scores came to differ by more than the gestures do, and its
        # norm fell to 0.2 when the generator moved to where it had not been held.
        share = torch.from_numpy(self.rng.random((len(windows), 1, 1), dtype=np.float32)).to(self.device)
        _, norms = scores_and_slopes(self.critic, audio, refined.detach().lerp(real, share))
        real_scores, refined_scores = self.critic(audio, real), self.critic(audio, refined.detach())
        self.critic_adam.zero_grad()
        critic_loss(real_scores, refined_scores, norms, self.settings).backward()
        self.critic_adam.step()

        self.critic.requires_grad_(False)
        self.generator_adam.zero_grad()
        generator_loss(self.critic(audio, refined), fake, refined, self.settings).backward()
        self.generator_adam.step()
        self.critic.requires_grad_(True)

        with torch.no_grad():
            values = ((refined - fake).abs().mean(), real_scores.mean() - refined_scores.mean(), norms.mean())
        for values_of, value in zip(
            (self.history.reconstruction, self.history.distance, self.history.gradient_norm), values, strict=True
        ):
            values_of.append(float(value))

    def check(self) -> None:
        """Measure the held-out figure and keep the weights if they are the best so far."""
        audio, fake, real = self.held_out
        figure = held_out_figure(audio, fake, _apply(self.generator, audio, fake), real, self.settings)
        self.history.checks.append(self.history.iterations)
        self.history.figures.append(figure)
        if self.history.best == len(self.history.figures) - 1:
            # Copies: the networks go on changing.
            self.best = {
                "generator": {name: value.clone() for name, value in self.generator.state_dict().items()},
                "critic": {name: value.clone() for name, value in self.critic.state_dict().items()},
            }

    def state(self) -> dict[str, Any]:
        """Return the state as numbers, texts and tensors only, so that reading it runs no code."""
        return {
            "format": checkpoints.FORMAT,
            "description": {"joints": list(self.description.joints), "fps": self.description.fps},
            "settings": self.settings.model_dump(),
            "seed": self.seed,
            "digest": self.digest,
            "audio_channels": len(self.audio_scale.mean),
            "scales": {
                "audio": _as_lists(self.audio_scale),
                "gesture": _as_lists(self.gesture_scale),
            },
            "best": self.best,
            "generator": self.generator.state_dict(),
            "critic": self.critic.state_dict(),
            "generator_adam": self.generator_adam.state_dict(),
            "critic_adam": self.critic_adam.state_dict(),
            "rng": self.rng.bit_generator.state,
            "history": vars(self.history).copy(),
        }

    def restore(self, state: dict[str, Any], path: Path) -> None:
        """Continue from a checkpoint; raises DataError when it is of another run."""
        _same_skeleton(state, self.description, path)
        old, new = state["settings"], self.settings.model_dump()
        changed = next((key for key in new if key not in _MAY_CHANGE and old.get(key) != new[key]), None)
        other = "another seed" if state["seed"] != self.seed else None
        other = "other pairs" if state["digest"] != self.digest else other
        other = f"{changed} {old.get(changed)}, not {new[changed]}" if changed else other
        if other:
            raise DataError(f"{path}: a run with {other}; delete it to train from the start, or write to another file")
        with checkpoints.fitting(path):
            self.generator.load_state_dict(state["generator"])
            self.critic.load_state_dict(state["critic"])
            self.generator_adam.load_state_dict(state["generator_adam"])
            self.critic_adam.load_state_dict(state["critic_adam"])
            self.rng.bit_generator.state = state["rng"]
        self.history = History(**state["history"])
        self.best = state["best"]


def held_out_figure(audio: Tensor, fake: Tensor, refined: Tensor, real: Tensor, settings: Refiner) -> float:
    """Compute the figure of early stopping: how far refined windows are from real ones, and from the k-NN's.

    The first part is how far poses and speeds go with the audio as real ones do: the mean difference of their
    covariances with it, over channels and audio values, relative to that of the k-NN's gestures. Not a difference
    frame by frame, because the real gesture is one of many that fit the speech, and the best answer by that measure
    is to stand still; not one of speeds or spreads alone, which noise can mend. The second part is the
    reconstruction in its weight. The k-NN's gestures as they are have the figure 1.
    """
    ours, found, wanted = (_covariances(audio, gesture) for gesture in (refined, fake, real))
    apart = (ours - wanted).abs().mean() / (found - wanted).abs().mean().clamp_min(1e-6)
    return float(apart + settings.w_reconstruction * (refined - fake).abs().mean())


def _covariances(audio: Tensor, gesture: Tensor) -> Tensor:
    """Compute covariances within windows of poses and of speeds with the audio `[shape=(2, A, C)]`."""
    values = []
    for part, sound in ((gesture, audio), (gesture.diff(dim=2).abs(), audio[..., 1:])):
        centred = part - part.mean(dim=2, keepdim=True)
        values.append(torch.einsum("kat,kct->ac", sound, centred) / (len(part) * part.shape[2]))
    return torch.stack(values)


def _apply(generator: Generator, audio: Tensor, gesture: Tensor) -> Tensor:
    """Refine windows by the running statistics of batch norm: no window depends on another."""
    generator.eval()
    with torch.no_grad():
        parts = zip(audio.split(_CHECKED_AT_ONCE), gesture.split(_CHECKED_AT_ONCE), strict=True)
        refined = torch.cat([generator(*part) for part in parts])
    generator.train()
    return refined


def _split(groups: np.ndarray, share: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Split windows into those to train on and those held out, by number.

    Whole recordings are held out, at least one; of a single recording its last windows.
    """
    if len(groups) < 2:
        raise DataError(f"{len(groups)} windows to train on; at least 2 are needed: give more reference recordings")
    recordings = np.unique(groups)
    if len(recordings) > 1:
        count = min(max(round(share * len(recordings)), 1), len(recordings) - 1)
        chosen = randomness.generator(seed, "refine held out").permutation(recordings)[:count]
        held_out = np.isin(groups, chosen)
    else:
        # Windows overlap, so the first few of these are not quite new; at random all would be old.
        count = min(max(round(share * len(groups)), 1), len(groups) - 1)
        held_out = np.arange(len(groups)) >= len(groups) - count
    return np.flatnonzero(~held_out), np.flatnonzero(held_out)


def _spread(windows: np.ndarray, most: int) -> np.ndarray:
    """Take at most `most` of `windows`, evenly spread."""
    if len(windows) <= most:
        return windows
    return windows[np.linspace(0, len(windows) - 1, most).round().astype(int)]


def _digest(pairs: Pairs) -> str:
    """Compute a hash of the training pairs."""
    digest = hashlib.sha256()
    for array in (pairs.audio, pairs.fake, pairs.real, pairs.groups):
        digest.update(f"{array.shape} {array.dtype}".encode())
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()


@contextmanager
def _one_thread() -> Iterator[None]:
    """Limit torch to one thread inside the block.

    The order of sums, and so their last bits, depends on the number of threads.
    """
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def _device(settings: Refiner) -> torch.device:
    """Choose the device of torch; raises DataError where a graphics card is asked for and there is none."""
    if settings.device == "cuda" and not torch.cuda.is_available():
        raise DataError("device cuda: torch finds no graphics card it can use; set device to auto or cpu")
    return torch.device("cuda" if settings.device != "cpu" and torch.cuda.is_available() else "cpu")


# --- checkpoints --------------------------------------------------------------------------------------------


def _as_lists(scale: Normalisation) -> dict[str, list[float]]:
    """Convert a normalisation to lists of numbers, as a checkpoint holds it."""
    return {"mean": scale.mean.tolist(), "scale": scale.scale.tolist()}


def _scale(state: dict[str, Any], name: str) -> Normalisation:
    """Read a normalisation from the state of a checkpoint."""
    return Normalisation(*(np.array(state["scales"][name][part]) for part in ("mean", "scale")))


def _description(state: dict[str, Any]) -> Description:
    """Read the description of the training data from the state of a checkpoint."""
    return Description(tuple(state["description"]["joints"]), state["description"]["fps"])


def _same_skeleton(state: dict[str, Any], description: Description, path: str | Path) -> None:
    """Raise DataError where a checkpoint was trained for another skeleton or rate."""
    if difference := _description(state).difference(description):
        raise DataError(f"{path}: trained for another skeleton: {difference}; train a refiner for this one")


def _networks(state: dict[str, Any], device: torch.device, path: str | Path) -> tuple[Generator, Critic]:
    """Load the networks with the best weights, for use; raises DamagedError when those of the file do not fit."""
    channels = state["audio_channels"], _description(state).channels
    generator, critic = Generator(*channels), Critic(*channels)
    with checkpoints.fitting(path):
        generator.load_state_dict(state["best"]["generator"])
        critic.load_state_dict(state["best"]["critic"])
    return generator.to(device).eval(), critic.to(device).eval()


# --- use ----------------------------------------------------------------------------------------------------


def refine(
    checkpoint_path: str | Path,
    audio: np.ndarray,
    gesture: np.ndarray,
    description: Description,
    settings: Refiner | None = None,
) -> np.ndarray:
    """Refine the k-NN's gesture `[shape=(C, T)]` for audio `[shape=(A, T)]`.

    Returns the refined gesture `[shape=(C, T)]`.

    The whole sequence in one pass: the generator is fully convolutional, so there are no windows to join.
    Raises DataError for a checkpoint that is missing, damaged, or of another skeleton than `description`.
    """
    state = checkpoints.load(checkpoint_path)
    _same_skeleton(state, description, checkpoint_path)
    device = _device(settings or Refiner())
    generator, _ = _networks(state, device, checkpoint_path)
    scale = _scale(state, "gesture")
    inputs = [
        torch.from_numpy(part)[None].to(device) for part in (_scale(state, "audio").apply(audio), scale.apply(gesture))
    ]
    with _one_thread(), torch.no_grad():
        refined = scale.undo(generator(*inputs)[0].cpu().numpy())
    if not np.isfinite(refined).all():
        raise DataError(f"{checkpoint_path}: gives values that are not finite; train again")
    return refined


def conditioning_margin(checkpoint_path: str | Path, pairs: Pairs, seeds: Sequence[int] = range(5)) -> dict[str, Any]:
    """Measure whether the audio is used: the loss when held-out windows are given the audio of other windows.

    critic : D(F, real) - D(F', real), with F' the audio of another window
    generator : D(F, G(F, kNN)) - D(F, G(F', kNN)): what the generator's output loses in the eyes of the critic
    change : mean |G(F, kNN) - G(F', kNN)| in standard deviations
    Each as mean and standard deviation over shuffles with `seeds`. D is in units of the distance between two
    windows. `pairs` are those the checkpoint was trained with.
    """
    state = checkpoints.load(checkpoint_path)
    settings = Refiner.model_validate(state["settings"])
    if state["digest"] != _digest(pairs):
        raise DataError(f"{checkpoint_path}: trained with other pairs than these")
    _, held_out = _split(pairs.groups, settings.held_out_share, state["seed"])
    if len(held_out) < 2:
        raise DataError(f"{len(held_out)} held-out windows: there is no other audio to give them")
    device = _device(settings)
    generator, critic = _networks(state, device, checkpoint_path)
    part = pairs.take(_spread(held_out, _CHECKED_WINDOWS))
    audio = torch.from_numpy(_scale(state, "audio").apply(part.audio)).to(device)
    fake, real = (torch.from_numpy(_scale(state, "gesture").apply(x)).to(device) for x in (part.fake, part.real))
    found: dict[str, list[float]] = {"critic": [], "generator": [], "change": []}
    with _one_thread(), torch.no_grad():
        refined = generator(audio, fake)
        right, right_refined = critic(audio, real).mean(), critic(audio, refined).mean()
        for seed in seeds:
            other = audio[_elsewhere(len(audio), seed)]
            misled = generator(other, fake)
            found["critic"].append(float(right - critic(other, real).mean()))
            found["generator"].append(float(right_refined - critic(audio, misled).mean()))
            found["change"].append(float((refined - misled).abs().mean()))
    summary: dict[str, Any] = {
        name: {"mean": float(np.mean(values)), "std": float(np.std(values))} for name, values in found.items()
    }
    return {**summary, "windows": len(part.groups)}


def _elsewhere(count: int, seed: int) -> np.ndarray:
    """Choose for each of `count` windows the number of another one, no two the same."""
    order = randomness.generator(seed, "refine shuffled audio").permutation(count)
    other = np.empty(count, dtype=int)
    other[order] = np.roll(order, 1)
    return other
