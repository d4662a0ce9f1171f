"""What the site reads of docstrings that its parser does not: one-line entries, comments at fields.

An argument is described in its own line (``width, height : Sizes in pixels.``), where numpydoc has
its type. The parser gets an entry for each name, with its description below it. Fields of a data
class are described by the comments behind or above them; these become its attributes.
"""

import re
from typing import Any

import griffe

_SECTION = re.compile(r"\n\n(Parameters|Attributes|Returns|Yields|Raises)\n-+\n")
_ENTRY = re.compile(r"^(\*{0,2}[\w.]+(?:, \*{0,2}[\w.]+)*) : (.*(?:\n {4}.*)*)", re.M)
_COMMENT = re.compile(r"(?:^|\s\s)# (.*)")


def apart(text: str) -> str:
    """A docstring with an entry of two lines or more for each of the names in its sections."""
    def entries(found: re.Match[str]) -> str:
        return "\n".join(f"{name}\n    {found[2]}" for name in found[1].split(", "))

    head, *sections = re.split(r"(?=\n\n\w+\n-{3})", text)
    return head + "".join(
        _ENTRY.sub(entries, section) if _SECTION.match(section) else section
        for section in sections)


def commented(lines: list[str], first: int, last: int) -> str:
    """The comment behind a field's lines (counted from 0), or the one above them."""
    if behind := _COMMENT.search(lines[last]):
        return behind[1]
    above = []
    while first and (found := re.fullmatch(r"\s*# (.*)", lines[first - 1])):
        above.insert(0, found[1])
        first -= 1
    return " ".join(above)


def attributes(lines: list[str], fields: dict[str, tuple[int, int]]) -> str:
    """The section of attributes that the comments at a data class's fields make."""
    shown = {}
    for name, (first, last) in fields.items():
        text = commented(lines, first, last)
        names, mark, rest = text.partition(": ")
        if mark and name in names.split(", ") and re.fullmatch(r"\w+(, \w+)+", names):
            shown |= dict.fromkeys(names.split(", "), rest)
        elif text:
            shown[name] = text
    return "\n\nAttributes\n----------\n" + "".join(
        f"{name} : {text}\n" for name, text in shown.items()) if shown else ""


class Docstrings(griffe.Extension):
    """Completes the docstrings of all that is read."""

    def on_object(self, *, obj: griffe.Object, loader: griffe.GriffeLoader, **_: Any) -> None:
        """Complete one object's docstring."""
        if obj.docstring is None:
            return
        text = obj.docstring.value
        if isinstance(obj, griffe.Class) and "\nAttributes\n---" not in text:
            lines = obj.source.splitlines()
            text += attributes(lines, {
                name: (entry.lineno - obj.lineno, entry.endlineno - obj.lineno)
                for name, entry in obj.members.items()
                if isinstance(entry, griffe.Attribute) and entry.lineno and entry.endlineno
                and entry.annotation is not None and entry.docstring is None})
        obj.docstring.value = apart(text)
