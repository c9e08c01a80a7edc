"""CSV files: what is read, and the one line that says what is wrong."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gesturegen import strict_csv
from gesturegen.errors import ConfigError
from tests.builders import SMALL, literally, refused

COLUMNS = {"clip": True, "start": True, "bits": False}


def write(tmp_path, content):
    path = tmp_path / "table.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def read(path):
    return strict_csv.read_rows(path, COLUMNS, "check `corrections_file`")


def row(clip, start, bits):
    return {"clip": clip, "start": start, "bits": bits}


def test_rows_come_with_their_lines(tmp_path):
    path = write(tmp_path, "clip,start,bits\na,1.5,01\nb,2,\n")
    assert read(path) == [(2, row("a", "1.5", "01")), (3, row("b", "2", ""))]


def test_columns_may_stand_in_any_order(tmp_path):
    assert read(write(tmp_path, "bits,clip,start\n01,a,1\n")) == [(2, row("a", "1", "01"))]


def test_spaces_around_texts_are_dropped(tmp_path):
    assert read(write(tmp_path, " clip , start,bits\n a b ,\t1 , 01 \n")) == [(2, row("a b", "1", "01"))]


def test_blank_lines_are_skipped_and_counted(tmp_path):
    path = write(tmp_path, "\n  \nclip,start,bits\n\na,1,01\n \t\nb,2,10\n\n")
    assert read(path) == [(5, row("a", "1", "01")), (7, row("b", "2", "10"))]


def test_a_header_alone_has_no_rows(tmp_path):
    assert read(write(tmp_path, "clip,start,bits")) == []


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_every_end_of_line_and_a_byte_order_mark(tmp_path, end):
    text = end.join(["clip,start,bits", "ä,1,01", "b,2,10"])
    assert read(write(tmp_path, text.encode("utf-8-sig"))) == [(2, row("ä", "1", "01")), (3, row("b", "2", "10"))]


def test_quotes_keep_commas(tmp_path):
    path = write(tmp_path, 'clip,start,bits\n"a, ""b""",1,01\n')
    assert read(path) == [(2, row('a, "b"', "1", "01"))]


@pytest.mark.parametrize(
    ("content", "line", "match"),
    [
        ('"c\nd",2,10\n', 3, r"a cell holds a line break or control character \(U\+000A\)"),
        ("c\x1b[2J,2,10\n", 2, r"a cell holds a .*control character \(U\+001B\) after"),
        ("<<<<<<< ours\na,1,01\n", 2, "merge conflict marker"),
        ("=======\n", 2, "merge conflict marker"),
        ("a" * 200_000 + ",1,01\n", 2, "not valid CSV .*field larger"),
        ('"a,1,01\n' * 3, 3, "not valid CSV .*check the quotes"),
    ],
)
def test_cells_that_hold_more_than_a_cell(tmp_path, content, line, match):
    path = write(tmp_path, "clip,start,bits\n" + content)
    with refused(ConfigError, literally(path, line) + match):
        read(path)


@SMALL
@given(st.lists(st.tuples(*[st.from_regex(r"[a-zé0-9.]{1,5}", fullmatch=True)] * 3), max_size=5))
def test_what_is_written_is_read(tmp_path_factory, rows):
    path = write(tmp_path_factory.mktemp("csv"), "\n".join(",".join(cells) for cells in [COLUMNS, *rows]))
    assert read(path) == [(number, row(*cells)) for number, cells in enumerate(rows, 2)]


def test_a_missing_file_and_a_folder(tmp_path):
    path = tmp_path / "none.csv"
    with refused(ConfigError, "cannot be read .*No such file.*; check `corrections_file`$", path):
        read(path)
    with refused(ConfigError, "cannot be read .*directory.*; check `corrections_file`$", tmp_path):
        read(tmp_path)


def test_binary_data(tmp_path):
    path = write(tmp_path, b"PK\3\4\0\0clip")
    with refused(ConfigError, "binary data", path):
        read(path)


def test_another_encoding(tmp_path):
    path = write(tmp_path, "clip,start,bits\na,1,01\nä,2,01\n".encode("latin-1"))
    with refused(ConfigError, literally(path, 3) + "not a text file in UTF-8"):
        read(path)


@pytest.mark.parametrize("content", ["", "\n\n", "\ufeff"])
def test_an_empty_file(tmp_path, content):
    path = write(tmp_path, content)
    with refused(ConfigError, "empty; expected a header line with the columns clip, start, bits$", path):
        read(path)


def test_a_missing_column(tmp_path):
    path = write(tmp_path, "clip,bits\na,01\n")
    with refused(ConfigError, literally(path, 1) + "column 'start' is missing.*clip, start, bits, separated by commas"):
        read(path)


def test_a_missing_header(tmp_path):
    path = write(tmp_path, "a,1,01\nb,2,10\n")
    with refused(ConfigError, literally(path, 1) + "column 'clip' is missing; found the header 'a,1,01', expected"):
        read(path)


@pytest.mark.parametrize("separator", [";", "\t"])
def test_other_separators(tmp_path, separator):
    path = write(tmp_path, "clip,start,bits\na,1,01\n".replace(",", separator))
    with refused(ConfigError, literally(path, 1) + "column 'clip' is missing.*separated by commas"):
        read(path)


def test_an_unknown_column(tmp_path):
    path = write(tmp_path, "clip,strat,bits\na,1,01\n")
    with refused(ConfigError, literally(path, 1) + "unknown column 'strat'; did you mean 'start'?"):
        read(path)
    path = write(tmp_path, "clip,start,bits,remark\na,1,01,\n")
    with refused(ConfigError, literally(path, 1) + "unknown column 'remark'; expected clip, start, bits$"):
        read(path)
    path = write(tmp_path, "clip,start,bits,\na,1,01,\n")
    with refused(ConfigError, literally(path, 1) + "unknown column ''; expected clip, start, bits$"):
        read(path)


def test_a_column_that_stands_twice(tmp_path):
    path = write(tmp_path, "clip,start,bits,start\na,1,01,2\n")
    with refused(ConfigError, literally(path, 1) + "column 'start' stands twice; keep one"):
        read(path)


@pytest.mark.parametrize(("cells", "count"), [("b,2", 2), ("b,2,01,x", 4), ("b", 1)])
def test_too_few_and_too_many_cells(tmp_path, cells, count):
    path = write(tmp_path, f"clip,start,bits\na,1,01\n\n{cells}\n")
    with refused(ConfigError, literally(path, 4) + f"found {count} cells, expected 3 .clip, start, bits."):
        read(path)


@pytest.mark.parametrize("cells", ["a,,01", "a, ,01", 'a,"",01'])
def test_an_empty_cell_that_must_be_filled(tmp_path, cells):
    path = write(tmp_path, f"clip,start,bits\n{cells}\n")
    with refused(ConfigError, literally(path, 2) + "column 'start' is empty; fill it or delete the line"):
        read(path)


def test_a_line_of_commas_is_not_blank(tmp_path):
    path = write(tmp_path, "clip,start,bits\n,,\n")
    with refused(ConfigError, literally(path, 2) + "column 'clip' is empty"):
        read(path)


def test_quotes_that_do_not_match(tmp_path):
    path = write(tmp_path, 'clip,start,bits\n"a,1,01\n')
    with refused(ConfigError, literally(path, 2) + "not valid CSV .*check the quotes"):
        read(path)
    path = write(tmp_path, 'clip,start,bits\n"a"b,1,01\n')
    with refused(ConfigError, literally(path, 2) + "not valid CSV .*check the quotes"):
        read(path)


def test_a_header_over_two_lines_is_refused_in_one(tmp_path):
    path = write(tmp_path, '"clip\nx",start,bits\n')
    with refused(ConfigError, "unknown column|is missing", path):
        read(path)
