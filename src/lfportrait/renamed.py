"""Parameters that were renamed: their old names work for one version, with a warning."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Sequence
from typing import Any, TypeVar

__all__ = ["NEW_NAMES", "accepts_old_names", "new_words"]

NEW_NAMES = {
    "finest": "resolution", "at_most": "max_resolution", "averaged": "polyak_fraction",
    "sweep": "mvs_init", "close": "fill_back", "trim": "cut_base", "slack": "tolerance",
    "gain": "min_improvement", "calm_levels": "background_levels", "polish": "final_3x3",
    "steadiness": "view_gain", "agree": "patchmatch",
}
"""By the old name."""

_Class = TypeVar("_Class", bound=type)


def _warn(old: str, new: str, level: int) -> None:
    warnings.warn(f"{old} is {new} now; the old name will go with the next version",
                  stacklevel=level + 1)


def accepts_old_names(kind: _Class) -> _Class:
    """Let a data class take its fields by their old names, too (`NEW_NAMES`)."""
    given: Any = kind.__init__  # type: ignore[misc]

    @functools.wraps(given)
    def initialise(self: Any, *values: Any, **named: Any) -> None:
        fields = kind.__dataclass_fields__  # type: ignore[attr-defined]
        for old in [name for name in named if name not in fields and NEW_NAMES.get(name) in fields]:
            _warn(old, NEW_NAMES[old], 2)
            named[NEW_NAMES[old]] = named.pop(old)
        given(self, *values, **named)

    kind.__init__ = initialise  # type: ignore[misc]
    return kind


def new_words(words: Sequence[str], known: Sequence[str]) -> list[str]:
    """A command's words with the options' new names.

    Parameters
    ----------
    words
        As they were typed.
    known
        Names of the options that there are; an old name that is one of them stays.
    """
    found = []
    for word in words:
        name, sign, value = word.partition("=")
        head, dot, last = name.rpartition(".")
        head, last = (head, last) if dot else ("--", name.removeprefix("--"))
        no = "no-" if last.startswith("no-") else ""
        old = last.removeprefix("no-").replace("-", "_")
        if name.startswith("--") and old in NEW_NAMES and name not in known:
            new = f"{head}{dot}{no}{NEW_NAMES[old].replace('_', '-')}"
            if new in known:
                _warn(name, new, 2)
                word = f"{new}{sign}{value}"
        found.append(word)
    return found
