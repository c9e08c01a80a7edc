"""Conditions in the frames of a clip: by hand, by their properties, and what is refused."""

import json
from types import MappingProxyType

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gesturegen.control import schedule
from gesturegen.control.measures import hand_measures
from gesturegen.control.schedule import Demand
from gesturegen.errors import DataError
from gesturegen.settings.control import Control
from tests.builders import SMALL, refused

CLIP = "tst_001"
# Eleven nodes, so that every tenth of them is a quantile; both hands at one height at node 5.
HEIGHTS = np.arange(11.0) * 10
VALUES = MappingProxyType(
    {
        ("height", "left"): HEIGHTS,
        ("height", "right"): HEIGHTS[::-1],
        ("height", "both"): np.full(11, 50.0),
        ("speed", "both"): np.array([0.0, 1, 4, 9, 16, 25, 36, 49, 64, 81, 100]),
        ("symmetry", "both"): np.abs(HEIGHTS - HEIGHTS[::-1]),
    }
)


def control(*conditions):
    return Control.model_validate(
        {"conditions": [{"measure": "height", "hand": "left"} | one for one in conditions]}, strict=False
    )


def demands(*conditions, clip=CLIP, n_frames=300, fps=30.0, values=VALUES):
    return schedule.demands(control(*conditions), clip, n_frames, fps, values)


def demand(low=-np.inf, high=np.inf, frames=(0, 10), key=("height", "left"), hard=True, price=1.0, scale=1.0, place=1):
    return Demand(place, *key, low, high, *frames, hard, price, scale)


def lines(*conditions, **options):
    """The lines of the refusal, without the clip's name."""
    with pytest.raises(DataError) as caught:
        demands(*conditions, **options)
    found = str(caught.value).splitlines()
    name = options.get("clip", CLIP)
    assert all(line.startswith(f"clip {name}: ") for line in found)
    return [line.removeprefix(f"clip {name}: ") for line in found]


# --- from conditions to demands -----------------------------------------------------------------------------


def test_a_demand_by_hand():
    (found,) = demands({"at_least": 20, "at_most": 55.5, "from": 1, "to": 2.5})
    assert found == Demand(1, "height", "left", 20, 55.5, 30, 75, True, 1, float(HEIGHTS.std()))
    assert found.key == ("height", "left")


def test_bounds_that_are_missing_are_infinite():
    assert [(d.low, d.high) for d in demands({"at_least": 20, "to": 1}, {"at_most": 30, "from": 1})] == [
        (20, np.inf),
        (-np.inf, 30),
    ]


def test_quantiles_are_those_of_the_references():
    (found,) = demands({"at_least": "85%", "at_most": "100%"})
    assert (found.low, found.high) == (pytest.approx(85), 100)
    (found,) = demands({"measure": "speed", "hand": "both", "at_least": "0%", "at_most": "30%"})
    assert (found.low, found.high) == (0, pytest.approx(9))
    (found,) = demands({"at_least": 3, "at_most": "50%"})
    assert (found.low, found.high) == (3, 50)


def test_a_quantile_of_single_precision_values_is_met_by_one_of_them():
    rng = np.random.default_rng(0)
    for size in (1, 2, 7, 100):
        values = {("height", "left"): rng.normal(30, 9, size).astype(np.float32)}
        for share in ("0%", "15%", "33.3%", "85%", "100%"):
            assert schedule.satisfied(demands({"at_least": share}, values=values), values).any()
            assert schedule.satisfied(demands({"at_most": share}, values=values), values).any()


def test_without_an_end_a_demand_holds_to_the_end_of_the_clip():
    (found,) = demands({"at_least": 20, "from": 4})
    assert (found.start_frame, found.end_frame) == (120, 300)


@pytest.mark.parametrize(
    ("times", "frames"),
    [
        ((0.3, 0.7), (9, 21)),
        ((0.0, 0.016), (0, 1)),
        ((0.0, 0.017), (0, 1)),
        ((0.02, 0.09), (1, 3)),
        # Less than a frame is one frame.
        ((1.0, 1.001), (30, 31)),
        # The last frame begins at 9.967 s; the clip ends at 10 s, and half a second more is let pass.
        ((9.99, 10.0), (299, 300)),
        ((5.0, 10.5), (150, 300)),
    ],
)
def test_times_are_rounded_to_frames(times, frames):
    (found,) = demands({"at_least": 20, "from": times[0], "to": times[1], "clip": CLIP})
    assert (found.start_frame, found.end_frame) == frames


@pytest.mark.parametrize("fps", [15.0, 29.97, 30.0, 120.0])
def test_ranges_that_meet_share_no_frame(fps):
    for meet in np.linspace(0.5, 9.5, 37).tolist():
        first, second = demands(
            {"at_least": 20, "to": meet}, {"at_least": 30, "from": meet}, n_frames=int(10 * fps), fps=fps
        )
        assert first.end_frame == second.start_frame


def test_only_the_conditions_of_the_clip_count_and_keep_their_numbers():
    rows = [
        {"at_least": 20, "clip": "tst_002"},
        {"at_least": 20, "to": 1, "clip": CLIP},
        {"at_least": 20, "clip": "trn_*"},
        {"at_least": 20, "from": 1, "to": 2, "clip": "tst_00[1-3]"},
        {"at_least": 20, "from": 2, "clip": "*"},
    ]
    assert [d.place for d in demands(*rows)] == [2, 4, 5]
    assert [d.place for d in demands(*rows, clip=f"{CLIP}_main-agent")] == [2, 4, 5]
    assert [d.place for d in demands(*rows[:-1], clip="trn_004")] == [3]
    assert demands(*rows[:-1], clip="val_1") == () == demands()


def test_prices_and_scales():
    rows = [{"at_least": 20, "to": 1}, {"at_least": 20, "from": 1, "to": 2, "hard": False}]
    rows.append({"at_least": 20, "from": 2, "hard": False, "price": 2.5})
    found = demands(*rows)
    assert [(d.hard, d.price) for d in found] == [(True, 1), (False, 1), (False, 2.5)]
    assert {d.scale for d in found} == {float(HEIGHTS.std())}


@pytest.mark.parametrize("constant", [50.0, 0.0, 0.1])
def test_a_measure_that_does_not_vary_has_scale_1(constant):
    (found,) = demands({"at_least": "10%"}, values={("height", "left"): np.full(7, constant)})
    assert found.scale == 1 and found.low == constant


def test_a_glob_is_clipped_to_the_clip():
    (found,) = demands({"at_least": 20, "from": 4, "to": 60})
    assert (found.start_frame, found.end_frame) == (120, 300)
    assert demands({"at_least": 20, "from": 10, "to": 60}) == ()
    assert demands({"at_least": 20, "from": 12}, {"at_least": 1e9, "from": 20, "clip": "tst*"}) == ()


# --- refusals -----------------------------------------------------------------------------------------------


def test_a_condition_past_the_end_of_its_clip():
    assert lines({"at_least": 20, "from": 10, "clip": CLIP}) == [
        "condition 1: starts at 10 s, the clip ends at 10.00 s"
    ]
    assert lines({"at_least": 20, "from": 9, "to": 10.6, "clip": CLIP}) == [
        "condition 1: ends at 10.6 s, the clip at 10.00 s; leave out `to` for the end of the clip"
    ]
    # The clip may be named without its agent.
    assert len(lines({"at_least": 20, "from": 99, "clip": CLIP}, clip=f"{CLIP}_main-agent")) == 1


def test_a_bound_that_no_node_meets():
    assert lines({"at_least": 120}) == [
        "condition 1: no frame of the references has height (left) of at least 120 cm; the nearest has 100 cm; "
        "ask for that, or set hard: false"
    ]
    (line,) = lines({"measure": "speed", "hand": "both", "at_least": 65, "at_most": 80})
    assert "speed (both) of at least 65 cm/s and at most 80 cm/s; the nearest has 64 cm/s;" in line
    (line,) = lines({"at_least": "51%", "at_most": "59%"})
    assert "height (left) of at least 51% (51 cm) and at most 59% (59 cm); the nearest has " in line
    (line,) = lines({"measure": "symmetry", "hand": "both", "at_most": -1})
    assert "has symmetry of at most -1 cm; the nearest has 0 cm" in line


@pytest.mark.parametrize(
    ("value", "bound", "named"),
    [
        (71.26, "at_least", 71.2),
        (7.21, "at_most", 7.3),
        (71.3, "at_least", 71.3),
        (1.1, "at_most", 1.1),
        (-3.14, "at_least", -3.2),
    ],
)
def test_what_a_refusal_suggests_can_be_asked_for(value, bound, named):
    values = {("height", "left"): np.array([value])}
    out_of_reach = value + 1 if bound == "at_least" else value - 1
    (line,) = lines({bound: out_of_reach}, values=values)
    assert f"; the nearest has {named:g} cm;" in line
    assert len(demands({bound: named}, values=values)) == 1


def test_a_soft_demand_may_be_out_of_reach():
    (found,) = demands({"at_least": 120, "hard": False})
    assert found.low == 120


@pytest.mark.parametrize("hard", [True, False])
def test_a_number_and_a_quantile_may_turn_out_backwards(hard):
    assert lines({"at_least": "90%", "at_most": 30, "hard": hard}) == [
        "condition 1: asks for height (left) of at least 90% (90 cm) and at most 30 cm, which no value is; "
        "exchange or change the bounds"
    ]


def test_conditions_of_different_patterns_that_overlap():
    rows = [{"at_least": 20, "clip": "tst_*", "to": 5}, {"at_most": 90, "clip": CLIP, "from": 2}]
    assert lines(*rows) == [
        "conditions 1 (tst_*) and 2 (tst_001) overlap from 2 to 5 s; let one of them concern this clip, or give times apart"
    ]
    (line,) = lines({"at_least": 20}, {"at_least": 30, "clip": "tst_*", "from": 1.5})
    assert line.startswith("conditions 1 (*) and 2 (tst_*) overlap from 1.5 s on; ")
    # It is not said again that no node meets both.
    assert len(lines({"at_least": 60}, {"at_most": 40, "clip": CLIP})) == 1
    # On another clip only one of them holds, and past the end of the clip neither does.
    assert len(demands(*rows, clip="tst_002")) == 1
    assert len(demands({"at_least": 20}, {"at_least": 30, "clip": "tst_*", "from": 10})) == 1
    assert len(demands({"at_least": 20, "to": 3}, {"at_least": 30, "clip": CLIP, "from": 3})) == 2
    assert len(demands({"at_least": 20}, {"at_least": 30, "hand": "right", "clip": CLIP})) == 2


def test_hard_conditions_that_no_node_meets_together():
    rows = [
        {"measure": "speed", "hand": "both", "at_least": 1},
        {"at_least": 80, "from": 1, "to": 6},
        {"hand": "right", "at_least": 40, "from": 3.5},
    ]
    assert lines(*rows) == [
        "no frame of the references meets conditions 2 and 3 together, as they ask from 3.50 s on; "
        "ask for less, or set hard: false"
    ]
    for place in (1, 2):
        softened = [row | {"hard": False} if n == place else row for n, row in enumerate(rows)]
        assert len(demands(*softened)) == 3
    # One after the other they can be met.
    assert len(demands(rows[0], rows[1], rows[2] | {"from": 6})) == 3


def test_three_conditions_of_which_any_two_can_be_met():
    # Nodes that meet the first and second, the first and third, the second and third.
    values = {("height", hand): np.array(v) for hand, v in zip(("left", "right", "both"), np.eye(3) < 0.5, strict=True)}
    rows = [{"hand": hand, "at_least": 1} for hand in ("left", "right", "both")]
    assert len(demands(*rows[:2], values=values)) == 2
    (line,) = lines(rows[0], rows[1] | {"from": 2}, rows[2] | {"from": 1}, values=values)
    assert "meets conditions 1, 2 and 3 together, as they ask from 2.00 s on;" in line


def test_every_mistake_gets_its_own_line():
    rows = [
        {"at_least": 120, "to": 1},
        {"at_least": 20, "from": 10, "clip": CLIP},
        {"at_least": 30, "from": 4, "clip": "tst_*", "to": 6},
        {"at_least": 40, "from": 5, "to": 7},
        {"at_least": -5, "at_most": -1, "hand": "right", "to": 1},
    ]
    starts = ["condition 1: no frame", "condition 2: starts", "condition 5: no frame", "conditions 3 (tst_*) and 4 (*)"]
    found = lines(*rows)
    assert len(found) == 4 and all(line.startswith(start) for line, start in zip(found, starts, strict=True))


def test_one_mistake_is_one_line():
    with refused(DataError, "^clip tst_001: condition 1: ", "120 cm"):
        demands({"at_least": 120})


# --- what nodes are worth -----------------------------------------------------------------------------------


def test_satisfied_and_violations_by_hand():
    asked = (demand(30, 50, scale=20.0), demand(high=4, key=("speed", "both"), scale=1.0))
    met = schedule.satisfied(asked, VALUES)
    assert met.dtype == bool and met.shape == (2, 11)
    assert np.flatnonzero(met[0]).tolist() == [3, 4, 5] and np.flatnonzero(met[1]).tolist() == [0, 1, 2]
    outside = schedule.violations(asked, VALUES)
    assert outside[0].tolist() == [1.5, 1, 0.5, 0, 0, 0, 0.5, 1, 1.5, 2, 2.5]
    assert outside[1].tolist() == [0, 0, 0, 5, 12, 21, 32, 45, 60, 77, 96]


def test_a_hair_outside_is_outside_in_single_precision_as_well():
    values = {("height", "left"): np.array([0.1], dtype=np.float32)}  # 0.1000000015
    assert not schedule.satisfied((demand(high=0.1),), values).any()
    outside = schedule.violations((demand(high=0.1),), values)
    assert outside.dtype == np.float64 and 0 < outside[0, 0] < 1e-8


def test_without_demands_there_are_no_rows():
    assert schedule.satisfied((), VALUES).shape == schedule.violations((), VALUES).shape == (0, 11)
    assert schedule.satisfied((), VALUES).dtype == bool
    assert schedule.frame_prices([()], (), VALUES, 9.0).tolist() == [[0.0] * 11]


def random_demands(rng, n_frames=12):
    """Demands on a few measures at random times, hard and soft, some of them without a bound."""
    found = []
    for place in range(1, int(rng.integers(0, 6)) + 1):
        low, high = np.sort(rng.normal(40, 40, 2))
        start, end = np.sort(rng.choice(n_frames + 1, 2, replace=False))
        low, high = [(low, high), (-np.inf, high), (low, np.inf)][rng.integers(3)]
        key = list(VALUES)[rng.integers(len(VALUES))]
        hard, price, scale = bool(rng.integers(2)), float(rng.uniform(0.1, 3)), float(rng.uniform(0.5, 30))
        found.append(demand(float(low), float(high), (int(start), int(end)), key, hard, price, scale, place))
    return tuple(found)


@SMALL
@given(seed=st.integers(0, 10_000))
def test_violations_are_0_exactly_where_demands_are_satisfied(seed):
    rng = np.random.default_rng(seed)
    asked = random_demands(rng)
    values = {key: rng.choice(np.append(row, [d.low for d in asked]), 30) for key, row in VALUES.items()}
    values = {key: np.where(np.isfinite(row), row, 0.0).astype(rng.choice(["f4", "f8"])) for key, row in values.items()}
    outside = schedule.violations(asked, values)
    assert ((outside == 0) == schedule.satisfied(asked, values)).all() and (outside >= 0).all()


def test_states_by_hand():
    asked = (demand(frames=(2, 6)), demand(frames=(4, 8)), demand(frames=(4, 6)), demand(frames=(9, 10)))
    of_frame, sets = schedule.states(asked, 10)
    assert sets == [(), (0,), (0, 1, 2), (1,), (3,)]
    assert of_frame.tolist() == [0, 0, 1, 1, 2, 2, 3, 3, 0, 4]


def test_a_state_that_comes_again_has_one_number():
    asked = (demand(frames=(0, 6)), demand(frames=(2, 3)))
    assert schedule.states(asked, 6)[0].tolist() == [1, 1, 2, 1, 1, 1]


def test_state_0_is_there_even_if_no_frame_has_it():
    of_frame, sets = schedule.states((demand(frames=(0, 5)),), 5)
    assert sets == [(), (0,)] and of_frame.tolist() == [1] * 5
    of_frame, sets = schedule.states((), 3)
    assert sets == [()] and of_frame.tolist() == [0] * 3


def test_frames_past_the_end_have_no_state():
    assert schedule.states((demand(frames=(6, 8)),), 4)[1] == [()]
    assert schedule.states((demand(frames=(2, 20)),), 4)[0].tolist() == [0, 0, 1, 1]


@SMALL
@given(seed=st.integers(0, 10_000))
def test_every_frame_is_in_the_state_of_what_holds_there(seed):
    asked = random_demands(np.random.default_rng(seed))
    of_frame, sets = schedule.states(asked, 12)
    assert of_frame.shape == (12,) and sets[0] == () and len(set(sets)) == len(sets)
    for frame, state in enumerate(of_frame.tolist()):
        assert sets[state] == tuple(n for n, d in enumerate(asked) if d.start_frame <= frame < d.end_frame)
    first = {state: frame for frame, state in reversed(list(enumerate(of_frame.tolist())))}
    others = [state for state in sorted(first, key=first.get) if state]
    assert others == list(range(1, len(sets)))


def test_frame_prices_by_hand():
    asked = (
        demand(30, hard=False, price=2, scale=10),
        demand(high=20, key=("height", "right"), hard=False, price=1, scale=20),
        demand(high=16, key=("speed", "both")),
        demand(60, key=("symmetry", "both")),
    )
    prices = schedule.frame_prices([(), (0,), (0, 1), (2, 3), (0, 2)], asked, VALUES, 1000)
    assert prices.shape == (5, 11) and (prices[0] == 0).all()
    assert prices[1].tolist() == [6, 4, 2, 0, 0, 0, 0, 0, 0, 0, 0]
    assert prices[2].tolist() == [10, 7.5, 5, 2.5, 2, 1.5, 1, 0.5, 0, 0, 0]
    # Symmetry is 100, 80, 60 ... 0 ... 60, 80, 100; only where it is at least 60 is the last one met.
    assert prices[3].tolist() == [0, 0, 0, 1000, 1000, 2000, 2000, 2000, 1000, 1000, 1000]
    assert prices[4].tolist() == [6, 4, 2, 0, 0, *[1000] * 6]


def test_what_is_forbidden_may_cost_infinitely_much():
    prices = schedule.frame_prices([(), (0,)], (demand(30), demand(50, hard=False)), VALUES, np.inf)
    assert (prices[0] == 0).all() and prices[1].tolist() == [np.inf] * 3 + [0] * 8


@SMALL
@given(seed=st.integers(0, 10_000))
def test_frame_prices_are_sums_over_what_holds(seed):
    asked = random_demands(np.random.default_rng(seed))
    sets = schedule.states(asked, 12)[1]
    met, outside = schedule.satisfied(asked, VALUES), schedule.violations(asked, VALUES)
    prices = schedule.frame_prices(sets, asked, VALUES, 1e6)
    for state, members in enumerate(sets):
        for node in range(11):
            soft = sum(asked[n].price * outside[n, node] for n in members if not asked[n].hard)
            broken = sum(not met[n, node] for n in members if asked[n].hard)
            assert prices[state, node] == pytest.approx(soft + 1e6 * broken)


# --- what was achieved --------------------------------------------------------------------------------------


def test_achieved_by_hand():
    output = {("height", "left"): np.array([0.0, 60, 62, 40, 78, 0, 0])}
    (found,) = schedule.achieved((demand(60, frames=(1, 5), place=3),), output, VALUES)
    assert (found.place, found.measure, found.hand, found.hard) == (3, "height", "left", True)
    assert (found.mean, found.inside, found.reference_mean) == (60, 0.75, 50)
    assert found.deviation == pytest.approx(np.sqrt((0 + 4 + 400 + 324) / 4))
    assert found.reference_deviation == pytest.approx(HEIGHTS.std())
    assert found.row() == {
        "place": 3, "measure": "height", "hand": "left", "hard": True, "start_frame": 1, "end_frame": 5,
        "at_least": 60, "at_most": None, "mean": 60, "deviation": found.deviation, "inside": 0.75,
        "reference_mean": 50, "reference_deviation": found.reference_deviation,
    }  # fmt: skip
    assert json.loads(json.dumps(found.row(), allow_nan=False)) == found.row()


def test_the_references_themselves_achieve_their_own_shares():
    rng = np.random.default_rng(1)
    values = hand_measures(rng.normal(0, 20, (1000, 2, 3)).cumsum(axis=0) / 9, [0, 400], 30.0)
    between = {"at_least": "15%", "at_most": "85%", "hard": False}
    asked = demands(*({"measure": m, "hand": hand} | between for m, hand in values), n_frames=1000, values=values)
    assert len(asked) == len(values)
    for found in schedule.achieved(asked, values, values):
        assert found.inside == pytest.approx(0.7, abs=0.002)
        assert (found.mean, found.deviation) == (found.reference_mean, found.reference_deviation)


def test_nothing_is_achieved_of_nothing():
    assert schedule.achieved((), VALUES, VALUES) == []


def test_an_output_that_is_too_short_is_refused():
    with pytest.raises(ValueError, match="the output has 11 frames, a demand holds until frame 12"):
        schedule.achieved((demand(60, frames=(1, 12)),), VALUES, VALUES)
