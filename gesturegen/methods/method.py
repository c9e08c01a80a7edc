"""The contract of a method: its properties, and the steps that lead from references and speech to a path.

A method is one class in one folder beside this file, entered in `METHODS`. Nothing outside the folder `methods` names
one. Modules with kernels are imported inside the functions that need them, so that reading a config stays fast.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, BinaryIO, Generic, TypeVar

if TYPE_CHECKING:
    import numpy as np

    from gesturegen.data.clips import Reference, Speech
    from gesturegen.errors import GesturegenError
    from gesturegen.frames import ReferenceFrames
    from gesturegen.outcome import Outcome
    from gesturegen.path import Path
    from gesturegen.settings.models import Config
    from gesturegen.stored.arrays import Kind

Library = TypeVar("Library", bound="ReferenceFrames")
# Bytes of a worker with its libraries and compiled loops, and of each reference frame: the recording, the library, and
# what building it or searching it needs beside them. Measured on demo references of 10 to 60 min, with a margin.
WORKER_BYTES, BYTES_PER_FRAME = 350e6, 10_000


@dataclass(frozen=True)
class Job:
    """A library that is to be built: its settings, its reference clips, and its file."""

    config: Config
    names: tuple[str, ...]
    path: FilePath


@dataclass(frozen=True)
class Prepared:
    """Results of the work before libraries are built, by library: parts, lines to say, errors and bugs."""

    parts: Mapping[str, Any] = field(default_factory=dict)
    notes: Mapping[str, Sequence[str]] = field(default_factory=dict)
    errors: Mapping[str, str] = field(default_factory=dict)
    bugs: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Description:
    """Report on a library that was built: lines and notes, and patterns in the config that match nothing in it.

    unmatched : (key of the config, pattern, error)
    """

    lines: Sequence[str]
    notes: Sequence[str] = ()
    unmatched: Sequence[tuple[str, str, str]] = ()


@dataclass(frozen=True)
class Inspection:
    """All figures of a library: facts for JSON, lines for reading, and a function that draws a PNG, or None."""

    facts: dict
    lines: Sequence[str]
    draw: Callable[[str, BinaryIO], None] | None = None


@dataclass(frozen=True)
class Material:
    """Properties of a data set that decide what methods can do with it: of usable references, and of tests."""

    references: str
    minutes: float
    all_have_onsets: bool
    gesture_clips: int
    shared_keywords: int
    joint_names: frozenset[str]
    config: Config


class Method(ABC, Generic[Library]):
    """A way to choose frames of references for speech; subclasses override what differs from the defaults here.

    name : as in the config and in what the method stores
    suffix : of the names of its files in `WORK/graphs`
    settings : keys of the config that its library depends on
    sections : of the config that say which clips it shows, such as mirrored ones
    control : the setting with which it follows conditions on the hands, as a user writes it; None where it cannot
    joint_settings : keys of its settings that name joints -> the roles that stand in for them on other skeletons
    bodies : names of the tracks of its paths, the first of which the pieces of a trace are of
    at_once : whether searching for many speeches together is faster than one by one
    """

    name: str
    suffix: str
    settings: tuple[str, ...]
    sections: tuple[str, ...] = ()
    control: str | None = None
    joint_settings: Mapping[str, tuple[str, ...]] = {}
    bodies: tuple[str, ...] = ()
    at_once: bool = False

    # --- what it says of a config

    def search_name(self, config: Config) -> str:
        """Return the name of the search under these settings."""
        return self.name

    def lacks(self, config: Config) -> str | None:
        """Say in one line what the method needs of recordings that these settings do not measure, or return None."""
        return None

    def follows_conditions(self, config: Config) -> bool:
        """Tell whether the method follows conditions on the hands under these settings."""
        return False

    def named_clips(self, config: Config) -> Iterable[tuple[str, str, str]]:
        """List clips that the settings name: (key of the config, name or pattern, `test clip` or `reference clip`)."""
        return ()

    def advice(self, config: Config) -> str:
        """Say what a user can do where the method found nothing or nothing new."""
        return "give longer references"

    def thrift(self, config: Config) -> str | None:
        """Return a setting with which the method needs less memory; None where there is none."""
        return None

    def prospects(self, material: Material) -> Sequence[tuple[str, str, str]]:
        """List what the method could do with a data set, for the doctor: (what, `yes`, `limited` or `no`, why)."""
        return ((self.name, "yes", material.references),)

    def bytes_needed(self, reference_frames: int, test_frames: int, config: Config, kept_frames: int) -> float:
        """Estimate the most bytes of a worker; kept_frames : of another library, held until the next one is read."""
        return WORKER_BYTES + BYTES_PER_FRAME * (reference_frames + kept_frames)

    # --- the library

    @abstractmethod
    def part(self, reference: Reference, config: Config) -> Any:
        """Extract one reference's part of a library; DataError when it is unfit."""

    @abstractmethod
    def assemble(self, parts: Sequence[Any], config: Config) -> Library:
        """Assemble a library from several parts; DataError when their skeletons differ."""

    @abstractmethod
    def kind(self) -> Kind:
        """Return the format of the method's stored library."""

    @abstractmethod
    def library_type(self) -> type[Library]:
        """Return the class of the method's library."""

    def prepare(
        self, jobs: Mapping[str, Job], is_stored: Callable[[Job], bool], run: Callable[[Mapping, str], Outcome]
    ) -> Prepared:
        """Do in several processes what `build` would do in one.

        is_stored : whether the library of a job is there and may stay, which reads the whole of it
        run : tasks by title and a label -> their outcome
        """
        return Prepared()

    def build(self, job: Job, prepared: Any = None) -> Library:
        """Build the library of a job; prepared : its parts, of `prepare`."""
        from gesturegen.data.stored_clips import load_references

        parts = prepared or [self.part(reference, job.config) for reference in load_references(job.config, job.names)]
        return self.assemble(parts, job.config)

    def built(self, job: Job) -> None:
        """Finish a job after its library has been stored, such as by deleting intermediate files."""
        return None

    def shown_clips(self, config: Config, names: Sequence[str]) -> Sequence[Reference]:
        """Return the clips of a library in the order of its nodes, for rendering what it shows of them."""
        from gesturegen.data.stored_clips import load_references

        return load_references(config, names)

    def describe(self, library: Library, config: Config) -> Description:
        """Describe a library for the output of `build-graph`."""
        return Description([f"{library.n_nodes} nodes"])

    def inspect(self, library: Library) -> Inspection:
        """Describe a library for the output of `inspect`."""
        from gesturegen.methods.inspection import inspect_frames

        return inspect_frames(library)

    def piece_name(self, library: Library, nodes: Sequence[int]) -> str | None:
        """Return the name of what a piece shows as a whole, such as a gesture clip; None where it has none."""
        return None

    def shows_whole_pieces(self) -> bool:
        """Tell whether each piece of the method's paths has a `piece_name`."""
        return False

    # --- the search

    @abstractmethod
    def search(
        self, library: Library, speech: Speech, config: Config, rng: np.random.Generator,
        earlier: Sequence[Path] = (),
    ) -> Path:  # fmt: skip
        """Find a path for a whole test speech; earlier : the paths of other variants, from which it should differ."""

    def search_all(
        self, library: Library, speeches: Mapping[str, Speech], config: Config
    ) -> dict[str, Path | GesturegenError]:
        """Find paths for many speeches, by name, or the error of one that has none; the same as one by one."""
        from gesturegen.errors import GesturegenError
        from gesturegen.randomness import generator

        found: dict[str, Path | GesturegenError] = {}
        for name, speech in speeches.items():
            try:
                found[name] = self.search(library, speech, config, generator(config.seed, name))
            except GesturegenError as error:
                found[name] = error
        return found

    def objective(self, library: Library, speech: Speech, nodes: np.ndarray, config: Config) -> float:
        """Compute what a path costs by the objective of the optimal search; NaN where there is none.

        nodes : int [shape=(n_frames,)], shown in each frame of the speech
        """
        return float("nan")

    # --- compiled loops

    def build_loops(self) -> Sequence[Callable[[], object]]:
        """Return functions that compile what building needs, so that no two processes compile it at once."""
        return ()

    def search_loops(self) -> Sequence[Callable[[], object]]:
        """Return functions that compile what searching needs."""
        return ()


class Trainer(Method[Library]):
    """A method on whose motion a refinement network is trained."""

    @abstractmethod
    def stand_in(
        self, library: Library, reference: Reference, k: int, config: Config, rng: np.random.Generator
    ) -> Path:
        """Find the k-th best path for the speech of a reference that shows nothing of it, where that can be."""
