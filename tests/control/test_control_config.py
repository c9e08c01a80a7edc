"""The control section and its file: what is read, and what is refused with which line."""

import pytest

from gesturegen.errors import ConfigError
from gesturegen.settings.control import Condition, Control, resolve_bound, shared_time, time_text
from gesturegen.settings.loading import load_config
from tests.builders import literally, refused


@pytest.fixture
def load(tmp_path):
    def load(text, *overrides, schedule=None):
        if schedule is not None:
            (tmp_path / "hands.yaml").write_text(schedule)
        path = tmp_path / "run.yaml"
        path.write_text(text)
        # With the default search there is no control; an override keeps the lines of the file as they are.
        return load_config(path, ("search=global", *overrides))

    return load


FILE = "control: {file: hands.yaml}\n"
SCHEDULE = """\
conditions:
- {measure: height, hand: left, at_least: 85%, to: 10}
- clip: tst_001
  from: 10
  to: 20.5
  measure: speed
  at_most: 30
  at_least: 2.5%
  hard: false
  price: 2
gestures:
- {word: Stop!, gesture: palm}
- {clip: tst_001, at: 3, gesture: wave}
"""

# --- what is read -------------------------------------------------------------------------------------------


def test_a_file_is_read_into_the_lists(load):
    control = load(FILE, schedule=SCHEDULE).control
    first, second = control.conditions
    assert (first.clip, first.from_, first.to, first.measure, first.hand) == ("*", 0, 10, "height", "left")
    assert (first.at_least, first.at_most, first.hard, first.price) == ("85%", None, True, None)
    assert (second.clip, second.from_, second.to, second.hand) == ("tst_001", 10, 20.5, "both")
    assert (second.at_least, second.at_most, second.hard, second.price) == ("2.5%", 30, False, 2)
    assert [(entry.clip, entry.word, entry.at, entry.gesture) for entry in control.gestures] == [
        ("*", "Stop!", None, "palm"),
        ("tst_001", None, 3, "wave"),
    ]
    assert control.file == "hands.yaml"


def test_the_lists_can_be_given_directly(load):
    direct = load("control:\n" + "".join(f"  {line}\n" for line in SCHEDULE.splitlines())).control
    read = load(FILE, schedule=SCHEDULE).control
    assert (direct.conditions, direct.gestures) == (read.conditions, read.gestures)


def test_what_is_given_directly_wins_over_the_file(load):
    text = "control: {file: none.yaml, gestures: [{at: 1, gesture: nod}]}\n"
    assert [entry.gesture for entry in load(text).control.gestures] == ["nod"]
    assert load(FILE, "control.conditions=[{measure: speed, at_most: 9}]").control.conditions[0].at_most == 9


def test_either_list_may_be_missing(load):
    assert load(FILE, schedule="gestures: [{at: 0, gesture: nod}]\n").control.conditions == ()
    assert load(FILE, schedule="conditions: [{measure: radius, at_most: 9}]\n").control.gestures == ()


def test_a_file_may_be_given_by_its_path(load, tmp_path):
    (tmp_path / "there").mkdir()
    path = tmp_path / "there/hands.yaml"
    path.write_text(SCHEDULE)
    assert len(load(f"control: {{file: {path}}}\n").control.conditions) == 2
    assert len(load_config(None, ["search=global", f"control.file={path}"]).control.conditions) == 2


def test_without_a_file_nothing_is_demanded(load):
    assert load("seed: 1\n").control == Control()


def test_a_config_read_before_needs_no_file(load, tmp_path):
    read = load(FILE, schedule=SCHEDULE)
    (tmp_path / "hands.yaml").unlink()
    again = load(read.model_dump_json(by_alias=True))
    assert again == read


def test_the_signature_knows_the_content_but_not_the_place(load, tmp_path):
    read = load(FILE, schedule=SCHEDULE)
    (tmp_path / "other.yaml").write_text(SCHEDULE)
    assert load("control: {file: other.yaml}\n").signature() == read.signature()
    assert load(FILE, schedule=SCHEDULE.replace("85%", "84%")).signature() != read.signature()
    assert load(FILE, schedule=SCHEDULE.replace("palm", "fist")).signature() != read.signature()
    assert load("seed: 0\n").signature() != read.signature()


@pytest.mark.parametrize("bound", ["0%", "100%", "99.9%", "0", "-12.5", "40"])
def test_bounds(load, bound):
    condition = load(FILE, schedule=f"conditions: [{{measure: height, at_least: {bound}}}]\n").control.conditions[0]
    assert condition.at_least == (bound if "%" in bound else float(bound))


def test_conditions_that_may_stand_side_by_side(load):
    rows = [
        "measure: height, hand: left, at_least: 1, to: 10",
        "measure: height, hand: left, at_least: 2, from: 10",
        "measure: height, hand: right, at_least: 3",
        "measure: height, hand: both, at_least: 3",
        "measure: speed, hand: left, at_least: 4",
        "measure: height, hand: left, at_least: 5, clip: tst_001",
        "measure: speed, at_least: 5, at_most: 5",
        "measure: radius, at_least: 40%, at_most: 40%",
        "measure: symmetry, at_least: 90%, at_most: 5",
    ]
    schedule = "conditions:\n" + "".join(f"- {{{row}}}\n" for row in rows)
    assert len(load(FILE, schedule=schedule).control.conditions) == len(rows)


def test_shared_times():
    def condition(start, end):
        return Condition.model_validate({"measure": "height", "at_least": 1.0, "from": start, "to": end})

    assert shared_time(condition(0, 10), condition(4, 20)) == (4, 10)
    assert shared_time(condition(4, 20), condition(0, 10)) == (4, 10)
    assert shared_time(condition(0, 10), condition(10, 20)) is None
    assert shared_time(condition(0, None), condition(5, None)) == (5, float("inf"))
    assert time_text(4, 10.5) == "from 4 to 10.5 s" and time_text(5, float("inf")) == "from 5 s on"


def test_bounds_are_resolved_by_what_they_are():
    assert resolve_bound(None, 7.0, None) == 7
    assert resolve_bound(12.5, 7.0, None) == 12.5
    assert resolve_bound("85%", 7.0, lambda share: 100 * share) == 85


# --- what is refused ----------------------------------------------------------------------------------------

BOUND = r"allowed: a finite number, or a quantile from `0%` to `100%` such as `85%`"
REFUSED = {
    "unknown key": ("conditons: []", 1, "unknown key 'conditons'; did you mean 'conditions'"),
    "key of the section": ("file: a.yaml", 1, "unknown key 'file'; allowed here: conditions, gestures"),
    "unknown key of a condition": (
        "conditions:\n- measure: height\n  atleast: 3",
        3,
        r"unknown key 'conditions\.0\.atleast'; did you mean 'at_least'",
    ),
    "unknown key of a gesture": (
        "gestures:\n- {at: 1, gesture: a, wrd: b}",
        2,
        r"'gestures\.0\.wrd'; did you mean 'word'",
    ),
    "no list": ("conditions: {measure: height}", 1, "conditions: found .*, allowed: a list"),
    "nothing": ("conditions: []\ngestures:", 2, "gestures: found null, allowed: a list"),
    "no condition": ("conditions:\n- height", 2, r'conditions\.0: found "height", allowed: a section'),
    "no measure": ("conditions:\n- {at_least: 3}", 2, r"conditions\.0\.measure: missing; add this key"),
    "another measure": (
        "conditions:\n- measure: hight\n  at_least: 3",
        2,
        r'conditions\.0\.measure: found "hight", allowed: \'height\', \'speed\', \'radius\' or \'symmetry\'',
    ),
    "another hand": (
        "conditions:\n- {measure: speed,\n   hand: any, at_least: 3}",
        3,
        r"conditions\.0\.hand: found \"any\", allowed: 'left', 'right' or 'both'",
    ),
    "no bound": ("conditions:\n- {measure: height}", 2, r"conditions\.0: give at_least, at_most or both"),
    "quantile above 100%": ("conditions:\n- {measure: height,\n   at_least: 101%}", 3, 'found "101%", ' + BOUND),
    "quantile below 0%": ("conditions:\n- {measure: height, at_most: -1%}", 2, r'\.at_most: found "-1%", ' + BOUND),
    "no quantile": ("conditions:\n- {measure: height, at_least: high}", 2, 'found "high", ' + BOUND),
    "quoted number": (
        "conditions:\n- {measure: height, at_least: '20'}",
        2,
        'found "20", ' + BOUND + r" \(this is text; write the number without quotes\)",
    ),
    "true for a bound": ("conditions:\n- {measure: height, at_least: true}", 2, "found true, " + BOUND),
    "list for a bound": ("conditions:\n- {measure: height, at_least: [1, 2]}", 2, r"found \[1, 2\], " + BOUND),
    "infinite bound": ("conditions:\n- {measure: height, at_least: .inf}", 2, r'found "\.inf", ' + BOUND),
    "bound that is no number": ("conditions:\n- {measure: height, at_least: .nan}", 2, r'found "\.nan", ' + BOUND),
    "numbers backwards": (
        "conditions:\n- {measure: height, at_least: 3.5, at_most: 3}",
        2,
        r"conditions\.0: at_least 3\.5 is more than at_most 3$",
    ),
    "quantiles backwards": (
        "conditions:\n- {measure: height, at_least: 9%, at_most: 8.5%}",
        2,
        r"conditions\.0: at_least 9% is more than at_most 8\.5%",
    ),
    "range backwards": (
        "conditions:\n- {measure: height, at_least: 3}\n- {measure: speed, at_least: 3, from: 2, to: 1}",
        3,
        r"conditions\.1: `to` must be later than `from`",
    ),
    "empty range": (
        "conditions:\n- {measure: speed, at_least: 3, from: 2, to: 2}",
        2,
        "`to` must be later than `from`",
    ),
    "before the start": (
        "conditions:\n- {measure: speed, at_least: 3, from: -1}",
        2,
        r"from: found -1, allowed: greater",
    ),
    "never": ("conditions:\n- {measure: speed, at_least: 3, from: .inf}", 2, r'from: found "\.inf", .* a finite'),
    "for ever": ("conditions:\n- {measure: speed, at_least: 3, to: .inf}", 2, r'to: found "\.inf", .* a finite'),
    "symmetry of a hand": (
        "conditions:\n- {measure: symmetry, hand: left, at_most: 5}",
        2,
        r"conditions\.0: symmetry compares the hands and has none of its own; leave out `hand`",
    ),
    "price of a hard condition": (
        "conditions:\n- {measure: height, at_least: 3, price: 1}",
        2,
        r"conditions\.0: a hard condition has no price; leave it out, or set hard: false",
    ),
    "no price": (
        "conditions:\n- {measure: speed, at_least: 3, hard: false, price: 0}",
        2,
        "price: found 0, allowed: gr",
    ),
    "overlap": (
        "conditions:\n"
        "- {measure: height, hand: left, at_least: 3, to: 20}\n"
        "- {measure: speed, hand: left, at_least: 3}\n"
        "- {measure: height, hand: left, at_most: 30, from: 10, to: 30}",
        4,
        r"conditions\.2: conditions 1 and 3 overlap from 10 to 20 s; give both bounds in one condition, or times apart",
    ),
    "overlap to the end": (
        "conditions:\n- {measure: speed, at_least: 3, clip: 'a{b}*'}\n- {measure: speed, at_most: 9, clip: 'a{b}*', from: 2.5}",
        3,
        r"conditions 1 and 2 overlap from 2\.5 s on; ",
    ),
    "neither word nor time": ("gestures:\n- {gesture: nod}", 2, r"gestures\.0: give one of word and at"),
    "both word and time": (
        "gestures:\n- {gesture: nod, word: yes!, at: 1}",
        2,
        r"gestures\.0: give one of word and at",
    ),
    "two words": ("gestures:\n- {gesture: nod, word: of course}", 2, r"gestures\.0\.word: 'of course' is not one word"),
    "laughter": (
        "gestures:\n- {gesture: nod, word: '#'}",
        2,
        r"gestures\.0\.word: '#' is not one word, so no transcript",
    ),
    "false for a word": ("gestures:\n- {gesture: nod, word: false}", 2, r"word: found false, .* \(put it in quotes\)"),
    "no gesture": ("gestures:\n- {at: 1}", 2, r"gestures\.0\.gesture: missing; add this key"),
    "gesture before the start": (
        "gestures:\n- {at: -1, gesture: nod}",
        2,
        r"gestures\.0\.at: found -1, allowed: greater",
    ),
    "key twice": ("gestures: []\nconditions: []\ngestures: []", 3, "key 'gestures' stands twice, first in line 1"),
    "no YAML": ("conditions: [1", 2, "not valid YAML"),
}


@pytest.mark.parametrize(("text", "line", "match"), REFUSED.values(), ids=REFUSED)
def test_mistakes_are_refused_with_file_and_line(load, tmp_path, text, line, match):
    with refused(ConfigError, literally(tmp_path / "hands.yaml", line) + ".*" + match):
        load(FILE, schedule=text + "\n")


IN_SECTION = ("no bound", "quantile above 100%", "price of a hard condition", "overlap", "both word and time")


@pytest.mark.parametrize("name", IN_SECTION)
def test_mistakes_in_the_config_itself_are_refused_with_its_lines(load, tmp_path, name):
    text, line, match = REFUSED[name]
    text = "control:\n" + "".join(f"  {row}\n" for row in text.splitlines())
    match = match.replace("conditions\\.", "control\\.conditions\\.").replace("gestures\\.", "control\\.gestures\\.")
    with refused(ConfigError, literally(tmp_path / "run.yaml", line + 1) + ".*" + match):
        load(text)


def test_every_mistake_gets_its_own_line(load, tmp_path):
    schedule = "conditions:\n- {measure: x, at_least: 1}\n- {measure: height, at_least: 1e3%}\ngestures:\nspeed: 1\n"
    with pytest.raises(ConfigError) as caught:
        load(FILE, schedule=schedule)
    lines = str(caught.value).splitlines()
    assert [line.split(": ")[0] for line in lines] == [f"{tmp_path / 'hands.yaml'}:{n}" for n in (2, 3, 4, 5)]


def test_every_overlap_gets_its_own_line(load, tmp_path):
    schedule = "conditions:\n" + "- {measure: radius, at_most: 9}\n" * 3
    with pytest.raises(ConfigError) as caught:
        load(FILE, schedule=schedule)
    lines = str(caught.value).splitlines()
    assert [line.split(": ")[0] for line in lines] == [f"{tmp_path / 'hands.yaml'}:{n}" for n in (3, 4, 4)]


@pytest.mark.parametrize("schedule", ["", "conditions: []\ngestures: []\n"])
def test_a_file_that_demands_nothing_is_refused(load, tmp_path, schedule):
    with refused(ConfigError, "neither conditions nor gestures in it", tmp_path / "hands.yaml"):
        load(FILE, schedule=schedule)


def test_a_file_that_is_no_mapping_is_refused(load, tmp_path):
    with refused(ConfigError, "expected `key: value` lines, found a list", tmp_path / "hands.yaml"):
        load(FILE, schedule="- {measure: height, at_least: 3}\n")


def test_a_missing_file_is_named(load, tmp_path):
    with refused(ConfigError, r"control\.file: 'hands\.yaml' does not exist \(looked at ", tmp_path / "hands.yaml"):
        load(FILE)


def test_a_mistake_in_an_override_is_refused_as_one(load):
    with refused(ConfigError, r"^--set: control\.conditions\.0: give at_least, at_most or both"):
        load("seed: 1\n", "control.conditions=[{measure: speed}]")
