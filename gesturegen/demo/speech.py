"""The words of the demo speakers and their times: sentences, syllables, stress and pauses."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from gesturegen.demo.speaker import Speaker

# Every word as its syllables, the stressed one in capitals; a word without capitals is a function word.
_WORDS = {
    "noun": """WEEK-end SUM-mer MORN-ing FAM-i-ly MO-vie TEACH-er STU-dent MU-sic COF-fee GAR-den DIN-ner
        HOL-i-day PROB-lem QUES-tion PRO-ject MAR-ket VIL-lage BRO-ther SIS-ter FRIEND BOOK HOUSE CI-ty JOB
        im-POR-tance ex-PE-ri-ence con-ver-SA-tion com-PU-ter PA-per""",
    "place": "RI-ver MOUN-tain SCHOOL STA-tion li-BRA-ry mu-SE-um BEACH PARK OF-fice KIT-chen",
    "verb": """THINK LIKE WANT NEED LOVE re-MEM-ber FOR-get de-CIDE en-JOY FIN-ish un-der-STAND EX-er-cise
        START FIND TELL SHOW WATCH COOK TEACH LEARN""",
    "action": "WALK DRIVE RIDE EN-ter O-pen at-TACH TAKE MOVE",
    "direction": "NORTH SOUTH EAST WEST BACK FRONT a-WAY HERE a-ROUND",
    "count": "ONE TWO THREE FIRST SEC-ond THIRD",
    "sentiment": "CRA-zy in-CRED-i-ble sur-PRIS-ing",
    "adjective": "BIG SMALL HAP-py TI-red IN-ter-est-ing im-POR-tant BEAU-ti-ful DIF-fi-cult QUI-et NEW",
    "adverb": "REAL-ly AL-ways U-sual-ly SOME-times NE-ver AC-tual-ly",
    "amount": "MORE LESS MUCH FEW",
    "greeting": "HEY HI hel-LO",
    "name": "AN-na PE-ter LON-don PA-ris sa-MAN-tha",
    "subject": "i we they you he she",
    "function": """the a of to and but so in on at is was it my our that this with for if when than just
        be-cause then about CALLED VE-ry EV-ery GO WENT THING TIME things be""",
}

_TEMPLATES = """
    {greeting} my {noun} is called {name}
    so {subject} {adverb} {verb} to {action} to the {place}
    the {count} thing {subject} {verb} is the {adjective} {noun}
    and then {subject} went {direction} to the {place} with my {noun}
    it was {sentiment} and {adverb} {adjective}
    {subject} {verb} {amount} {noun} than the {noun}
    because the {noun} in the {place} is very {adjective}
    when {subject} {action} to the {place} {subject} {verb} the {noun}
    my {noun} is {direction} of the {adjective} {place}
    {subject} {verb} that {count} of my {noun} was {adverb} {adjective}
    but {subject} just {verb} the {noun} every {noun}
    a {noun} called {name} was in the {place}
    if {subject} {action} {direction} {subject} {verb} {amount} time
    {sentiment} things {verb} in the {noun} and the {noun}
    so the {adjective} {noun} is about the {adjective} {noun}
    {adverb} {subject} {verb} to {verb} the {noun} at the {place}
"""

# Categories whose words are keywords: a clip uses only some of them, so that tests hold what a reference lacks.
_KEYWORD_CATEGORIES = ("action", "direction", "count", "sentiment", "amount", "greeting")


@dataclass(frozen=True)
class Syllable:
    """One syllable in time: its spelling, seconds of start, vowel start and end, and stress 0 to 1."""

    text: str
    start: float
    vowel_start: float
    end: float
    stress: float


@dataclass(frozen=True)
class SpokenWord:
    """A word, or `#` for laughter, with its seconds and its syllables (none for laughter)."""

    text: str
    start: float
    end: float
    syllables: tuple[Syllable, ...]


@dataclass(frozen=True)
class Script:
    """All the words of a clip, with their times.

    seconds : length of the clip
    words : in order of time, not overlapping
    phrases : (start, end) seconds of every stretch without a pause
    rests : (start, end) seconds of the long pauses, and of the silence at both ends of the clip
    """

    seconds: float
    words: tuple[SpokenWord, ...]
    phrases: tuple[tuple[float, float], ...]
    rests: tuple[tuple[float, float], ...]


def _spellings() -> tuple[dict[str, tuple[str, ...]], dict[str, list[str]]]:
    """Load the syllables of every word, and the words of every category."""
    syllables: dict[str, tuple[str, ...]] = {}
    categories: dict[str, list[str]] = {}
    for category, text in _WORDS.items():
        for spelling in text.split():
            parts = tuple(spelling.split("-"))
            word = "".join(parts).lower()
            syllables[word] = parts
            categories.setdefault(category, []).append(word)
    return syllables, categories


SYLLABLES, CATEGORIES = _spellings()


def write_script(rng: np.random.Generator, speaker: Speaker, seconds: float) -> Script:
    """Fill `seconds` with sentences, short pauses, laughter and several pauses of 2 to 6 s."""
    rest_count = max(3, round(seconds / 20.0)) if seconds >= 40.0 else max(1, int(seconds / 12.0))
    # Long pauses come at sentence ends nearest to jittered, evenly spread times.
    rest_times = (np.arange(rest_count) + rng.uniform(0.55, 1.0, rest_count)) * seconds / (rest_count + 0.6)
    vocabulary = _clip_vocabulary(rng)
    words: list[SpokenWord] = []
    phrases: list[tuple[float, float]] = []
    time = rng.uniform(0.5, 1.5)
    rests = [(0.0, time)]
    next_rest = 0
    while True:
        said = _speak(rng, speaker, _sentence(rng, vocabulary), time)
        if said[-1].end > seconds - 0.6:
            break
        words += said
        phrases.append((said[0].start, said[-1].end))
        time = said[-1].end
        if next_rest < rest_count and time > rest_times[next_rest]:
            next_rest += 1
            pause = rng.uniform(2.3, 4.0) if rng.random() < 0.8 else rng.uniform(4.0, 5.9)
            rests.append((time, min(time + pause, seconds)))
        elif rng.random() < 0.07:
            laugh = _laughter(rng, time + rng.uniform(0.1, 0.3))
            words.append(laugh)
            time, pause = laugh.end, rng.uniform(0.3, 0.7)
        else:
            pause = rng.uniform(0.2, 0.8) if rng.random() < 0.6 else rng.uniform(0.03, 0.12)
        time += pause
    while words and words[-1].end > seconds - 0.1:
        words.pop()
    if rests[-1][0] == words[-1].end:
        rests.pop()
    rests.append((words[-1].end, seconds))
    return Script(seconds, tuple(words), tuple(phrases), tuple(rests))


def _clip_vocabulary(rng: np.random.Generator) -> dict[str, list[str]]:
    """Draw the words of one clip: of every keyword category about two thirds, of the others all."""
    chosen = {}
    for category, words in CATEGORIES.items():
        keep = max(1, round(len(words) * rng.uniform(0.45, 0.9))) if category in _KEYWORD_CATEGORIES else len(words)
        chosen[category] = [words[i] for i in sorted(rng.choice(len(words), keep, replace=False))]
    return chosen


def _sentence(rng: np.random.Generator, vocabulary: dict[str, list[str]]) -> list[str]:
    """Draw the words of a random template, its slots filled from `vocabulary`."""
    lines = [line.split() for line in _TEMPLATES.strip().splitlines()]
    sentence = []
    for part in lines[rng.integers(len(lines))]:
        slot = re.fullmatch(r"\{(\w+)\}", part)
        sentence.append(str(rng.choice(vocabulary[slot[1]])) if slot else part)
    return sentence


def _speak(rng: np.random.Generator, speaker: Speaker, sentence: list[str], start: float) -> list[SpokenWord]:
    """Time a sentence syllable by syllable: stressed ones longer, the last word drawn out."""
    words = []
    time = round(start, 3)
    for number, text in enumerate(sentence):
        last = number == len(sentence) - 1
        syllables = []
        for spelling in SYLLABLES[text]:
            stressed = spelling.isupper()
            mean = 0.25 if stressed else 0.12
            length = mean / speaker.rate * (1.35 if last else 1.0) * float(np.exp(rng.normal(0.0, 0.18)))
            # Some content words are said in passing; those carry little stress and no stroke.
            stress = (
                float(rng.uniform(0.55, 1.0) if rng.random() < 0.75 else rng.uniform(0.25, 0.5)) if stressed else 0.0
            )
            consonants = len(_split_syllable(spelling)[0])
            vowel_start = time + min(0.035 * consonants, 0.4 * length)
            syllables.append(Syllable(spelling.lower(), time, vowel_start, time + length, stress))
            time += length
        end = round(time, 3)
        words.append(SpokenWord(text, syllables[0].start, end, tuple(syllables)))
        time = end + (rng.uniform(0.02, 0.09) if rng.random() < 0.12 and not last else 0.0)
        time = round(time, 3)
    return words


def _laughter(rng: np.random.Generator, start: float) -> SpokenWord:
    """Make about a second of laughter from `start` seconds."""
    start = round(start, 3)
    return SpokenWord("#", start, round(start + rng.uniform(0.6, 1.1), 3), ())


def _split_syllable(spelling: str) -> tuple[str, str, str]:
    """Split a syllable as spelled into consonants, vowels, consonants; `y` is a vowel where no other is."""
    vowels = "aeiou" if re.search("[aeiou]", spelling.lower()) else "aeiouy"
    match = re.match(rf"([^{vowels}]*)([{vowels}]*)(.*)", spelling.lower())
    assert match is not None  # the pattern fits any text
    return match[1], match[2], match[3]


def consonants_and_vowel(syllable: Syllable) -> tuple[str, str, str]:
    """Return the consonants before the vowel, the first vowel letter, and the consonants after it."""
    before, vowel, after = _split_syllable(syllable.text)
    # The e of "take" is silent.
    return before, (vowel or "e")[0].replace("y", "i"), re.sub("e$", "", after)


def format_tsv(script: Script) -> str:
    """Format a script as lines `start<TAB>end<TAB>text` in seconds, one word a line, no header.

    Sentences have a capital and a full stop.
    """
    starts, ends = (set(times) for times in zip(*script.phrases, strict=True))
    lines = []
    for word in script.words:
        text = word.text.capitalize() if word.start in starts or word.text == "i" else word.text
        stop = "." if word.end in ends else ""
        lines.append(f"{word.start:.3f}\t{word.end:.3f}\t{text}{stop}\n")
    return "".join(lines)


def stressed_times(script: Script, least: float = 0.5) -> np.ndarray:
    """List the vowel starts in seconds of the syllables stressed at least `least`."""
    return np.array([s.vowel_start for word in script.words for s in word.syllables if s.stress >= least])
