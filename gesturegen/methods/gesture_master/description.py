"""Statistics of a gesture database, of recordings and their mirrored copies where not said otherwise."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from functools import partial
from typing import Any, BinaryIO

import numpy as np

from gesturegen.methods.gesture_master import style
from gesturegen.methods.gesture_master.database import GestureDatabase
from gesturegen.methods.gesture_master.extraction import BODIES
from gesturegen.methods.inspection import BLUE, GREY, ORANGE, new_figure, save_figure
from gesturegen.methods.method import Inspection
from gesturegen.speech import cutting, rhythm
from gesturegen.text import align, count

# GestureMaster, §3.1.
PAPER_GAP_SECONDS = 0.4
_QUANTILES = {"min": 0.0, "25%": 0.25, "median": 0.5, "75%": 0.75, "max": 1.0}
_UNITS = {"speed": "cm/s", "radius": "cm", "height": "cm"}
# Of recordings and of clips that were left out, and of gesture clips, in the lines.
_MOST_NAMED, _MOST_CLIPS = 20, 40
_MORE = "(--json lists all)"


def describe_database(database: GestureDatabase) -> dict:
    """Compute all figures of a database for JSON; NaN is null. Lengths are in seconds unless named otherwise.

    `recordings`, `clips`, `lengths`, `rhythm` and `thresholds` leave out mirrored copies, `style` leaves out rests
    unless there is nothing else.
    """
    copied = of_copies(database)
    own = ~copied
    recordings = _describe_recordings(database)
    dropped = [{"clip": name, "reason": reason} for name, reason in database.dropped.tolist()]
    return {
        "recordings": recordings,
        "mirrored": bool(database.mirrored.any()),
        "frames": sum(recording["frames"] for recording in recordings),
        "seconds": sum(recording["seconds"] for recording in recordings),
        "fps": database.fps,
        "joints": {
            "compared": len(database.joint_names),
            "upper": len(database.upper_names),
            "lower": len(database.lower_names),
            "fingers": len(database.finger_names),
        },
        "gesture_clips": {
            "total": len(database.starts),
            "gestures": int((~database.rests).sum()),
            "rests": int(database.rests.sum()),
            "mirrored": int(copied.sum()),
        },
        "lengths": {
            kind: _spread(database.lengths[own & which] / database.fps)
            for kind, which in (("gestures", ~database.rests), ("rests", database.rests))
        },
        "thresholds": [
            {"gap_seconds": gap, "clips": int(number), "mean_seconds": _figure(mean)}
            for gap, (number, mean) in zip(cutting.THRESHOLDS, database.thresholds, strict=True)
        ],
        "paper_gap_seconds": PAPER_GAP_SECONDS,
        "rhythm": {
            "bits": database.rhythms.shape[1],
            "mean_set": _mean(database.rhythms[own].sum(axis=1)),
            "mean_set_gestures": _mean(database.rhythms[own & ~database.rests].sum(axis=1)),
            "mean_set_rests": _mean(database.rhythms[own & database.rests].sum(axis=1)),
        },
        "style": {
            name: {"mean": _figure(mean), "std": _figure(std), "unit": _UNITS[name]}
            for name, mean, std in zip(style.VALUES, database.style_means, database.style_scales, strict=True)
        },
        "regression": _describe_regression(database),
        "edges": {body: _describe_edges(database, body) for body in BODIES},
        "clips_with_fingers_of_others": int((database.finger_sources != np.arange(len(database.starts))).sum()),
        "dropped": dropped,
        "dropped_kinds": dict(Counter(_reason_kind(one["reason"]) for one in dropped).most_common()),
        "notes": database.notes.tolist(),
        "clips": [_describe_clip(database, k, copied) for k in np.flatnonzero(own).tolist()],
    }


def of_copies(database: GestureDatabase) -> np.ndarray:
    """Mark the gesture clips of mirrored copies, bool `[shape=(G,)]`."""
    return database.mirrored[_recordings_of(database)]


def leaving(database: GestureDatabase, body: str) -> np.ndarray:
    """Count the edges of one body that leave each gesture clip, int `[shape=(G,)]`."""
    return np.bincount(getattr(database, f"{body}_sources"), minlength=len(database.starts))


def _recordings_of(database: GestureDatabase) -> np.ndarray:
    return np.searchsorted(database.clip_starts, database.starts, side="right") - 1


def _describe_recordings(database: GestureDatabase) -> list[dict]:
    ends = np.append(database.clip_starts[1:], database.n_nodes)
    held = Counter(_recordings_of(database).tolist())
    return [
        {
            "clip": name,
            "start_node": int(start),
            "frames": int(end - start),
            "seconds": float((end - start) / database.fps),
            "gesture_clips": held[k],
        }
        for k, (name, start, end) in enumerate(zip(database.clip_names, database.clip_starts, ends, strict=True))
        if not database.mirrored[k]
    ]


def _describe_clip(database: GestureDatabase, clip: int, copied: np.ndarray) -> dict:
    start, stop = int(database.starts[clip]), int(database.stops[clip])
    source = int(database.finger_sources[clip])
    return {
        "name": str(database.names[clip]),
        "start_node": start,
        "start_seconds": float(database.source_frames[start] / database.fps),
        "stop_seconds": float((database.source_frames[stop - 1] + 1) / database.fps),
        "kind": "rest" if database.rests[clip] else "gesture",
        "frames": stop - start,
        "bits": rhythm.to_text(database.rhythms[clip]),
        **dict(zip(style.VALUES, map(_figure, database.styles[clip]), strict=True)),
        "fingers_of": None
        if source == clip
        else {"name": str(database.names[source]), "mirrored": bool(copied[source])},
    }


def _describe_regression(database: GestureDatabase) -> dict | None:
    if not np.isfinite(database.r2).all():
        return None
    found = database.regression
    return {
        "clips": found.n_clips,
        "r2": dict(zip(style.VALUES, found.r2.tolist(), strict=True)),
        "summary": style.describe(found),
    }


def _describe_edges(database: GestureDatabase, body: str) -> dict:
    outwards, inwards = leaving(database, body), np.diff(getattr(database, f"{body}_indptr"))
    total = int(inwards.sum())
    return {
        "delta_t": float(database.deltas[BODIES.index(body)]),
        "total": total,
        # A clip may follow itself.
        "share_of_pairs": total / len(outwards) ** 2,
        "per_clip": _spread(outwards),
        "clips_without_out": int((outwards == 0).sum()),
        "clips_without_in": int((inwards == 0).sum()),
    }


def _reason_kind(reason: str) -> str:
    """Return the first word of a reason, or `short` for a clip that is too short."""
    word = reason.split()[0]
    return "short" if word[0].isdigit() else word


def _spread(values: np.ndarray) -> dict[str, float] | None:
    if not len(values):
        return None
    return {"mean": _mean(values)} | dict(
        zip(_QUANTILES, np.quantile(values, list(_QUANTILES.values())).tolist(), strict=True)
    )


def _mean(values: np.ndarray) -> float | None:
    return float(values.mean()) if len(values) else None


def _figure(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


# --- lines --------------------------------------------------------------------------------------------------


def database_lines(facts: Mapping) -> list[str]:
    """Format the figures of `describe_database` for reading."""
    recordings, clips, dropped = facts["recordings"], facts["gesture_clips"], facts["dropped"]
    joints, bits = facts["joints"], facts["rhythm"]
    copies = "each also mirrored" if facts["mirrored"] else "none mirrored"
    lines = [
        f"gesture database: {count(len(recordings), 'recording')}, {copies}; {facts['frames']} frames "
        f"({facts['seconds']:.1f} s at {facts['fps']:g} fps)",
        *(
            f"recording: {one['clip']}, {one['frames']} frames from node {one['start_node']}, "
            f"{count(one['gesture_clips'], 'gesture clip')}"
            for one in recordings[:_MOST_NAMED]
        ),
        *_more(len(recordings), _MOST_NAMED, "recordings"),
        f"joints: {joints['compared']} compared; {joints['upper']} of the upper body, {joints['lower']} of the lower, "
        f"{joints['fingers']} of the fingers",
        f"gesture clips: {clips['total']}: {count(clips['gestures'], 'gesture')}, {count(clips['rests'], 'rest')}; "
        f"{clips['mirrored']} of them mirrored copies",
        *(f"lengths of {kind}, s: {_spread_text(found, 2)}" for kind, found in facts["lengths"].items()),
        *_threshold_lines(facts),
        f"rhythm: of {bits['bits']} bits {_mean_text(bits['mean_set'])} are set on average (gestures "
        f"{_mean_text(bits['mean_set_gestures'])}, rests {_mean_text(bits['mean_set_rests'])})",
        "style of the gestures, mean and standard deviation: "
        + ", ".join(
            f"{name} {_mean_text(one['mean'])}, {_mean_text(one['std'])} {one['unit']}"
            for name, one in facts["style"].items()
        ),
        facts["regression"]["summary"] if facts["regression"] else "style from prosody: not asked for",
    ]
    for body, edges in facts["edges"].items():
        lines.append(
            f"edges of the {body} body: {edges['total']} below delta_T {edges['delta_t']:.4g}, {edges['share_of_pairs']:.2%} of "
            f"all pairs; per clip: {_spread_text(edges['per_clip'])}; "
            f"{count(edges['clips_without_out'], 'clip')} without one out, {edges['clips_without_in']} without one in"
        )
    lines.append(f"clips with the fingers of another: {facts['clips_with_fingers_of_others']}")
    kinds = ", ".join(f"{number} {kind}" for kind, number in facts["dropped_kinds"].items())
    lines.append(f"clips dropped: {len(dropped)}" + (f": {kinds}" if dropped else ""))
    lines += [f"dropped: {one['clip']}, {one['reason']}" for one in dropped[:_MOST_NAMED]]
    lines += _more(len(dropped), _MOST_NAMED, "dropped")
    return [*lines, *(f"note: {note}" for note in facts["notes"]), *_clip_lines(facts["clips"])]


def _threshold_lines(facts: Mapping) -> list[str]:
    rows = facts["thresholds"]
    table = [
        ("gap between words over, s", *(f"{row['gap_seconds']:g}" for row in rows)),
        ("clips of gestures", *(str(row["clips"]) for row in rows)),
        ("their mean length, s", *(_mean_text(row["mean_seconds"]) for row in rows)),
    ]
    return [
        "clips by gap threshold, before any was dropped, without mirrored copies (the paper chose "
        f"{facts['paper_gap_seconds']:g} s):",
        *(f"  {line}" for line in align(table, range(1, len(rows) + 1))),
    ]


def _clip_lines(clips: list[dict]) -> list[str]:
    heading = ("gesture clip", "seconds", "kind", "frames", "bits", *style.VALUES, "")
    rows = [
        (
            clip["name"], f"{clip['start_seconds']:.2f}-{clip['stop_seconds']:.2f}", clip["kind"], str(clip["frames"]),
            clip["bits"], *(_mean_text(clip[name]) for name in style.VALUES),
            _fingers_text(clip["fingers_of"]),
        )
        for clip in clips[:_MOST_CLIPS]
    ]  # fmt: skip
    return [*align([heading, *rows], (3, 5, 6, 7)), *_more(len(clips), _MOST_CLIPS, "gesture clips")]


def _fingers_text(source: Mapping | None) -> str:
    return "" if source is None else f"fingers of {source['name']}{' mirrored' if source['mirrored'] else ''}"


def _more(total: int, most: int, what: str) -> list[str]:
    return [f"and {total - most} more {what} {_MORE}"] if total > most else []


def _spread_text(spread: Mapping[str, float] | None, digits: int = 0) -> str:
    if spread is None:
        return "-"
    return ", ".join(
        f"{word} {value:.{max(digits, 1) if word == 'mean' else digits}f}" for word, value in spread.items()
    )


def _mean_text(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"


def inspect(database: GestureDatabase) -> Inspection:
    """Describe a database with all its figures and plots."""
    facts = describe_database(database)
    return Inspection(facts, database_lines(facts), partial(plot_database, database))


# --- pictures -----------------------------------------------------------------------------------------------


def plot_database(database: GestureDatabase, title: str, file: BinaryIO) -> None:
    """Draw a PNG of clip lengths, clips by gap threshold, styles and edges; the first three without mirrored copies."""
    figure = new_figure()
    (lengths, thresholds), (styles, edges) = figure.subplots(2, 2)
    own = ~of_copies(database)
    kinds = (("gestures", own & ~database.rests, BLUE), ("rests", own & database.rests, ORANGE))
    lengths.hist(
        [database.lengths[which] / database.fps for _, which, _ in kinds], bins=30, stacked=True,
        color=[color for _, _, color in kinds], label=[name for name, _, _ in kinds],
    )  # fmt: skip
    lengths.set(xlabel="length, s", ylabel="gesture clips", title="lengths")
    lengths.yaxis.get_major_locator().set_params(integer=True)
    lengths.legend()
    _draw_thresholds(thresholds, database)
    for name, which, color in kinds:
        styles.plot(database.styles[which, 0], database.styles[which, 2], ".", color=color, markersize=4, label=name)
    styles.set(xlabel="hand speed, cm/s", ylabel="height of the right hand, cm", title="styles")
    degrees = [leaving(database, body) for body in BODIES]
    most = max(int(one.max()) for one in degrees)
    bins = np.arange(most + 2) - 0.5 if most < 40 else np.linspace(-0.5, most + 0.5, 41)
    edges.hist(degrees, bins=bins, color=[BLUE, ORANGE], label=[f"{body} body" for body in BODIES])
    edges.set(xlabel="edges that leave a clip", ylabel="clips (log)", yscale="log", title="edges")
    edges.set_ylim(bottom=0.5)  # a single clip must be visible
    edges.yaxis.set_major_formatter("{x:g}")
    edges.yaxis.set_minor_formatter("")
    edges.legend()
    save_figure(figure, title, file)


def _draw_thresholds(axes: Any, database: GestureDatabase) -> None:
    """Draw the number of clips and, on a second axis, their mean length."""
    numbers, means = database.thresholds.T
    axes.plot(cutting.THRESHOLDS, numbers, ".-", color=BLUE)
    axes.axvline(PAPER_GAP_SECONDS, color=GREY, linewidth=1)
    axes.set(xlabel="gap between words over, s; the paper's in grey", title="clips by gap threshold")
    axes.set_ylabel("clips", color=BLUE)
    axes.set_ylim(bottom=0)
    other = axes.twinx()
    other.plot(cutting.THRESHOLDS, means, ".-", color=ORANGE)
    other.set_ylabel("mean length, s", color=ORANGE)
    other.set_ylim(bottom=0)
