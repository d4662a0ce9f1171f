"""Hooks of MkDocs: what code hosts and docstrings write otherwise than the site.

A page may link to the source; the site holds pages alone. The texts of such links are the names of
the files, so the texts stay. Docstrings announce code with two colons, as Python's own do.
"""

import re
from typing import Any

_OUTSIDE = re.compile(
    r"\[([^\]\[]+)\]\((?:\.\./)+(?:src|scripts|tests|examples|[A-Z]+\.md)[^)\s]*\)")


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Take the links to files outside docs/ from the Markdown of a page; their texts stay."""
    return _OUTSIDE.sub(r"\1", markdown)


def on_page_content(html: str, **_: Any) -> str:
    """Make one colon of two at the end of a paragraph in the HTML of a page."""
    return html.replace("::</p>", ":</p>")
