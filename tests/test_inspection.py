"""`inspect`: the figures of a graph with known components and pieces, and the lines of a trace."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from gesturegen import submission
from gesturegen.cli import main
from gesturegen.config import load_config
from gesturegen.errors import DataError
from gesturegen.graph import motion_graph
from gesturegen.inspection import graphs, traces
from gesturegen.keynodes import of_speech
from gesturegen.pipeline import inspect
from tests import tiny

# Two segments, 0-5 and 6-9. The edge 4 -> 1 closes a cycle of four; 6-9 hang on by 2 -> 7 only.
ROWS = [(2, "onset"), (5, "keyword", "greeting"), (8, "keyword", "greeting"), (9, "onset")]


@pytest.fixture
def graph():
    return tiny.graph_of_edges(10, {(4, 1): 0.5, (2, 7): 0.7}, rows=ROWS, segment_starts=(0, 6))


@pytest.fixture
def work(tmp_path, graph) -> Path:
    """A work folder with that graph and the trace of a speech found in it."""
    motion_graph.save(tmp_path / "graphs/clip.npz", graph, load_config())
    path = tiny.path_of(([0, 1, 2], 4), [3, 4, 1, 2], [8, 9])
    speech = tiny.speech(10, [4, 8], name="talk")
    trace = submission.make_trace(path, graph, "clip", speech, of_speech(speech, {}), load_config())
    (tmp_path / "reenact").mkdir()
    (tmp_path / "reenact/talk.trace.json").write_text(submission.format_trace(trace))
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
    output = run(work / "graphs/clip.npz").output
    for line in (
        "frames: 10 (0.3 s at 30 fps), 1 joints, 2 segments",
        "key nodes: 4: 2 onset, 2 keyword, 0 break",
        "keywords: greeting 2",
        "edges: 10: 8 natural, 2 unnatural",
        "strongly connected components: 7, the largest of 4 frames (40%)",
        "longest piece: 3 frames (0.10 s), from node 2, clip frame 2",
    ):
        assert line in output.splitlines(), output
    assert run("clip", "--work", work).output == output


def test_every_piece_of_a_trace_is_one_line(work):
    lines = run("talk", "--work", work).output.splitlines()
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
    trace = json.loads((work / "reenact/talk.trace.json").read_text())
    trace["failure"] = {"start_frame": 8, "end_frame": 10, "end_kind": "keyword", "keyword": "greeting"}
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
    from gesturegen.inspection import plots

    monkeypatch.setattr(plots, "_MOST_DOTS", 3)
    with open(tmp_path / "many.png", "wb") as file:
        plots.plot_graph(tiny.random_graph(np.random.default_rng(0), 30), "many", file)
    assert (tmp_path / "many.png").stat().st_size > 5000


def test_what_is_refused(work, tmp_path):
    np.savez(tmp_path / "clip.npz", expmaps=np.zeros(3))
    (tmp_path / "other.json").write_text("{}")
    (tmp_path / "notes.txt").write_text("")
    for target, words in (
        (tmp_path / "clip.npz", "not a graph"),
        (tmp_path / "other.json", "no trace of gesturegen"),
        (tmp_path / "notes.txt", "neither a graph"),
        ("tolk", "nearest is talk"),
    ):
        result = run(target, "--work", work)
        assert result.exit_code == 1 and words in result.output and len(result.output.splitlines()) == 1


def test_a_plot_without_matplotlib_says_what_to_install(work, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(DataError, match=r"pip install 'gesturegen\[video\]'"):
        inspect(load_config(None, [f"paths.work={work}"]), "clip", work / "a.png")
