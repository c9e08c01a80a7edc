"""Control of the hands from files to files: what is asked for is shown, measured and drawn (Habibie et al. 2022)."""

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest

from gesturegen.control.measures import hand_measures
from gesturegen.demo import dataset
from gesturegen.settings.loading import configs_folder
from gesturegen.stored import documents
from tests.builders import data_folder
from tests.commands import errors, run, succeed
from tests.report.test_browser import browser, opened, ready  # noqa: F401

TEST = "tst_2023_v0_000_main-agent"
MATCHING = ("--config", configs_folder() / "motion_matching_2022.yaml")
GLOBAL = ("--set", "search=global", "--set", "references.mode=all")
METHODS = {"motion_matching": MATCHING, "global": GLOBAL}
# What the paper's table 2 asks for: measure, hand, bound, share of the references' frames below it.
ASKED = {
    "high": ("height", "left", "at_least", 0.85),
    "low": ("height", "left", "at_most", 0.15),
    "fast": ("speed", "left", "at_least", 0.85),
    "slow": ("speed", "left", "at_most", 0.15),
    "symmetric": ("symmetry", "both", "at_most", 0.15),
}
# By how many standard deviations of the references the mean may fall short of the bound. It is looked up at the ends
# of a step only, and joins are blended: the paper asks for 3 cm/s and gets 5.9, and for a symmetry of 0 cm and gets 1.
SHORT = {("motion_matching", "symmetric"): 0.25, ("motion_matching", "fast"): 0.02, ("global", "slow"): 0.1}


def condition(name: str) -> str:
    measure, hand, bound, share = ASKED[name]
    return f"{{measure: {measure}, hand: {hand}, {bound}: {share:.0%}}}"


def asked(*conditions: str) -> tuple[str, str]:
    return "--set", f"control.conditions=[{', '.join(conditions)}]"


class Folder:
    """A dataset, and a work folder for each method, with clips and graphs."""

    def __init__(self, data: Path, base: Path):
        self.data, self.base, self.built = data, base, set()

    def common(self, method: str) -> tuple:
        return *METHODS[method], "--data", self.data, "--work", self.base / method, "-j", 1

    def command(self, name: str, method: str, *options):
        if method not in self.built:
            for stage in ("preprocess", "build-graph"):
                succeed(stage, *self.common(method))
            self.built.add(method)
        return run(name, *self.common(method), *options)

    def controlled(self, method: str, *options) -> list[dict]:
        """What `evaluate` says was achieved."""
        for stage in ("reenact", "evaluate"):
            result = self.command(stage, method, *options)
            assert result.exit_code == 0, result.output
        return self.summary(method)["control"][TEST]

    def summary(self, method: str) -> dict:
        return json.loads((self.base / method / "evaluate/summary.json").read_text())

    def recorded(self, method: str) -> dict[tuple[str, str], np.ndarray]:
        """Every measure of the hands in the references."""
        (graph,) = (self.base / method / "graphs").glob("*.npz")
        stored = np.load(graph)
        places = [stored["joint_names"].tolist().index(name) for name in ("b_l_wrist", "b_r_wrist")]
        return hand_measures(stored["positions"][:, places], stored["segment_starts"], float(stored["fps"]))


@pytest.fixture(scope="module")
def demo(tmp_path_factory) -> Folder:
    base = tmp_path_factory.mktemp("control")
    specs = dataset.clip_specs(references=2, tests=1, seed=0, reference_seconds=(60.0, 60.0), test_seconds=(30.0, 30.0))
    for spec in specs:
        dataset.write_clip(base / "data", spec)
    dataset.write_metadata(base / "data", specs)
    return Folder(base / "data", base)


@pytest.fixture(scope="module")
def real(tmp_path_factory) -> Folder:
    return Folder(data_folder() / "genea_style_sample", tmp_path_factory.mktemp("real"))


# --- what is asked for is shown -----------------------------------------------------------------------------


def check(name: str, method: str, row: dict, recorded: np.ndarray) -> None:
    """The columns of table 2, and whether they are as they should be.

    The mean lies beyond the bound, but not much further than that of the references' frames that meet it, and the
    motion varies as they do: it is not stuck.
    """
    _, _, bound, share = ASKED[name]
    sign = 1 if bound == "at_least" else -1
    threshold, spread = row[bound], recorded.std()
    assert threshold == pytest.approx(np.quantile(recorded.astype(float), share))
    assert (row["reference_mean"], row["reference_deviation"]) == pytest.approx((recorded.mean(), spread))
    inside = recorded[sign * recorded >= sign * threshold]
    beyond = sign * (row["mean"] - threshold) / spread
    offered = sign * (inside.mean() - threshold) / spread
    assert -SHORT.get((method, name), 0.0) <= beyond <= max(0.5, offered + 0.25), (beyond, offered, row)
    assert row["deviation"] > 0.8 * inside.std(), (inside.std(), row)
    # Far more frames meet it than of the references, of which 15 % do.
    assert row["inside"] > 0.3, row


@pytest.mark.slow
@pytest.mark.parametrize("name", ASKED)
@pytest.mark.parametrize("method", METHODS)
def test_what_is_asked_for_is_shown(method, name, demo):
    (row,) = demo.controlled(method, *asked(condition(name)))
    assert (row["measure"], row["hand"], row["from"], row["to"]) == (*ASKED[name][:2], 0, 30)
    check(name, method, row, demo.recorded(method)[ASKED[name][:2]])


@pytest.mark.slow
def test_inertialization_keeps_fast_hands_fast(demo):
    """A cross-fade slows down the ends of steps, which are the frames that are chosen for being fast."""
    crossfaded, whole = (
        demo.controlled("motion_matching", *asked(condition("fast")), "--set", f"blend.method={method}")[0]
        for method in ("crossfade", "inertialize")
    )
    spread = whole["reference_deviation"]
    assert whole["mean"] > crossfaded["mean"] and whole["mean"] > whole["at_least"] - 0.05 * spread


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_real_hands_go_up_and_down(method, real):
    """A short reference has few stretches to choose from: high must be above the average and low below, and so on."""
    shown = {}
    for name in ("high", "low", "fast", "slow"):
        for stage in ("reenact", "evaluate"):
            result = real.command(stage, method, *asked(condition(name)))
            assert result.exit_code == 0, result.output
        shown[name] = [rows[0] for rows in real.summary(method)["control"].values()]
    for more, less in (("high", "low"), ("fast", "slow")):
        for one, other in zip(shown[more], shown[less], strict=True):
            assert one["mean"] > one["reference_mean"] > other["mean"]
            assert one["mean"] - other["mean"] > 0.7 * one["reference_deviation"]
    for rows in shown.values():
        assert all(row["deviation"] > 0 and row["inside"] > 0.3 for row in rows)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["motion_matching", pytest.param("global", marks=pytest.mark.slow)])
@pytest.mark.parametrize("middle", [15.0, 14.2])
def test_demands_change_over_time(method, middle, demo):
    rows = demo.controlled(
        method,
        *asked(
            f"{{measure: height, hand: left, at_least: 85%, to: {middle}}}",
            f"{{measure: height, hand: left, at_most: 15%, from: {middle}}}",
        ),
    )
    spread = rows[0]["reference_deviation"]
    assert [(row["from"], row["to"]) for row in rows] == [(0, pytest.approx(middle)), (pytest.approx(middle), 30)]
    assert rows[0]["mean"] > rows[0]["at_least"] and rows[1]["mean"] < rows[1]["at_most"] + 0.1 * spread
    assert all(row["inside"] > 0.7 for row in rows)


@pytest.mark.slow
def test_a_soft_demand_draws_by_its_price(demo):
    means = [
        demo.controlled(
            "motion_matching",
            *asked(f"{{measure: height, hand: left, at_least: 85%, hard: false, price: {price}}}"),
        )[0]["mean"]
        for price in (0.001, 100)
    ]
    assert means[1] > means[0] + 5


# --- where it is told ---------------------------------------------------------------------------------------


def test_the_table_the_files_the_trace_and_the_report(demo):
    options = asked(condition("high"), "{measure: speed, at_least: 10%, at_most: 60%, from: 5, to: 20, hard: false}")
    rows = demo.controlled("motion_matching", *options)
    work = demo.base / "motion_matching"
    with open(work / "evaluate/control.csv") as file:
        stored = list(csv.DictReader(file))
    assert [row["clip"] for row in stored] == [TEST, TEST]
    for one, other in zip(stored, rows, strict=True):
        assert one["at_most"] == ("" if other["at_most"] is None else str(other["at_most"]))
        assert {key: float(one[key]) for key in ("mean", "deviation", "inside", "reference_mean")} == {
            key: other[key] for key in ("mean", "deviation", "inside", "reference_mean")
        }
        assert one["config_hash"]
    printed = demo.command("evaluate", "motion_matching", *options).output
    block = printed[printed.index("[control]") :].splitlines()
    assert re.split(r"  +", block[1]) == [
        "clip", "measure", "hand", "when", "asked", "mean", "deviation", "inside", "reference"
    ]  # fmt: skip
    assert re.search(
        r"height +left +0\.00-30\.00 s +at least [\d.]+ cm +[\d.]+ +[\d.]+ +\d+% +[\d.]+ ± [\d.]+", block[2]
    )
    assert re.search(r"speed +both +5\.00-20\.00 s +at least .* cm/s and at most .* cm/s \(soft\)", block[3])
    kept = demo.command("run", "motion_matching", *options)
    assert kept.exit_code == 0 and "\n".join(block[:4]) in kept.output
    inspected = succeed("inspect", TEST, "--work", work).output.splitlines()
    assert any(
        re.fullmatch(r"condition 1: height \(left\) at least [\d.]+ cm from 0.00 to 30.00 s, hard", line)
        for line in inspected
    )
    assert any(
        line.startswith("condition 2: speed (both) at least") and "soft, price 1 for" in line for line in inspected
    )
    assert len(json.loads(succeed("inspect", TEST, "--work", work, "--json").output)["header"]["control"]) == 2
    assert demo.command("report", "motion_matching", *options).exit_code == 0
    page = (work / "report.html").read_text()
    packed = json.loads(re.search(r'id="clip-0">(.*?)</script>', page)[1])
    first, second = packed["motions"][0]["trace"]["control"]
    assert (first["unit"], second["unit"], len(first["values"])) == ("cm", "cm/s", 900)
    # The report measures what `evaluate` measured.
    assert first["cells"] == re.split(r"  +", block[2])[1:]
    assert np.mean(first["values"]) == pytest.approx(rows[0]["mean"], abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("width", [390, 1280])
def test_the_report_draws_it(width, demo, browser, tmp_path):  # noqa: F811
    options = asked(condition("low"), condition("slow"))
    demo.controlled("motion_matching", *options)
    pages = [tmp_path / "with.html", tmp_path / "without.html"]
    assert demo.command("report", "motion_matching", *options, "--out", pages[0]).exit_code == 0
    trace = demo.base / f"motion_matching/reenact/{TEST}.trace.json"
    told = trace.read_text()
    documents.write(trace, {**json.loads(told), "control": []})
    assert demo.command("report", "motion_matching", *options, "--out", pages[1]).exit_code == 0
    trace.write_text(told)
    heights = []
    for path, rows in zip(pages, (2, 0), strict=True):
        with opened(browser, path, viewport={"width": width, "height": 844}) as page:
            ready(page, TEST)
            assert page.evaluate("document.documentElement.scrollWidth") <= width
            assert page.is_visible("#control") == bool(rows) and page.locator("#control tbody tr").count() == rows
            assert page.is_visible(".achieved") == bool(rows)
            heights.append(page.locator("#timeline").bounding_box()["height"])
            if rows:
                assert page.locator("#control thead th").all_inner_texts()[:4] == ["measure", "hand", "when", "asked"]
                assert "at most" in page.inner_text("#control tbody tr >> nth=0")
            # The curve and the bound, in colours of their own, in the first row below the others.
            found = page.evaluate("""() => {
                const canvas = document.getElementById("timeline"), scale = canvas.width / canvas.clientWidth;
                const place = [48, 267, canvas.clientWidth - 48, 64].map((x) => Math.round(x * scale));
                const data = canvas.getContext("2d").getImageData(...place).data, seen = new Set();
                for (let k = 0; k < data.length; k += 4) seen.add([data[k], data[k + 1], data[k + 2]].join());
                const named = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
                const rgb = (text) => [1, 3, 5].map((k) => parseInt(text.slice(k, k + 2), 16)).join();
                return ["--accent", "--fallback", "--shade-2"].map((name) => seen.has(rgb(named(name))));
            }""")
            assert found == [bool(rows)] * 3
    assert heights[0] == heights[1] + 2 * 66


@pytest.mark.slow
def test_without_control_nothing_is_told(demo):
    demo.controlled("motion_matching", *asked(condition("high")))
    work = demo.base / "motion_matching"
    assert (work / "evaluate/control.csv").is_file()
    for stage in ("reenact", "evaluate", "report"):
        result = demo.command(stage, "motion_matching")
        assert result.exit_code == 0 and "[control]" not in result.output
    assert not (work / "evaluate/control.csv").exists() and "control" not in demo.summary("motion_matching")
    assert "condition" not in succeed("inspect", TEST, "--work", work).output
    packed = json.loads(re.search(r'id="clip-0">(.*?)</script>', (work / "report.html").read_text())[1])
    assert packed["motions"][0]["trace"]["control"] == []


def test_the_example_works_on_any_data(demo):
    example = configs_folder() / "control.yaml"
    rows = demo.controlled("motion_matching", "--set", f"control.file={example}")
    assert len(rows) >= 3 and {row["hard"] for row in rows} == {True, False}


# --- what is refused ----------------------------------------------------------------------------------------


def refused(demo: Folder, method: str, *options) -> str:
    """The one line of a refused run, which did not search."""
    result = demo.command("reenact", method, *options)
    assert result.exit_code == 1, result.output
    lines = [line for line in errors(result) if line != "error: 1 of 1 failed"]
    assert len(lines) == 1, result.output
    return lines[0]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{measure: height, at_leest: 3}", r"hands\.yaml:2: unknown key 'conditions\.0\.at_leest'; did you mean 'at_least'\?"),
        ("{measure: heigth, at_least: 3}", r"hands\.yaml:2: conditions\.0\.measure: found \"heigth\", allowed: 'height'"),
        ("{measure: height, at_least: 3, to: 9}\n- {measure: height, at_most: 9, from: 8}",
         r"hands\.yaml:3: .*conditions 1 and 2 overlap from 8 to 9 s"),
        (f"{{clip: {TEST}, measure: height, at_least: 3, from: 40}}", r"condition 1: starts at 40 s, the clip ends at 30\.00 s"),
        (f"{{clip: {TEST}, measure: height, at_least: 3, to: 40}}", r"condition 1: ends at 40 s, the clip at 30\.00 s"),
        ("{measure: height, hand: left, at_least: 500}",
         r"condition 1: no frame of the references has height \(left\) of at least 500 cm; the nearest has [\d.]+ cm"),
    ],
)  # fmt: skip
def test_bad_conditions(method, text, said, demo, tmp_path):
    path = tmp_path / "hands.yaml"
    path.write_text(f"conditions:\n- {text}\n")
    line = refused(demo, method, "--set", f"control.file={path}")
    assert re.search(said, line), line


@pytest.mark.parametrize("method", METHODS)
def test_an_unknown_joint(method, demo):
    line = refused(demo, method, *asked(condition("high")), "--set", "control.left=b_l_wirst")
    assert "control.left: 'b_l_wirst' is none of the joints" in line and "b_l_wrist" in line


def test_the_beam_search_cannot_be_controlled(demo):
    line = refused(demo, "global", "--set", "search=beam", *asked(condition("high")))
    assert "needs search: global or method: motion_matching" in line
