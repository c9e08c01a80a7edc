import numpy as np

from gesturegen.frames import describe, join
from tests import tiny


def still(frames):
    return tiny.motion(np.random.default_rng(0), frames)


def test_several_clips_are_numbered_one_after_the_other():
    first = tiny.reference(still(6), onsets=[1], name="a", segment_starts=[0, 4])
    second = tiny.reference(still(4), onsets=[0], words=[("one", 2, 3)], name="b")
    found = join([describe(reference, tiny.config()) for reference in (first, second)])
    assert found["clip_names"] == ("a", "b") and found["fps"] == tiny.FPS
    assert found["clip_starts"].tolist() == [0, 6] and found["segment_starts"].tolist() == [0, 4, 6]
    assert found["source_frames"].tolist() == [0, 1, 2, 3, 4, 5, 0, 1, 2, 3] and found["speaking"].all()
    nodes = found["key_nodes"]
    assert list(zip(nodes.frames.tolist(), nodes.kinds.tolist(), nodes.keywords.tolist(), strict=True)) == [
        (1, "onset", ""), (3, "break", ""), (5, "break", ""), (6, "onset", ""), (8, "keyword", "counting"),
        (9, "break", ""),
    ]  # fmt: skip
