"""Packing of one clip as compact text: joint positions in small steps, audio as Vorbis, and its trace.

Positions are whole multiples of a step (a 2000th of the figure), stored as differences from frame to frame, low
bytes before high bytes, deflated, in base64: about 0.3 MB for a minute of 60 joints. The error is at most
half a step in each axis.
"""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Mapping, Sequence

import numpy as np

from gesturegen import evaluation
from gesturegen.control.measures import UNITS
from gesturegen.control.schedule import Demand, Measures
from gesturegen.data.clips import Speech
from gesturegen.joints import settings_for
from gesturegen.motion.skeleton import Motion
from gesturegen.report import figure, sound
from gesturegen.settings.models import Config
from gesturegen.trace import Trace

STEPS_PER_FIGURE = 2000
# Steps are int16; a motion that travels further than this many is stored in longer ones.
_MOST_STEPS = 32_000


def pack_motion(motion: Motion, config: Config, label: str, trace: Mapping | None = None) -> dict:
    """Pack a motion for the player that draws it.

    label : what the viewer reads; trace : of `pack_trace`, None for a motion that has none
    """
    drawn = figure.of_skeleton(motion.skeleton, settings_for(motion.skeleton, config).positions.root_joint)
    positions = config.positions.scale * figure.points(drawn, motion)
    steps, step, centre = quantise(positions, figure.size(positions) / STEPS_PER_FIGURE)
    return {
        "label": label,
        "fps": motion.fps,
        "frames": motion.n_frames,
        "parents": drawn.parents,
        "sides": "".join(drawn.sides),
        "thin": "".join("1" if thin else "0" for thin in drawn.thin),
        "pelvis": drawn.pelvis,
        "head": drawn.head,
        "facing": round(figure.facing(drawn, positions), 4),
        "size": round(figure.size(positions), 3),
        "floor": round(figure.floor(positions), 3),
        "step": step,
        "centre": centre,
        "data": encode_steps(steps),
        "trace": trace,
    }


def quantise(positions: np.ndarray, step: float) -> tuple[np.ndarray, float, list[float]]:
    """Quantise positions `[shape=(T, K, 3)]` to int16 multiples of a step around a centre; also return step and centre.

    The step grows where the motion would leave the range of int16.
    """
    low, high = positions.min(axis=(0, 1)), positions.max(axis=(0, 1))
    centre = np.round((low + high) / 2, 3)
    step = max(step, float((high - low).max()) / 2 / _MOST_STEPS)
    return np.round((positions - centre) / step).astype(np.int16), step, centre.tolist()


def encode_steps(steps: np.ndarray) -> str:
    """Encode int16 `[shape=(T, K, 3)]` as text: per channel the differences in time, low bytes, then high bytes."""
    channels = steps.reshape(len(steps), -1).T
    differences = np.diff(channels, axis=1, prepend=np.int16(0)).astype("<u2")
    low, high = differences & 0xFF, differences >> 8
    return base64_text(zlib.compress(low.astype(np.uint8).tobytes() + high.astype(np.uint8).tobytes(), 9))


def pack_audio(samples: np.ndarray, rate: int) -> dict:
    """Pack a speech for the player: the sound, and peaks to draw."""
    return {
        "ogg": base64_text(sound.vorbis(samples, rate)),
        "peaks": base64_text(sound.peaks(samples, rate).tobytes()),
        "peaks_per_second": sound.PEAKS_PER_SECOND,
    }


def pack_control(demands: Sequence[Demand], shown: Measures, recorded: Measures, fps: float) -> list[dict]:
    """Pack each demand with its bounds, the curve of its measure over the whole clip, and a row of a table.

    shown, recorded : the measures of the hands in the frames of the motion and in the nodes of its references
    """
    rows = evaluation.measure_control(demands, shown, recorded, fps)
    return [
        {
            "name": row["measure"],
            "hand": "" if row["measure"] == "symmetry" else row["hand"],
            "unit": UNITS[row["measure"]],
            "low": None if row["at_least"] is None else round(row["at_least"], 2),
            "high": None if row["at_most"] is None else round(row["at_most"], 2),
            "from": row["from"],
            "to": row["to"],
            "values": np.round(shown[demand.key], 1).tolist(),
            "cells": evaluation.control_cells(row),
        }
        for demand, row in zip(demands, rows, strict=True)
    ]


def pack_trace(trace: Trace, source_frames: np.ndarray, control: Sequence[dict] = ()) -> dict:
    """Pack the pieces and joins of a trace, and the reference frame that each output frame shows.

    source_frames : of the graph [shape=(N,)]; DataError when the trace walks over nodes that it lacks
    control : of `pack_control`
    """
    shown = trace.shown_nodes()
    starts = np.array(trace.start_nodes)
    clips = np.searchsorted(starts, shown, side="right") - 1
    # Gestures of a library come after the frames of the graph.
    gesture = np.array([reference.is_gesture for reference in trace.references])[clips]
    if shown[~gesture].max(initial=-1) >= len(source_frames):
        raise trace.of_another_graph()
    source = np.where(gesture, shown - starts[clips], source_frames[np.where(gesture, 0, shown)])
    return {
        "references": [
            reference.clip + (" (mirrored)" if reference.mirrored else "") for reference in trace.references
        ],
        "reference": clips.tolist(),
        "source": source.tolist(),
        "pieces": [
            [piece.start_frame, piece.end_frame, piece.end_kind, piece.keyword, piece.fallback]
            for piece in trace.pieces
        ],
        "joins": [[join.frame, round(join.distance, 3), join.natural] for join in trace.joins],
        "control": list(control),
    }


def pack_clip(
    speech: Speech, keywords: Mapping[str, str], motions: Sequence[dict], audio: dict | None, notes: Sequence[str] = ()
) -> dict:
    """Pack all that the report shows of one clip.

    speech : onsets and words; keywords : word -> keyword; motions : of `pack_motion`, the run's own first
    audio : of `pack_audio`, None without; notes : what a viewer should know
    """
    return {
        "name": speech.name,
        "fps": speech.fps,
        "frames": speech.n_frames,
        "onsets": np.round(speech.onset_times, 3).tolist(),
        "words": [
            [word.text, round(word.start, 3), round(word.end, 3), keywords.get(word.text)] for word in speech.words
        ],
        "audio": audio,
        "motions": list(motions),
        "notes": list(notes),
    }


def inert_json(value) -> str:
    """Format JSON for the inside of an HTML script tag: ASCII only, and nothing in it can close the tag."""
    text = json.dumps(value, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def base64_text(data: bytes) -> str:
    """Encode bytes as ASCII text in base 64."""
    return base64.b64encode(data).decode("ascii")
