"""A data set with each fault once: each is named, and no other."""

import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
import soundfile

from gesturegen.demo import dataset as demo
from gesturegen.doctor import dataset, examination, page
from gesturegen.motion import bvh
from gesturegen.motion.skeleton import Motion
from gesturegen.settings.loading import configs_folder, load_config
from tests.builders import write_dataset
from tests.commands import succeed, tree
from tests.motion.test_roles import LAFAN

RATE = demo.SAMPLE_RATE


class Files:
    """The three files of a clip, to be changed one by one."""

    def __init__(self, folder, name):
        agent = folder / "main-agent"
        self.wav, self.tsv, self.bvh = (agent / kind / f"{name}.{kind}" for kind in ("wav", "tsv", "bvh"))

    def motion(self, change):
        bvh.write(self.bvh, change(bvh.read(self.bvh)))

    def sound(self, change, rate=RATE):
        samples, _ = soundfile.read(self.wav)
        soundfile.write(self.wav, change(samples), rate, subtype="PCM_16")

    def words(self, change):
        rows = [line.split("\t") for line in self.tsv.read_text().splitlines()]
        moved = [(*change(float(start), float(end)), text) for start, end, text in rows]
        self.tsv.write_text("".join(f"{start:.3f}\t{end:.3f}\t{text}\n" for start, end, text in moved))


def later(files, seconds):
    """The sound and its words come so much later than the motion."""
    n = round(seconds * RATE)
    files.sound(lambda x: np.concatenate([1e-3 * np.random.default_rng(0).standard_normal(n), x[:-n]]))
    files.words(lambda start, end: (start + seconds, end + seconds))


def slower(files, factor):
    """The sound and its words run slower than the motion."""
    files.sound(lambda x: np.interp(np.arange(len(x)) / factor, np.arange(len(x)), x))
    files.words(lambda start, end: (start * factor, end * factor))


def jump(motion):
    rotations = motion.rotations.copy()
    arm = motion.skeleton.names.index("b_r_arm")
    rotations[600, arm] = np.roll(rotations[600, arm], 1)
    return replace(motion, rotations=rotations)


def smaller(motion):
    skeleton = motion.skeleton
    head, foot = skeleton.hierarchy.split("MOTION")[0], ""
    text = re.sub(r"-?\d+\.\d+", lambda number: f"{float(number[0]) / 100:.8f}", head) + foot
    small = replace(skeleton, offsets=skeleton.offsets / 100, end_sites=skeleton.end_sites / 100, hierarchy=text)
    return Motion(small, motion.rotations, motion.positions / 100, motion.fps)


def longer_arm(motion):
    """One offset of the skeleton is another."""
    skeleton, arm = motion.skeleton, motion.skeleton.names.index("b_r_forearm")
    offsets = skeleton.offsets.copy()
    before = " ".join(f"{value:.6f}" for value in offsets[arm])
    offsets[arm] *= 1.5
    positions = motion.positions.copy()
    positions[:, arm] *= 1.5
    after = " ".join(f"{value:.6f}" for value in offsets[arm])
    assert skeleton.hierarchy.count(before) >= 1
    return Motion(
        replace(skeleton, offsets=offsets, hierarchy=skeleton.hierarchy.replace(before, after, 1)),
        motion.rotations,
        positions,
        motion.fps,
    )


def stereo(samples):
    turn = (np.arange(len(samples)) // (3 * RATE)) % 2
    return np.stack([samples * turn, samples * (1 - turn)], axis=1)


FAULTS = {
    "good": (lambda files: None, set()),
    "still": (lambda files: files.motion(lambda m: m.take(np.zeros(m.n_frames, dtype=int))), {"still"}),
    "torn": (lambda files: files.motion(jump), {"torn"}),
    "metres": (lambda files: files.motion(smaller), {"units"}),
    "arm": (lambda files: files.motion(longer_arm), {"other skeleton"}),
    "fast": (lambda files: files.motion(lambda m: replace(m.take(np.repeat(np.arange(m.n_frames), 2)), fps=60.0)), {"frame rate"}),
    "silent": (lambda files: files.sound(lambda x: 0 * x), {"silent"}),
    "quiet": (lambda files: files.sound(lambda x: x * 0.02), {"quiet"}),
    "clipped": (lambda files: files.sound(lambda x: np.clip(x * 30, -1, 1)), {"clipped"}),
    "two": (lambda files: files.sound(stereo), {"channels"}),
    "long": (lambda files: files.sound(lambda x: np.concatenate([x, np.zeros(5 * RATE)])), {"lengths"}),
    "late": (lambda files: later(files, 2.0), {"out of step"}),
    "drifting": (lambda files: slower(files, 1.04), {"drifts"}),
    "shifted": (lambda files: files.words(lambda a, b: (a + 4.0, b + 4.0)), {"transcript"}),
    "foreign": (lambda files: files.words(lambda a, b: (60.0 - b, 60.0 - a)), {"transcript"}),
    "half": (lambda files: files.tsv.write_text("".join(files.tsv.read_text().splitlines(True)[:40])), {"transcript"}),
    "words": (lambda files: files.tsv.write_text("what is this"), {"transcript"}),
    "cut": (lambda files: files.bvh.write_bytes(files.bvh.read_bytes()[:90_000]), {"unreadable"}),
    "deaf": (lambda files: files.wav.unlink(), {"no audio"}),
}  # fmt: skip


@pytest.fixture(scope="module")
def planted(tmp_path_factory):
    """One demo clip many times over, and in each copy one fault."""
    folder = tmp_path_factory.mktemp("doctor")
    spec = demo.ClipSpec("trn", 0, 60.0, 0, 1)
    demo.write_clip(folder / "made", spec)
    for name, (plant, _) in FAULTS.items():
        for kind in ("wav", "tsv", "bvh"):
            target = folder / "data" / "trn" / "main-agent" / kind / f"{name}.{kind}"
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(folder / "made" / "trn" / "main-agent" / kind / f"{spec.name}.{kind}", target)
        plant(Files(folder / "data" / "trn", name))
    return folder / "data"


@pytest.fixture(scope="module")
def looked(planted):
    """The data set as `gesturegen doctor` sees it: its folder, what was printed, findings by clip and kind."""
    before = tree(planted)
    work = planted.parent / "work"
    result = succeed(
        "doctor",
        planted,
        "--work",
        work,
        "--blacklist",
        work.parent / "b.yaml",
        "--set",
        "data.test_split=trn",
        "-j",
        2,
    )
    assert tree(planted) == before, "the data are only read"
    found = {name: {} for name in FAULTS}
    for name, kind, text in re.findall(r"^trn/(\w+): ([\w ]+): (.*)$", result.output, re.MULTILINE):
        found[name][kind] = f"{found[name].get(kind, '')} {text}"
    return work, result.output, found


@pytest.mark.slow
def test_each_fault_is_named_and_no_other(looked):
    assert {name: set(kinds) for name, kinds in looked[2].items()} == {
        name: kinds for name, (_, kinds) in FAULTS.items()
    }


@pytest.mark.slow
def test_findings_give_the_figure(looked):
    found = looked[2]
    assert re.search(r"the motion is (1\.[89]|2\.[0-3])\d s earlier than the sound", found["late"]["out of step"])
    assert re.search(r"moved by -(3\.[89]|4\.[01]) s they would fit", found["shifted"]["transcript"])
    assert re.search(
        r"words do not lie where a voice is heard \(correlation -?0\.[0-3]", found["foreign"]["transcript"]
    )
    assert "lengths are taken to be in m" in found["metres"]["units"]
    assert re.search(r"words cover \d+ % of the speech", found["half"]["transcript"])


@pytest.mark.slow
def test_the_blacklist_loads_and_the_page_has_everything(looked):
    work, output, found = looked
    config = load_config(work.parent / "b.yaml")
    assert set(config.blacklist) == {"still", "arm", "silent", "late", "drifting", "cut", "deaf"}
    assert [range_.clip for range_ in config.exclude] == ["torn"] and config.exclude[0].from_ < 20.0 < config.exclude[
        0
    ].to
    html = (work / "doctor.html").read_text()
    assert "default-src 'none'" in html and "<script" not in html and "http://" not in html and "https://" not in html
    for name, kinds in found.items():
        assert name in html and all(html.count(f">{kind}</td>") for kind in kinds)
    assert "motion_graph, search: beam" in html and "motion_graph, search: beam" in output


@pytest.mark.slow
def test_any_number_of_workers_writes_the_same(tmp_path):
    data = write_dataset(tmp_path / "data")
    for jobs in (1, 2):
        written = ("--out", tmp_path / f"{jobs}.html", "--blacklist", tmp_path / f"{jobs}.yaml")
        succeed("doctor", data, *written, "-j", jobs)
    for kind in ("html", "yaml"):
        assert (tmp_path / f"1.{kind}").read_bytes() == (tmp_path / f"2.{kind}").read_bytes()


def test_names_and_texts_of_files_are_escaped():
    one = examination.Examined("trn/<b>", seconds=1.0)
    one.add("transcript", "<script>alert(1)</script> # x", "look & see")
    html = page.render(page.Content("<data>", {"trn": [one]}, [("m", "yes", "<i>")], "# <pre>"))
    assert (
        "<script" not in html
        and "&lt;script&gt;" in html
        and "<b>" not in html.replace("<b>1</b>", "").replace("<b>0</b>", "")
    )


def test_a_blacklist_of_any_name_loads(tmp_path):
    names = ["a: b", "'quoted'", "#x", "yes", "[1]"]
    examined = []
    for name in names:
        examined.append(examination.Examined(f"trn/{name}"))
        examined[-1].add("silent", "line one\nline two: # {", "")
    (tmp_path / "b.yaml").write_text(dataset.blacklist_yaml(examined, {f"trn/{name}": name for name in names}))
    assert list(load_config(tmp_path / "b.yaml").blacklist) == names
    (tmp_path / "none.yaml").write_text(dataset.blacklist_yaml([], {}))
    assert load_config(tmp_path / "none.yaml").blacklist == ()
    # The other settings that it was made with, and what they leave out, are in it.
    best = load_config(configs_folder() / "best.yaml", ("blacklist=[old]", "exclude=[{clip: b, from: 1, to: 2.5}]"))
    (tmp_path / "best.yaml").write_text(dataset.blacklist_yaml(examined, {f"trn/{name}": name for name in names}, best))
    again = load_config(tmp_path / "best.yaml")
    assert list(again.blacklist) == ["old", *names] and again.exclude == best.exclude
    assert again.model_copy(update={"blacklist": best.blacklist}).signature() == best.signature()


def test_joints_of_other_skeletons_are_known_by_their_roles():
    one = examination.Examined("trn/a", seconds=400.0, skeleton=LAFAN)
    able = {name: can for name, can, _ in dataset.methods([one], [one], 0, load_config())}
    assert able["motion_matching"] == able["control of the hands"] == "yes"
