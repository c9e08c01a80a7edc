"""Keyword gestures: the places where a gesture of the library is to be shown (Habibie et al. 2022, §4.2)."""

from __future__ import annotations

from dataclasses import dataclass

from gesturegen.control.schedule import names_one_clip
from gesturegen.data.clips import Speech
from gesturegen.data.recordings import is_listed
from gesturegen.errors import DataError
from gesturegen.settings.control import Control, KeywordGesture
from gesturegen.speech.transcript import normalize

# Seconds from one gesture to the next; a shorter one would be cut off before it is seen.
_APART = 0.5
# Times exactly that far apart are, whatever their rounding.
_SLACK = 1e-6


@dataclass(frozen=True)
class Placement:
    """A gesture of the library that is to be shown at `time` seconds."""

    time: float
    gesture: str


def placements(control: Control, speech: Speech) -> tuple[list[Placement], list[str]]:
    """List the gestures of a speech in order of time, and one line of explanation for each that is left out.

    Of two gestures less than 0.5 s apart, the later one is left out; of two at the same time, the one that stands
    later in the file. Raises DataError with one line for each gesture past the end of the clip that it names.
    """
    duration = speech.n_frames / speech.fps
    wanted: list[Placement] = []
    notes: list[str] = []
    problems: list[str] = []
    for place, entry in enumerate(control.gestures, 1):
        if not is_listed(speech.name, (entry.clip,)):
            continue
        own = names_one_clip(entry.clip, speech.name)
        if entry.at is not None and entry.at >= duration - _SLACK:
            text = f"gesture {place} ({entry.gesture}): at {entry.at:g} s, the clip ends at {duration:.2f} s"
            if own:
                problems.append(f"clip {speech.name}: {text}")
            else:
                notes.append(f"{text}, so it is left out")
            continue
        times = _times(entry, speech)
        if not times and own:
            notes.append(f"gesture {place} ({entry.gesture}): the word {entry.word!r} is never said")
        wanted += [Placement(time, entry.gesture) for time in times]
    if problems:
        raise DataError("\n".join(problems))
    shown: list[Placement] = []
    for placement in sorted(wanted, key=lambda placement: placement.time):
        if shown and placement.time - shown[-1].time < _APART - _SLACK:
            notes.append(
                f"gesture {placement.gesture} at {placement.time:.2f} s comes less than {_APART:g} s after "
                f"{shown[-1].gesture} at {shown[-1].time:.2f} s, so it is left out"
            )
        else:
            shown.append(placement)
    return shown, notes


def _times(entry: KeywordGesture, speech: Speech) -> list[float]:
    """List the times in seconds at which a gesture is wanted."""
    if entry.at is not None:
        return [entry.at]
    assert entry.word is not None  # the settings demand one of `word` and `at`
    word = normalize(entry.word)
    return [said.start for said in speech.words if said.text == word]
