"""The index of the clips that `preprocess` stored, `clips/index.json`."""

from __future__ import annotations

from gesturegen.stored.documents import Document, Part, Seconds

FORMAT_VERSION = 2


class IndexedClip(Part):
    """A recording that became a clip, its length in seconds."""

    speaker: str | None
    seconds: Seconds


class IndexedTest(IndexedClip):
    """A test recording, with the places of its sound and, where there is one, of its true motion.

    In the file they are as seen from the work folder; `pipeline.common.read_index` makes them paths that can be opened.
    """

    audio: str | None = None
    truth: str | None


class Index(Document):
    """The clips of a work folder, by name.

    settings : JSON of those that say which recordings there are; training_seconds : of all of them, the blacklist
    included; failed : test clips that could not be read, and why
    """

    format_version: int
    settings: str
    references: dict[str, IndexedClip]
    tests: dict[str, IndexedTest]
    training_seconds: Seconds
    failed: dict[str, str]

    @property
    def durations(self) -> dict[str, float]:
        """Return the seconds of each reference clip."""
        return {name: row.seconds for name, row in self.references.items()}
