"""Join distance and coverage by the length of the references, for each way of searching them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gesturegen.experiment.figures import Result
from gesturegen.settings.models import Config
from gesturegen.tables import json_figures

# Means over the clips; the others of a point are formed below.
_MEANS = ("join_distance_mean", "hard_joins_per_minute", "reference_share", "objective", "search_seconds")


def table(setups: Mapping[str, Config], result: Result) -> dict:
    """Gather what `reference_length.json` holds: for every line of the plot its points, by length.

    A line is a group of setups that differ in `references.seconds` alone; it is called after its search, or,
    where another is too, after its first setup.
    """
    groups: dict[str, list[str]] = {}
    for name, config in setups.items():
        groups.setdefault(_but_for_length(config), []).append(name)
    searches = [setups[names[0]].search_name for names in groups.values()]
    lines = {}
    for search, names in zip(searches, groups.values(), strict=True):
        points = [_point(name, setups[name], [row for row in result.clips if row["setup"] == name]) for name in names]
        points.sort(key=lambda point: (point["reference_seconds"], point["asked_seconds"] or np.inf))
        lines[search if searches.count(search) == 1 else names[0]] = points
    return {"signature": result.signature, "n_clips": result.n_clips, "lines": lines}


def _but_for_length(config: Config) -> str:
    references = config.references.model_copy(update={"seconds": None})
    return config.model_copy(update={"references": references}).signature()


def _point(name: str, config: Config, rows: Sequence[Mapping]) -> dict:
    """Sum up one setup over all its clips and seeds that have an output; a figure that is missing is None.

    reference_seconds : of a graph; used_seconds : of it, that a clip shows; both means over the clips
    join_distance_per_minute : cm per minute of output
    """
    made = [row for row in rows if not row["failure"]]
    minutes = sum(row["seconds"] for row in made) / 60.0
    figures = {key: _mean([row[key] for row in made]) for key in _MEANS} | {
        "used_seconds": _mean([row["reference_share"] * row["reference_seconds"] for row in made]),
        "join_distance_per_minute": sum(row["join_distance_sum"] for row in made) / minutes if made else np.nan,
    }
    return {
        "setup": name,
        "asked_seconds": config.references.seconds,
        "reference_seconds": _mean([row["reference_seconds"] for row in rows]),
        **json_figures(figures),
    }


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if len(values) else float("nan")
