"""The examination of one recording: figures, and findings with what to do about each.

Reading stops at nothing: where the transcript cannot be read the sound is looked at all the same, and likewise the
motion.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.signal import correlate

from gesturegen.data import clips
from gesturegen.data.clips import Clip
from gesturegen.data.recordings import Recording
from gesturegen.doctor import lag
from gesturegen.errors import DataError
from gesturegen.inputs import shown
from gesturegen.joints import settings_for
from gesturegen.motion import cleanup, kinematics, screening, space
from gesturegen.motion.skeleton import Motion, Skeleton
from gesturegen.settings.models import Config
from gesturegen.speech import audio, cutting

# What a recording is unfit for a reference for; other findings leave it usable.
UNFIT = ("unreadable", "no audio", "still", "torn", "silent", "out of step", "drifts", "other skeleton")
_SILENT_DB, _QUIET_DB = -60.0, -45.0
# Samples at the largest value, in runs of 3 and more: a recording that was too loud for its converter.
_CLIPPED_SHARE, _CLIPPED_RUN = 1e-3, 3
# Lags below it are below what the measure can tell; drifts likewise.
LARGEST_STEP, LARGEST_DRIFT = 0.35, 0.5
_LENGTHS_APART_SECONDS = 1.0
# Of the time in which a voice is heard that words must cover; of the words' time in which one is heard, or they are others'.
_VOICE_WRITTEN, _WORDS_HEARD = 0.6, 0.85
# Correlation of words and voice: 0.59 to 0.88 over nine speeches with their own words, 0.42 at most with others'.
_FITTING, _FITTING_BETTER, _UNFITTING, _LEAST_PAUSED = 0.4, 0.25, 0.35, 0.05
_LEAST_SHIFT_SECONDS, _LONGEST_SHIFT_SECONDS = 0.4, 10.0
_LEAST_SPEECH_SECONDS = 2.0


@dataclass(frozen=True)
class Finding:
    """A fault or an oddity: its kind, a text with its figure, and what to do.

    start, end : seconds of the motion that it is confined to; None for the whole recording
    """

    kind: str
    text: str
    cure: str
    start: float | None = None
    end: float | None = None


@dataclass
class Examined:
    """Figures of a recording (None where there are none), its findings, and facts for the comparison with others."""

    name: str
    speaker: str | None = None
    seconds: float | None = None
    fps: float | None = None
    height: float | None = None
    hand_speed: float | None = None
    level: float | None = None
    voiced: float | None = None
    onset_rate: float | None = None
    n_words: int | None = None
    lag: float | None = None
    lag_sure: bool = False
    gesture_clips: int = 0
    keywords: tuple[str, ...] = ()
    skeleton: Skeleton | None = None
    findings: list[Finding] = field(default_factory=list)

    @property
    def unfit(self) -> bool:
        """Tell whether the recording as a whole cannot serve as a reference."""
        return any(finding.kind in UNFIT and finding.start is None for finding in self.findings)

    def add(self, kind: str, text: str, cure: str, start: float | None = None, end: float | None = None) -> None:
        """Add a finding."""
        self.findings.append(Finding(kind, text, cure, start, end))


def examine(recording: Recording, name: str, config: Config) -> Examined:
    """Examine all files of a recording; whatever cannot be read becomes a finding."""
    found = Examined(name, recording.speaker)
    if recording.problem is not None:
        found.add("unreadable", recording.problem, "rename or remove it")
        return found
    motion = _read_motion(recording, found, config)
    clip = _read_sound(recording, found, config)
    if motion is not None:
        _look_at_motion(motion, found, config)
    if motion is not None and clip is not None:
        _look_at_both(motion, clip, found, config)
    return found


def _one_line(error: DataError) -> str:
    """Format an error on one line."""
    return shown(str(error).splitlines()[0])


# --- sound and words ----------------------------------------------------------------------------------------


def _read_sound(recording: Recording, found: Examined, config: Config) -> Clip | None:
    """Read the sound and the words of a recording and add what is odd about them; None without usable sound."""
    if recording.audio_path is None:
        found.add("no audio", "no audio file beside it", f"add {recording.name}.wav")
        return None
    config = config.model_copy(
        update={part: getattr(config, part).model_copy(update={"enabled": False}) for part in ("prosody", "acoustics")}
    )
    try:
        sound = audio.read(recording.audio_path, config.audio.channel)
    except DataError as error:
        found.add("unreadable", _one_line(error), "copy it again or leave it out")
        return None
    try:
        clip = clips.prepare(recording, config, with_motion=False)
    except DataError as error:
        found.add(
            "transcript", _one_line(error), "mend the transcript, or remove it: the sound then tells where speech is"
        )
        clip = clips.prepare(replace(recording, transcript_path=None, other_transcripts=()), config, with_motion=False)
    found.seconds = clip.duration
    silent = _look_at_level(sound, found) < _SILENT_DB
    for note in sound.notes:
        found.add("channels", note, "set audio.channel")
    voiced = clip.voiced(config)
    heard = audio.voiced_seconds(voiced)
    found.voiced = heard / clip.duration
    found.n_words = len(clip.words)
    keywords = config.keywords.words or {}
    found.keywords = tuple(sorted({keywords[word.text] for word in clip.words if word.text in keywords}))
    if not silent:
        if heard < min(_LEAST_SPEECH_SECONDS, 0.1 * clip.duration):
            found.add(
                "silent", f"{heard:.1f} s of speech in {clip.duration:.1f} s", "check that this is the speaker's audio"
            )
        else:
            found.onset_rate = clip.onset_rate(config)
            if found.onset_rate < clips.LEAST_ONSETS_PER_SECOND:
                found.add(
                    "few onsets",
                    f"{found.onset_rate:.2f} onsets per second of speech",
                    f"set onsets.per_second={clips.USUAL_ONSETS_PER_SECOND:g}",
                )
    if clip.words:
        if not silent:
            _look_at_words(clip, found, config)
        for note in clip.notes:
            if recording.transcript_path is not None and note.startswith(recording.transcript_path.name):
                found.add("transcript", note, "check the transcript")
    return clip


def _look_at_level(sound: audio.Sound, found: Examined) -> float:
    """Add findings on silent, quiet and clipped sound, and return the level in dB of full scale."""
    samples = sound.samples
    power = float(np.mean(np.square(samples, dtype=np.float64)))
    level = found.level = float(10 * np.log10(max(power, 1e-20)))
    if level < _SILENT_DB:
        found.add(
            "silent", f"the audio is silent ({max(level, -200):.0f} dB)", "check that this is the speaker's audio"
        )
        return level
    if level < _QUIET_DB:
        found.add(
            "quiet",
            f"the audio is very quiet ({level:.0f} dB)",
            "use onsets.per_second, which does not depend on loudness",
        )
    largest = float(np.abs(samples).max())
    extreme = np.abs(samples) >= 0.999 * largest
    inside = extreme[1:-1] & extreme[:-2] & extreme[2:]
    share = float(inside.mean()) if len(inside) else 0.0
    if share > _CLIPPED_SHARE:
        found.add(
            "clipped",
            f"{100 * share:.1f} % of the samples are clipped at {largest:.2f}",
            "record it at a lower gain, or repair it",
        )
    return level


def _look_at_words(clip: Clip, found: Examined, config: Config) -> None:
    """Add a finding where the words do not lie where a voice is heard.

    Both are compared on the detector's windows, by correlation: speech without pauses overlaps with any words.
    """
    if clip.voice is None or not clip.voice.is_known(config.voice):
        return
    heard = clip.voice.speaking(config.voice)
    times = (np.arange(len(heard)) + 0.5) * clip.duration / max(len(heard), 1)
    written = np.zeros(len(heard), dtype=bool)
    for word in clip.words:
        written[np.searchsorted(times, word.start) : np.searchsorted(times, word.end)] = True
    shift, best, there = _fit(heard, written, len(heard) / clip.duration)
    both, n_heard, n_written = (int(np.count_nonzero(windows)) for windows in (heard & written, heard, written))
    covered, true = both / max(n_heard, 1), both / max(n_written, 1)
    paused = min(np.count_nonzero(~heard), np.count_nonzero(~written)) >= _LEAST_PAUSED * len(heard)
    apart = "its words do not lie where a voice is heard"
    if abs(shift) > _LEAST_SHIFT_SECONDS and best >= _FITTING and best - there >= _FITTING_BETTER:
        text, cure = (
            f"{apart}; moved by {shift:+.1f} s they would fit",
            "move them, or check the beginning of the audio",
        )
    elif covered < _VOICE_WRITTEN and true >= _WORDS_HEARD:
        text, cure = (
            f"its words cover {100 * covered:.0f} % of the speech that is heard",
            "complete it, or set pauses.voice=always",
        )
    elif paused and there < _UNFITTING:
        text, cure = f"{apart} (correlation {there:.2f})", "check that it is of this recording"
    else:
        return
    found.add("transcript", text, cure)


def _fit(heard: np.ndarray, written: np.ndarray, rate: float) -> tuple[float, float, float]:
    """Find the shift of the words in seconds that fits the voice best.

    Returns the shift, the correlation with it, and the correlation without any shift.
    """
    if not (0 < np.count_nonzero(heard) < len(heard) and 0 < np.count_nonzero(written) < len(written)):
        return 0.0, 0.0, 0.0
    one, other = heard - heard.mean(), written - written.mean()
    most = min(round(_LONGEST_SHIFT_SECONDS * rate), len(heard) // 2)
    scores = correlate(one, other, "full", "fft")[len(heard) - 1 - most : len(heard) + most]
    scores = scores / np.sqrt(np.dot(one, one) * np.dot(other, other))
    best = int(scores.argmax())
    return (best - most) / rate, float(scores[best]), float(scores[most])


# --- motion -------------------------------------------------------------------------------------------------


def _read_motion(recording: Recording, found: Examined, config: Config) -> Motion | None:
    """Read the motion of a recording at the configured frame rate; None without usable motion."""
    if recording.motion_path is None:
        return None
    try:
        motion = space.read(recording.motion_path, config)
        found.fps, found.skeleton = motion.fps, motion.skeleton
        return cleanup.resample(motion, config.fps)
    except DataError as error:
        found.add("unreadable", _one_line(error), "copy it again or leave it out")
        return None


def _look_at_motion(motion: Motion, found: Examined, config: Config) -> None:
    """Add the figures of a motion, and findings on its joints, unit, stillness and tracking."""
    try:
        joints, _ = clips.select_joints(motion.skeleton, config)
    except DataError as error:
        found.add("joints", _one_line(error), "name those of this skeleton in the key joints")
        joints = list(range(len(motion.skeleton.names)))
    settings = settings_for(motion.skeleton, config)
    world = kinematics.joint_positions(motion, list(range(len(motion.skeleton.names))))
    extents = np.median(np.ptp(world, axis=1), axis=0)
    found.height = float(extents.max())
    for note in space.notes(motion.skeleton, config):
        found.add("units", note, "set motion.unit or motion.up_axis where that is wrong")
    for problem in screening.screen(motion, joints, settings.wrists.joints):
        whole = problem.start is None
        kind = "still" if problem.reason.startswith(("near-motionless", "frozen", "a single")) else "torn"
        cure = "blacklist it" if whole else f"exclude {problem.start:.2f} to {problem.end:.2f} s"
        found.add(kind, problem.reason, cure, problem.start, problem.end)
    hands = _hand_speeds(motion, settings)
    found.hand_speed = None if hands is None else float(hands.mean())


def _hand_speeds(motion: Motion, config: Config) -> np.ndarray | None:
    """Compute the mean speed of both hands seen from the pelvis, cm/s `[shape=(T,)]`; None without these joints."""
    names = motion.skeleton.names
    if motion.n_frames < 2 or not {config.control.left, config.control.right} <= set(names):
        return None
    pelvis = motion.skeleton.pelvis(config.positions.root_joint)
    joints = [names.index(config.control.left), names.index(config.control.right), pelvis]
    places = kinematics.joint_positions(motion, joints)
    steps = np.diff(places[:, :2] - places[:, 2:], axis=0)
    speeds = np.linalg.norm(steps, axis=-1).mean(axis=1) * motion.fps
    return np.append(speeds, speeds[-1])


# --- sound and motion ---------------------------------------------------------------------------------------


def _look_at_both(motion: Motion, clip: Clip, found: Examined, config: Config) -> None:
    """Add findings on sound and motion that differ in length, are out of step or drift apart."""
    seconds = motion.n_frames / motion.fps
    if abs(seconds - clip.duration) > _LENGTHS_APART_SECONDS:
        found.add(
            "lengths",
            f"the motion lasts {seconds:.1f} s, its audio {clip.duration:.1f} s",
            "check where each begins and cut the longer one",
        )
    speech = clip.test_speech(config)
    words = cutting.spoken(clip.words, speech.onset_times, speech.voice)
    found.gesture_clips = sum(not cut.rest for cut in cutting.cut(words, motion.n_frames, motion.fps, config.cutting))
    hands = _hand_speeds(motion, settings_for(motion.skeleton, config))
    if hands is None or found.unfit:
        return
    speaking = np.zeros(motion.n_frames, dtype=bool)
    for start, end in clip.voiced(config):
        speaking[int(start * motion.fps) : int(np.ceil(end * motion.fps))] = True
    evidence = (speaking, clip.onset_peaks.times, hands, motion.fps)
    measured = lag.measure(*evidence)
    if measured is None:
        return
    found.lag, found.lag_sure = measured.seconds, measured.sure
    drifting = lag.drift(*evidence)
    if drifting is not None and abs(drifting) > LARGEST_DRIFT:
        found.add(
            "drifts",
            f"sound and motion drift apart by {abs(drifting):.2f} s from the beginning to the end",
            "check the frame rate of the motion and the sample rate of the audio",
        )
    elif measured.sure and abs(measured.seconds) > LARGEST_STEP:
        later = "later" if measured.seconds > 0 else "earlier"
        found.add(
            "out of step",
            f"the motion is {abs(measured.seconds):.2f} s {later} than the sound (correlation {measured.correlation:.2f})",
            "cut or pad one of them by as much",
        )
