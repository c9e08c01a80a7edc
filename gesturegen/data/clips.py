"""Clips: recordings read, checked and cleaned, and the references and speeches made of them (§3).

A `Clip` is what `preprocess` stores; a `Reference` (motion with its speech) and
a `Speech` are what the methods see. Nothing here writes outside the folder it is given.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from gesturegen import files
from gesturegen.data.recordings import Recording, is_listed
from gesturegen.errors import DamagedError, DataError
from gesturegen.joints import roles_of, settings_for, unknown_names
from gesturegen.motion import cleanup, kinematics, rotation, space
from gesturegen.motion.skeleton import Motion, Skeleton, Space, read_only
from gesturegen.settings.models import Config
from gesturegen.speech import acoustics, alignment, audio, prosody, transcripts, voice
from gesturegen.speech.acoustics import Acoustics
from gesturegen.speech.prosody import Contour
from gesturegen.speech.transcript import Word
from gesturegen.speech.voice import Voice
from gesturegen.stored import arrays as stored_arrays
from gesturegen.stored.arrays import Array, Kind
from gesturegen.stored.sealing import damaged

FORMAT_VERSION = 3
# Everything a stored clip depends on. The onset threshold is applied when a clip is used.
_SETTINGS = (
    "audio", "fps", "joints", "wrists", "exclude", "breaks", "positions.root_joint", "motion.unit", "motion.up_axis", "skeleton",
    "onsets.sample_rate", "onsets.hop_length", "onsets.muted_min_seconds", "onsets.muted_max_seconds",
    "onsets.muted_margin_seconds",
)  # fmt: skip
# Of a speech with fewer onsets the threshold is wrong; on the real sample the published threshold gives as many as usual.
LEAST_ONSETS_PER_SECOND, USUAL_ONSETS_PER_SECOND = 0.5, 2.0
# Of less speech a few onsets say nothing.
LEAST_VOICED_SECONDS = 2.0
# Far beyond any recording: eleven days of sound, and as long a motion at 120 frames per second.
_LONGEST_SECONDS, _MOST_FRAMES = 1e6, 1 << 27
_RATE = stored_arrays.within(1e-3, 1e5)
# A rotation vector is never longer than a turn.
_TURN = stored_arrays.within(-2 * np.pi, 2 * np.pi)
# What a stored clip holds of its speech.
_SPEECH = {
    "settings": Array("str"),
    "input_digest": Array("str"),
    "name": Array("str"),
    "speaker": Array("str"),
    "duration": Array("f8", "", stored_arrays.within(0, _LONGEST_SECONDS)),
    "notes": Array("str", "notes"),
    "onset_times": Array("f8", "onsets", stored_arrays.not_negative),
    "onset_strengths": Array("f8", "onsets"),
    "onset_near_mute": Array("bool", "onsets"),
    "voice_probabilities": Array("f4", "voices", stored_arrays.within(0, 1)),
    "voice_levels": Array("f4", "voices", stored_arrays.within(-200, 400)),
    "word_texts": Array("str", "words"),
    "word_times": Array("f8", "words 2", stored_arrays.not_negative),
    "prosody_settings": Array("str", group="prosody"),
    "energy": Array("f8", "loudnesses", group="prosody"),
    "pitch": Array("f8", "loudnesses", stored_arrays.finite_or_nan, "prosody"),
    "prosody_rate": Array("f8", "", _RATE, "prosody"),
    "acoustics_settings": Array("str", group="acoustics"),
    "mfcc": Array("f4", "sounds values", group="acoustics"),
    "acoustics_rate": Array("f8", "", _RATE, "acoustics"),
}
# And of its motion, of T frames and J joints.
_MOTION = {
    "fps": Array("f8", "", _RATE),
    "n_recorded": Array("i8", "", stored_arrays.within(1, _MOST_FRAMES)),
    "source_frames": Array("i8", "T", stored_arrays.rising_numbers),
    "segment_starts": Array("i8", "segments", stored_arrays.starts("T")),
    "expmaps": Array("f8", "T J 3", _TURN),
    "joint_positions": Array("f4", "T K 3"),
    "joint_names": Array("str", "K"),
    "skeleton_names": Array("str", "J"),
    "skeleton_parents": Array("i8", "J"),
    "skeleton_offsets": Array("f8", "J 3"),
    "skeleton_end_sites": Array("f8", "J 3", stored_arrays.finite_or_nan),
    "skeleton_channels": Array("str", "J"),
    "hierarchy": Array("str"),
    "unit_centimetres": Array("f8", "", stored_arrays.within(1e-6, 1e6)),
    "up_axis": Array("str"),
    "written_joints": Array("i8", "written", stored_arrays.rising("J")),
    "written_angles": Array("f8", "T written 3", stored_arrays.finite_or_nan),
    "rest_positions": Array("f8", "J 3"),
    "moving_joints": Array("i8", "moving", stored_arrays.rising("J")),
    "moving_positions": Array("f8", "T moving 3"),
}


def _unfit(stored: Mapping[str, np.ndarray]) -> str | None:
    """What is wrong between the arrays of a clip, each of which is as it should be."""
    times = stored["word_times"]
    if not (times[:, 0] <= times[:, 1]).all() or not (np.diff(times[:, 0]) >= 0).all():
        return "word_times are not in order"
    if "expmaps" not in stored:
        return None
    parents = stored["skeleton_parents"]
    if not (parents < np.arange(len(parents))).all() or parents[0] != -1 or not (parents[1:] >= 0).all():
        return "skeleton_parents do not come before their children"
    if stored["source_frames"][-1] >= stored["n_recorded"]:
        return f"source_frames lie beyond the {stored['n_recorded']} frames that were recorded"
    if str(stored["up_axis"]) not in ("y", "z"):
        return "up_axis is neither y nor z"
    if not np.isin(stored["joint_names"], stored["skeleton_names"]).all():
        return "joint_names are not of the skeleton"
    return None


KIND = Kind(
    "clip", "preprocess",
    _SPEECH | {name: replace(array, group="motion") for name, array in _MOTION.items()}, FORMAT_VERSION, _unfit,
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Speech:
    """A speech on the frame grid.

    onset_times : float [shape=(K,)], seconds, at the configured strength
    words : in order of time; n_frames : round(duration * fps) for a test speech, the motion's for a reference
    prosody, acoustics : None where they are not measured (`prosody.enabled`, `acoustics.enabled`)
    onset_strengths : float [shape=(K,)], of the onsets; None where they are unknown
    voice : float [shape=(S, 2)], seconds in which somebody is heard to speak beside the words; None for never
    """

    name: str
    onset_times: np.ndarray
    words: tuple[Word, ...]
    n_frames: int
    fps: float
    prosody: Contour | None = None
    acoustics: Acoustics | None = None
    onset_strengths: np.ndarray | None = None
    voice: np.ndarray | None = None

    def __post_init__(self):
        object.__setattr__(self, "onset_times", read_only(self.onset_times))
        if self.voice is not None:
            object.__setattr__(self, "voice", read_only(self.voice))

    @property
    def onset_frames(self) -> np.ndarray:
        """Frames `[shape=(K,)]` of the onsets inside the speech, each once, in order."""
        frames = np.unique(np.round(self.onset_times * self.fps).astype(int))
        return frames[(frames >= 0) & (frames < self.n_frames)]


@dataclass(frozen=True, eq=False)
class Reference:
    """A recorded motion with its speech.

    motion : the frames that may be used
    source_frames : int [shape=(T,)], their numbers in the recording (excluded ranges are left out)
    segment_starts : int [shape=(S,)], first frames of the uninterrupted stretches of `motion`
    """

    name: str
    motion: Motion
    speech: Speech
    source_frames: np.ndarray
    segment_starts: np.ndarray

    def __post_init__(self):
        for name in ("source_frames", "segment_starts"):
            object.__setattr__(self, name, read_only(getattr(self, name)))


@dataclass(frozen=True, eq=False)
class Clip:
    """One preprocessed recording, as stored in `clips/<name>.npz`; `motion` is None for a test clip."""

    name: str
    speaker: str | None
    duration: float
    onset_peaks: audio.OnsetPeaks
    words: tuple[Word, ...]
    motion: Motion | None = None
    source_frames: np.ndarray | None = None
    segment_starts: np.ndarray | None = None
    n_recorded: int = 0
    notes: tuple[str, ...] = field(default=())
    prosody: Contour | None = None
    acoustics: Acoustics | None = None
    voice: Voice | None = None

    def all_notes(self, config: Config) -> list[str]:
        """What is odd about the clip, with these settings."""
        return [*self.notes, *self._voice_notes(config), *self._onset_notes(config)]

    def voiced(self, config: Config) -> np.ndarray:
        """Seconds `[shape=(S, 2)]` in which somebody speaks, by the sound or by the transcript."""
        return voice.voiced(self.voice, self.words, config.voice)

    def onset_threshold(self, config: Config) -> float:
        """The strength from which on a peak is an onset (`onsets`)."""
        return self.onset_peaks.threshold(config.onsets, self.voiced(config))

    def onset_rate(self, config: Config) -> float:
        """Onsets per second of speech; NaN without speech."""
        return self.onset_peaks.rate(self.onset_threshold(config), config.onsets.muted_max_share, self.voiced(config))

    def _voice_notes(self, config: Config) -> list[str]:
        if self.words or self.voice is None:
            return []
        heard = audio.voiced_seconds(self.voiced(config))
        if not heard:
            return ["no words, and no voice is heard, so all of it without an onset is a pause"]
        how = (
            "speech is heard" if self.voice.is_known(config.voice) else "hardly a voice is known in it, but it is loud"
        )
        return [f"no words, so the sound tells when there is speech: {how} in {heard:.1f} of {self.duration:.1f} s"]

    def _onset_notes(self, config: Config) -> list[str]:
        voiced, threshold = self.voiced(config), self.onset_threshold(config)
        rate, seconds = self.onset_rate(config), audio.voiced_seconds(voiced)
        if not rate < LEAST_ONSETS_PER_SECOND or (rate > 0 and seconds < LEAST_VOICED_SECONDS):
            return []
        strongest = self.onset_peaks.strengths.max(initial=0.0)
        usual = self.onset_peaks.threshold_for(USUAL_ONSETS_PER_SECOND, voiced, 0.0)
        count = round(rate * seconds)
        what = (
            f"{f'{count} onsets' if count > 1 else 'one onset' if count else 'no onset'} in {seconds:.1f} s of speech"
        )
        if self.words and not count:
            what = f"{len(self.words)} words but {what}"
        if config.onsets.per_second is not None and config.onsets.per_second < LEAST_ONSETS_PER_SECOND:
            return [f"{what}: onsets.per_second is {config.onsets.per_second:g}; {USUAL_ONSETS_PER_SECOND:g} is usual"]
        if usual >= threshold or not usual > 0:
            return [
                f"{what}: its strongest peak is {strongest:.1f}, and no setting would hear more; is it the right audio?"
            ]
        return [
            f"{what}: the strongest peak is {strongest:.1f}, onsets.min_strength is {threshold:g}; for the usual "
            f"{USUAL_ONSETS_PER_SECOND:g} a second set onsets.min_strength={np.floor(usual * 100) / 100:g}, or "
            f"onsets.per_second={USUAL_ONSETS_PER_SECOND:g}, which suits every recording"
        ]

    def test_speech(self, config: Config) -> Speech:
        return self._speech(config, round(self.duration * config.fps))

    def reference(self, config: Config) -> Reference:
        if self.motion is None:
            raise DataError(f"clip {self.name} has no motion, so it cannot be a reference")
        return Reference(
            self.name, self.motion, self._speech(config, self.n_recorded), self.source_frames, self.segment_starts
        )

    def _speech(self, config: Config, n_frames: int) -> Speech:
        onsets = self.onset_peaks.are_onsets(self.onset_threshold(config), config.onsets.muted_max_share)
        heard = voice.beside_words(self.voice, self.words, config.voice, config.pauses)
        return Speech(
            self.name, self.onset_peaks.times[onsets], self.words, n_frames, float(config.fps), self.prosody,
            self.acoustics, self.onset_peaks.strengths[onsets], heard,
        )  # fmt: skip


# --- from recording to clip ---------------------------------------------------------------------------------


def prepare(recording: Recording, config: Config, with_motion: bool) -> Clip:
    """Read, check and clean one recording; raises DataError for anything that cannot be used."""
    if recording.problem is not None:
        raise DataError(recording.problem)
    if recording.audio_path is None:
        raise DataError(
            f"clip {recording.name}: no audio file beside it; add {recording.name}.wav, or blacklist the clip"
        )
    sound = audio.read(recording.audio_path, config.audio.channel)
    samples, rate = sound.samples, sound.rate
    duration = len(samples) / rate
    if not with_motion and round(duration * config.fps) < 1:
        raise DataError(f"{recording.audio_path}: {duration:.3f} s is less than one frame")
    peaks = audio.detect_onset_peaks(samples, rate, config.onsets)
    paths = [path for path in (recording.transcript_path, *recording.other_transcripts) if path is not None]
    words, notes = transcripts.read_best(paths, duration, (samples, rate))
    notes = [*sound.notes, *notes]
    contour = prosody.measure(samples, rate, config.prosody) if config.prosody.enabled else None
    spectrum = acoustics.measure(samples, rate, config.acoustics) if config.acoustics.enabled else None
    clip = Clip(
        recording.name, recording.speaker, duration, peaks, words, notes=tuple(notes), prosody=contour,
        acoustics=spectrum, voice=voice.measure(samples, rate),
    )  # fmt: skip
    return _with_motion(clip, recording, config) if with_motion else clip


def _with_motion(clip: Clip, recording: Recording, config: Config) -> Clip:
    notes = list(clip.notes)
    motion = space.read(recording.motion_path, config)
    notes += space.notes(motion.skeleton, config) + unknown_names(motion.skeleton, config)
    own = settings_for(motion.skeleton, config)
    if motion.fps != config.fps:
        notes.append(f"{recording.motion_path.name}: {motion.fps:g} fps, resampled to {config.fps}")
        motion = cleanup.resample(motion, config.fps)
    n_recorded = motion.n_frames
    seconds = n_recorded / config.fps
    if abs(seconds - clip.duration) > 1.0:
        notes.append(f"the motion lasts {seconds:.1f} s, its audio {clip.duration:.1f} s")
    kept = np.ones(n_recorded, dtype=bool)
    times = np.arange(n_recorded) / config.fps
    for range_ in config.exclude:
        if is_listed(clip.name, (range_.clip,)):
            if range_.from_ >= seconds:
                notes.append(
                    f"exclude from {range_.from_:g} s lies past the end at {seconds:.1f} s and excludes nothing"
                )
            kept &= (times < range_.from_) | (times >= range_.to)
    source_frames = np.flatnonzero(kept)
    if len(source_frames) == 0:
        raise DataError(f"clip {clip.name}: `exclude` leaves no frame of it; shorten the ranges or blacklist the clip")
    gaps = np.flatnonzero(np.diff(source_frames) > 1)
    motion = motion.take(source_frames).cut_at(gaps + 1)
    joints, joint_notes = select_joints(motion.skeleton, config)
    jumps = cleanup.tracking_jumps(
        kinematics.joint_positions(motion, joints), config.fps, config.breaks.max_joint_speed
    )
    segment_starts = np.union1d([0], np.union1d(jumps, gaps) + 1).astype(int)
    motion, wrist_notes = cleanup.clean_wrists(motion, segment_starts, own.wrists)
    notes += joint_notes + wrist_notes
    return replace(
        clip, motion=motion, source_frames=source_frames, segment_starts=segment_starts, n_recorded=n_recorded,
        notes=tuple(notes),
    )  # fmt: skip


def select_joints(skeleton: Skeleton, config: Config) -> tuple[list[int], list[str]]:
    """The joint numbers that distances are measured on, and a note when the configured ones do not exist.

    A skeleton with none of the default joints is of another kind: its own joints of the same roles are taken, or all
    where it is not recognised as a body. One with only some of them raises DataError.
    """
    everything = list(range(len(skeleton.names)))
    if config.joints == "all":
        return everything, []
    own = settings_for(skeleton, config)
    if own.joints != config.joints:
        found = roles_of(skeleton, config)
        known = f"recognised as {found.family}" if found.family else "recognised by its shape"
        note = (
            f"the skeleton has none of the configured joints; {known}, so {len(own.joints)} of its {len(everything)} are "
            "used: trunk, head, arms and legs (joints; `gesturegen inspect FILE.bvh` shows them)"
        )
        return [skeleton.names.index(name) for name in own.joints], [note]
    missing = [name for name in config.joints if name not in skeleton.names]
    if len(missing) == len(config.joints):
        return everything, [
            f"the skeleton has none of the configured joints, so all its {len(everything)} are used (joints)"
        ]
    if missing:
        skeleton.index(missing[0])
    return [skeleton.names.index(name) for name in config.joints], []


# --- storing clips ------------------------------------------------------------------------------------------


def input_digest(recording: Recording) -> str:
    """A hash of all that a clip is made from: its files' bytes and its speaker."""
    others = recording.other_transcripts
    paths = (recording.motion_path, recording.audio_path, recording.transcript_path, *others)
    parts = [recording.speaker or "", *(files.sha256(path) if path else "" for path in paths)]
    texts = [path.suffix.lower() in transcripts.WITHOUT_TIMES for path in (recording.transcript_path, *others) if path]
    parts += [alignment.version()] if any(texts) else []
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def load_if_current(path: str | Path, config: Config, digest: str, with_motion: bool) -> Clip | None:
    """The stored clip, without its motion, when it was made from these inputs with these settings; else None.

    DamagedError for one that is not as it was written.
    """
    try:
        stored = stored_arrays.read(path, KIND)  # all of it, so that a damaged array is found now and made again
        if str(stored["input_digest"]) != digest or ("expmaps" in stored) != with_motion:
            return None
        return load(path, config, with_motion=False)
    except DamagedError:
        raise
    except DataError:
        return None


def save(path: str | Path, clip: Clip, config: Config, digest: str = "") -> None:
    """Store a clip as `.npz` (docs/files.md); digest : of its inputs, so that `run` can tell."""
    arrays = {
        "format_version": np.array(FORMAT_VERSION),
        "settings": np.array(config.section_json(*_SETTINGS)),
        "input_digest": np.array(digest),
        "name": np.array(clip.name),
        "speaker": np.array(clip.speaker or ""),
        "duration": np.array(float(clip.duration)),
        "notes": np.array(clip.notes, dtype=str),
        "onset_times": clip.onset_peaks.times,
        "onset_strengths": clip.onset_peaks.strengths,
        "onset_near_mute": clip.onset_peaks.near_mute,
        "voice_probabilities": clip.voice.probabilities if clip.voice else np.zeros(0, dtype=np.float32),
        "voice_levels": clip.voice.levels if clip.voice else np.zeros(0, dtype=np.float32),
        "word_texts": np.array([word.text for word in clip.words], dtype=str),
        "word_times": np.array([(word.start, word.end) for word in clip.words]).reshape(-1, 2),
    }
    if clip.prosody is not None:
        arrays |= {
            "prosody_settings": np.array(config.section_json("prosody")),
            "energy": clip.prosody.energy,
            "pitch": clip.prosody.pitch,
            "prosody_rate": np.array(clip.prosody.rate),
        }
    if clip.acoustics is not None:
        arrays |= {
            "acoustics_settings": np.array(config.section_json("acoustics")),
            "mfcc": clip.acoustics.values,
            "acoustics_rate": np.array(clip.acoustics.rate),
        }
    if clip.motion is not None:
        skeleton = clip.motion.skeleton
        joints, _ = select_joints(skeleton, config)
        arrays |= {
            "fps": np.array(float(clip.motion.fps)),
            "n_recorded": np.array(clip.n_recorded),
            "source_frames": clip.source_frames,
            "segment_starts": clip.segment_starts,
            "expmaps": rotation.to_expmap(clip.motion.rotations),
            "joint_positions": kinematics.joint_positions(clip.motion, joints).astype(np.float32),
            "joint_names": np.array([skeleton.names[j] for j in joints]),
            "skeleton_names": np.array(skeleton.names),
            "skeleton_parents": skeleton.parents,
            "skeleton_offsets": skeleton.offsets,
            "skeleton_end_sites": skeleton.end_sites,
            "skeleton_channels": np.array([" ".join(channels) for channels in skeleton.channels], dtype=str),
            "hierarchy": np.array(skeleton.hierarchy),
            "unit_centimetres": np.array(float(skeleton.space.scale)),
            "up_axis": np.array(skeleton.space.up),
            "written_joints": clip.motion.written_joints,
            "written_angles": clip.motion.written_angles,
            **_pack_positions(clip.motion.positions),
        }
    stored_arrays.write(path, arrays)


def load(path: str | Path, config: Config, with_motion: bool = True) -> Clip:
    """Read a stored clip; DataError when it is missing, damaged or was made with other settings."""
    path = Path(path)
    if not path.is_file():
        raise DataError(f"{path}: clip {path.stem} has not been preprocessed; run `gesturegen preprocess` first")
    stored = stored_arrays.read(path, KIND, None if with_motion else _SPEECH)
    try:
        check_settings(path, str(stored["settings"]), config.section_json(*_SETTINGS), "preprocess")
        peaks = audio.OnsetPeaks(stored["onset_times"], stored["onset_strengths"], stored["onset_near_mute"])
        times = stored["word_times"].tolist()
        words = tuple(Word(str(text), *time) for text, time in zip(stored["word_texts"], times, strict=True))
        described = (str(stored["name"]), str(stored["speaker"]) or None, float(stored["duration"]))
        notes = tuple(map(str, stored["notes"]))
        heard = Voice(stored["voice_probabilities"], stored["voice_levels"])
        contour = sound = None
        if _is_measured(path, stored, config, "prosody"):
            contour = Contour(stored["energy"], stored["pitch"], float(stored["prosody_rate"]))
        if _is_measured(path, stored, config, "acoustics"):
            sound = Acoustics(stored["mfcc"], float(stored["acoustics_rate"]))
        if not with_motion or "expmaps" not in stored:
            return Clip(*described, peaks, words, notes=notes, prosody=contour, acoustics=sound, voice=heard)
        skeleton = Skeleton(
            tuple(map(str, stored["skeleton_names"])),
            stored["skeleton_parents"],
            stored["skeleton_offsets"],
            stored["skeleton_end_sites"],
            tuple(tuple(str(channels).split()) for channels in stored["skeleton_channels"]),
            str(stored["hierarchy"]),
            Space(float(stored["unit_centimetres"]), str(stored["up_axis"])),
        )
        rotations = rotation.from_expmap(stored["expmaps"])
        motion = Motion(
            skeleton, rotations, _unpack_positions(stored, len(rotations)), float(stored["fps"]),
            stored["written_joints"], stored["written_angles"],
        )  # fmt: skip
        return Clip(
            *described, peaks, words, motion, stored["source_frames"], stored["segment_starts"],
            int(stored["n_recorded"]), notes, contour, sound, heard,
        )  # fmt: skip
    except ValueError as error:
        raise damaged(path, str(error), "preprocess") from None


def _is_measured(path: Path, stored: Mapping[str, np.ndarray], config: Config, what: str) -> bool:
    """Whether the config asks for a measure of the voice, which then must be there, and be as it asks."""
    if not getattr(config, what).enabled:
        return False
    if f"{what}_settings" not in stored:
        raise DataError(
            f"{path}: holds no {what}, the config says {what}.enabled: true; run `gesturegen preprocess` again"
        )
    check_settings(path, str(stored[f"{what}_settings"]), config.section_json(what), "preprocess")
    return True


def check_settings(path: Path, stored: str, wanted: str, command: str) -> None:
    """DataError naming the first setting in which a stored file differs from the config."""
    try:
        before, now = _leaves(json.loads(stored)), _leaves(json.loads(wanted))
    except (ValueError, RecursionError):
        raise damaged(path, "its settings are not JSON", command) from None
    for key in sorted(before.keys() | now.keys()):
        if before.get(key) != now.get(key):
            raise DataError(
                f"{path}: made with {key} = {_brief(before.get(key))}, the config says {_brief(now.get(key))}; "
                f"run `gesturegen {command}` again"
            )


def _leaves(value, name: str = "") -> dict:
    """Settings by their full key path."""
    if not isinstance(value, dict):
        return {name: value}
    found: dict = {}
    for key, inner in value.items():
        found |= _leaves(inner, f"{name}.{key}" if name else key)
    return found


def _brief(value) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _pack_positions(positions: np.ndarray) -> dict[str, np.ndarray]:
    """Local positions: a constant for most joints, a track for the few that travel."""
    moving = np.flatnonzero(np.ptp(positions, axis=0).max(axis=-1) > 0)
    return {"rest_positions": positions[0], "moving_joints": moving, "moving_positions": positions[:, moving]}


def _unpack_positions(stored: Mapping[str, np.ndarray], n_frames: int) -> np.ndarray:
    positions = np.tile(stored["rest_positions"], (n_frames, 1, 1))
    positions[:, stored["moving_joints"]] = stored["moving_positions"]
    return positions
