"""The command `train-refiner`: train a network that refines what k-NN matching retrieves towards recorded motion."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from gesturegen import files, render
from gesturegen.data.clips import Reference, Speech, select_joints
from gesturegen.data.stored_clips import digests, load_references
from gesturegen.errors import DamagedError, DataError
from gesturegen.extras import need
from gesturegen.frames import ReferenceFrames
from gesturegen.joints import settings_for
from gesturegen.methods import TRAINER
from gesturegen.motion import body, cleanup, rotation
from gesturegen.motion.skeleton import Motion, Skeleton
from gesturegen.outcome import Outcome
from gesturegen.parallel import for_each
from gesturegen.pipeline.common import Summary, chosen_references, read_index
from gesturegen.randomness import generator
from gesturegen.refine import representation
from gesturegen.settings.models import Config
from gesturegen.speech.acoustics import Acoustics
from gesturegen.stored import sealing
from gesturegen.workspace import work_path


def checkpoint_path(config: Config) -> Path:
    """Return the network's file: `refiner.checkpoint`, else in the work folder."""
    return Path(config.refiner.checkpoint) if config.refiner.checkpoint else work_path(config, "refiner.pt")


def require_trained(config: Config) -> Path:
    """Return the network's file; DataError where there is none."""
    path = checkpoint_path(config)
    if not path.is_file():
        raise DataError(
            f"{path}: no refinement network has been trained; run `gesturegen train-refiner` first, or set refine=false"
        )
    return path


def gesture_joints(skeleton: Skeleton, config: Config) -> list[int]:
    """List the joints that are refined: those of the upper body that distances are measured on."""
    chosen, _ = select_joints(skeleton, config)
    upper = body.split(skeleton, skeleton.pelvis(settings_for(skeleton, config).positions.root_joint)).upper
    return [joint for joint in chosen if joint in upper]


def audio_channels(acoustics: Acoustics, n_frames: int) -> np.ndarray:
    """Stack MFCC and energy with their first derivatives, float32 `[shape=(28, n_frames)]`; the last value is held."""
    values = acoustics.values[np.minimum(np.arange(n_frames), len(acoustics.values) - 1)]
    slopes = np.gradient(values, axis=0) if n_frames > 1 else np.zeros_like(values)
    return np.concatenate([values, slopes], axis=1).T.astype(np.float32)


def _acoustics_of(speech: Speech) -> Acoustics:
    """Return the acoustic features of a clip; DataError where they were not measured."""
    if speech.acoustics is None:
        raise DataError(f"clip {speech.name}: its sound was not measured; set acoustics.enabled: true")
    return speech.acoustics


def refine_motion(motion: Motion, speech: Speech, config: Config) -> Motion:
    """Refine a motion with the trained network (§3.2).

    The network sees it at the rate of the audio features; what it changes is turned into corrections that are laid
    over all frames, so that detail between its frames stays.
    """
    need("torch", "torch")
    from gesturegen.refine import training

    acoustics = _acoustics_of(speech)
    joints = gesture_joints(motion.skeleton, config)
    slow = cleanup.resample(motion, acoustics.rate)
    channels = representation.to_channels(slow, joints)
    refined = training.refine(
        require_trained(config), audio_channels(acoustics, slow.n_frames), channels.T.astype(np.float32),
        representation.describe(slow, joints), config.refiner,
    )  # fmt: skip
    changed = representation.from_channels(slow, joints, refined.T)
    turns = rotation.multiply(changed.rotations, rotation.inverse(slow.rotations))
    corrections = replace(slow, rotations=turns, positions=np.zeros_like(slow.positions))
    times = np.minimum(np.arange(motion.n_frames) * (slow.fps / motion.fps), slow.n_frames - 1)
    return replace(
        motion,
        rotations=rotation.normalize(
            rotation.multiply(cleanup.interpolate(corrections, times).rotations, motion.rotations)
        ),
    )


def train_refiner(config: Config, jobs: int, quiet: bool) -> Summary:
    """Train the refinement network on all references of the test clips, or go on where training stopped."""
    need("torch", "torch")
    from gesturegen.refine import training

    index = read_index(config)
    names = sorted({name for chosen in chosen_references(config, index).values() for name in chosen})
    path = checkpoint_path(config)
    tasks = {name: partial(_recording, name, tuple(names), config) for name in names}
    outcome = for_each(tasks, jobs, "train-refiner: pairs", quiet)
    if outcome.failed:
        return Summary(outcome)
    parts = [outcome.done[name] for name in names]
    audio, fake, real = (np.concatenate([part[key] for part in parts]) for key in ("audio", "fake", "real"))
    pairs = training.Pairs(
        audio,
        fake,
        real,
        groups=np.repeat(np.arange(len(parts)), [len(part["audio"]) for part in parts]),
    )
    if len(pairs.audio) < 2:
        raise DataError(
            f"{len(pairs.audio)} windows of {config.window_seconds:.1f} s to train on; give longer references"
        )
    description = parts[0]["description"]
    started, warnings = time.monotonic(), []
    with _bar(config.refiner.iterations, quiet) as bar:
        train = partial(
            training.train, pairs, config.refiner, config.seed, path, description, progress=partial(_advance, bar)
        )
        try:
            history = train()
        except DamagedError as error:
            if config.refiner.checkpoint:  # it may be another program's
                raise
            warnings.append(("refiner", sealing.remade(error)))
            history = train(resume=False)
    try:
        margin = training.conditioning_margin(path, pairs)
    except DataError as error:  # too few windows are held out
        margin = {}
        warnings.append(("margin", str(error)))
    files.write_json(path.with_suffix(".json"), {"windows": len(pairs.audio), **_figures(history), "margin": margin})
    return Summary(
        Outcome(done=dict.fromkeys(names)),
        warnings,
        lines=_describe(history, pairs, margin, time.monotonic() - started),
        written=[path, path.with_suffix(".json")],
    )


@lru_cache(maxsize=1)
def _library(
    config_json: str, names: tuple[str, ...], _digests: tuple[str, ...]
) -> tuple[list[Reference], ReferenceFrames]:
    """Load all references and build their database; a worker keeps both for its next recording."""
    config = Config.model_validate_json(config_json)
    references = load_references(config, names)
    return references, TRAINER.assemble([TRAINER.part(reference, config) for reference in references], config)


def _recording(name: str, names: Sequence[str], config: Config) -> dict:
    """Cut one recording into windows of its sound, what k-NN matching retrieves, and what was recorded (§3.3)."""
    references, library = _library(config.model_dump_json(by_alias=True), tuple(names), digests(config, names))
    own = references[list(names).index(name)]
    acoustics = _acoustics_of(own.speech)
    fps, rate = own.motion.fps, acoustics.rate
    joints = gesture_joints(own.motion.skeleton, config)
    window = round(config.window_seconds * rate)
    stride = max(round(config.refiner.stride_seconds * rate), 1)
    rng = generator(config.seed, f"refiner, {name}")
    real_motion = cleanup.resample(own.motion, rate)
    real = representation.to_channels(real_motion, joints).T
    # Excluded ranges are left out of the motion, so each frame has the sound of its own time.
    times = (
        own.source_frames[
            np.minimum(np.round(np.arange(real.shape[1]) * fps / rate).astype(int), own.motion.n_frames - 1)
        ]
        / fps
    )
    values = acoustics.values
    heard = Acoustics(values[np.minimum(np.round(times * rate).astype(int), len(values) - 1)], rate)
    audio = audio_channels(heard, real.shape[1])
    starts = np.arange(0, real.shape[1] - window + 1, stride)
    found: dict[str, list] = {"audio": [], "fake": [], "real": []}
    # Half of the fakes are of the nearest, the others of a further one.
    for k in (1, int(rng.integers(2, config.refiner.furthest_k + 1))):
        fake_motion = cleanup.resample(_fake(library, references, own, k, config, rng), rate)
        fake = representation.to_channels(fake_motion, joints).T
        for start in starts:
            here = slice(start, start + window)
            for key, values in (("audio", audio), ("fake", fake), ("real", real)):
                found[key].append(values[:, here])
    shapes = {"audio": len(audio), "fake": len(real), "real": len(real)}
    return {
        **{key: np.array(rows, dtype=np.float32).reshape(-1, shapes[key], window) for key, rows in found.items()},
        "description": representation.describe(real_motion, joints),
    }  # fmt: skip


def _fake(
    library: ReferenceFrames, references: Sequence[Reference], own: Reference, k: int, config: Config,
    rng: np.random.Generator,
) -> Motion:  # fmt: skip
    """Render what matching retrieves for a recording's speech, from other recordings where possible."""
    return render.render(TRAINER.stand_in(library, own, k, config, rng), references, library, config)


def _bar(total: int, quiet: bool):
    from tqdm import tqdm

    return tqdm(total=total, desc="train-refiner", unit="step", disable=True if quiet else None)


def _advance(bar, iterations: int, history) -> None:
    bar.update(iterations - bar.n)
    if history.figures:
        bar.set_postfix(held_out=f"{history.figures[-1]:.3f}", refresh=False)


def _figures(history) -> dict:
    """Summarise the course of training: means over its first and its last tenth."""
    tenth = max(history.iterations // 10, 1)
    return {
        "iterations": history.iterations,
        "stopped_early": bool(history.stopped),
        "checks": list(map(int, history.checks)),
        "held_out": list(map(float, history.figures)),
        **{
            f"{name}_{when}": float(np.mean(values[part]))
            for name, values in (("reconstruction", history.reconstruction), ("gradient_norm", history.gradient_norm))
            for when, part in (("first", slice(0, tenth)), ("last", slice(-tenth, None)))
        },
    }


def _describe(history, pairs, margin: dict, seconds: float) -> list[str]:
    figures = _figures(history)
    return [
        f"{len(pairs.audio)} windows, {figures['iterations']} iterations in {seconds:.0f} s"
        + (", stopped early" if figures["stopped_early"] else ""),
        f"reconstruction {figures['reconstruction_first']:.3f} -> {figures['reconstruction_last']:.3f}, gradient norm "
        f"{figures['gradient_norm_first']:.2f} -> {figures['gradient_norm_last']:.2f}, held-out figure "
        f"{min(figures['held_out'], default=float('nan')):.3f} (1 is the k-NN's motion as it is)",
        "lost by other audio in held-out windows, mean ± deviation over 5 shuffles: "
        + ("" if margin else "not measured")
        + ", ".join(
            f"{name} {margin[name]['mean']:.3f} ± {margin[name]['std']:.3f}" for name in ("critic", "generator") if margin
        ),
    ]  # fmt: skip
