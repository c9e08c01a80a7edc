"""Edits of every stored file: each is noticed, told in one line, and what was stored comes back; nothing ever crashes.

Two kinds of edits. A plain one changes bytes, as a failing disk does: the checksum tells. A forged one writes what the
file's reader would otherwise believe, checksum and all: the check of the values has to tell.
"""

from __future__ import annotations

import io
import json
import os
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from gesturegen import submission
from gesturegen.data import clips
from gesturegen.data.index import Index
from gesturegen.errors import DataError
from gesturegen.manifest import Manifest
from gesturegen.methods import libraries
from gesturegen.methods.gesture_master import building as build_database
from gesturegen.stored import arrays, documents
from gesturegen.stored.sealing import seal_archive
from tests.commands import run, succeed, tree
from tests.test_gesture_master import SMALL as GESTURES
from tests.test_gesture_master import settings, write_recording
from tests.test_motion_matching import SMALL as MATCHING

PLAIN = settings("joints=all", "wrists.enabled=false", "references.mode=all")
METHODS = {
    "motion_graph": PLAIN,
    "gesture_master": (*GESTURES, *settings("references.mode=all")),
    "motion_matching": (*MATCHING, *settings("references.mode=all")),
    "baseline": (*PLAIN, *settings("method=baseline")),
}
EXTREMES = (-1, 10**12, -(10**18), 2**31 - 1)
FLOATS = (np.nan, np.inf, -np.inf, 1e38, -1e38)


@dataclass(frozen=True)
class Work:
    """A finished run: where it is, the options of its commands, and the hash of every file."""

    method: str
    data: Path
    folder: Path
    files: dict[str, str]

    def command(self, name: str):
        return run(name, *METHODS[self.method], "--data", self.data, "--work", self.folder, "-j", 1)

    @property
    def stored(self) -> list[Path]:
        """The files that commands read again."""
        suffixes = (".npz", ".json", "metrics.csv", ".bvh")
        found = (path for path in sorted(self.folder.rglob("*")) if path.is_file())
        return [p for p in found if str(p).endswith(suffixes) and "submission" not in str(p.relative_to(self.folder))]


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> dict[str, Work]:
    """A tiny run of every method on the same recordings."""
    base = tmp_path_factory.mktemp("stored")
    for seed, (name, seconds) in enumerate((("trn_a", 6.0), ("trn_b", 4.0), ("tst_a", 2.0))):
        write_recording(base / "data", name, seconds, seed)
    works = {}
    for method, options in METHODS.items():
        folder = base / method
        succeed("run", *options, "--data", base / "data", "--work", folder, "-j", 1)
        works[method] = Work(method, base / "data", folder, tree(folder))
    return works


# --- edits --------------------------------------------------------------------------------------------------


def replaced(path: Path, data: bytes) -> None:
    """Another file in its place, with a time of its own: files are told apart by their state."""
    state = path.stat()
    temporary = path.with_name("edited")
    temporary.write_bytes(data)
    os.utime(temporary, ns=(state.st_atime_ns, state.st_mtime_ns + 1_000_000))
    os.replace(temporary, path)


def flip_bit(data: bytes, rng: np.random.Generator) -> bytes:
    place = int(rng.integers(len(data)))
    return data[:place] + bytes([data[place] ^ (1 << int(rng.integers(8)))]) + data[place + 1 :]


def other_byte(data: bytes, rng: np.random.Generator) -> bytes:
    place = int(rng.integers(len(data)))
    return data[:place] + bytes([(data[place] + int(rng.integers(1, 256))) % 256]) + data[place + 1 :]


def cut(data: bytes, rng: np.random.Generator) -> bytes:
    return data[: int(rng.integers(len(data)))]


def lengthened(data: bytes, rng: np.random.Generator) -> bytes:
    return data + rng.integers(0, 256, size=int(rng.integers(1, 40)), dtype=np.uint8).tobytes()


def zeroed(data: bytes, rng: np.random.Generator) -> bytes:
    place = int(rng.integers(len(data)))
    block = data[place : place + 512]
    return data[:place] + bytes(len(block)) + data[place + 512 :] if any(block) else data[:-1]


def deleted(data: bytes, rng: np.random.Generator) -> None:
    return None


PLAIN_EDITS = (flip_bit, flip_bit, other_byte, cut, lengthened, zeroed)


def forge_array(path: Path, rng: np.random.Generator) -> str:
    """Change one array of a file, with a checksum that is right; what was done."""
    with np.load(path) as found:
        held = {name: found[name] for name in found.files}
    name = str(rng.choice(sorted(held)))
    value = held[name]
    kind = str(rng.choice(["element", "element", "element", "dtype", "order", "shape", "missing", "extra"]))
    if kind == "element" and value.size and value.dtype.kind in "if":
        value = value.copy()
        choice = rng.choice(EXTREMES if value.dtype.kind == "i" else FLOATS)
        with np.errstate(all="ignore"):
            value.reshape(-1)[int(rng.integers(value.size))] = np.asarray(choice).astype(value.dtype)
    elif kind == "dtype":
        value = (
            value.astype({"f": "f2", "i": "i2", "b": "u1", "U": "S"}[value.dtype.kind])
            if value.dtype.kind != "U"
            else np.zeros(value.shape)
        )
    elif kind == "order":
        value = value.astype(value.dtype.newbyteorder(">")) if value.dtype.itemsize > 1 else value.astype("f8")
    elif kind == "shape":
        value = value[..., None] if value.ndim == 0 or rng.random() < 0.5 else value[:-1] if len(value) else value[None]
    elif kind == "extra":
        held["extra"] = np.zeros(3)
    if kind == "missing":
        del held[name]
    else:
        held[name] = value
    arrays.write(path, held)
    return f"{kind} of {name}"


def forge_bomb(path: Path, rng: np.random.Generator) -> str:
    """One array that announces 80 GB, or one that unpacks to more than it is; with a checksum that is right."""
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    name = str(rng.choice(sorted(members)))
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (10**10,)})
    packed = rng.random() < 0.5
    members[name] = header.getvalue() + bytes(10_000_000 if packed else 64)
    whole = io.BytesIO()
    with zipfile.ZipFile(whole, "w", zipfile.ZIP_DEFLATED if packed else zipfile.ZIP_STORED) as archive:
        for member, data in members.items():
            archive.writestr(member, data)
    seal_archive(whole)
    replaced(path, whole.getvalue())
    return f"bomb in {name}"


def forge_value(path: Path, rng: np.random.Generator) -> str:
    """Change one value of a JSON file, with a checksum that is right; what was done."""
    document = json.loads(path.read_text())
    del document["checksum"]
    holder, key = document, str(rng.choice(sorted(document)))
    while isinstance(holder[key], dict | list) and holder[key] and rng.random() < 0.8:
        holder = holder[key]
        key = str(rng.choice(sorted(holder))) if isinstance(holder, dict) else int(rng.integers(len(holder)))
    value = [None, True, "x", -1, 10**18, 1e300, [], {}, [[1]], "", "../..", "é\x00"][int(rng.integers(12))]
    holder[key] = value
    documents.write(path, document)
    return f"{key} = {value!r}"


def forge(path: Path, rng: np.random.Generator) -> str:
    if path.suffix == ".json":
        return forge_value(path, rng)
    return forge_bomb(path, rng) if rng.random() < 0.1 else forge_array(path, rng)


# --- readers alone ------------------------------------------------------------------------------------------


def read(path: Path):
    """What the commands read of a stored file."""
    if path.name == "index.json":
        return documents.read(path, Index, "preprocess")
    if path.name == "manifest.json":
        return documents.read(path, Manifest, "reenact")
    if path.name == "summary.json":
        return documents.read(path, documents.Summary, "evaluate")
    if path.name.endswith(".trace.json"):
        return submission.read_trace(path)
    if path.parent.name == "graphs":
        return libraries.read(path)
    return arrays.read(path, clips.KIND if path.parent.name == "clips" else build_database._PART)


def sealed(work: Work) -> list[Path]:
    return [path for path in work.stored if path.suffix in (".npz", ".json")]


def refused(path: Path) -> str | None:
    """How the reader refuses a file, in one line; None when it takes it."""
    try:
        read(path)
    except DataError as error:
        assert "\n" not in str(error) and path.name in str(error) and len(str(error)) < 600, str(error)
        return str(error)
    return None


@pytest.mark.parametrize("method", METHODS)
def test_readers_refuse_whatever_is_not_as_it_was_written(method, finished, tmp_path):
    work, rng = copied(finished[method], tmp_path.name), np.random.default_rng(11)
    for path in sealed(work):
        whole = path.read_bytes()
        for edit in PLAIN_EDITS:
            replaced(path, edit(whole, rng))
            assert refused(path), (path, edit.__name__)
        path.unlink()
        path.mkdir()
        assert refused(path), (path, "a folder")
        path.rmdir()
        path.write_bytes(whole)
        assert refused(path) is None


@pytest.mark.parametrize("method", METHODS)
def test_readers_take_forged_files_or_refuse_them(method, finished, tmp_path):
    work, rng = copied(finished[method], tmp_path.name), np.random.default_rng(12)
    refusals = []
    for path in sealed(work):
        whole = path.read_bytes()
        for _ in range(8):
            told = forge(path, rng)
            if refused(path):
                refusals.append(told)
            replaced(path, whole)
    assert len(refusals) > 30


@pytest.mark.parametrize(("name", "forged", "words"), [
    ("indices", 10**12, "indices holds"), ("indptr", -1, "indptr does not rise"), ("phrase_ends", -1, "phrase_ends holds"),
    ("segment_starts", 7, "segment_starts does not begin at 0"), ("positions", np.nan, "positions holds"),
    ("weights", -1.0, "weights holds"), ("key_frames", 10**6, "key_frames"), ("clip_starts", 1, "does not begin"),
])  # fmt: skip
def test_what_crashed_the_loops_is_refused(name, forged, words, finished, tmp_path):
    (path,) = (finished["motion_graph"].folder / "graphs").glob("*.npz")
    held = dict(np.load(path))
    held[name].reshape(-1)[0] = forged
    arrays.write(tmp_path / "graphs/graph.npz", held)
    assert words in refused(tmp_path / "graphs/graph.npz")


def test_another_programs_file_is_refused_and_ours_by_hand_is_not(finished, tmp_path):
    (path,) = (finished["motion_graph"].folder / "graphs").glob("*.npz")
    held = dict(np.load(path))
    (tmp_path / "graphs").mkdir()
    np.savez(tmp_path / "graphs/graph.npz", **held)
    assert "no checksum: cut off, or written by an older gesturegen or another program" in refused(
        tmp_path / "graphs/graph.npz"
    )
    arrays.write(tmp_path / "graphs/graph.npz", held)
    assert refused(tmp_path / "graphs/graph.npz") is None
    assert (tmp_path / "graphs/graph.npz").read_bytes() == path.read_bytes()


# --- whole runs ---------------------------------------------------------------------------------------------


def one_line(output: str) -> bool:
    lines = [line for line in output.splitlines() if line.lower().startswith("error: ")]
    return bool(lines) and "Traceback" not in output


def restored(work: Work, edited: Sequence[Path], told: str) -> None:
    """`run` names the files that were edited, makes them again and ends as before."""
    result = work.command("run")
    assert result.exit_code == 0 and "Traceback" not in result.output, (told, result.output)
    for path in edited:
        assert any(path.name in line and "made again" in line for line in result.output.splitlines()), (told, path)
    assert tree(work.folder) == work.files, told


# Of a clip the trace is looked at before its BVH, and of the figures the JSON before the tables.
@pytest.mark.parametrize("second", [False, True], ids=["traces", "motions"])
@pytest.mark.parametrize("method", METHODS)
def test_run_makes_all_of_it_again(method, second, finished, tmp_path):
    work, rng = copied(finished[method], tmp_path.name), np.random.default_rng(13)
    behind = (".bvh", "metrics.csv")
    edited = [path for path in work.stored if path.name.endswith(behind) == second]
    for path in edited:
        replaced(path, flip_bit(path.read_bytes(), rng))
    restored(work, edited, method)


def readers(work: Work, path: Path) -> tuple[str, ...]:
    """A command that reads a stored file; of parts and figures, which none but `run` reads, none."""
    if path.parent.name == "clips":
        return ("reenact",) if "tst" in path.name else ("build-graph",)
    return {"graphs": ("reenact",), "reenact": ("evaluate",)}.get(path.parent.name, ())


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_every_plain_edit_is_told_and_undone(method, finished, tmp_path):
    work, rng = copied(finished[method], tmp_path.name), np.random.default_rng(14)
    count = 0
    for path in work.stored:
        whole = path.read_bytes()
        for edit in (*PLAIN_EDITS, deleted):
            if edit is deleted and path.parent.name == "gestures":
                continue  # a database that is whole needs no parts
            told = f"{path.relative_to(work.folder)}, {edit.__name__}"
            data = edit(whole, rng)
            path.unlink() if data is None else replaced(path, data)
            for name in readers(work, path):
                result = work.command(name)
                assert result.exit_code == 1 and one_line(result.output), (told, name, result.output)
                assert path.name in result.output or data is None, (told, name, result.output)
            restored(work, [] if data is None else [path], told)
            count += 1
    assert count >= 40


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_no_forged_file_crashes_a_command(method, finished, tmp_path):
    work = copied(finished[method], tmp_path.name)
    # In a process of its own: a loop that reads out of bounds ends it without a word.
    script = f"from tests.faults import test_stored_files as t; t.forge_all({method!r}, {str(work.data)!r}, {str(work.folder)!r})"
    done = subprocess.run(
        [sys.executable, "-X", "faulthandler", "-c", script], capture_output=True, text=True, timeout=3000, check=False
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]


def forge_all(method: str, data: str, folder: str, count: int = 100) -> None:
    """Forge files of a run, one after the other, and try the commands; each edit is printed before it is tried."""
    rng, whole = np.random.default_rng(15), Path(folder).with_name(f"{Path(folder).name}-whole")
    shutil.copytree(folder, whole, symlinks=True)
    for _ in range(count):
        work = Work(method, Path(data), Path(folder), {})
        path = sealed(work)[int(rng.integers(len(sealed(work))))]
        told = f"{path.relative_to(folder)}: {forge(path, rng)}"
        print(told, flush=True)
        for name in ("reenact", "evaluate", "run"):
            result = work.command(name)
            bad = "Traceback" in result.output or "a bug of" in result.output
            if bad or result.exit_code not in (0, 1) or (result.exit_code == 1 and not one_line(result.output)):
                sys.exit(f"{told}, {name}: {result.exit_code} {result.output} {result.exception!r}")
        shutil.rmtree(folder)
        shutil.copytree(whole, folder, symlinks=True)


def copied(work: Work, name: str) -> Work:
    """A copy beside it: the index has the places of recordings as seen from the work folder."""
    return Work(work.method, work.data, Path(shutil.copytree(work.folder, work.folder.with_name(name))), work.files)
