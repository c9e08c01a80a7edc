"""Errors that the user can fix: one line each, shown without a traceback."""


class GesturegenError(Exception):
    """Error that says in one line what was found, where, and what to do."""


class DataError(GesturegenError):
    """Error about a recording, transcript, graph or folder that cannot be used."""


class ConfigError(GesturegenError):
    """Error about a config file or `--set` value that is not allowed."""


class SearchError(GesturegenError):
    """Error about a test speech for which the search found no path."""


class DamagedError(DataError):
    """Error about a stored file that is not as it was written; `run` makes it again."""
