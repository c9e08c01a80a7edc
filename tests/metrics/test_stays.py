"""Planted stays, stutters and repeats."""

import numpy as np
import pytest

from gesturegen.metrics.stays import stays


def shown(*ranges):
    return np.concatenate([np.arange(start, end) for start, end in ranges])


def test_planted_stays():
    # 60 frames at 30 fps: stays of 20, 10 and 30 frames. The first join goes back 5 frames (to 15, from where 20 would
    # have come): a stutter. The second goes 100 ahead. Of the frames of the second stay those up to 22 were shown, or
    # nearly: 15 to 22.
    nodes = shown((0, 20), (15, 25), (125, 155))
    found = stays(nodes, [20, 30], [0], fps=30)
    assert found.mean_seconds == pytest.approx(60 / 3 / 30)
    assert found.stutters_per_minute == pytest.approx(1 / (60 / 30 / 60))
    assert found.again_share == 8 / 60
    assert stays(nodes, [20, 30], [0], fps=30, same_frames=0).again_share == 5 / 60
    assert stays(nodes, [20, 30], [0], fps=30, stutter_frames=4).stutters_per_minute == 0


def test_a_jump_into_another_clip_is_no_stutter_and_shows_nothing_again():
    nodes = shown((90, 100), (105, 110), (96, 106))
    one_clip, two_clips = (stays(nodes, [10, 15], starts, fps=30) for starts in ([0], [0, 100]))
    assert one_clip.stutters_per_minute == pytest.approx(2 / (25 / 30 / 60))
    assert two_clips.stutters_per_minute == 0  # 105 and 96 to 99 lie on the other side of the border
    # Of 96 to 105: in one clip 96 to 102 are near 90 to 99, 102 to 105 near 105 and later; across no border 96 to 99
    # are near the first stay, and 102 to 105 near the second.
    assert one_clip.again_share == 10 / 25 and two_clips.again_share == 8 / 25


def test_a_repeat_counts_for_a_while_only():
    nodes = shown((0, 30), (200, 290), (0, 30))
    again = {seconds: stays(nodes, [30, 120], [0], fps=30, again_seconds=seconds).again_share for seconds in (3, 5)}
    assert again == {3: 0.0, 5: 30 / 150}


def test_held_frames_and_rates_are_no_joins():
    slow = np.repeat(np.arange(30), 2)
    assert stays(slow, [], [0], fps=30) == (2.0, 0.0, 0.0)
    assert np.isnan(stays([], [], [0], fps=30)).all()
