"""Gesture motion graphs (Zhao et al. 2023) as a method: the published search, piece by piece, or the optimal one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from gesturegen.methods.method import BYTES_PER_FRAME, WORKER_BYTES, Description, Inspection, Material, Method

if TYPE_CHECKING:
    import numpy as np

    from gesturegen.data.clips import Reference, Speech
    from gesturegen.methods.motion_graph.graph import MotionGraph, Part
    from gesturegen.path import Path
    from gesturegen.settings.models import Config
    from gesturegen.stored.arrays import Kind

# The tables of the global search: of each frame of the speech and node how the path goes on from there, and what a join
# from there may cost where joins lead from; of each frame of the shortest stay three rows, of what is earned and priced
# some forty more, each a number a node; and join costs of all pairs of nodes, up to a limit, while they are made some
# more.
_PER_FRAME_AND_NODE, _MOST_GATES, _ROWS, _PER_ROW_AND_NODE = 4, 8192, 40, 8
_JOINS_PER_PAIR, _MOST_JOINS = 8.0, 350e6


class MotionGraphMethod(Method["MotionGraph"]):
    """Method that searches a graph of all reference frames, with edges to those that may follow each (§4)."""

    name = "motion_graph"
    suffix = ""
    settings = (
        "fps", "joints", "skeleton", "positions", "continuity", "audio", "voice", "onsets", "keywords.words", "wrists",
        "exclude", "breaks", "pauses", "phrases", "references.seconds",
    )  # fmt: skip
    control = "search: global"

    def search_name(self, config: Config) -> str:
        return config.search

    def follows_conditions(self, config: Config) -> bool:
        return config.search == "global"

    def advice(self, config: Config) -> str:
        return super().advice(config) + (" or set search=global" if config.search == "beam" else "")

    def thrift(self, config: Config) -> str | None:
        return "search: beam" if config.search == "global" else None

    def prospects(self, material: Material) -> Sequence[tuple[str, str, str]]:
        onsets = material.all_have_onsets
        why = f"{material.shared_keywords} keywords in both" if onsets else "but some have no onset"
        return (
            (f"{self.name}, search: beam", "yes" if onsets else "limited", f"{material.references}, {why}"),
            (f"{self.name}, search: global", "yes", material.references),
        )

    def bytes_needed(self, reference_frames: int, test_frames: int, config: Config, kept_frames: int) -> float:
        need = WORKER_BYTES + BYTES_PER_FRAME * (reference_frames + kept_frames)
        if config.search == "global":
            rows = _ROWS + 3 * (config.global_search.min_stay_seconds * config.fps + 1)
            need += (_PER_FRAME_AND_NODE * test_frames + _PER_ROW_AND_NODE * rows) * reference_frames
            need += _PER_FRAME_AND_NODE * test_frames * min(reference_frames, _MOST_GATES)
            need += min(_JOINS_PER_PAIR * reference_frames**2, _MOST_JOINS)
        return need

    def part(self, reference: Reference, config: Config) -> Part:
        from gesturegen.methods.motion_graph import graph

        return graph.part(reference, config)

    def assemble(self, parts: Sequence[Any], config: Config) -> MotionGraph:
        from gesturegen.methods.motion_graph import graph

        return graph.assemble(parts, config)

    def kind(self) -> Kind:
        from gesturegen.methods.motion_graph import graph

        return graph.KIND

    def library_type(self) -> type[MotionGraph]:
        from gesturegen.methods.motion_graph import graph

        return graph.MotionGraph

    def describe(self, library: MotionGraph, config: Config) -> Description:
        from gesturegen.methods.motion_graph import description

        return Description(description.lines(library, config))

    def inspect(self, library: MotionGraph) -> Inspection:
        from gesturegen.methods.motion_graph import description

        return description.inspect(library)

    def search(
        self, library: MotionGraph, speech: Speech, config: Config, rng: np.random.Generator,
        earlier: Sequence[Path] = (),
    ) -> Path:  # fmt: skip
        from gesturegen.methods.motion_graph import search

        return search.search(library, speech, config, rng, earlier)

    def objective(self, library: MotionGraph, speech: Speech, nodes: np.ndarray, config: Config) -> float:
        from gesturegen.methods.motion_graph import global_search, objective

        return objective.total(nodes, global_search.price_list(library, speech, config))["total"]

    def build_loops(self) -> Sequence[Callable[[], object]]:
        from gesturegen.methods.motion_graph import compiling

        return (compiling.small_graph,)

    def search_loops(self) -> Sequence[Callable[[], object]]:
        from gesturegen.methods.motion_graph import compiling

        return (compiling.compile_beam, compiling.compile_global)
