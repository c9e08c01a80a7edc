import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from gesturegen.motion import rotation, splice


def recording(seed, count=200):
    rng = np.random.default_rng(seed)
    expmaps, places = (gaussian_filter1d(rng.normal(size=(count, 2, 3)), 4.0, axis=0) for _ in range(2))
    return rotation.from_expmap(expmaps), places


def spliced(seed, nodes, turn=None):
    """Runs of a recording, shown one after the other; `turn` turns all but the first."""
    rotations, places = recording(seed)
    nodes = np.asarray(nodes)
    runs = np.cumsum(np.append(0, np.diff(nodes) != 1))
    firsts = nodes - np.arange(len(nodes))

    def played(of, frames):
        shown = firsts[np.searchsorted(runs, of)] + frames
        turned = rotations[shown]
        if turn is not None:
            turned = np.where((of > 0)[:, None, None], rotation.multiply(turn, turned), turned)
        return turned, places[shown]

    raw = played(runs, np.arange(len(nodes)))
    return runs, raw, splice.least_change(*raw, runs, played)


def test_a_run_alone_comes_back_untouched():
    _, raw, found = spliced(0, range(20, 80))
    assert all(np.array_equal(a, b) for a, b in zip(raw, found, strict=True))


def test_a_seam_without_an_offset_needs_no_correction():
    rotations, places = recording(1)
    runs = np.repeat([0, 1], 40)  # the second run goes on where the first one ends
    found = splice.least_change(
        rotations[:80], places[:80], runs, lambda _, frames: (rotations[frames], places[frames])
    )
    np.testing.assert_allclose(found[0], rotations[:80], atol=1e-9)
    np.testing.assert_allclose(found[1], places[:80], atol=1e-9)


@pytest.mark.parametrize(
    "nodes", [[*range(20, 70), *range(110, 160)], [*range(20, 22), *range(90, 93), *range(50, 80)]]
)
def test_seams_are_as_smooth_as_the_recording_and_stay_finite(nodes):
    runs, raw, found = spliced(2, nodes)
    assert np.isfinite(found[0]).all() and np.isfinite(found[1]).all()
    np.testing.assert_allclose(np.linalg.norm(found[0], axis=-1), 1.0, atol=1e-12)
    across = runs[1:] != runs[:-1]
    leaps = [np.linalg.norm(np.diff(places, axis=0), axis=-1)[across].max() for places in (raw[1], found[1])]
    usual = np.linalg.norm(np.diff(recording(2)[1], axis=0), axis=-1).max()
    assert leaps[0] > 2 * usual and leaps[1] < usual
