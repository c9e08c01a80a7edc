"""`report` on tiny runs: what is in the file, what it says when something is missing."""

import base64
import hashlib
import json
import re
import shutil
import zlib
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from gesturegen.methods import libraries
from gesturegen.report import lengths, page
from gesturegen.settings.loading import load_config
from gesturegen.stored import documents
from gesturegen.submission import read_trace
from tests import tiny
from tests.builders import chain, write_clip
from tests.commands import run, succeed
from tests.report import synthetic

NASTY = 'tst_<b onclick="x">&amp;'
TESTS = ("tst_a", NASTY)


def report(data: Path, work: Path, *options):
    return succeed("report", "--data", data, "--work", work, "-j", 1, *options)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Path:
    """Two references, and two tests with their true motion."""
    folder = tmp_path_factory.mktemp("data")
    rng = np.random.default_rng(0)
    for name in ("trn_a", "trn_b"):
        write_clip(folder / "trn", name, 3.0, (0.4, 0.9, 1.5, 2.2), motion=tiny.motion(rng, 90, chain(4)))
    for name in TESTS:
        words = ((0.5, 0.8, "hello"), (1.2, 1.5, "</script><script>alert(1)"))
        write_clip(folder / "tst", name, 2.0, (0.5, 1.1), words, motion=tiny.motion(rng, 60, chain(4)))
    return folder


def make_run(data: Path, work: Path, *options, commands=("preprocess", "build-graph", "reenact")) -> Path:
    for command in commands:
        succeed(command, "--data", data, "--work", work, "-j", 1, "--set", "references.mode=all", *options)
    return work


@pytest.fixture(scope="module")
def reenacted(recorded, tmp_path_factory) -> Path:
    """A run that has not been evaluated."""
    return make_run(recorded, tmp_path_factory.mktemp("work"))


@pytest.fixture
def work(reenacted, tmp_path) -> Path:
    """A copy of the run that a test may change."""
    return Path(shutil.copytree(reenacted, tmp_path / "work"))


class Tags(HTMLParser):
    """All tags with their attributes, and the text inside each kind of tag."""

    def __init__(self, html: str):
        super().__init__()
        self.tags, self.texts, self.open = [], {}, None
        self.feed(html)

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        self.open = tag
        self.texts.setdefault(tag, []).append("")

    def handle_data(self, data):
        if self.open:
            self.texts[self.open][-1] += data

    def handle_endtag(self, tag):
        self.open = None


def read(path: Path) -> tuple[str, Tags, dict[str, dict]]:
    """The page: its text, its tags, and its clips by name."""
    html = path.read_text()
    tags = Tags(html)
    data = re.findall(r'<script type="application/json" id="clip-(\d+)">(.*?)</script>', html)
    assert [int(place) for place, _ in data] == list(range(len(data)))
    return html, tags, {packed["name"]: packed for packed in (json.loads(text) for _, text in data)}


# --- what is in it ------------------------------------------------------------------------------------------


def test_every_clip_is_there_with_its_truth_its_sound_and_its_trace(recorded, work):
    result = report(recorded, work)
    assert f"written: {work / 'report.html'}" in result.output
    _, _, clips = read(work / "report.html")
    assert sorted(clips) == sorted(TESTS)
    for name, packed in clips.items():
        assert [motion["label"] for motion in packed["motions"]] == ["generated", "truth"]
        assert packed["frames"] == 60 and base64.b64decode(packed["audio"]["ogg"]).startswith(b"OggS")
        trace = read_trace(work / f"reenact/{name}.trace.json")
        graph = libraries.read(work / f"graphs/{trace.graph}.npz")
        told = packed["motions"][0]["trace"]
        shown = trace.shown_nodes()
        assert told["source"] == graph.source_frames[shown].tolist()
        assert [told["references"][k] for k in told["reference"]] == [
            graph.clip_names[int(node >= graph.clip_starts[1])] for node in shown
        ]
        assert len(told["pieces"]) == len(trace.pieces) and len(told["joins"]) == len(trace.joins)
        assert packed["motions"][1]["trace"] is None and packed["notes"] == []


def test_it_is_one_file_that_asks_for_nothing(recorded, work):
    report(recorded, work)
    html, tags, _ = read(work / "report.html")
    assert "http:" not in html and "https:" not in html
    for tag, attributes in tags.tags:
        assert not {"src", "href", "action", "style"} & attributes.keys(), tag
        assert not [name for name in attributes if name.startswith("on")], tag
    policy = next(a["content"] for _, a in tags.tags if a.get("http-equiv") == "Content-Security-Policy")
    assert policy.startswith("default-src 'none'; ")
    scripts = list(re.findall(r"<script>(.*?)</script>", html, re.S))
    styles = re.findall(r"<style>(.*?)</style>", html, re.S)
    for kind, texts in (("script", scripts), ("style", styles)):
        digest = base64.b64encode(hashlib.sha256(texts[0].encode()).digest()).decode()
        assert len(texts) == 1 and f"{kind}-src 'sha256-{digest}'" in policy


def test_names_and_words_are_text_and_nothing_else(recorded, work):
    report(recorded, work)
    _, tags, clips = read(work / "report.html")
    assert NASTY in tags.texts["option"] and NASTY in tags.texts["button"]
    assert sum(tag == "script" for tag, _ in tags.tags) == len(clips) + 1
    assert "b" not in {tag for tag, _ in tags.tags}


def test_the_same_run_gives_the_same_bytes_for_any_number_of_workers(recorded, work):
    report(recorded, work)
    before = (work / "report.html").read_bytes()
    succeed("report", "--data", recorded, "--work", work, "-j", 2)
    assert (work / "report.html").read_bytes() == before


def test_the_signature_is_at_the_top(recorded, work):
    report(recorded, work, "--out", work / "elsewhere" / "page.html")
    html, _, _ = read(work / "elsewhere" / "page.html")
    manifest = json.loads((work / "reenact/manifest.json").read_text())
    for value in (manifest["config_hash"], manifest["gesturegen"], "motion_graph", "beam"):
        assert f"<dd>{value}</dd>" in html
    assert not (work / "report.html").exists()


# --- figures ------------------------------------------------------------------------------------------------


def test_it_says_that_evaluate_has_not_been_run(recorded, work):
    result = report(recorded, work)
    assert "warning: evaluate: This run has not been evaluated" in result.output
    assert "This run has not been evaluated: run <code>gesturegen evaluate</code>" in (work / "report.html").read_text()


def test_the_figures_of_evaluate_are_in_the_table(recorded, work):
    make_run(recorded, work, commands=("evaluate",))
    report(recorded, work)
    html, tags, _ = read(work / "report.html")
    total = json.loads((work / "evaluate/summary.json").read_text())["total"]
    assert "has not been evaluated" not in html
    assert f"{total['syn']:.5g}" in tags.texts["td"] and "Syn cm/f ↓" in tags.texts["th"]


def test_figures_of_another_run_are_left_out(recorded, work):
    make_run(recorded, work, commands=("evaluate",))
    make_run(recorded, work, "--set", "seed=5", commands=("reenact",))
    report(recorded, work)
    html, tags, _ = read(work / "report.html")
    assert "are of another configuration or seed" in html and "Syn cm/f ↓" not in tags.texts["th"]


def test_an_ablation_is_shown_where_there_is_one(recorded, work):
    (work / "ablation").mkdir()
    picture = b"\x89PNG\r\n\x1a\n" + bytes(4) + b"IEND" + zlib.crc32(b"IEND").to_bytes(4)
    (work / "ablation/ablation.png").write_bytes(picture)
    setup = {
        "mean": {"syn": 0.5, "failure": 1, "div": None},
        "spread": {"syn": 0.25},
        "paper": {"syn": 0.6, "bc": 0.02},
    }
    documents.write(work / "ablation/ablation.json", {"setups": {"weak_<pruning>": setup}})
    report(recorded, work)
    html, tags, _ = read(work / "report.html")
    assert "data:image/png;base64," + base64.b64encode(picture).decode() in html
    assert "weak_<pruning>" in tags.texts["th"] and {"0.5 ± 0.25", "0.6", "0.02"} <= set(tags.texts["td"])


@pytest.mark.parametrize("results", [[], {}, {"setups": {"a": 1}}, {"rows": [1]}])
def test_an_ablation_of_another_shape_does_no_harm(results):
    html = page._ablation(page.Ablation(None, results))
    assert "holds no table" in html or "<tbody></tbody>" in html


def points(search: str, *rows) -> list[dict]:
    """Points of a line from rows (minutes, join distance per minute, share of the reference)."""
    return [
        {
            "setup": f"{minutes:g}min_{search}", "asked_seconds": 60.0 * minutes, "reference_seconds": 60.0 * minutes,
            "join_distance_per_minute": distance, "reference_share": share, "used_seconds": share and 60.0 * minutes * share,
        }
        for minutes, distance, share in rows
    ]  # fmt: skip


def places(html: str, shape: str) -> list[list[tuple[float, float]]]:
    """Where the markers of each plot are."""
    x, y = {"circle": ("cx", "cy"), "rect": ("x", "y")}[shape]
    plots = re.findall(r'<svg class="plot".*?</svg>', html)
    return [
        [(float(a), float(b)) for a, b in re.findall(rf'<{shape} class="mark-\d" {x}="([\d.]+)" {y}="([\d.]+)"', plot)]
        for plot in plots
    ]


def test_reference_lengths_are_plotted(recorded, work):
    (work / "ablation").mkdir()
    documents.write(work / "ablation/ablation.json", {"setups": {}})
    lines = {
        "beam": points("beam", (0.5, 900.0, 0.5), (5, 300.0, 0.2)),
        "glo<bal>": points("global", (0.5, 700.0, 0.6), (5, None, None)),
    }
    documents.write(work / "ablation/reference_length.json", {"lines": lines})
    report(recorded, work)
    html, tags, _ = read(work / "report.html")
    section = html[html.index('id="reference-length"') :]
    assert section.count('<svg class="plot"') == 3 and "glo&lt;bal&gt;" in section and "glo<bal>" not in section
    for axis in ("cm per minute of output", "reference length, minutes (log)", "%", "seconds"):
        assert axis in section
    beam, other = places(section, "circle"), places(section, "rect")
    assert [len(marks) for marks in beam] == [2, 2, 2] and [len(marks) for marks in other] == [1, 1, 1]
    (x_short, y_far), (x_long, y_near) = beam[0]
    assert x_short < x_long and y_far < y_near, "a smaller distance lies lower, at a greater length"
    assert beam[2][0][1] > beam[2][1][1], "more seconds lie higher"
    assert not [attributes for tag, attributes in tags.tags if "style" in attributes]
    assert {"0.5min_beam", "5min_global"} <= set(tags.texts["th"]) and "900" in tags.texts["td"]
    assert "beam 900 cm at 0.5 min to 300 cm at 5 min" in section


@pytest.mark.parametrize(
    "results", [[], {}, {"lines": 1}, {"lines": {"a": 3}}, {"lines": {"a": [{}, 5, {"reference_seconds": "x"}]}}]
)
def test_reference_lengths_of_another_shape_do_no_harm(results):
    assert "holds no lines" in page._ablation(page.Ablation(None, None, results))


def test_reference_lengths_without_a_figure_have_no_plot():
    html = page._ablation(page.Ablation(None, None, {"lines": {"beam": points("beam", (1, None, None))}}))
    assert '<svg class="plot"' not in html and html.count("No figure.") == 3


@pytest.mark.parametrize(
    ("largest", "top", "step"),
    [(0.0, 1.0, 0.5), (1.0, 1.0, 0.5), (93.0, 100.0, 50.0), (812.0, 1000.0, 500.0), (41, 60, 20)],
)
def test_the_scale_of_a_plot(largest, top, step):
    assert lengths._scale(largest) == pytest.approx((top, step))


# --- side by side -------------------------------------------------------------------------------------------


def test_other_runs_are_shown_beside(recorded, work, tmp_path):
    other = make_run(recorded, tmp_path / "other", "--set", "seed=9")
    (other / f"reenact/{NASTY}.bvh").unlink()
    manifest = json.loads((other / "reenact/manifest.json").read_text())
    next(row for row in manifest["clips"] if row["clip"] == NASTY)["error"] = "it broke"
    documents.write(other / "reenact/manifest.json", manifest)
    result = report(recorded, work, "--compare", f"seed 9={other}")
    _, _, clips = read(work / "report.html")
    assert [motion["label"] for motion in clips["tst_a"]["motions"]] == ["generated", "truth", "seed 9"]
    assert clips["tst_a"]["motions"][2]["trace"]["pieces"]
    assert len(clips[NASTY]["motions"]) == 2 and clips[NASTY]["notes"] == ["seed 9 has no motion of this clip"]
    assert f"warning: {NASTY}: seed 9 has no motion of this clip" in result.output


def test_a_compared_folder_without_a_run_is_refused(recorded, work, tmp_path):
    result = run("report", "--data", recorded, "--work", work, "--compare", f"weak={tmp_path / 'nowhere'}")
    assert result.exit_code == 1 and "run `gesturegen reenact` first" in result.output and "nowhere" in result.output
    assert not (work / "report.html").exists()


def test_labels_are_given_once(recorded, work):
    result = run("report", "--data", recorded, "--work", work, "--compare", f"truth={work}")
    assert result.exit_code == 1 and "the label 'truth' is taken" in result.output
    for wrong in ("weak", "=x", "weak="):
        result = run("report", "--work", work, "--compare", wrong)
        assert result.exit_code == 2 and "is not LABEL=WORK" in result.output


# --- what is missing ----------------------------------------------------------------------------------------


def test_nothing_to_report_on(recorded, work, tmp_path):
    result = run("report", "--data", recorded, "--work", tmp_path / "new")
    assert result.exit_code == 1 and "run `gesturegen preprocess` first" in result.output
    shutil.rmtree(work / "reenact")
    result = run("report", "--data", recorded, "--work", work)
    assert result.exit_code == 1 and "run `gesturegen reenact` first" in result.output


def test_failed_clips_are_listed_with_their_error(recorded, tmp_path):
    data = Path(shutil.copytree(recorded, tmp_path / "data"))
    wav = data / "tst/main-agent/wav/tst_a.wav"
    wav.write_bytes(wav.read_bytes()[:2000])
    for command in ("preprocess", "build-graph", "reenact"):
        run(command, "--data", data, "--work", tmp_path / "work", "-j", 1, "--set", "references.mode=all")
    result = report(data, tmp_path / "work")
    assert "1 clips to watch, 1 failed ones listed" in result.output
    html, tags, clips = read(tmp_path / "work/report.html")
    assert "tst_a" in tags.texts["th"] and "failed" in tags.texts["td"] and "all 2" in tags.texts["th"]
    assert list(clips) == [NASTY] and "<b>tst_a</b>: failed in preprocess: " in html and "cut off" in html


def test_a_run_in_which_every_clip_failed(recorded, work):
    manifest = json.loads((work / "reenact/manifest.json").read_text())
    for row in manifest["clips"]:
        row["error"] = "it broke & <burnt>"
    documents.write(work / "reenact/manifest.json", manifest)
    report(recorded, work)
    html, _, clips = read(work / "report.html")
    assert clips == {} and "No clip of this run can be shown." in html and "it broke &amp; &lt;burnt&gt;" in html


@pytest.mark.parametrize("suffix", [".bvh", ".trace.json"])
def test_a_lost_file_fails_its_clip_only(suffix, recorded, work):
    (work / f"reenact/tst_a{suffix}").unlink()
    result = run("report", "--data", recorded, "--work", work, "-j", 1)
    assert result.exit_code == 1 and "Traceback" not in result.output
    assert f"tst_a{suffix}: missing; run `gesturegen reenact` again" in result.output
    html, _, clips = read(work / "report.html")
    assert list(clips) == [NASTY] and "<b>tst_a</b>" in html


def test_lost_sound_and_truth_leave_a_note(recorded, tmp_path):
    data = Path(shutil.copytree(recorded, tmp_path / "data"))
    work = make_run(data, tmp_path / "work")
    (data / "tst/main-agent/wav/tst_a.wav").unlink()
    (data / "tst/main-agent/bvh/tst_a.bvh").unlink()
    result = report(data, work)
    _, _, clips = read(work / "report.html")
    packed = clips["tst_a"]
    assert packed["audio"] is None and [motion["label"] for motion in packed["motions"]] == ["generated"]
    assert [note.split(":")[0] for note in packed["notes"]] == ["no true motion", "no sound"]
    assert result.output.count("warning: tst_a: no ") == 2


def test_a_clip_that_the_index_no_longer_has(recorded, work):
    index = json.loads((work / "clips/index.json").read_text())
    del index["tests"]["tst_a"]
    documents.write(work / "clips/index.json", index)
    result = run("report", "--data", recorded, "--work", work, "-j", 1)
    assert result.exit_code == 1 and "error: tst_a: clip tst_a: " in result.output


def test_the_template_has_every_place_filled(tmp_path):
    written = synthetic.write_page(tmp_path / "page.html", {"a {{clips}} {{script}}": synthetic.clip_text("a")})
    html = written.read_text()
    assert html.count("{{clips}} {{script}}") == 2 and html.count("{{") == 4  # in the list and in the table
    assert load_config().signature() in html
