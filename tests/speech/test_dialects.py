"""What people have instead of our TSV: the same words and times, and one line that says how they were read."""

import json

import pytest

from gesturegen.errors import DataError
from gesturegen.speech import transcripts
from gesturegen.speech.transcripts import NotATranscript
from tests.builders import data_folder, refused

# Of a recording of 6 s.
WORDS = (
    ("so", 0.1, 0.4),
    ("it's", 0.5, 0.9),
    ("a", 1.2, 1.3),
    ("well-known", 1.5, 2.25),
    ("thing", 3.0, 3.75),
    ("2014", 4.0, 4.5),
    ("okay", 4.5, 5.25),
)
DURATION = 6.0


def table(row, header="", words=WORDS, end="\n"):
    return header + "".join(row(word, start, stop) + end for word, start, stop in words)


def clock(seconds, mark):
    return f"00:{int(seconds // 60):02}:{int(seconds % 60):02}{mark}{round(seconds * 1000) % 1000:03}"


def long_textgrid(tiers):
    lines = [
        'File type = "ooTextFile"',
        'Object class = "TextGrid"',
        "",
        "xmin = 0",
        f"xmax = {DURATION}",
        "tiers? <exists>",
    ]
    lines += [f"size = {len(tiers)}", "item []:"]
    for number, (name, words) in enumerate(tiers, 1):
        lines += [
            f"    item [{number}]:",
            '        class = "IntervalTier"',
            f'        name = "{name}"',
            "        xmin = 0",
        ]
        lines += [f"        xmax = {DURATION}", f"        intervals: size = {len(words)}"]
        for place, (word, start, end) in enumerate(words, 1):
            lines += [f"        intervals [{place}]:", f"            xmin = {start}", f"            xmax = {end}"]
            lines += [f'            text = "{word}"']
    return "\n".join(lines) + "\n"


def short_textgrid(name, words):
    head = ['File type = "ooTextFile"', 'Object class = "TextGrid"', "", "0", f"{DURATION}", "<exists>", "1"]
    rows = [line for word, start, end in words for line in (f"{start}", f"{end}", f'"{word}"')]
    return "\n".join([*head, '"IntervalTier"', f'"{name}"', "0", f"{DURATION}", f"{len(words)}", *rows]) + "\n"


def filled(words):
    """With the silences between them, as Praat has them."""
    done, last = [], 0.0
    for word, start, end in words:
        done += [("", last, start)] if start > last else []
        done.append((word, start, end))
        last = end
    return [*done, ("sil", last, DURATION)]


def objects(words=WORDS, text="word", **more):
    return [{text: word, "start": start, "end": end, **more} for word, start, end in words]


TSV = table(lambda w, a, b: f"{a}\t{b}\t{w}")
CUES = [(clock(a, ","), clock(b, ","), w) for w, a, b in WORDS]
# name of the file, what it holds, what must be in the note (None: no note at all)
DIALECTS = {
    "GENEA": ("a.tsv", TSV, None),
    "upper case ending and CRLF": ("a.TSV", TSV.replace("\n", "\r\n"), None),
    "punctuation and case": ("a.tsv", table(lambda w, a, b: f"{a}\t{b}\t{w.capitalize()},"), None),
    "byte order mark": ("a.tsv", TSV.encode("utf-8-sig"), None),
    "UTF-16": ("a.tsv", TSV.encode("utf-16"), "in UTF-16"),
    "UTF-16 without a mark": ("a.tsv", TSV.encode("utf-16-le"), "in UTF-16"),
    "header": ("a.tsv", "start\tend\ttext\n" + TSV, "read as a table with a header"),
    "header with other columns": (
        "a.tsv",
        table(lambda w, a, b: f"A\t{w}\t{a}\t{b}\t0.9", "Speaker\tWord\tStart\tEnd\tScore\n"),
        "a header (columns not used: Speaker, Score)",
    ),
    "header with duration": (
        "a.tsv",
        table(lambda w, a, b: f"{a}\t{b - a:.3f}\t{w}", "start\tduration\tword\n"),
        "a header, durations in place of ends",
    ),
    "header in milliseconds": (
        "a.csv",
        table(lambda w, a, b: f"{w},{a * 1000:g},{b * 1000:g}", "word,start (ms),end (ms)\n"),
        "times in milliseconds",
    ),
    "Praat's table": ("a.tsv", table(lambda w, a, b: f"{a}\twords\t{w}\t{b}", "tmin\ttier\ttext\ttmax\n"), "not used: tier"),
    "decimal commas": ("a.tsv", TSV.replace(".", ","), "a table with decimal commas"),
    "quotes": ("a.tsv", table(lambda w, a, b: f'"{a}"\t"{b}"\t"{w}"'), "quotes around cells"),
    "trailing tabs": ("a.tsv", TSV.replace("\n", "\t\t\n"), None),
    "trimmed tab": ("a.tsv", TSV + "5.3\t5.4\n", "lines without a text, passed over: 1"),
    "milliseconds": ("a.tsv", table(lambda w, a, b: f"{a * 1000:g}\t{b * 1000:g}\t{w}"), "times in milliseconds"),
    "HTK's units": ("a.tsv", table(lambda w, a, b: f"{a * 1e7:.0f} {b * 1e7:.0f} {w}"), "times in units of 100 ns"),
    "durations": ("a.tsv", table(lambda w, a, b: f"{a}\t{b - a:.3f}\t{w}"), "durations in place of ends"),
    "durations in milliseconds": (
        "a.tsv",
        table(lambda w, a, b: f"{a * 1000:g}\t{(b - a) * 1000:.0f}\t{w}"),
        "times in milliseconds, durations in place of ends",
    ),
    "clock times": ("a.tsv", table(lambda w, a, b: f"{clock(a, '.')}\t{clock(b, '.')}\t{w}"), "clock times"),
    "Audacity": ("a.tsv", TSV.replace("\n", "\n\\\t100.0\t2000.0\n"), "lines of frequencies, as Audacity writes them"),
    "spaces": ("a.tsv", TSV.replace("\t", " "), None),
    "CSV": ("a.csv", table(lambda w, a, b: f"{a},{b},{w}", "start,end,word\n"), "commas between columns, a header"),
    "CSV without a header": ("a.csv", table(lambda w, a, b: f'{a},{b},"{w}"'), "commas between columns"),
    "CSV of a spreadsheet": ("a.csv", TSV.replace(".", ",").replace("\t", ";"), "semicolons between columns, decimal commas"),
    "table in a .txt": ("a.txt", TSV, "read as a table, whatever its ending says"),
    "long TextGrid": ("a.TextGrid", long_textgrid([("words", filled(WORDS)), ("phones", [("s", 0.1, 0.2)])]), "tier 'words'"),
    "short TextGrid": ("a.textgrid", short_textgrid("Ann - words", filled(WORDS)), "tier 'Ann - words'"),
    "TextGrid in UTF-16": ("a.TextGrid", short_textgrid("x", filled(WORDS)).encode("utf-16"), "in UTF-16; read as Praat TextGrid with tier 'x'"),
    "SRT": ("a.srt", "\n".join(f"{n}\n{a} --> {b}\n{w}\n" for n, (a, b, w) in enumerate(CUES, 1)), "read as SRT"),
    "WebVTT": (
        "a.vtt",
        "WEBVTT\nKind: captions\n\nNOTE of no use\n\n"
        + "\n".join(f"{a[3:].replace(',', '.')} --> {b.replace(',', '.')} line:0\n<v Ann>{w}</v>\n" for a, b, w in CUES),
        "read as WebVTT",
    ),
    "WebVTT with times of words": (
        "a.vtt",
        "WEBVTT\n\n00:00.100 --> 00:02.250\nso<00:00:00.400> <00:00:00.500><c> it's</c><00:00:00.900> <00:00:01.200><c> a</c>"
        "<00:00:01.300> <00:00:01.500><c> well-known</c>\n\n00:02.250 --> 00:02.260\nso it's a well-known\n\n"
        "00:03.000 --> 00:05.250\nso it's a well-known\nthing<00:00:03.750> <00:00:04.000><c> 2014</c><00:00:04.500><c> okay</c>\n",
        "times within cues",
    ),
    "Whisper JSON": (
        "a.json",
        json.dumps({"text": "", "segments": [{"start": 0.1, "end": 5.25, "text": "", "words": objects(probability=0.9)}], "language": "en"}),
        "read as JSON with entries of Whisper",
    ),
    "WhisperX JSON": (
        "a.json",
        json.dumps({"segments": [{"start": 0, "end": 6, "words": objects(score=0.5)}], "word_segments": objects()}),
        "entries of WhisperX",
    ),
    "whisper.cpp": (
        "a.json",
        json.dumps({"transcription": [{"offsets": {"from": a * 1000, "to": b * 1000}, "text": f" {w}"} for w, a, b in WORDS]}),
        "whisper.cpp",
    ),
    "Seamless Interaction": (
        "a.json",
        json.dumps({"id": "V0", "metadata:vad": [], "metadata:transcript": [{"words": objects(), "start": 0, "end": 6, "transcript": ""}]}),
        "Seamless",
    ),
    "aeneas": (
        "a.json",
        json.dumps({"fragments": [{"begin": f"{a:.3f}", "end": f"{b:.3f}", "lines": [w], "children": []} for w, a, b in WORDS]}),
        "aeneas",
    ),
    "Gentle, in a .txt": (
        "a.txt", json.dumps({"transcript": "", "words": objects(case="success", alignedWord="x")}), "JSON with words, whatever",
    ),
    "Vosk": ("a.json", json.dumps({"result": objects(conf=1.0), "text": "so"}), "Vosk"),
    "list of words in milliseconds": (
        "a.json",
        json.dumps([{"text": w, "start": a * 1000, "end": b * 1000} for w, a, b in WORDS]),
        "times in milliseconds",
    ),
    "CTM": ("a.ctm", table(lambda w, a, b: f"a 1 {a} {b - a:.3f} {w} 0.98", ";; from x\n"), "read as CTM"),
    "CTM of a corpus": (
        "a.ctm",
        table(lambda w, a, b: f"a A {a} {b - a:.3f} {w}") + "b A 0.0 0.5 no\n",
        "words of other recordings, passed over: 1",
    ),
}  # fmt: skip


def write(folder, name, content):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


@pytest.mark.parametrize(("name", "content", "note"), DIALECTS.values(), ids=DIALECTS)
def test_every_dialect_gives_the_same_words_and_times(tmp_path, name, content, note):
    words, notes = transcripts.read(write(tmp_path, name, content), DURATION)
    assert [word.text for word in words] == [word for word, _, _ in WORDS]
    for word, (_, start, end) in zip(words, WORDS, strict=True):
        assert (word.start, word.end) == (pytest.approx(start, abs=1e-3), pytest.approx(end, abs=1e-3))
    assert notes == [] if note is None else len(notes) == 1 and note in notes[0] and notes[0].startswith(f"{name}: ")


def test_whisper_segments_are_spread_by_syllables(tmp_path):
    path = write(tmp_path, "a.tsv", "start\tend\ttext\n0\t3000\tA banana, please.\n4000\t5000\tyes\n")
    words, notes = transcripts.read(path, DURATION)
    assert [(word.text, round(word.start, 3), round(word.end, 3)) for word in words] == [
        ("a", 0.0, 0.6), ("banana", 0.6, 2.4), ("please", 2.4, 3.0), ("yes", 4.0, 5.0),
    ]  # fmt: skip
    assert notes == [
        "a.tsv: read as a table with a header, times in milliseconds, words spread over each row by syllables"
    ]


def test_cues_are_spread_by_syllables_without_marks_and_tags(tmp_path):
    text = "1\n00:00:00,000 --> 00:00:03,000\n- <i>A banana</i>,\n[laughs] please &amp; ♪\n"
    words, notes = transcripts.read(write(tmp_path, "a.srt", text), DURATION)
    assert [(word.text, round(word.start, 3)) for word in words] == [("a", 0.0), ("banana", 0.6), ("please", 2.4)]
    (note,) = notes
    assert note.startswith("a.srt: read as SRT with words spread over each cue by syllables; marks") and note.endswith(
        ": 2"
    )


def test_words_without_times_are_placed_between_their_neighbours(tmp_path):
    words = [
        {"word": "in", "start": 1.0, "end": 1.2},
        {"word": "2014"},
        {"word": "we", "start": 1.8, "end": 2.0},
        {"word": "met"},
    ]
    path = write(tmp_path, "a.json", json.dumps({"segments": [{"start": 1, "end": 3, "words": words}]}))
    found, notes = transcripts.read(path, DURATION)
    assert [(word.text, round(word.start, 3), round(word.end, 3)) for word in found] == [
        ("in", 1.0, 1.2), ("2014", 1.2, 1.8), ("we", 1.8, 2.0), ("met", 2.0, 2.333),
    ]  # fmt: skip
    assert notes[0].endswith("; words without times, placed between their neighbours: 2")


def test_durations_are_known_though_some_words_overlap(tmp_path):
    rows = [f"{k}\t{1.1 if k % 5 == 4 else 0.9}\tw{k}\n" for k in range(20)]
    words, notes = transcripts.read(write(tmp_path, "a.tsv", "".join(rows)), 21.0)
    assert [(word.start, round(word.end, 3)) for word in words[3:5]] == [(3.0, 3.9), (4.0, 5.1)]
    assert notes == ["a.tsv: read as a table with durations in place of ends; words that overlap the next one: 3"]


def test_one_wrong_row_is_no_other_dialect(tmp_path):
    """What only a few rows say is a mistake of theirs, and is told as such."""
    path = write(tmp_path, "a.tsv", TSV + "5.5\t5.3\tlate\n")
    words, notes = transcripts.read(path, DURATION)
    assert len(words) == len(WORDS) and notes == ["a.tsv: words that end before they start, dropped: 1"]
    path = write(tmp_path, "a.tsv", TSV + "100\t200\tbeyond\n")
    assert transcripts.read(path, DURATION)[1] == ["a.tsv: words outside the audio, dropped: 1"]
    words, notes = transcripts.read(write(tmp_path, "a.tsv", "100.5\t101\thi\n102\t103\tyou\n"), DURATION)
    assert words == () and "no word of it lies in the audio of 6.0 s; is it another recording's?" in notes[-1]


@pytest.mark.parametrize(
    "text",
    [
        "Time to start, text me.",
        "From 10 to 20 people came.\n5 of them left.",
        "[1] So it goes.",
        "Yes --> no",
        "{ok} fine",
        "Start. End.",
    ],
)
def test_a_text_is_no_table(tmp_path, text):
    words, notes = transcripts.read(write(tmp_path, "a.txt", text), DURATION)
    assert words == () and notes[0].startswith("a.txt: a text without times, so its words are not used; ")


REFUSED = {
    "both kinds of decimals": ("a.tsv", "0.1\t0.3\ta\n0,4\t0,5\tb\n", "decimal commas and decimal points"),
    "TextGrid cut off": ("a.TextGrid", long_textgrid([("words", WORDS)])[:300], "damaged or no TextGrid|no tier"),
    "TextGrid of phones and more": ("a.TextGrid", long_textgrid([("x", WORDS), ("y", WORDS)]), "which tier holds the words"),
    "no TextGrid": ("a.TextGrid", "hello", "damaged or no TextGrid"),
    "cue without times": ("a.srt", "1\n00:00:00,100 --> 00:00:00,300\nhi\n\n2\nyou\n", r"a\.srt:5: no times of a cue"),
    "cue with odd times": ("a.srt", "1\n00:00:00,100 --> 00:00:00,300\nhi\n\n2\n00:00:61,0 --> x\nyou\n", r"a\.srt:6: .* are no times"),
    "no JSON": ("a.json", '{"segments": [', r"not valid JSON"),
    "NaN": ("a.json", '{"words": [{"word": "a", "start": NaN, "end": 1}]}', "NaN is no number"),
    "a word's time": ("a.json", '{"words": [{"word": "a", "start": "soon", "end": 1}]}', "words, entry 1: start is soon, not a time"),
    "no times at all": ("a.json", '{"words": [{"word": "a"}]}', "no word has a start and an end"),
    "CTM of others": ("a.ctm", "x 1 0 1 hi\ny 1 0 1 hi\n", r"has 2 recordings \(x, y\), none of them a"),
    "CTM of two channels": ("a.ctm", "a 1 0 1 hi\na 2 0 1 hi\n", "channels 1 and 2"),
    "CTM with a word for a time": ("a.ctm", "a 1 0 1 hi\na 1 x 1 hi\n", r"a\.ctm:2: column 3 is 'x', not a start"),
    "conflict": ("a.srt", "<<<<<<< HEAD\n1\n00:00:00,100 --> 00:00:00,300\nhi\n", "merge conflict marker"),
}  # fmt: skip


@pytest.mark.parametrize(("name", "content", "match"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_right_is_refused_in_one_line(tmp_path, name, content, match):
    path = write(tmp_path, name, content)
    with refused(DataError, match, path):
        transcripts.read(path, DURATION)


@pytest.mark.parametrize(
    ("name", "content", "match"),
    [
        ("a.json", '{"names": ["jawOpen"], "frames": [{"weights": [0.1], "time": 0}]}', "movements of the face, as BEAT has them"),
        ("a.json", '{"take": 3}', r"JSON without words and times \(it has: take\)"),
        ("a.json", "[[1, 2]]", "a list without words and times"),
        ("a.csv", "prefix,id\na,5\n", "neither words with times nor a text"),
        ("a.txt", "01_beat_align\t0\t68.0\t68.0\t0.1\n", "neither words with times nor a text"),
    ],
    ids=["face", "JSON", "numbers", "CSV", "gesture labels"],
)  # fmt: skip
def test_other_files_of_such_endings_are_no_transcripts(tmp_path, name, content, match):
    path = write(tmp_path, name, content)
    with refused(NotATranscript, match, path):
        transcripts.read(path, DURATION)


@pytest.mark.parametrize(("name", "n_words"), [("acoustic_corpus", 58), ("cold_corpus3", 61)])
def test_real_textgrids(name, n_words):
    words, notes = transcripts.read(data_folder() / f"speech/mfa/{name}.TextGrid", 30.0)
    assert len(words) == n_words and "read as Praat TextGrid with tier 'words'" in notes[0]
