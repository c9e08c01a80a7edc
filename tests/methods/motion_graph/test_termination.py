"""How a test speech is cut into pieces."""

from hypothesis import given, settings
from hypothesis import strategies as st

from gesturegen.methods.motion_graph.termination import targets
from gesturegen.path import Target
from tests import naive, tiny


def test_pieces_end_at_key_nodes_and_at_the_end():
    nodes = tiny.key_nodes([(5, "onset"), (8, "keyword", "greeting"), (20, "onset")])
    assert targets(nodes, 30) == [
        Target(0, 5, "onset"), Target(5, 8, "keyword", "greeting"), Target(8, 20, "onset"), Target(20, 30, "break"),
    ]  # fmt: skip
    assert [target.length for target in targets(nodes, 30)] == [5, 3, 12, 10]


def test_a_speech_without_key_nodes_is_one_piece():
    assert targets(tiny.key_nodes([]), 7) == [Target(0, 7, "break")]


def test_a_key_node_at_frame_zero_cuts_nothing():
    nodes = tiny.key_nodes([(0, "keyword", "greeting"), (4, "onset")])
    assert targets(nodes, 9) == [Target(0, 4, "onset"), Target(4, 9, "break")]
    assert targets(tiny.key_nodes([(0, "onset")]), 1) == [Target(0, 1, "break")]


def test_a_key_node_at_the_last_frame_leaves_a_piece_of_one_frame():
    assert targets(tiny.key_nodes([(8, "onset")]), 9) == [Target(0, 8, "onset"), Target(8, 9, "break")]


@settings(deadline=None, derandomize=True, max_examples=60)
@given(frames=st.sets(st.integers(0, 39)), words=st.sets(st.integers(0, 39)))
def test_pieces_cover_the_speech_without_gap(frames, words):
    rows = [(frame, "keyword", "counting") if frame in words else (frame, "onset", "") for frame in sorted(frames)]
    pieces = targets(tiny.key_nodes(rows), 40)
    assert [(p.start_frame, p.end_frame, p.keyword) for p in pieces] == naive.pieces_of(rows, 40)
    assert sum(piece.length for piece in pieces) == 40 and all(piece.length > 0 for piece in pieces)
