"""Names that stand inside other files: many readers end them at a space or garble their letters."""

from __future__ import annotations

import hashlib
import re
import unicodedata

__all__ = ["plain_stem"]

LONGEST = 60
"""Letters that are kept of a name that is not plain."""
_PLAIN = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")
_ODD = re.compile(r"[^A-Za-z0-9_.-]+")


def plain_stem(stem: str) -> str:
    """A file's name without its ending, in ASCII letters, digits and ``-``, ``_``, ``.``.

    A plain name stays. Others get six digits of their hash, so that ``a b`` and ``a_b`` in one
    folder have files of their own, and the same name gives the same files again.
    """
    if _PLAIN.fullmatch(stem):
        return stem
    # Some file systems take letters apart that others keep together.
    stem = unicodedata.normalize("NFC", stem)
    letters = "".join(letter for letter in unicodedata.normalize("NFKD", stem)
                      if not unicodedata.combining(letter))
    # A reader would take a dash at the start for an option.
    kept = _ODD.sub("_", letters)[:LONGEST].strip("_.-") or "portrait"
    return f"{kept}-{hashlib.sha256(stem.encode('utf-8', 'surrogateescape')).hexdigest()[:6]}"
