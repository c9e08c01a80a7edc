"""Pronunciations of English words that no dictionary has: numbers, names run together, initials, and by rule.

Phones are those of the CMU Pronouncing Dictionary without stress, such as `HH AH L OW`.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from types import ModuleType

Lookup = Callable[[str], str | None]

_PARTS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z']+|[0-9][0-9,]*(?:\.[0-9]+)?(?:st|nd|rd|th|s)?|[$€£%&+@]")
_SIGNS = {"$": "dollars", "€": "euros", "£": "pounds", "%": "percent", "&": "and", "+": "plus", "@": "at"}
_VOWELS = "aeiouy"
# Letters, longest first, and their phones; a place marked by ^ is the beginning of a word, by $ its end.
_RULES = (
    ("tion", "SH AH N"), ("sion", "ZH AH N"), ("ough", "AO"), ("augh", "AO"), ("eigh", "EY"), ("tch", "CH"), ("igh", "AY"),
    ("dge", "JH"), ("sch", "S K"), ("oor", "AO R"), ("ear", "IH R"), ("air", "EH R"), ("^kn", "N"), ("^wr", "R"), ("^ps", "S"),
    ("ch", "CH"), ("sh", "SH"), ("th", "TH"), ("ph", "F"), ("wh", "W"), ("gh", "G"), ("ck", "K"), ("ng", "NG"), ("qu", "K W"),
    ("ee", "IY"), ("ea", "IY"), ("ai", "EY"), ("ay", "EY"), ("oa", "OW"), ("oo", "UW"), ("ou", "AW"), ("ow", "OW"), ("oi", "OY"),
    ("oy", "OY"), ("au", "AO"), ("aw", "AO"), ("eu", "UW"), ("ew", "UW"), ("ie", "IY"), ("ei", "EY"), ("ey", "IY"), ("ue", "UW"),
    ("ui", "UW"), ("ar", "AA R"), ("er", "ER"), ("ir", "ER"), ("ur", "ER"), ("or", "AO R"), ("ce", "S EH"), ("ci", "S IH"),
    ("cy", "S IY"), ("ge", "JH EH"), ("gi", "JH IH"), ("^x", "Z"), ("^y", "Y"), ("y$", "IY"), ("o$", "OW"), ("a$", "AH"),
    ("i$", "IY"), ("a", "AE"), ("b", "B"), ("c", "K"), ("d", "D"), ("e", "EH"), ("f", "F"), ("g", "G"), ("h", "HH"), ("i", "IH"),
    ("j", "JH"), ("k", "K"), ("l", "L"), ("m", "M"), ("n", "N"), ("o", "AA"), ("p", "P"), ("q", "K"), ("r", "R"), ("s", "S"),
    ("t", "T"), ("u", "AH"), ("v", "V"), ("w", "W"), ("x", "K S"), ("y", "IH"), ("z", "Z"),
)  # fmt: skip
_LETTERS = dict(
    zip(
        "abcdefghijklmnopqrstuvwxyz",
        ("EY", "B IY", "S IY", "D IY", "IY", "EH F", "JH IY", "EY CH", "AY", "JH EY", "K EY", "EH L", "EH M", "EH N", "OW",
         "P IY", "K Y UW", "AA R", "EH S", "T IY", "Y UW", "V IY", "D AH B AH L Y UW", "EH K S", "W AY", "Z IY"),
        strict=True,
    )
)  # fmt: skip


def pronounce(word: str, lookup: Lookup) -> tuple[list[str], bool]:
    """Pronounce a word as it is written, and tell whether a rule had to guess; empty for a word without Latin letters.

    lookup : phones of a word in lower case, or None for one that the dictionary does not have
    """
    word = word.replace("\N{RIGHT SINGLE QUOTATION MARK}", "'")
    bare = re.sub(r"[^\w']", "", word).strip("'").lower()
    if (found := lookup(bare)) is not None:
        return [found], False
    ways, guessed = [""], False
    for part in _PARTS.findall(word):
        own, by_rule = _part(part, lookup)
        guessed |= by_rule
        ways = [f"{before} {after}".strip() for before in ways for after in own][:4]
    return [way for way in ways if way], guessed


def _part(part: str, lookup: Lookup) -> tuple[list[str], bool]:
    """Pronounce a run of letters or digits, or a sign, and tell whether a rule guessed."""
    if part in _SIGNS:
        part = _SIGNS[part]
    if part[0].isdigit():
        return [way for text in _spoken(part) if (way := _spelled_out(text, lookup))], False
    lower = part.strip("'").lower()
    if not lower:
        return [""], False
    if (found := lookup(lower)) is not None:
        return [found], False
    if part.isupper() and (len(part) <= 4 or not any(letter in _VOWELS for letter in lower)):
        return [" ".join(_LETTERS[letter] for letter in lower)], False
    if lower.endswith("'s") and (found := lookup(lower[:-2])) is not None:
        return [f"{found} Z"], False
    return [by_rule(lower)], True


def _spoken(number: str) -> list[str]:
    """Spell a number in words: as a quantity and, of four digits, also as a year."""
    engine = _inflect().engine()
    ordinal = re.sub(r"(st|nd|rd|th|s)$", "", number)
    digits = ordinal.replace(",", "")
    if len(digits.partition(".")[0]) > 12:
        return [" ".join(engine.number_to_words(digit) for digit in digits if digit.isdigit())]
    ending = number[len(ordinal) :]
    ways = [engine.number_to_words(digits + ending if ending not in ("", "s") else digits)]
    if len(digits) == 4 and digits.isdigit():
        ways.append(engine.number_to_words(digits, group=2, zero="oh"))
    return ways


def _spelled_out(text: str, lookup: Lookup) -> str:
    """Look up the phones of all words of a text and join them."""
    return " ".join(found for word in re.findall("[a-z]+", text.lower()) if (found := lookup(word)))


def _inflect() -> ModuleType:
    """Import inflect, or tell how to install it."""
    from gesturegen.extras import need

    return need("inflect", "align")


def by_rule(word: str) -> str:
    """Pronounce a word in lower case by the commonest sounds of its letters."""
    # A silent e at the end lengthens the vowel before the last consonant.
    letters = re.sub("[^a-z]", "", word)
    long = {"a": "EY", "e": "IY", "i": "AY", "o": "OW", "u": "UW"}
    silent = re.fullmatch(r"(.*)([aeiou])([bcdfgklmnprstvz])e", letters)
    if silent:
        start, vowel, last = silent.groups()
        soft = {"c": "S", "g": "JH"}.get(last)
        return " ".join(filter(None, [_by_letters(start), long[vowel], soft or _by_letters(last)]))
    return _by_letters(letters)


def _by_letters(letters: str) -> str:
    """Convert letters to phones from left to right, each time by the first rule that fits."""
    phones, place = [], 0
    while place < len(letters):
        for pattern, sound in _RULES:
            bare = pattern.strip("^$")
            fits = letters.startswith(bare, place)
            fits &= not pattern.startswith("^") or place == 0
            fits &= not pattern.endswith("$") or (place > 0 and place + len(bare) == len(letters))
            if fits:
                phones.append(sound)
                place += len(bare)
                break
        if place < len(letters) and place and letters[place] == letters[place - 1] and letters[place] not in _VOWELS:
            place += 1  # a double consonant is one sound
    return " ".join(phones)
