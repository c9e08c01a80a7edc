"""Results of tasks that were done clip by clip."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


@dataclass
class Outcome:
    """The result, error or bug of each clip, by name in sorted order.

    done : results; errors : one line each, the user's to mend; bugs : tracebacks, ours to mend
    """

    done: dict[str, Any] = field(default_factory=dict)
    errors: dict[str, str] = field(default_factory=dict)
    bugs: dict[str, str] = field(default_factory=dict)

    @property
    def failed(self) -> int:
        """Count the clips that failed."""
        return len(self.errors) + len(self.bugs)
