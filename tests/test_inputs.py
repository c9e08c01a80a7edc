"""Files that users hand in: what is opened, and the one line about what is not."""

import os
import pickle
import re
import socket
from pathlib import Path

import pytest
from click.testing import CliRunner

from gesturegen import inputs
from gesturegen.cli import main
from gesturegen.errors import ConfigError, DataError
from gesturegen.files import sha256
from gesturegen.motion import bvh, positions
from gesturegen.settings.loading import load_config
from gesturegen.speech import audio, transcripts
from tests.builders import bvh_text, refused, write_clip


def fifo(path):
    os.mkfifo(path)


def listening(path):
    with socket.socket(socket.AF_UNIX) as made:
        # The path of a socket is short, that of a test's folder is not.
        here = os.getcwd()
        os.chdir(path.parent)
        try:
            made.bind(path.name)
        finally:
            os.chdir(here)


def loop(path):
    path.symlink_to(path)


NO_FILES = {
    "pipe": (fifo, "it is a pipe, not a file"),
    "socket": (listening, "it is a socket, not a file"),
    "endless device": (lambda path: path.symlink_to("/dev/zero"), "it is a device, not a file"),
    "terminal": (lambda path: path.symlink_to("/dev/tty"), "it is a device, not a file|cannot be read"),
    "folder": (lambda path: path.mkdir(), "Is a directory"),
    "link to itself": (loop, "Too many levels of symbolic links"),
    "link to nothing": (lambda path: path.symlink_to("nowhere"), "No such file"),
    "missing": (lambda path: None, "No such file"),
}
READERS = {
    "bvh": (bvh.read, DataError),
    "skeleton": (bvh.read_skeleton, DataError),
    "wav": (audio.read_samples, DataError),
    "tsv": (lambda path: transcripts.read(path, 5.0), DataError),
    "npz": (positions.read, DataError),
    "hash": (sha256, DataError),
    "config": (load_config, ConfigError),
}


@pytest.mark.parametrize(("make", "match"), NO_FILES.values(), ids=NO_FILES)
def test_no_reader_waits_for_what_is_no_file(tmp_path, make, match):
    path = tmp_path / "a\nb"
    make(path)
    assert not inputs.is_file(path)
    for read, kind in READERS.values():
        with refused(kind, match, r"a\nb: cannot be read ("):
            read(path)


@pytest.mark.parametrize("path", ["a\0b", "a\udcffb", "a" * 300, "b/" * 3000])
def test_paths_that_no_file_can_have(path):
    assert not inputs.is_file(path) and not inputs.is_dir(path)
    with refused(DataError, "cannot be read"):
        inputs.open_regular(path)
    with refused(ConfigError, "does not exist|control character|keywords.*(NUL|not valid YAML)"):
        load_config(None, [f"keywords.file={path}"])


def test_a_file_larger_than_allowed_is_refused_and_one_of_that_size_is_read(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(b"12345")
    assert inputs.read_bytes(path, 5) == b"12345"
    with refused(ConfigError, r"0\.0 MB, more than the 4e-06 MB that are read", path):
        inputs.read_bytes(path, 4, ConfigError)


def test_a_file_that_grows_while_it_is_read_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "a"
    path.write_bytes(b"12345")
    really = inputs.open_regular

    def grown(*args):
        file = really(*args)
        with path.open("ab") as more:
            more.write(b"6789")
        return file

    monkeypatch.setattr(inputs, "open_regular", grown)
    with refused(DataError, "more than the .* that are read", path):
        inputs.read_bytes(path, 6)


@pytest.mark.parametrize(
    ("text", "number"),
    [("1", 1.0), ("-1.5", -1.5), ("+.5", 0.5), ("2.", 2.0), ("1e-3", 1e-3), (" 1E+2\t", 100.0)]
    + [(text, None) for text in ("", ".", "e5", "1_0", "٣", "²", "nan", "inf", "0x1", "1 2", "1e", "9" * 500)],
)
def test_numbers_are_decimal(text, number):
    assert inputs.decimal(text) == number


@pytest.mark.parametrize(
    ("text", "shown"),
    [("a b é", "a b é"), ("a\nb\tc", r"a\nb\tc"), ("\udcff\x1b\u2028", r"\udcff\x1b\u2028"), (Path("x/y"), "x/y")],
)
def test_what_is_shown_stands_on_one_line(text, shown):
    assert inputs.shown(text) == shown
    assert len(inputs.shown("\n" * 5000)) < 500


def test_folders_whose_names_no_file_can_hold_are_refused():
    with refused(ConfigError, r"out.udcff: the name holds U\+DCFF; rename the folder \(paths\.work\)"):
        load_config(None, (), {"paths.work": "out\udcff"})


@pytest.mark.parametrize(
    ("name", "what"), [(b"a\xff", "bytes that are not UTF-8"), (b"a\nb", r"U\+000A"), (b"a\x1bb", r"U\+001B")]
)
@pytest.mark.parametrize("command", ["export", "check", "evaluate"])
def test_files_whose_names_cannot_be_written_again_are_refused(tmp_path, command, name, what):
    folder, work = tmp_path / "motions", tmp_path / "work"
    folder.mkdir()
    path = Path(os.fsdecode(os.fsencode(folder) + b"/" + name + b".bvh"))
    for motion in (path, folder / "good.bvh"):
        motion.write_text(bvh_text())
    write_clip(tmp_path / "data/trn", "trn_a")
    write_clip(tmp_path / "data/tst", "tst_a", with_motion=False)
    arguments = {
        "export": [folder, "--format", "csv", "--out", work],
        "check": [folder],
        "evaluate": ["--bvh", folder],
    }[command]
    result = CliRunner().invoke(
        main, [command, *map(str, arguments), "--data", str(tmp_path / "data"), "--work", str(work)]
    )
    lines = [line for line in result.stderr.splitlines() if inputs.shown(path) in line]
    assert result.exit_code == 1 and len(lines) == 1, result.output
    assert re.search(f"the name of the file holds {what}; rename it$", lines[0]), lines
    # The other motion is none the worse for it.
    assert (work / "good.csv").is_file() == (command == "export") and path.name not in map(
        os.path.basename, work.rglob("*")
    )


def test_labels_that_cannot_be_shown_are_refused(tmp_path):
    result = CliRunner().invoke(main, ["report", "--compare", f"a\udcff={tmp_path}", "--work", str(tmp_path)])
    assert result.exit_code == 2 and "the label holds U+DCFF" in result.stderr, result.output


@pytest.mark.parametrize("char", ("\ue000", "\ud7fc", "\u202e", "\x1b"))
def test_errors_show_only_what_can_be_printed(char):
    """Whatever a reader quotes of a file: its errors go to terminals and logs."""
    error = ConfigError(f"a.yaml:1: {char}: one mistake\na.yaml:2: another, é")
    first, second = str(error).split("\n")
    assert first == f"a.yaml:1: {char.encode('unicode_escape').decode()}: one mistake" and second.endswith("é")
    assert str(pickle.loads(pickle.dumps(error))) == str(error)
