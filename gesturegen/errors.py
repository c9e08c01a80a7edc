"""Errors that are the user's to mend: one line each, shown without a traceback."""


class GesturegenError(Exception):
    """Says what was found, where, and what to do, in one line."""


class DataError(GesturegenError):
    """A recording, transcript, graph or folder that cannot be used."""


class ConfigError(GesturegenError):
    """A config file or `--set` value that is not allowed."""


class SearchError(GesturegenError):
    """A test speech for which the search found no path."""


class DamagedError(DataError):
    """A stored file that is not as it was written; `run` makes it again."""
