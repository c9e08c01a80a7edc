"""The Python interface, whose results are byte for byte those of the commands.

    import gesturegen as gg

    gesturer = gg.Gesturer().fit([("take.bvh", "take.wav", "take.tsv")])
    gesture = gesturer.gesture("speech.wav", "speech.tsv")
    gesture.save("speech.bvh")
    print(gg.measure(gesture.motion, "speech.wav")["a2m_z"])

Everything that goes wrong with a file or a setting is a `GesturegenError` of one line.
"""

from __future__ import annotations

import json
import os
import shutil
import tempfile
import weakref
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from gesturegen import evaluation, files, pipeline, remembered, submission, tables
from gesturegen import export as formats
from gesturegen.data import clips
from gesturegen.data.recordings import Recording
from gesturegen.errors import ConfigError, DataError
from gesturegen.joints import settings_for
from gesturegen.motion import cleanup, space
from gesturegen.motion.skeleton import Motion
from gesturegen.parallel import describe_bugs
from gesturegen.pipeline.evaluate import locate_file, read_heard, require_same_joints
from gesturegen.settings.loading import load_config
from gesturegen.settings.models import Config
from gesturegen.trace import Trace

Place = str | os.PathLike[str]


def read_motion(path: Place, config: str | Place = remembered.RECOMMENDED) -> Motion:
    """Read a BVH file in centimetres with y up, whatever its unit and axes (`motion.unit`, `motion.up_axis`).

    Rotations are local unit quaternions `[shape=(T, J, 4)]`, wxyz; positions are local, `[shape=(T, J, 3)]`.

    - `path`: the BVH file
    - `config`: file, or name of a config that comes with gesturegen, `best` unless told otherwise

    Raises `DataError` with file and line, `ConfigError` for the config.

    Examples
    --------
    >>> import gesturegen as gg
    >>> motion = gg.read_motion("take.bvh")
    >>> motion.fps
    30.0
    >>> motion.rotations.shape == (motion.n_frames, len(motion.skeleton.names), 4)
    True
    """
    return space.read(os.fspath(path), load_config(remembered.shipped(config)))


def read_speech(
    audio: Place, transcript: Place | None = None, config: str | Place = remembered.RECOMMENDED
) -> clips.Speech:
    """Read a recording of speech and its transcript, as onsets and words on a grid of frames.

    - `audio`: the sound file
    - `transcript`: of any kind that the commands read; without it, the sound tells when somebody speaks
    - `config`: file, or name of a config that comes with gesturegen, `best` unless told otherwise

    Raises `DataError` and `ConfigError`.

    Examples
    --------
    >>> import gesturegen as gg
    >>> speech = gg.read_speech("speech.wav", "speech.tsv")
    >>> speech.n_frames, speech.fps  # 8 seconds
    (240, 30.0)
    >>> len(speech.words) > 0
    True
    """
    settings = load_config(remembered.shipped(config))
    recording = Recording(Path(audio).stem, None, Path(audio), Path(transcript) if transcript else None)
    return clips.prepare(recording, settings, with_motion=False).test_speech(settings)


@dataclass(frozen=True, eq=False)
class Gesture:
    """A gesture motion generated for a speech recording.

    - `name`: of the speech
    - `motion`: in centimetres with y up, as `read_motion` gives it
    - `trace`: what explains every frame of it, with the fields of its file as attributes (see the page on file formats)
    - `text`: the BVH file, byte by byte
    - `pelvis`: the name of the joint that is the pelvis
    - `notes`: what was guessed or given up, a line each
    """

    name: str
    motion: Motion
    trace: Trace
    text: bytes = field(repr=False)
    pelvis: str
    notes: tuple[str, ...] = ()

    def save(self, path: Place) -> None:
        """Write the motion as BVH, all or nothing, with the bytes that `gesturegen reenact` writes."""
        files.write_bytes(path, lambda file: file.write(self.text))

    def export(self, path: Place) -> None:
        """Write the motion in the format of the file's ending: `.bvh`, `.glb` (extra `gltf`), `.csv` or `.npz`.

        Raises `ConfigError` for any other ending.
        """
        place = Path(path)
        suffix = place.suffix.lower()
        if suffix == ".bvh":
            self.save(place)
        elif suffix.removeprefix(".") in formats.FORMATS:
            formats.write(place, self.motion, self.name, self.pelvis)
        else:
            endings = ", ".join(f".{kind}" for kind in ("bvh", *formats.FORMATS))
            raise ConfigError(f"{place}: motions are exported as {endings}; give one of these endings")


class Gesturer:
    """Make gestures for new speech from recordings of a speaker.

    - `config`: file, or name of a config that comes with gesturegen, `best` unless told otherwise
    - `settings`: such as `{"seed": 1, "onsets.min_strength": 0.4}`, over those of the config
    - `jobs`: worker processes, which change no result

    Raises `ConfigError`.

    Examples
    --------
    >>> import gesturegen as gg
    >>> gesturer = gg.Gesturer(config="best", settings={"seed": 1})
    >>> gesturer = gesturer.fit([("take.bvh", "take.wav", "take.tsv")])
    >>> gesture = gesturer.gesture("speech.wav", "speech.tsv")
    >>> gesture.motion.n_frames  # 8 seconds
    240
    >>> gesture.trace.search
    'global'
    >>> gesture.save("speech.bvh")
    >>> gesture.export("speech.csv")
    """

    def __init__(
        self,
        config: str | Place = remembered.RECOMMENDED,
        settings: Mapping[str, object] | None = None,
        jobs: int = 1,
    ):
        self._folder = Path(tempfile.mkdtemp(prefix="gesturegen-"))
        # Nothing of it is left when the object goes.
        self._finalizer = weakref.finalize(self, shutil.rmtree, self._folder, ignore_errors=True)
        places = {"paths.work": "work", "data.references": "references", "data.tests": "speeches"}
        for folder in places.values():
            (self._folder / folder).mkdir()
        overrides = ["references.mode=all", *(f"{key}={json.dumps(value)}" for key, value in (settings or {}).items())]
        self.config: Config = load_config(
            remembered.shipped(config), overrides, {key: str(self._folder / name) for key, name in places.items()}
        )
        self.jobs = jobs
        self._fitted = False
        # Where the files stand that were given.
        self._files: dict[Path, Path] = {}

    def fit(self, recordings: Sequence[Sequence[Place | None]]) -> Gesturer:
        """Use recordings as references: `(bvh, wav)` or `(bvh, wav, tsv)` each; all of them serve every speech.

        What was guessed or left out is in the notes of each gesture. Returns itself. Raises `DataError`.
        """
        if not recordings:
            raise DataError("no recordings were given; give at least one (bvh, wav) or (bvh, wav, tsv)")
        self._fitted = False
        self._place("references", recordings)
        self._fitted = True
        return self

    def gesture(self, audio: Place, transcript: Place | None = None) -> Gesture:
        """Generate gestures for a speech recording, `round(seconds * fps)` frames. Raises `DataError`."""
        if not self._fitted:
            raise DataError("there are no recordings to gesture from; call `fit` first")
        self._place("speeches", [(audio, transcript)])
        name = Path(audio).stem
        notes: list[str] = []
        for command in (pipeline.preprocess, pipeline.build_graphs, pipeline.reenact):
            try:
                summary = command(self.config, self.jobs, True, reuse=True)
            except DataError as error:
                raise type(error)(self._as_given(str(error))) from None
            if summary.outcome.bugs:
                raise RuntimeError("\n".join(describe_bugs(summary.outcome.bugs)))
            if summary.outcome.errors:
                raise DataError(self._as_given("\n".join(summary.outcome.errors.values())))
            notes += [self._as_given(f"{clip}: {note}") for clip, note in summary.warnings]
        folder = self._folder / "work/reenact"
        path = folder / f"{name}.bvh"
        trace = submission.read_trace(folder / f"{name}.trace.json")
        motion = space.read(path, self.config)
        pelvis = settings_for(motion.skeleton, self.config).positions.root_joint
        return Gesture(name, motion, trace, path.read_bytes(), pelvis, tuple(notes))

    def _as_given(self, text: str) -> str:
        """Replace the paths of temporary links in a message by the names of the files that the user gave."""
        for place, file in self._files.items():
            text = text.replace(str(place), str(file))
        return text

    def _place(self, folder: str, recordings: Sequence[Sequence[Place | None]]) -> None:
        """Link the files of each recording into a folder under one name, as a dataset folder has them."""
        target = self._folder / folder
        self._files = {place: file for place, file in self._files.items() if place.parent != target}
        for old in sorted(target.iterdir()):
            old.unlink()
        names: set[str] = set()
        for recording in recordings:
            given = [Path(file) for file in recording if file is not None]
            if missing := [file for file in given if not file.is_file()]:
                raise DataError(f"{missing[0]}: no such file")
            name = given[0].stem
            if name in names:
                raise DataError(f"{given[0]}: two recordings are called {name}; rename one")
            names.add(name)
            for file in given:
                place = target / f"{name}{file.suffix.lower()}"
                self._files[place] = file
                try:
                    place.symlink_to(file.resolve())
                except OSError:  # where there are no links
                    shutil.copyfile(file, place)


def measure(
    motion: Motion | Place, audio: Place, truth: Motion | Place | None = None,
    config: str | Place = remembered.RECOMMENDED,
) -> dict[str, float | None]:  # fmt: skip
    """Measure the motion of any system against its speech, as `gesturegen evaluate --bvh` does.

    - `motion`, `truth`: motions or BVH files; `truth` is the true motion of that speech
    - `audio`: the sound file
    - `config`: file, or name of a config that comes with gesturegen, `best` unless told otherwise

    Returns the figures by their names in `metrics.csv`; None where there is none. Raises `DataError` and `ConfigError`.

    Examples
    --------
    >>> import gesturegen as gg
    >>> figures = gg.measure("take.bvh", "take.wav", truth="take.bvh")
    >>> figures["syn"]  # the mean difference to itself
    0.0
    >>> figures["hard_joins_per_minute"] is None  # only a trace tells
    True
    """
    settings = load_config(remembered.shipped(config))
    found = _joints(motion, settings)
    true = None if truth is None else _joints(truth, settings)
    if true is not None:
        require_same_joints("truth", true, found)
    row = evaluation.measure_clip(
        found, settings, read_heard(Path(audio), settings), true, None, None, evaluation.NAN, []
    )
    pairs = ([found], [true]) if true is not None else ([], [])
    return tables.json_figures(evaluation.totals([row], *pairs, settings))


def _joints(motion: Motion | Place, config: Config) -> evaluation.Joints:
    if not isinstance(motion, Motion):
        return locate_file(Path(motion), config)
    return evaluation.locate(cleanup.resample(motion, config.fps), config)
