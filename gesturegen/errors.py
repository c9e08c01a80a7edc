"""Errors that the user can fix: one line each, shown without a traceback."""


class GesturegenError(Exception):
    """Error that says what was found, where, and what to do, in one line for each mistake.

    Whatever it quotes of a file, each character is shown as one that can be printed.
    """

    def __init__(self, message: str):
        super().__init__("\n".join(map(printable, message.split("\n"))))


def printable(text: str) -> str:
    """Write characters that cannot be printed, line breaks among them, as Python's escapes."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


class DataError(GesturegenError):
    """Error about a recording, transcript, graph or folder that cannot be used."""


class ConfigError(GesturegenError):
    """Error about a config file or `--set` value that is not allowed."""


class DamagedError(DataError):
    """Error about a stored file that is not as it was written; `run` makes it again."""
