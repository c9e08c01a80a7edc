import json
import re
from typing import Literal, get_args, get_origin

import pytest
import yaml
from pydantic import BaseModel, ValidationError

from gesturegen import strict_yaml
from gesturegen.errors import ConfigError
from gesturegen.randomness import generator
from gesturegen.settings import loading
from gesturegen.settings.loading import configs_folder, layer_config, load_config
from gesturegen.settings.models import Config
from tests.builders import literally, refused


@pytest.fixture
def load(tmp_path):
    def load(text, *overrides):
        path = tmp_path / "run.yaml"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return load_config(path, overrides)

    return load


# --- what is read -------------------------------------------------------------------------------------------


def test_the_defaults_are_the_papers():
    config = load_config()
    assert (config.method, config.search, config.fps) == ("motion_graph", "beam", 30)
    assert len(config.joints) == len(set(config.joints)) == 25
    assert config.onsets.min_strength == 5 and (config.onsets.sample_rate, config.onsets.hop_length) == (22050, 512)
    assert (config.wrists.window, config.wrists.order, config.wrists.axes) == (15, 3, "XYZ")
    assert (config.continuity.lambda_pos, config.continuity.lambda_vel) == (1, 1)
    assert (config.continuity.l_cn, config.continuity.l_pn) == (5, 10)
    assert (config.beam.l_npaths, config.beam.min_ratio, config.beam.max_ratio) == (20, 0.9, 1.1)
    assert (config.beam.lambda_w, config.beam.lambda_len) == (1, 1)
    assert (config.features.l_feat, config.features.lambda_occ, config.features.align) == (10, 0.5, "following")
    assert (config.termination.keyword_retries, config.termination.discard_after_retries) == (5, 10)
    assert (config.termination.max_retries, config.termination.failure_retries) == (40, 400)
    assert (config.blend.method, config.blend.l_blend, config.root.return_half_life) == ("crossfade", 8, 3)
    assert config.references.mode == "per_test_clip" and config.breaks.max_joint_speed is None


def test_the_defaults_of_gesture_master_are_its_papers():
    config = load_config().gesture_master
    upper, lower = config.upper, config.lower
    assert [getattr(upper, f"lambda_{k}") for k in range(1, 7)] == [0.7, 0.3, 1.0, 3.0, 1.0, 0.1]
    # The paper prints 0 for the lower body's lambda_4 and zeta, which leaves nothing to minimise.
    assert [getattr(lower, f"lambda_{k}") for k in range(1, 7)] == [0.7, 0.3, 0.0, 1.0, 0.0, 0.0]
    assert (upper.delta_t, lower.delta_t, upper.zeta, lower.zeta) == (8, 8, 10000, 10000)
    assert (config.cutting.gap_seconds, config.rhythm.bits, config.mirror) == (0.4, 32, True)
    smoothing = load_config().smoothing
    assert (smoothing.window, smoothing.limb_order, smoothing.order) == (7, 2, 1)
    prices = (config.time_scale.lambda_outside, config.lambda_kind, upper.lambda_4 * upper.zeta)
    assert sorted(prices, reverse=True) == list(prices) and config.lambda_reuse == config.lambda_kind


def test_the_defaults_of_motion_matching_are_its_papers():
    config = load_config()
    acoustics, matching, refiner = config.acoustics, config.motion_matching, config.refiner
    # The paper counts frames at 15 per second.
    assert [round(15 * seconds, 9) for seconds in (matching.sequence_seconds, matching.step_seconds)] == [64, 8]
    assert (acoustics.rate, acoustics.coefficients, matching.k, matching.preselect) == (15, 13, 1, "pose")
    assert (matching.audio_values, round(15 * matching.audio_interval_seconds, 9)) == (8, 2)
    assert (matching.pose_values, round(15 * matching.pose_interval_seconds, 9)) == (4, 1)
    assert len(matching.joints) == len(set(matching.joints)) == 8 and matching.start == "random"
    assert (refiner.w_reconstruction, refiner.w_adversarial, refiner.w_penalty) == (0.1, 1, 100)
    assert (refiner.learning_rate, refiner.iterations, refiner.furthest_k) == (1e-4, 300_000, 15)
    assert round(15 * refiner.stride_seconds, 9) == 5 and not config.refine and not acoustics.enabled


def test_a_file_changes_only_what_it_names(load):
    config = load("continuity:\n  l_pn: 3\nseed: 7\n")
    assert (config.continuity.l_pn, config.continuity.l_cn, config.seed) == (3, 5, 7)


@pytest.mark.parametrize("text", ("", "# only a comment\n", "---\n"))
def test_an_empty_file_is_the_defaults(load, text):
    assert load(text) == load_config()


def test_whole_numbers_are_fine_where_decimals_are_asked_for(load):
    assert load("onsets: {min_strength: 4}\n").onsets.min_strength == 4.0


def test_aliases_from_and_list(load):
    config = load("exclude:\n- {clip: a, from: 1, to: 2.5}\nreferences: {mode: list, list: pins.yaml}\n")
    assert (config.exclude[0].clip, config.exclude[0].from_, config.exclude[0].to) == ("a", 1.0, 2.5)
    assert config.references.list_file == "pins.yaml"


def test_joints_are_a_list_or_all(load):
    assert load("joints: all\n").joints == "all"
    assert load("joints: [a, b]\n").joints == ("a", "b")


def test_a_config_is_frozen():
    with pytest.raises(ValidationError, match="frozen"):
        load_config().continuity.l_pn = 1


def test_every_config_that_comes_with_gesturegen_loads():
    paths = sorted(configs_folder().glob("*.yaml"))
    # A list of words, a schedule of what hands are to do, and plans of runs.
    others = {
        "keywords.yaml", "control.yaml", "ablation.yaml", "compare.yaml", "comparison.yaml", "reference_length.yaml",
        "gesture_master_ablation.yaml",
    }  # fmt: skip
    assert others <= {path.name for path in paths}
    for path in paths:
        if path.name not in others:
            assert load_config(path).keywords.words, path


# --- what is refused ----------------------------------------------------------------------------------------

REFUSED = {
    "unknown section": ("continuty: {}", 1, "unknown key 'continuty'; did you mean 'continuity'?"),
    "unknown key": ("seed: 1\ncontinuity:\n  l_pm: 3", 3, "unknown key 'continuity.l_pm'; did you mean 'l_pn'?"),
    "nothing like it": ("zzz: 1", 1, "unknown key 'zzz'; allowed here: method, search, beam"),
    "key of another section": ("beam:\n  q: 1", 2, "unknown key 'beam.q'; allowed here: l_npaths, lambda_w"),
    "key in a list": (
        "exclude:\n- clip: a\n  from: 0\n  to: 1\n  too: 2",
        5,
        "unknown key 'exclude.0.too'; did you mean 'to'?",
    ),
    "the name in the code": (
        "references: {list_file: a}",
        1,
        "unknown key 'references.list_file'; did you mean 'list'",
    ),
    "missing key": ("exclude:\n- {clip: a, from: 0}", 2, r"exclude\.0\.to: missing"),
    "text for a count": ("continuity:\n  l_pn: many", 2, r'continuity\.l_pn: found "many", allowed: a valid integer'),
    "decimal for a count": ("\nfps: 29.97", 2, "fps: found 29.97, allowed: a valid integer"),
    "quoted count": ("seed: '1'", 1, 'seed: found "1", allowed: a valid integer'),
    "true for a count": ("seed: true", 1, "seed: found true, allowed: a valid integer"),
    "no for a bool": (
        "feet:\n  lock: no",
        2,
        r'feet\.lock: found "no", allowed: .* \(this is text; write true or false',
    ),
    "true for a name": ("data:\n  truth_split: true", 2, r"found true, allowed: a valid string \(put it in quotes\)"),
    "octal": ("seed: 010", 1, r'seed: found "010", allowed: a valid integer \(.* without a leading zero\)'),
    "sexagesimal": ("seed: 1:30", 1, r'seed: found "1:30", allowed: a valid integer \(.* write seconds as a decimal'),
    "hexadecimal": ("seed: 0x1F", 1, r'seed: found "0x1F", allowed: a valid integer \(.* write a decimal number\)'),
    "underscores": ("seed: 1_000", 1, r'seed: found "1_000", allowed: a valid integer \(.* digits'),
    "no date": ("fps: 30\nblacklist: {a: 2020-13-45}", 2, "blacklist: found .*2020-13-45.*, allowed: a list"),
    "a long number": (f"fps: 30\nseed: {'9' * 4300}", 2, "seed: a number of 4,300 digits, at most 18 are read"),
    "a large number": ("onsets: {min_strength: 1e999}", 1, r"onsets\.min_strength: 1e999 is too large"),
    "a tag": ("fps: 30\nseed: !!int '3'", 2, r"seed: the tag tag:yaml\.org,2002:int is not read"),
    "an own tag": ("seed: !x 3", 1, "seed: the tag !x is not read"),
    "an anchor": ("fps: &a 30", 1, "fps: `&a`: anchors and aliases are not read"),
    "an alias": ("fps: *a", 1, r"fps: `\*a`: anchors and aliases are not read"),
    "a merge key": ("beam:\n  <<: {l_npaths: 3}", 2, "merge keys .* are not read"),
    "2,000 levels": ("seed: " + "[" * 2000 + "]" * 2000, 1, "seed: more than 50 levels"),
    "levels of dashes": ("seed: 1\nfps:\n" + "- " * 2000 + "a", 3, "fps: more than 50 levels"),
    "a list as a key": ("fps: 30\n? [a]\n: 3", 2, "a list as a key"),
    "an impossible character": ('fps: 30\npaths: {data: "\\U00110000"}', 2, r"not valid YAML"),
    "half a character": ('fps: 30\npaths: {data: "\\uD800"}', 2, r"paths\.data: holds .*control character \(U\+D800\)"),
    "a line break": ("paths:\n  work: |\n    a\n    b", 2, r"paths\.work: holds a line break .* \(U\+000A\)"),
    "quoted no": ("wrists:\n  enabled: 'no'", 2, r'wrists\.enabled: found "no", allowed: a valid boolean'),
    "one for true": ("wrists: {enabled: 1}", 1, r"wrists\.enabled: found 1, allowed: a valid boolean"),
    "text for a list": ("blacklist: trn_1", 1, r'blacklist: found "trn_1", allowed: '),
    "number in a list": ("blacklist:\n- a\n- 5", 3, r"blacklist\.1: found 5, allowed: a valid string"),
    "number for a section": ("continuity: 3", 1, "continuity: found 3"),
    "nothing for a section": ("seed: 1\ncontinuity:", 2, "continuity: found null"),
    "section for a number": ("seed: {a: 1}", 1, "seed: found .*, allowed: a valid integer"),
    "a date": ("seed: 2020-01-01", 1, "seed: found"),
    "joints number": ("joints: 5", 1, "joints: found 5, allowed: "),
    "joints text": ("joints: none", 1, 'joints: found "none", allowed: '),
    "joints with a number": ("joints: [b_root, 5]", 1, "joints.*found"),
    "too small": ("continuity: {l_pn: 0}", 1, r"l_pn: found 0, allowed: greater than or equal to 1"),
    "negative": ("beam: {lambda_w: -1}", 1, r"lambda_w: found -1, allowed: greater than or equal to 0"),
    "not above zero": ("root: {return_half_life: 0}", 1, "return_half_life: found 0, allowed: greater than 0"),
    "too large": ("beam: {min_ratio: 1.5}", 1, r"min_ratio: found 1\.5, allowed: less than or equal to 1"),
    "weight too large": ("features:\n  w_full: [2]", 2, r"features\.w_full\.0: found 2, allowed: less than"),
    "channel": (
        "audio: {channel: both}",
        1,
        r"audio\.channel: found \"both\", allowed: 'mix', 'left', 'right' or a number",
    ),
    "channel 0": ("audio: {channel: 0}", 1, r"audio\.channel: found 0, allowed: 'mix'"),
    "nan": ("onsets: {min_strength: .nan}", 1, r'min_strength: found "\.nan", allowed: .* write a finite number'),
    "infinity": ("onsets: {min_strength: .inf}", 1, r'min_strength: found "\.inf", allowed: .* write a finite number'),
    "no such choice": ("search: globl", 1, 'search: found "globl", allowed: '),
    "even window": ("wrists:\n  window: 4", 1, "wrists: window must be odd and larger than order"),
    "order above the window": ("wrists: {window: 3, order: 3}", 1, "wrists: window must be odd and larger than order"),
    "weights for l_feat": ("features: {l_feat: 3}", 1, "features: w_full has 10 weights for l_feat 3"),
    "range backwards": (
        "exclude:\n- {clip: a, from: 0, to: 1}\n- {clip: a, from: 2, to: 1}",
        3,
        r"exclude\.1: `to` must be later than `from`",
    ),
    "list without a file": (
        "references:\n  mode: list",
        1,
        r"references: mode `list` needs the key `references\.list`",
    ),
    "both thresholds": (
        "gesture_master:\n  upper:\n    delta_quantile: 0.2",
        2,
        r"gesture_master\.upper: give one of delta_t and delta_quantile, and null for the other",
    ),
    "neither threshold": (
        "gesture_master:\n  upper: {}\n  lower:\n    delta_t: null",
        3,
        r"gesture_master\.lower: give one of delta_t and delta_quantile",
    ),
    "a quantile above 1": (
        "gesture_master:\n  upper:\n    delta_t: null\n    delta_quantile: 25",
        4,
        r"gesture_master\.upper\.delta_quantile: found 25, allowed: less than or equal to 1",
    ),
    "clips too long to be cut in two": (
        "gesture_master:\n  cutting:\n    min_seconds: 6",
        2,
        r"gesture_master\.cutting: max_seconds must be at least twice min_seconds",
    ),
    "even smoothing window": (
        "smoothing:\n  window: 6",
        1,
        "smoothing: window must be odd and larger than order and limb_order",
    ),
    "smoothing order above the window": ("smoothing: {window: 3, limb_order: 3}", 1, "smoothing: window must be odd"),
    "pitches backwards": ("prosody:\n  pitch_max: 70", 1, "prosody: pitch_max must be at least 1.2 times pitch_min"),
    "pitches above the sample rate": ("prosody: {sample_rate: 4000, pitch_max: 2000}", 1, "prosody: pitch_max must"),
    "targets without a file": (
        "gesture_master:\n  style:\n    source: targets",
        2,
        r"gesture_master\.style: source `targets` needs the key `targets_file`, .*clip,from,to,speed,radius,height",
    ),
    "a style source that is a list": (
        "gesture_master:\n  style:\n    source: [x]",
        3,
        r"gesture_master\.style\.source: found \[\"x\"\], allowed: 'predict', 'targets' or 'none'",
    ),
    "predicted style without prosody": (
        "seed: 1\nmethod: gesture_master",
        2,
        r"method: gesture_master with gesture_master\.style\.source: predict needs prosody\.enabled: true",
    ),
    "unknown key of gesture_master": (
        "gesture_master:\n  mirror: false\n  rythm: {bits: 16}",
        3,
        r"unknown key 'gesture_master\.rythm'; did you mean 'rhythm'\?",
    ),
    "unknown key two sections down": (
        "gesture_master:\n  upper:\n    lambda_7: 1.0",
        3,
        r"unknown key 'gesture_master\.upper\.lambda_7'; did you mean 'lambda_\d'\?",
    ),
    "unknown key of a correction": (
        "gesture_master:\n  rhythm:\n    corrections:\n    - {clip: a, start: 0, bits: '01',\n       strt: 1}",
        5,
        r"unknown key 'gesture_master\.rhythm\.corrections\.0\.strt'; did you mean 'start'\?",
    ),
    "unknown key of a target": (
        "gesture_master:\n  style:\n    targets:\n    - {clip: a, from: 0, to: 1, hight: 2}",
        4,
        r"unknown key 'gesture_master\.style\.targets\.0\.hight'; did you mean 'height'\?",
    ),
    "bits of a correction": (
        "gesture_master:\n  rhythm:\n    bits: 4\n    corrections: [{clip: a, start: 1.5, bits: '010'}]",
        2,
        r"gesture_master\.rhythm: the correction of a at 1\.5 s has 3 bits, rhythm\.bits is 4",
    ),
    "bits that are no bits": (
        "gesture_master:\n  rhythm:\n    corrections: [{clip: a, start: 1.5, bits: '012'}]",
        3,
        r'corrections\.0\.bits: found "012"',
    ),
    "bits without quotes": (
        "gesture_master:\n  rhythm:\n    corrections: [{clip: a, start: 1.5, bits: 111}]",
        3,
        r"corrections\.0\.bits: found 111, allowed: a valid string",
    ),
    "target backwards": (
        "gesture_master:\n  style:\n    targets:\n    - {clip: a, from: 2, to: 1}",
        4,
        r"gesture_master\.style\.targets\.0: `to` must be later than `from`",
    ),
    "one joint of a pair": (
        "gesture_master:\n  joint_pairs:\n  - [a, b]\n  - [c]",
        4,
        r"gesture_master\.joint_pairs\.1\.1: missing",
    ),
    "matching without sound": (
        "seed: 1\nmethod: motion_matching",
        2,
        r"method: motion_matching needs acoustics\.enabled: true, which measures the sound",
    ),
    "a rate that is no part of the sample rate": (
        "seed: 1\nacoustics:\n  rate: 16",
        2,
        r"acoustics: sample_rate must be a multiple of rate",
    ),
    "a given start without a pose": (
        "motion_matching:\n  start: given",
        1,
        r"motion_matching: start: given goes with start_pose, .* such as trn_000@12\.30",
    ),
    "a pose for another start": (
        "seed: 1\nmotion_matching: {start: mean, start_pose: a@1}",
        2,
        r"motion_matching: start: given goes with start_pose",
    ),
    "unknown key of motion_matching": (
        "motion_matching:\n  k: 2\n  preselct: audio",
        3,
        r"unknown key 'motion_matching\.preselct'; did you mean 'preselect'\?",
    ),
    "all held out": (
        "refiner:\n  held_out_share: 1.0",
        2,
        r"refiner\.held_out_share: found 1\.0, allowed: less than 1",
    ),
    "no such device": (
        "refiner:\n  device: gpu",
        2,
        r"refiner\.device: found \"gpu\", allowed: 'auto', 'cpu' or 'cuda'",
    ),
    "no such baseline": (
        "method: baseline\nbaseline: still",
        2,
        r"baseline: found \"still\", allowed: 'random_stretch' or 'mismatched'",
    ),
    "control of the beam": (
        "seed: 1\ncontrol:\n  conditions:\n  - {measure: height, at_least: 5}",
        2,
        r"control: control of the hands needs search: global or method: motion_matching; choose one of them",
    ),
    "control of gesture_master": (
        "method: gesture_master\nsearch: global\nprosody: {enabled: true}\n"
        "control: {conditions: [{measure: height, at_least: 5}]}",
        4,
        r"control: control of the hands needs search: global or method: motion_matching",
    ),
    "conditions that overlap in the config": (
        "search: global\ncontrol:\n  conditions:\n  - {measure: height, at_least: 5}\n  - {measure: height, at_most: 9}",
        5,
        r"control\.conditions\.1: conditions 1 and 2 overlap from 0 s on",
    ),
    "key twice": ("seed: 1\nfps: 30\nseed: 2", 3, "key 'seed' stands twice, first in line 1"),
    "key twice in a section": ("beam:\n  l_npaths: 1\n  l_npaths: 2", 3, "key 'l_npaths' stands twice"),
    "a key YAML reads as false": ("keywords:\n  words:\n    false: nope", 3, "key False is read by YAML as a bool"),
    "a key YAML reads as a number": ("1: a", 1, "key 1 is read by YAML as a int"),
    "no YAML": ("seed: [1", 2, "not valid YAML"),
    "bad indentation": ("beam:\n  l_npaths: 1\n l_npaths: 2", 3, "not valid YAML"),
    "two documents": ("seed: 1\n---\nseed: 2", 2, "a second document starts here; keep one"),
}


@pytest.mark.parametrize(("text", "line", "match"), REFUSED.values(), ids=REFUSED)
def test_mistakes_are_refused_with_file_and_line(load, tmp_path, text, line, match):
    with refused(ConfigError, literally(tmp_path / "run.yaml", line) + ".*" + match):
        load(text + "\n")


@pytest.mark.parametrize(
    ("text", "found"), [("- a\n- b\n", "list"), ("just text\n", "str"), ("3\n", "int")], ids=["list", "text", "number"]
)
def test_a_file_that_is_no_mapping_is_refused(load, tmp_path, text, found):
    with refused(ConfigError, f"expected `key: value` lines, found a {found}", tmp_path / "run.yaml"):
        load(text)


@pytest.mark.parametrize(
    ("content", "match"),
    [
        (b"\xff\xfe\x00", "not a text file in UTF-8"),
        (b"seed: 1\nfps: \xff", ":2: not a text file in UTF-8"),
        (b"seed: \x001", "not valid YAML"),
        (b"seed: 1\n" * 30_000, r"0\.2 MB, more than the 0\.2 MB that are read"),
    ],
    ids=["binary", "Latin-1", "control character", "large"],
)
def test_a_file_that_is_no_text_is_refused(load, tmp_path, content, match):
    with refused(ConfigError, match, tmp_path / "run.yaml"):
        load(content)


def test_a_missing_file_is_named(tmp_path):
    with refused(ConfigError, "cannot be read .*--config", tmp_path / "none.yaml"):
        load_config(tmp_path / "none.yaml")


def test_every_mistake_gets_its_own_line(load, tmp_path):
    with pytest.raises(ConfigError) as caught:
        load("seed: x\nbeam:\n  l_npaths: 0\nfsp: 3\n")
    lines = str(caught.value).splitlines()
    assert [line.split(": ")[0] for line in lines] == [f"{tmp_path / 'run.yaml'}:{n}" for n in (1, 3, 4)]


# --- --set --------------------------------------------------------------------------------------------------


def test_overrides_win_in_order(load):
    config = load("continuity: {l_pn: 3, l_cn: 4}\n", "continuity.l_pn=1", "continuity.l_pn=2", "seed=9")
    assert (config.continuity.l_pn, config.continuity.l_cn, config.seed) == (2, 4, 9)


@pytest.mark.parametrize(
    ("override", "get", "value"),
    [
        ("joints=all", lambda c: c.joints, "all"),
        ("joints=[a, b]", lambda c: c.joints, ("a", "b")),
        ("blacklist=[trn_2023_v0_003]", lambda c: c.blacklist, ("trn_2023_v0_003",)),
        ("wrists.enabled=false", lambda c: c.wrists.enabled, False),
        ("breaks.max_joint_speed=400", lambda c: c.breaks.max_joint_speed, 400.0),
        ("breaks.max_joint_speed=null", lambda c: c.breaks.max_joint_speed, None),
        ("beam={l_npaths: 3}", lambda c: c.beam.l_npaths, 3),
        ("references.list=pins.yaml", lambda c: c.references.list_file, "pins.yaml"),
        ("exclude=[{clip: a, from: 0, to: 1}]", lambda c: c.exclude[0].to, 1.0),
        ("paths.data=a=b", lambda c: c.paths.data, "a=b"),
        (" seed =4", lambda c: c.seed, 4),
        ("onsets.min_strength=1.0e-3", lambda c: c.onsets.min_strength, 1e-3),
        ("onsets.min_strength=1e-3", lambda c: c.onsets.min_strength, 1e-3),
        ("onsets.min_strength=+.5E+1", lambda c: c.onsets.min_strength, 5.0),
        (
            "blacklist=[no, 010, 2020-01-02, 1:30, 0x1, 1_0, .inf, =, a\u00a0b]",
            lambda c: c.blacklist[:-1],
            ("no", "010", "2020-01-02", "1:30", "0x1", "1_0", ".inf", "="),
        ),
    ],
)
def test_set_forms(override, get, value):
    assert get(load_config(None, (override,))) == value


@pytest.mark.parametrize(
    ("override", "match"),
    [
        ("continuity.l_pn", "expected key=value, such as continuity.l_pn=1"),
        ("=3", "expected key=value"),
        ("", "expected key=value"),
        ("continuity.l_pm=1", r"^--set: unknown key 'continuity\.l_pm'; did you mean 'l_pn'"),
        ("a.b.c=1", "^--set: unknown key 'a'"),
        ("continuity.l_pn=0", r"^--set: continuity\.l_pn: found 0, allowed: greater than or equal to 1"),
        ("onsets.min_strength=1e999", "^--set onsets.min_strength=1e999:1: 1e999 is too large"),
        (".".join("a" * 5000) + "=1", "^--set .*: no such key"),
        ("paths.data=" + "[" * 5000, "^--set paths.*:1: more than 50 levels"),
        ("paths.data=a\udcff", "^--set paths.data=a.udcff.*: not valid YAML"),
        ("a\nb", r"^--set \"a\\nb\": expected key=value"),
        ("seed=[", "not valid YAML"),
        ("seed=", "^--set: seed: found null, allowed: a valid integer"),
        ("wrists.window=4", "^--set: wrists: window must be odd"),
        ("seed.x=1", "^--set: seed: "),
        ("method=gesture_master", r"^--set: method: .* needs prosody\.enabled: true"),
        ("method=motion_matching", r"^--set: method: .* needs acoustics\.enabled: true"),
        ("control.conditions=[{measure: speed, at_most: 9}]", "^--set: control: .* needs search: global or method:"),
        ("keywords.words={false: nope}", "key False"),
        ("beam={l_npaths: 3, l_npaths: 4}", "stands twice"),
    ],
)
def test_wrong_overrides_are_refused(override, match):
    with refused(ConfigError, match):
        load_config(None, (override,))


def test_a_value_of_the_file_is_no_section(load):
    with refused(ConfigError, "'seed' is no section"):
        load("seed: 1\n", "seed.x=2")


def test_mistakes_in_the_file_keep_their_line_beside_overrides(load, tmp_path):
    with refused(ConfigError, literally(tmp_path / "run.yaml", 2) + r"beam\.l_npaths"):
        load("beam:\n  l_npaths: 0\n", "beam.lambda_w=2")


def test_an_override_mends_the_file(load):
    assert load("beam: {l_npaths: 0}\n", "beam.l_npaths=5").beam.l_npaths == 5


def test_what_is_wrong_with_the_file_is_not_blamed_on_an_override(load, tmp_path):
    with refused(ConfigError, literally(tmp_path / "run.yaml", 1) + "method: .* needs prosody"):
        load("method: gesture_master\n", "seed=2")
    assert load("method: gesture_master\n", "prosody.enabled=true").prosody.enabled


def test_folders_are_taken_to_the_letter(load, tmp_path):
    folders = {"paths.data": "1e3", "paths.work": "no", "data.tests": "a: b"}
    config = load_config(None, ("paths.data=other",), folders)
    assert (config.paths.data, config.paths.work, config.data.tests) == ("1e3", "no", "a: b")
    (tmp_path / "run.yaml").write_text("paths: {work: kept}\n")
    config = load_config(tmp_path / "run.yaml", (), {"paths.data": "given"})
    assert (config.paths.data, config.paths.work) == ("given", "kept")


def test_a_folder_beside_a_broken_section_is_refused(tmp_path):
    (tmp_path / "run.yaml").write_text("paths: 3\n")
    with refused(ConfigError, "paths", tmp_path / "run.yaml"):
        load_config(tmp_path / "run.yaml", (), {"paths.data": "given"})


# --- keywords -----------------------------------------------------------------------------------------------


def test_the_keyword_list_that_comes_with_gesturegen():
    words = load_config().keywords.words
    listed = """hey hi hello one two three first second third east west north south back front away here around crazy
        incredible surprising screaming walk drive ride enter open attach take move more less much few called"""
    assert set(words) == set(listed.split())


def test_keywords_beside_the_config_come_first(load, tmp_path, monkeypatch):
    (tmp_path / "keywords.yaml").write_text("Yo: hey\n")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "keywords.yaml").write_text("other: 1\n")
    monkeypatch.chdir(elsewhere)
    assert load("seed: 1\n").keywords.words == {"yo": "hey"}


def test_a_named_keyword_file_beside_the_config(load, tmp_path):
    (tmp_path / "mine.yaml").write_text("yo: hey\nhowdy: hey\n")
    assert load("keywords: {file: mine.yaml}\n").keywords.words == {"yo": "hey", "howdy": "hey"}
    assert load("", f"keywords.file={tmp_path / 'mine.yaml'}").keywords.words == {"yo": "hey", "howdy": "hey"}


def test_keywords_inside_the_config(load):
    assert load("keywords:\n  words: {yo: hey}\n").keywords.words == {"yo": "hey"}
    assert load("keywords: {words: {}}\n").keywords.words == {}


def test_words_that_other_readers_take_for_bools_are_words(load, tmp_path):
    (tmp_path / "mine.yaml").write_text("no: negation\non: on\n")
    assert load("keywords: {file: mine.yaml}\n").keywords.words == {"no": "negation", "on": "on"}


def test_only_the_first_mistakes_of_many_are_told(load, tmp_path):
    with pytest.raises(ConfigError, match=r"run\.yaml: and 2980 more$") as caught:
        load("".join(f"a{n}: 1\n" for n in range(3000)))
    assert len(str(caught.value).splitlines()) == 21


def test_keywords_are_lower_cased_wherever_they_stand(load, tmp_path):
    (tmp_path / "mine.yaml").write_text("Hello: hello\n")
    assert load("keywords: {file: mine.yaml}\n").keywords.words == {"hello": "hello"}
    assert load("keywords: {words: {Hello: hello}}\n").keywords.words == {"hello": "hello"}


@pytest.mark.parametrize(
    ("content", "match"),
    [
        ("- hey\n- you\n", "expected `word: keyword` lines"),
        ("hey:\n", "expected `word: keyword` lines"),
        ("one: 1\n", "expected `word: keyword` lines"),
        ("stop: true\n", "put words such as true and null in quotes"),
        ("false: nope\n", "mine.yaml:1: key False is read by YAML as a bool; put it in quotes"),
        ("hey: a\nhey: b\n", "mine.yaml:2: key 'hey' stands twice"),
        ("hey: [\n", "mine.yaml:2: not valid YAML"),
        ("", "expected `word: keyword` lines"),
    ],
)
def test_broken_keyword_files_are_refused(load, tmp_path, content, match):
    (tmp_path / "mine.yaml").write_text(content)
    with refused(ConfigError, match, tmp_path / "mine.yaml"):
        load("keywords: {file: mine.yaml}\n")


def test_a_missing_keyword_file_is_named_with_the_places_looked_at(load, tmp_path):
    with refused(ConfigError, r"keywords\.file: 'none.yaml' does not exist", tmp_path / "none.yaml"):
        load("keywords: {file: none.yaml}\n")


# --- corrections and targets --------------------------------------------------------------------------------

CORRECTED = "gesture_master:\n  rhythm: {bits: 4, corrections_file: mine.csv}\n"
TARGETED = "gesture_master:\n  style: {source: targets, targets_file: mine.csv}\n"
TARGET_COLUMNS = "clip,from,to,speed,radius,height\n"


def test_corrections_beside_the_config(load, tmp_path):
    (tmp_path / "mine.csv").write_text("start,clip,bits\n1.5, a ,0110\n\n0,b*,0000\n")
    found = load(CORRECTED).gesture_master.rhythm.corrections
    assert [(c.clip, c.start, c.bits) for c in found] == [("a", 1.5, "0110"), ("b*", 0.0, "0000")]
    inside = [{"clip": "a", "start": 1.5, "bits": "0110"}, {"clip": "b*", "start": 0, "bits": "0000"}]
    assert load(CORRECTED, f"gesture_master.rhythm.corrections={json.dumps(inside)}").gesture_master.rhythm == (
        load(CORRECTED).gesture_master.rhythm
    )


def test_targets_beside_the_config_may_leave_values_free(load, tmp_path):
    (tmp_path / "mine.csv").write_text(TARGET_COLUMNS + "a,0,2.5,40,,-3\nb,1,2,,,\n")
    first, second = load(TARGETED).gesture_master.style.targets
    assert (first.clip, first.from_, first.to, first.speed, first.radius, first.height) == ("a", 0, 2.5, 40, None, -3)
    assert (second.speed, second.radius, second.height) == (None, None, None)


def test_a_list_inside_the_config_wins_over_its_file(load):
    inside = "[{clip: a, from: 0, to: 1}]"
    assert load(TARGETED, f"gesture_master.style.targets={inside}").gesture_master.style.targets[0].clip == "a"


WRONG_ROWS = {
    "no such column": (CORRECTED, "clip,strt,bits\na,0,0101\n", 1, "unknown column 'strt'; did you mean 'start'?"),
    "column missing": (CORRECTED, "clip,bits\na,0101\n", 1, "column 'start' is missing"),
    "cell missing": (CORRECTED, "clip,start,bits\na,0\n", 2, "found 2 cells, expected 3"),
    "cell empty": (CORRECTED, "clip,start,bits\na,,0101\n", 2, "column 'start' is empty"),
    "no number": (CORRECTED, "clip,start,bits\na,0,0101\n\nb,x,0101\n", 4, 'start: found "x", allowed: a valid number'),
    "nan": (CORRECTED, "clip,start,bits\na,nan,0101\n", 2, 'start: found "nan", allowed: a finite number'),
    "negative": (
        CORRECTED,
        "clip,start,bits\na,-1,0101\n",
        2,
        'start: found "-1", allowed: greater than or equal to 0',
    ),
    "no bits": (CORRECTED, "clip,start,bits\na,0,01x1\n", 2, 'bits: found "01x1"'),
    "bits of another length": (
        CORRECTED,
        "clip,start,bits\na,0,0101\nb,2.5,010\n",
        3,
        "the correction of b at 2.5 s has 3 bits, rhythm.bits is 4",
    ),
    "no speed": (TARGETED, TARGET_COLUMNS + "a,0,1,fast,,\n", 2, 'speed: found "fast", allowed: a valid number'),
    "target backwards": (TARGETED, TARGET_COLUMNS + "a,0,1,,,\na,2,1,,,\n", 3, "`to` must be later than `from`"),
}


@pytest.mark.parametrize(("text", "content", "line", "match"), WRONG_ROWS.values(), ids=WRONG_ROWS)
def test_wrong_rows_are_refused_with_file_and_line(load, tmp_path, text, content, line, match):
    (tmp_path / "mine.csv").write_text(content)
    with refused(ConfigError, literally(tmp_path / "mine.csv", line) + re.escape(match)):
        load(text)


@pytest.mark.parametrize(
    ("text", "key"),
    [(CORRECTED, r"rhythm\.corrections_file"), (TARGETED, r"style\.targets_file")],
    ids=["rhythm", "style"],
)
def test_a_missing_list_is_named_with_the_places_looked_at(load, tmp_path, text, key):
    with refused(ConfigError, rf"^gesture_master\.{key}: 'mine\.csv' does not exist", tmp_path / "mine.csv"):
        load(text)


# --- layers -------------------------------------------------------------------------------------------------


@pytest.fixture
def layer(load, tmp_path):
    def layer(base, setup):
        (tmp_path / "setup.yaml").write_text(setup)
        path = tmp_path / "setup.yaml"
        return layer_config(load(base), *strict_yaml.read_mapping(path, "check the path"), path)

    return layer


def test_layers_merge_nested_sections(layer):
    base = "gesture_master:\n  upper: {lambda_5: 2.0, lambda_6: 3.0}\n  mirror: false\nseed: 4\n"
    config = layer(base, "gesture_master: {upper: {lambda_6: 0.5}, rhythm: {bits: 16}}\n")
    master = config.gesture_master
    assert (master.upper.lambda_5, master.upper.lambda_6, master.rhythm.bits) == (2.0, 0.5, 16)
    assert (master.mirror, config.seed, master.lower.lambda_4) == (False, 4, 1.0)


def test_a_layer_replaces_lists_as_a_whole(layer):
    assert layer("blacklist: [a, b]\n", "blacklist: [c]\n").blacklist == ("c",)
    config = layer("keywords: {words: {a: b}}\n", "keywords: {words: {c: d}}\n")
    assert config.keywords.words == {"c": "d"}


def test_a_layer_that_names_another_file_drops_the_rows_of_the_base(layer, tmp_path):
    (tmp_path / "mine.csv").write_text("clip,start,bits\na,0,0101\n")
    (tmp_path / "other.csv").write_text("clip,start,bits\nb,0,1111\nc,1,1111\n")

    def clips(setup):
        found = layer(CORRECTED, setup).gesture_master.rhythm
        assert found.bits == 4
        return found.corrections and [c.clip for c in found.corrections]

    assert clips("gesture_master: {rhythm: {corrections_file: other.csv}}\n") == ["b", "c"]
    assert clips("gesture_master: {rhythm: {corrections_file: null}}\n") is None
    assert clips("gesture_master: {rhythm: {words: span}}\n") == ["a"]
    assert clips("gesture_master: {rhythm: {corrections: [{clip: d, start: 0, bits: '0000'}]}}\n") == ["d"]


def test_a_layer_that_names_another_file_drops_the_targets_of_the_base(layer, tmp_path):
    (tmp_path / "mine.csv").write_text(TARGET_COLUMNS + "a,0,1,10,,\n")
    (tmp_path / "other.csv").write_text(TARGET_COLUMNS + "b,0,1,20,,\n")
    style = layer(TARGETED, "gesture_master: {style: {targets_file: other.csv}}\n").gesture_master.style
    assert [target.clip for target in style.targets] == ["b"]


def test_a_layer_whose_bits_do_not_fit_the_corrections_of_the_base_is_refused(layer, tmp_path):
    (tmp_path / "mine.csv").write_text("clip,start,bits\na,0,0101\n")
    with refused(ConfigError, literally(tmp_path / "setup.yaml", 2) + r"gesture_master\.rhythm: .* has 4 bits"):
        layer(CORRECTED, "gesture_master:\n  rhythm: {bits: 8}\n")


@pytest.mark.parametrize(
    ("setup", "line", "match"),
    [
        ("gesture_master:\n", 1, "gesture_master: found null, allowed: a section"),
        ("gesture_master: [rhythm]\n", 1, r"gesture_master: found \[\"rhythm\"\], allowed: a section"),
        ("gesture_master:\n  rhythm: 3\n", 2, r"gesture_master\.rhythm: found 3, allowed: a section"),
        ("gesture_master:\n  style:\n", 2, r"gesture_master\.style: found null, allowed: a section"),
    ],
)
def test_a_layer_with_a_broken_section_is_refused(layer, tmp_path, setup, line, match):
    with refused(ConfigError, literally(tmp_path / "setup.yaml", line) + match):
        layer("seed: 1\n", setup)


# --- signature ----------------------------------------------------------------------------------------------


def leaves(model=Config, prefix=""):
    """(key path, default, annotation) of every setting that is no section."""
    for name, field in model.model_fields.items():
        key = prefix + (field.alias or name)
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            yield from leaves(field.annotation, f"{key}.")
        else:
            yield key, field.default, field.annotation


ANOTHER = {
    "audio.channel": 2,
    "onsets.per_second": 2.0,
    "joints": ["a"],
    "exclude": [{"clip": "a", "from": 0, "to": 1}],
    "blacklist": ["a"],
    "keywords.words": {"yo": "hey"},
    "features.l_feat": None,  # changes with w_full, below
    "features.w_full": [1.0] * 9 + [0.3],
    "beam.max_ratio": 1.5,
    "global_search.max_ratio": 1.5,
    "evaluation.frechet_windows": [30],
    "breaks.max_joint_speed": 100,
    "data.truth_split": "val",
    "references.list": "a.yaml",
    "references.mode": "all",
    "references.seconds": 30,
    "method": "gesture_master",
    "gesture_master.quality.include": ["a"],
    "gesture_master.quality.exclude": ["a"],
    "gesture_master.joint_pairs": [["a", "b"]],
    "gesture_master.rhythm.corrections": [{"clip": "a", "start": 0, "bits": "01" * 16}],
    "gesture_master.style.source": "none",
    "gesture_master.style.targets": [{"clip": "a", "from": 0, "to": 1}],
    "motion.unit": "m",
    **{key: ["a"] for key in ("skeleton.spine", "skeleton.left_fingers", "skeleton.right_fingers")},
    "gesture_master.upper.delta_quantile": 0.5,
    "gesture_master.lower.delta_quantile": 0.5,
    "gesture_master.time_scale.max": 1.5,
    "acoustics.sample_rate": 44100,
    "acoustics.rate": 25,
    "motion_matching.start": "mean",
    "motion_matching.start_pose": "a@2",
    "control.conditions": [{"measure": "height", "at_least": 5}],
    "control.gestures": [{"at": 1, "gesture": "a"}],
    "refiner.learning_rate": 0.001,
    "global_search.beat_lag_seconds": 0.1,
}
# What a setting needs beside it, before and after its change.
BESIDE = {
    "method": ["prosody.enabled=true"],
    "gesture_master.upper.delta_quantile": ["gesture_master.upper={delta_t: null, delta_quantile: 0.25}"],
    "gesture_master.lower.delta_quantile": ["gesture_master.lower={delta_t: null, delta_quantile: 0.25}"],
    "motion_matching.start_pose": ["motion_matching={start: given, start_pose: a@1}"],
    "control.conditions": ["search=global"],
}


def another(key, default, annotation):
    if key in ANOTHER:
        return ANOTHER[key]
    if get_origin(annotation) is Literal:
        return next(choice for choice in get_args(annotation) if choice != default)
    if isinstance(default, bool):
        return not default
    if isinstance(default, int):
        return default + 2
    if isinstance(default, float):
        return default / 2 or 1.0
    if isinstance(default, tuple):
        return list(default[1:])
    return f"{default}x"


PLACES = {
    "paths.data", "paths.work", "data.references", "data.tests", "keywords.file",
    "gesture_master.rhythm.corrections_file", "gesture_master.style.targets_file",
    "control.file", "control.library", "refiner.checkpoint",
}  # fmt: skip
SETTINGS = [leaf for leaf in leaves() if leaf[0] not in PLACES]


@pytest.mark.parametrize(("key", "default", "annotation"), SETTINGS, ids=[leaf[0] for leaf in SETTINGS])
def test_every_setting_changes_the_signature(key, default, annotation):
    value = another(key, default, annotation)
    override = f"{key}={json.dumps(value)}"
    if key == "features.l_feat":
        override = "features={l_feat: 1, w_full: [1.0]}"
    beside = BESIDE.get(key, [])
    assert load_config(None, [*beside, override]).signature() != load_config(None, beside).signature()


def test_the_signature_does_not_depend_on_where_files_are(load, tmp_path):
    default = load_config().signature()
    assert re.fullmatch(r"[0-9a-f]{12}", default)
    assert load("paths: {data: /somewhere, work: /else}\n").signature() == default
    assert load("data: {references: /somewhere, tests: /else}\n").signature() == default
    # What these hold is in the hash of every result (`inputs`).
    assert load("control: {library: /somewhere}\nrefiner: {checkpoint: /else.pt}\n").signature() == default
    copy = tmp_path / "copy.yaml"
    copy.write_text((configs_folder() / "keywords.yaml").read_text())
    assert load("keywords: {file: copy.yaml}\n").signature() == default
    spelled_out = yaml.safe_load(copy.read_text())
    assert load(yaml.safe_dump({"keywords": {"words": spelled_out}})).signature() == default


def test_the_signature_depends_on_what_lists_hold_and_not_on_where_they_are(load, tmp_path):
    row = {"clip": "a", "start": 0, "bits": "0101"}
    inside = load("", "gesture_master.rhythm.bits=4", f"gesture_master.rhythm.corrections={json.dumps([row])}")
    for name in ("mine.csv", "other.csv"):
        (tmp_path / name).write_text("clip,start,bits\na,0,0101\n")
        assert load(CORRECTED.replace("mine.csv", name)).signature() == inside.signature()
    (tmp_path / "mine.csv").write_text("clip,start,bits\na,0,0111\n")
    assert load(CORRECTED).signature() != inside.signature()


def test_the_order_of_keys_does_not_matter(load):
    assert load("seed: 1\nfps: 25\n").signature() == load("fps: 25\nseed: 1\n").signature()


def test_section_json_is_canonical():
    config = load_config()
    text = config.section_json("onsets.min_strength", "fps", "continuity")
    assert json.loads(text) == {
        "onsets.min_strength": 5.0,
        "fps": 30,
        "continuity": {"lambda_pos": 1.0, "lambda_vel": 1.0, "l_cn": 5, "l_pn": 10},
    }
    assert text == config.section_json("continuity", "fps", "onsets.min_strength")
    with pytest.raises(KeyError):
        config.section_json("continuty")


def test_configs_are_found_inside_the_package_first(tmp_path, monkeypatch):
    package = tmp_path / "gesturegen"
    package.mkdir()
    monkeypatch.setattr(loading, "__file__", str(package / "settings/loading.py"))
    assert configs_folder() == tmp_path / "configs"
    (package / "configs").mkdir()
    assert configs_folder() == package / "configs"


# --- randomness ---------------------------------------------------------------------------------------------


def test_generators_depend_on_seed_and_purpose_alone():
    def draws(seed, purpose):
        return generator(seed, purpose).integers(0, 2**62, 4).tolist()

    assert draws(3, "clip_a") == draws(3, "clip_a")
    assert len({tuple(draws(seed, name)) for seed in (0, 1, 2**40) for name in ("", "clip_a", "clip_b", "Grüße")}) == 12
