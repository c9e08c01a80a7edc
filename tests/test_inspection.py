"""`inspect`: the figures of graphs with known components and pieces and of gesture databases, the lines of traces."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from gesturegen import submission
from gesturegen.cli import main
from gesturegen.data.keynodes import of_speech
from gesturegen.errors import DataError
from gesturegen.inspection import traces
from gesturegen.methods import METHODS, libraries
from gesturegen.methods.gesture_master import database as database_module
from gesturegen.methods.gesture_master import description as databases
from gesturegen.methods.gesture_master.extraction import extract
from gesturegen.methods.motion_graph import description as graphs
from gesturegen.methods.motion_graph import graph as motion_graph
from gesturegen.pipeline import inspect
from gesturegen.settings.loading import load_config
from gesturegen.stored import arrays
from gesturegen.trace import Failure
from tests import tiny
from tests.methods.gesture_master import gesture_builders as builders

# Two segments, 0-5 and 6-9. The edge 4 -> 1 closes a cycle of four; 6-9 hang on by 2 -> 7 only.
ROWS = [(2, "onset"), (5, "keyword", "greeting"), (8, "keyword", "greeting"), (9, "onset")]


@pytest.fixture
def graph():
    return tiny.graph_of_edges(10, {(4, 1): 0.5, (2, 7): 0.7}, rows=ROWS, segment_starts=(0, 6))


@pytest.fixture
def work(tmp_path, graph) -> Path:
    """A work folder with that graph and the trace of a speech found in it."""
    libraries.save(tmp_path / "graphs/clip.npz", METHODS["motion_graph"], graph, load_config())
    path = tiny.path_of(([0, 1, 2], 4), [3, 4, 1, 2], [8, 9])
    speech = tiny.speech(10, [4, 8], name="talk")
    trace = submission.make_trace(path, graph, "clip", speech, of_speech(speech, {}), load_config())
    (tmp_path / "reenact").mkdir()
    submission.write_clip(tmp_path / "reenact", "talk", None, trace)
    return tmp_path


def run(*arguments):
    return CliRunner().invoke(main, ["inspect", *map(str, arguments)])


def test_figures_of_a_small_graph(graph):
    facts = graphs.describe_graph(graph)
    assert facts["frames"] == 10 and facts["segments"] == 2 and facts["clips"][0]["frames"] == 10
    assert facts["key_nodes"] == {"onset": 2, "keyword": 2, "break": 0} and facts["keywords"] == {"greeting": 2}
    edges = facts["edges"]
    assert (edges["total"], edges["natural"], edges["unnatural"]) == (10, 8, 2)
    assert edges["per_frame_mean"] == 1.0 and edges["frames_without_edges"] == 2
    assert edges["frames_without_unnatural"] == 8
    # {1, 2, 3, 4} is a cycle, each other frame is alone.
    assert facts["components"]["strong"] == {"count": 7, "largest_frames": 4, "largest_share": 0.4}
    assert facts["components"]["weak"] == {"count": 1, "largest_frames": 10, "largest_share": 1.0}
    # 0 -> 2 -> 5 and 6 -> 8 -> 9.
    assert facts["pieces"]["count"] == 4 and facts["pieces"]["quantiles"] == [1.0, 1.75, 2.0, 2.25, 3.0]
    assert facts["pieces"]["longest_frames"] == 3 and facts["pieces"]["longest_seconds"] == pytest.approx(0.1)
    assert facts["pieces"]["longest_start_node"] == 2


def test_without_the_edge_between_segments_there_are_two_weak_components():
    graph = tiny.graph_of_edges(10, {(4, 1): 0.5}, rows=ROWS, segment_starts=(0, 6))
    assert graphs.describe_components(graph, "weak") == {"count": 2, "largest_frames": 6, "largest_share": 0.6}


def test_a_graph_of_one_frame():
    facts = graphs.describe_graph(tiny.graph_of_edges(1, {}))
    assert facts["pieces"]["count"] == 0 and facts["edges"]["total"] == 0
    assert "pieces between key nodes: 0, frames -" in graphs.graph_lines(facts)


def test_a_graph_on_the_command_line(work):
    output = run(work / "graphs/clip.npz").stdout
    for line in (
        "frames: 10 (0.3 s at 30 fps), 1 joints, 2 segments",
        "key nodes: 4: 2 onset, 2 keyword, 0 break",
        "keywords: greeting 2",
        "edges: 10: 8 natural, 2 unnatural",
        "strongly connected components: 7, the largest of 4 frames (40%)",
        "longest piece: 3 frames (0.10 s), from node 2, clip frame 2",
    ):
        assert line in output.splitlines(), output
    assert run("clip", "--work", work).stdout == output


def test_every_piece_of_a_trace_is_one_line(work):
    lines = run("talk", "--work", work).stdout.splitlines()
    heading = next(n for n, line in enumerate(lines) if line.lstrip().startswith("time"))
    assert len(lines) - heading - 1 == 3
    first, second, third = (line.split() for line in lines[heading + 1 :])
    assert first[:6] == ["0.00", "s", "0-4", "3", "->", "4"] and "clip:0-2" in first and "start" in first
    assert "natural" in second and second[-3:] == ["1", "jump", "inside"] and "3-2" in second
    assert third[0] == "0.27" and "8-9" in third and "natural" not in third
    assert lines[0] == "clip: talk, 10 frames (0.3 s at 30 fps)"


def test_a_trace_without_its_graph_still_says_where_its_frames_are_from(work):
    (work / "graphs/clip.npz").unlink()
    result = run(work / "reenact/talk.trace.json", "--work", work)
    assert result.exit_code == 0 and "clip:0-2" in result.output and "its graph clip is not there" in result.output


def test_a_search_that_got_stuck_is_told(work):
    trace = submission.read_trace(work / "reenact/talk.trace.json")
    failure = Failure(start_frame=8, end_frame=10, end_kind="keyword", keyword="greeting")
    trace = trace.model_copy(update={"failure": failure})
    lines = traces.trace_lines(traces.describe_trace(trace))
    assert "stuck: no path for frames 8 to 10, which end at keyword greeting" in lines


@pytest.mark.parametrize("target", ["clip", "talk"])
def test_json_and_plot(target, work):
    plot = work / f"{target}.png"
    result = run(target, "--work", work, "--json", "--plot", plot)
    assert result.exit_code == 0, result.output
    facts = json.loads(result.output)
    assert facts["frames"] == 10 if target == "clip" else len(facts["pieces"]) == 3
    assert plot.read_bytes().startswith(b"\x89PNG")


def test_a_plot_of_many_edges_is_a_density(tmp_path, monkeypatch):
    from gesturegen.methods.motion_graph import description

    monkeypatch.setattr(description, "_MOST_DOTS", 3)
    with open(tmp_path / "many.png", "wb") as file:
        description.plot_graph(tiny.random_graph(np.random.default_rng(0), 30), "many", file)
    assert (tmp_path / "many.png").stat().st_size > 5000


def test_what_is_refused(work, tmp_path):
    arrays.write(tmp_path / "clip.npz", {"expmaps": np.zeros(3)})
    np.savez(tmp_path / "mine.npz", indptr=np.zeros(3))
    (tmp_path / "other.json").write_text("{}")
    (tmp_path / "notes.txt").write_text("")
    for target, words in (
        (tmp_path / "clip.npz", "not a graph"),
        (tmp_path / "mine.npz", "no checksum"),
        (tmp_path / "other.json", "no checksum"),
        (tmp_path / "notes.txt", "neither a graph"),
        ("tolk", "nearest is talk"),
    ):
        result = run(target, "--work", work)
        assert result.exit_code == 1 and words in result.output and len(result.output.splitlines()) == 1


def test_a_plot_without_matplotlib_says_what_to_install(work, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(DataError, match=r"pip install 'gesturegen\[video\]'"):
        inspect(load_config(None, [f"paths.work={work}"]), "clip", work / "a.png")


# --- gesture databases --------------------------------------------------------------------------------------

MASTER = METHODS["gesture_master"]
GESTURES = builders.config()


def strict_json(text: str):
    """JSON as others read it, without NaN."""

    def refuse(constant):
        raise AssertionError(f"{constant} is no JSON")

    return json.loads(text, parse_constant=refuse)


def png_size(path: Path) -> tuple[int, int]:
    head = path.read_bytes()[:24]
    assert head.startswith(b"\x89PNG")
    return int.from_bytes(head[16:20], "big"), int.from_bytes(head[20:24], "big")


@pytest.fixture(scope="module")
def references():
    """One recording with a gap and a torn frame, one whose fingers do not move."""
    rng = np.random.default_rng(1)
    first = builders.reference(rng, 400, "first", excluded=[(150, 170)], voice=1)
    return [builders.glitch(first, 300), builders.reference(rng, 300, "second", fingers=False, voice=2)]


@pytest.fixture(scope="module")
def database(references):
    return database_module.build(references, GESTURES)


@pytest.fixture
def stored(tmp_path, database) -> Path:
    """A work folder with that database and the trace of a speech found in it."""
    libraries.save(tmp_path / "graphs/both.npz", METHODS["gesture_master"], database, GESTURES)
    speech = builders.speech(240, builders.words(np.random.default_rng(3), 240), name="talk")
    path = MASTER.search(database, speech, GESTURES, np.random.default_rng(0))
    trace = submission.make_trace(path, database, "both", speech, of_speech(speech, {}), GESTURES)
    (tmp_path / "reenact").mkdir()
    submission.write_clip(tmp_path / "reenact", "talk", None, trace)
    return tmp_path


def test_figures_of_a_database(database):
    facts = databases.describe_database(database)
    half = len(database.starts) // 2
    assert [one["clip"] for one in facts["recordings"]] == ["first", "second"] and facts["mirrored"]
    assert [one["frames"] for one in facts["recordings"]] == [380, 300] and facts["frames"] == 680
    assert facts["seconds"] == pytest.approx(680 / 30)
    clips = facts["gesture_clips"]
    assert clips["total"] == 2 * half == clips["gestures"] + clips["rests"] and clips["mirrored"] == half
    assert [clip["name"] for clip in facts["clips"]] == database.names[:half].tolist()
    assert sum(one["gesture_clips"] for one in facts["recordings"]) == half
    rests = np.array([clip["frames"] for clip in facts["clips"] if clip["kind"] == "rest"]) / 30
    assert facts["lengths"]["rests"]["mean"] == pytest.approx(rests.mean())
    assert facts["lengths"]["rests"]["max"] == pytest.approx(rests.max())
    ones = [clip["bits"].count("1") for clip in facts["clips"]]
    assert facts["rhythm"]["mean_set"] == pytest.approx(np.mean(ones)) and facts["rhythm"]["bits"] == 32
    shown = database.styles[~database.rests]
    for k, name in enumerate(("speed", "radius", "height")):
        assert facts["style"][name]["mean"] == pytest.approx(shown[:, k].mean())
        assert facts["style"][name]["std"] == pytest.approx(shown[:, k].std())
    assert facts["regression"] is None


@pytest.mark.parametrize("body", ["upper", "lower"])
def test_edges_of_a_database_are_counted_both_ways(database, body):
    facts = databases.describe_database(database)["edges"][body]
    indptr, sources = (getattr(database, f"{body}_{key}") for key in ("indptr", "sources"))
    n_clips = len(database.starts)
    pairs = {(int(p), q) for q in range(n_clips) for p in sources[indptr[q] : indptr[q + 1]]}
    out = [sum(p == clip for p, _ in pairs) for clip in range(n_clips)]
    assert facts["total"] == len(pairs) and facts["share_of_pairs"] == pytest.approx(len(pairs) / n_clips**2)
    assert facts["clips_without_out"] == out.count(0)
    assert facts["clips_without_in"] == n_clips - len({q for _, q in pairs})
    assert facts["per_clip"]["mean"] == pytest.approx(np.mean(out)) and facts["per_clip"]["max"] == max(out)
    assert facts["delta_t"] == database.deltas[["upper", "lower"].index(body)]


def test_seconds_of_a_gesture_clip_are_those_of_its_recording(database):
    clips = databases.describe_database(database)["clips"]
    assert all(float(clip["name"].split("@")[1]) == pytest.approx(clip["start_seconds"], abs=0.006) for clip in clips)
    assert all(clip["stop_seconds"] - clip["start_seconds"] == pytest.approx(clip["frames"] / 30) for clip in clips)
    # After the 20 frames that were left out.
    after = next(clip for clip in clips if clip["start_seconds"] > 5.5)
    assert after["start_node"] == round(after["start_seconds"] * 30) - 20


def test_a_database_on_the_command_line(stored, database):
    result = run(stored / "graphs/both.npz")
    lines = result.output.splitlines()
    assert result.exit_code == 0 and run("both", "--work", stored).stdout == result.stdout
    half = len(database.starts) // 2
    clips = [line for line in lines if line.startswith(("first@", "second@"))]
    assert [line.split()[0] for line in clips] == database.names[:half].tolist()
    for line in (
        "gesture database: 2 recordings, each also mirrored; 680 frames (22.7 s at 30 fps)",
        "style from prosody: not asked for",
        "  gap between words over, s  0.1  0.2  0.3  0.4  0.5  0.6  0.8    1",
        f"clips with the fingers of another: {(database.finger_sources != np.arange(2 * half)).sum()}",
    ):
        assert line in lines, result.output
    assert any("the paper chose 0.4 s" in line for line in lines)
    first = next(k for k in range(half) if database.names[k].startswith("second@"))
    lent = next(line for line in clips if line.startswith(f"{database.names[first]} "))
    source = database.finger_sources[first]
    assert lent.endswith(f"fingers of {database.names[source]}{' mirrored' if source >= half else ''}")
    assert len({len(line.split(" fingers of")[0].rstrip()) for line in clips}) == 1


def test_dropped_clips_are_named_with_the_reason(stored, database):
    facts = strict_json(run("both", "--work", stored, "--json").output)
    assert [[one["clip"], one["reason"]] for one in facts["dropped"]] == database.dropped.tolist()
    torn = next(one for one in facts["dropped"] if "above" in one["reason"])
    kind = torn["reason"].split()[0]
    assert torn["clip"].startswith("first@") and kind in ("turns", "moves") and facts["dropped_kinds"][kind] == 1
    lines = run("both", "--work", stored).output.splitlines()
    assert f"dropped: {torn['clip']}, {torn['reason']}" in lines
    assert any(line.startswith(f"clips dropped: {len(facts['dropped'])}: ") and f"1 {kind}" in line for line in lines)


def test_json_of_a_database_is_complete_and_has_no_nan(stored, database):
    facts = strict_json(run("both", "--work", stored, "--json").output)
    assert len(facts["clips"]) == len(database.starts) // 2 and len(facts["thresholds"]) == 8
    # A pause of over 0.6 s is a rest, so a gap of more than that cuts nothing else.
    assert facts["thresholds"][-1] == facts["thresholds"][-2] | {"gap_seconds": 1.0}
    assert facts["thresholds"][0]["clips"] == database.thresholds[0, 0]


def test_of_many_clips_the_first_are_listed():
    rng = np.random.default_rng(4)
    many = [builders.reference(rng, 2400, name) for name in ("used", "unused")]
    config = builders.config({"quality": {"exclude": ("unused@*",)}})
    database = database_module.build(many, config)
    facts = databases.describe_database(database)
    kept, dropped = len(facts["clips"]), len(facts["dropped"])
    assert kept > 40 and dropped > 20 and facts["dropped_kinds"]["excluded"] > 20
    lines = databases.database_lines(facts)
    assert sum(line.startswith("used@") for line in lines) == 40
    assert lines[-1] == f"and {kept - 40} more gesture clips (--json lists all)"
    assert sum(line.startswith("dropped: ") for line in lines) == 20
    assert f"and {dropped - 20} more dropped (--json lists all)" in lines


def test_a_database_with_a_regression_and_without_mirrored_copies(references):
    config = builders.config({"style": {"source": "predict"}, "mirror": False})
    facts = databases.describe_database(database_module.build(references, config))
    lines = databases.database_lines(facts)
    gestures = sum(clip["kind"] == "gesture" for clip in facts["clips"])
    assert facts["regression"]["clips"] == gestures and set(facts["regression"]["r2"]) == {"speed", "radius", "height"}
    assert facts["regression"]["summary"] in lines and "cross-validated R2" in facts["regression"]["summary"]
    assert not facts["mirrored"] and facts["gesture_clips"]["mirrored"] == 0 and "none mirrored" in lines[0]


def test_a_database_of_one_rest():
    still = builders.reference(np.random.default_rng(5), 40, "quiet", spoken=[], moved=None)
    config = builders.config({"mirror": False, "upper": {"delta_t": 8}, "lower": {"delta_t": 8}})
    facts = databases.describe_database(database_module.build([still], config))
    assert facts["lengths"]["gestures"] is None and facts["rhythm"]["mean_set_gestures"] is None
    assert {row["mean_seconds"] for row in facts["thresholds"]} == {None}
    strict_json(json.dumps(facts))
    lines = databases.database_lines(facts)
    assert (
        "lengths of gestures, s: -" in lines
        and "gesture clips: 1: 0 gestures, 1 rest; 0 of them mirrored copies" in lines
    )


def test_every_piece_of_both_bodies_is_one_line(stored, database):
    lines = run("talk", "--work", stored).stdout.splitlines()
    trace = json.loads((stored / "reenact/talk.trace.json").read_text())
    heading = next(n for n, line in enumerate(lines) if line.lstrip().startswith("time"))
    rows = [line.split() for line in lines[heading + 1 :]]
    upper = [row for row in rows if "upper" in row]
    lower = [row for row in rows if row[0] == "lower"]
    assert len(upper) == len(lower) == len(trace["pieces"]) and rows[0] in upper and rows[1] in lower
    for shown, pieces in ((upper, trace["pieces"]), (lower, trace["tracks"][0]["pieces"])):
        for row, piece in zip(shown, pieces, strict=True):
            clip = int(np.flatnonzero(database.starts == piece["nodes"][0])[0])
            assert str(database.names[clip]) in row
            assert ("mirrored" in row) == (clip >= len(database.starts) // 2)
            assert f"{database.source_frames[piece['nodes'][0]]}-{database.source_frames[piece['nodes'][-1]]}" in row
    # Fingers only where they are of another clip.
    lent = [row for row in rows if row[0] == "fingers"]
    sources = [piece["nodes"][0] for piece in trace["tracks"][1]["pieces"]] if len(trace["tracks"]) > 1 else []
    assert len(lent) == sum(a != b["nodes"][0] for a, b in zip(sources, trace["pieces"], strict=False))
    assert len(rows) == len(upper) + len(lower) + len(lent)
    assert "graph: both, of first, second; all of them mirrored as well" in lines
    assert any(line.startswith("upper body: ") and "rhythm" in line for line in lines)


def test_json_of_a_trace_of_two_bodies(stored):
    facts = strict_json(run("talk", "--work", stored, "--json").output)
    trace = json.loads((stored / "reenact/talk.trace.json").read_text())
    assert [track["joints"] for track in facts["tracks"]] == [track["joints"] for track in trace["tracks"]]
    for found, given in zip([facts, *facts["tracks"]], [trace, *trace["tracks"]], strict=True):
        assert [piece["costs"] for piece in found["pieces"]] == [piece["costs"] for piece in given["pieces"]]
        assert all(piece["gesture"] for piece in found["pieces"])
    assert facts["header"]["references"] == ["first", "second"] and facts["header"]["mirrored"]
    assert facts["header"]["objective"] == trace["objective"]


def test_a_trace_without_its_database_or_with_another_one(stored, references):
    trace = stored / "reenact/talk.trace.json"
    for settings in ({"mirror": False}, {"cutting": {"min_seconds": 0.7}}):
        libraries.save(
            stored / "graphs/both.npz",
            METHODS["gesture_master"],
            database_module.build(references, builders.config(settings)),
            GESTURES,
        )
        result = run(trace, "--work", stored)
        assert result.exit_code == 0 and "its graph both is another one now" in result.output
        assert "first@" not in result.output and "lower" in result.output
    (stored / "graphs/both.npz").unlink()
    result = run(trace, "--work", stored)
    assert result.exit_code == 0 and "its graph both is not there" in result.output and "lower" in result.output


@pytest.mark.parametrize("target", ["both", "talk"])
def test_pictures_of_a_database_and_of_its_trace(target, stored):
    plot = stored / f"{target}.png"
    result = run(target, "--work", stored, "--plot", plot)
    assert result.exit_code == 0, result.output
    width, height = png_size(plot)
    assert width >= 1000 and height >= 500 and plot.stat().st_size > 20_000


def test_a_database_is_found_by_the_name_of_its_recording(stored):
    (stored / "graphs/both.npz").rename(stored / "graphs/both-gestures.npz")
    result = run("both", "--work", stored)
    assert result.exit_code == 1 and "nearest is both-gestures" in result.output
    found = run("both", "--work", stored, "--set", "method=gesture_master", "--set", "prosody.enabled=true")
    assert found.exit_code == 0 and found.stdout == run("both-gestures", "--work", stored).stdout


def test_a_library_is_read_as_what_it_is(stored, graph, references):
    libraries.save(stored / "graphs/clip.npz", METHODS["motion_graph"], graph, load_config())
    assert isinstance(libraries.read(stored / "graphs/clip.npz"), motion_graph.MotionGraph)
    assert isinstance(libraries.read(stored / "graphs/both.npz"), database_module.GestureDatabase)
    part = stored / "part.npz"
    arrays.write(part, extract(references[0], GESTURES).arrays())
    for path, words in ((part, "not a gesture database"), (stored / "none.npz", "has not been built")):
        with pytest.raises(DataError, match=words):
            libraries.read(path)
    (stored / "damaged.npz").write_bytes(b"PK")
    with pytest.raises(DataError, match="damaged"):
        libraries.read(stored / "damaged.npz")
    result = run(part)
    assert result.exit_code == 1 and len(result.output.splitlines()) == 1
