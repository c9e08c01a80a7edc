"""Traces, manifests and the index of clips: what is written is read back, and nothing else is taken for one."""

import json
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from gesturegen.data.index import Index, IndexedClip, IndexedTest
from gesturegen.manifest import ClipRow, Manifest
from gesturegen.stored import documents
from gesturegen.trace import Demand, Failure, Join, KeyNode, Origin, Piece, Trace, Track

GOLDEN = Path(__file__).parent / "golden/expected/tst_tiny.trace.json"
NUMBERS, TEXTS = st.integers(0, (1 << 31) - 1), st.text(max_size=5)
# JSON has no NaN; whole numbers stay whole.
FIGURES = st.floats(allow_nan=False, allow_infinity=False) | st.integers(-(1 << 53), 1 << 53)
TERMS = st.dictionaries(TEXTS, FIGURES, max_size=3)
SECONDS = st.floats(0, 1e6)


@st.composite
def walks(draw, lengths):
    """Pieces of these lengths, and the joins between them."""
    pieces, frame = [], 0
    for length in lengths:
        pieces.append(
            Piece(
                start_frame=frame, end_frame=frame + length, target_length=length, end_kind=draw(TEXTS),
                keyword=draw(TEXTS), nodes=draw(st.lists(NUMBERS, min_size=1, max_size=4)), cost=draw(FIGURES),
                retries=draw(NUMBERS), fallback=draw(st.none() | TEXTS), costs=draw(st.none() | TERMS),
            )
        )  # fmt: skip
        frame += length
    joins = [
        Join(frame=piece.start_frame, from_node=draw(NUMBERS), to_node=draw(NUMBERS), distance=draw(SECONDS),
             natural=draw(st.booleans()))
        for piece in pieces[1:]
    ]  # fmt: skip
    return pieces, joins


@st.composite
def traces(draw):
    lengths = draw(st.lists(st.integers(1, 50), min_size=1, max_size=3))
    frames = sum(lengths)
    (pieces, joins), (others, meetings) = draw(walks(lengths)), draw(walks(lengths))
    start, kinds = draw(st.integers(0, frames - 1)), st.sampled_from(("onset", "keyword", "break"))
    demand = Demand(place=1, measure="height", hand="left", low=draw(FIGURES), high=None, start_frame=start,
                    end_frame=frames, hard=True, price=draw(FIGURES), scale=1.0)  # fmt: skip
    failure = Failure(start_frame=frames, end_frame=frames + 1, end_kind="onset", keyword="")
    return Trace(
        clip=draw(TEXTS), method="motion_graph", search="beam", seed=draw(NUMBERS), variant=draw(NUMBERS),
        graph=draw(TEXTS), references=[Origin(clip=draw(TEXTS), start_node=0, mirrored=draw(st.booleans()))],
        fps=draw(st.floats(1, 100)), n_frames=frames, version="0", config_hash="",
        key_nodes=[KeyNode(frame=start, kind=draw(kinds), keyword=draw(TEXTS))], pieces=pieces, joins=joins,
        pauses=[(start, frames)], objective=draw(st.none() | st.dictionaries(TEXTS, TERMS, max_size=2)),
        failure=draw(st.none() | st.just(failure)), control=draw(st.just(()) | st.just((demand,))),
        tracks=[Track(joints=("a", "b"), pieces=others, joins=meetings)], notes=draw(st.lists(TEXTS, max_size=2)),
        inputs="", bvh_sha256=draw(st.none() | TEXTS),
    )  # fmt: skip


@st.composite
def manifests(draw):
    row = ClipRow(clip=draw(TEXTS), references=[draw(TEXTS)], graph="g", n_frames=draw(NUMBERS), pieces=1, hard_joins=0,
                  retries=0, fallbacks={draw(TEXTS): 1}, stuck=False, error=None, files={"a.bvh": ""})  # fmt: skip
    lost = ClipRow(clip="lost", references=(), stuck=False, error=draw(TEXTS), files={})
    return Manifest(
        gesturegen="0", method="m", search="s", seed=draw(NUMBERS), variant=1, config_hash="", n_clips=2, n_failed=1,
        clips=[row, lost], config={"fps": draw(st.integers(1, 100) | st.floats(1, 100)), "onsets": draw(TERMS)},
    )  # fmt: skip


@st.composite
def indices(draw):
    speaker, seconds = draw(st.none() | TEXTS), draw(SECONDS)
    test = IndexedTest(speaker=speaker, seconds=seconds, audio=draw(TEXTS), truth=draw(st.none() | TEXTS))
    return Index(
        format_version=2, settings="{}", references={draw(TEXTS): IndexedClip(speaker=speaker, seconds=seconds)},
        tests={"tst": test}, training_seconds=seconds, failed={draw(TEXTS): draw(TEXTS)},
    )  # fmt: skip


@settings(max_examples=40, deadline=None)
@given(traces() | manifests() | indices())
def test_what_is_written_is_read_back(document):
    text = document.to_json()
    again = type(document).from_json(text)
    assert again == document and again.to_json() == text


def test_the_golden_trace_is_written_as_it_was_read(tmp_path):
    trace = documents.read(GOLDEN, Trace, "reenact")
    documents.write(tmp_path / "again.json", trace)
    assert (tmp_path / "again.json").read_bytes() == GOLDEN.read_bytes()
    rows = [line for line in GOLDEN.read_text().splitlines() if line.startswith('  {"start_frame"')]
    assert len(rows) == len(trace.pieces), "one line for each piece"


def test_entries_that_no_model_names_are_kept(tmp_path):
    told = json.loads(GOLDEN.read_text())
    del told["checksum"]
    told["pieces"][0]["mine"] = told["yours"] = {"a": [1, 2.5]}
    documents.write(tmp_path / "more.json", told)
    trace = documents.read(tmp_path / "more.json", Trace, "reenact")
    assert json.loads(trace.to_json()) == told and trace.model_extra == {"yours": {"a": [1, 2.5]}}


def test_nothing_of_a_trace_can_be_changed():
    trace = documents.read(GOLDEN, Trace, "reenact")
    for part, name in ((trace, "seed"), (trace.pieces[0], "nodes"), (trace.references[0], "clip")):
        with pytest.raises(ValidationError, match="frozen"):
            setattr(part, name, None)


@pytest.mark.parametrize(("place", "value", "words"), [
    (("pieces", 0, "cost"), "x", "pieces.0.cost: Input should be a finite number"),
    (("pieces", 0, "nodes"), [], "pieces.0.nodes"), (("pieces", 0, "nodes", 0), -1, "pieces.0.nodes.0"),
    (("joins", 0, "natural"), 1, "joins.0.natural"), (("n_frames",), 7, "frames beyond the 7"),
    (("pieces", 0, "end_frame"), 1, "does not follow"), (("references", 0, "start_node"), 3, "do not rise from 0"),
])  # fmt: skip
def test_what_is_no_trace_is_refused(place, value, words):
    told = holder = json.loads(GOLDEN.read_text())
    for key in place[:-1]:
        holder = holder[key]
    holder[place[-1]] = value
    with pytest.raises(ValidationError) as refusal:
        Trace.from_json(json.dumps(told))
    assert words in documents.first_problem(refusal.value)


@pytest.mark.parametrize(("nodes", "length"), [([4, 5, 6], 3), ([4], 3), ([4, 5, 6, 7], 2), ([1, 9], 5)])
def test_shown_nodes_are_evenly_resampled(nodes, length):
    piece = Piece(start_frame=0, end_frame=length, target_length=length, end_kind="onset", keyword="", nodes=nodes,
                  cost=0.0, retries=0, fallback=None)  # fmt: skip
    places = [round(k * (len(nodes) - 1) / max(length - 1, 1)) for k in range(length)]
    assert piece.shown_nodes().tolist() == [nodes[place] for place in places]
