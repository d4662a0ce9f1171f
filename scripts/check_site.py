"""Check that a built site asks no network for scripts, styles, fonts or pictures.

    python scripts/check_site.py site

Links that a reader may follow are fine. What is loaded from elsewhere is listed, with exit code 1.
"""

from __future__ import annotations

import re
import sys
from html.parser import HTMLParser
from pathlib import Path

LOADING = {
    "script": ("src",), "img": ("src", "srcset"), "iframe": ("src",), "source": ("src", "srcset"),
    "video": ("src", "poster"), "audio": ("src",), "track": ("src",), "embed": ("src",),
    "object": ("data",), "input": ("src",), "use": ("href", "xlink:href"),
    "image": ("href", "xlink:href"), "link": ("href",),
}
"""Attributes, by tag, whose address a browser loads by itself."""
FOLLOWED = {"canonical", "next", "prev", "alternate", "license", "author", "help", "edit"}
"""Relations of a link that nobody loads."""

_AWAY = re.compile(r"(?:^|[\s,])((?:https?:)?//[^\s,]+)", re.IGNORECASE)
_STYLE = re.compile(r"""(?:url\(|@import)\s*["']?((?:https?:)?//[^"')\s;]+)""", re.IGNORECASE)


class Page(HTMLParser):
    """Collects the addresses elsewhere that a page loads."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []
        self.styled = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Look at the attributes of a tag."""
        values = {name: value or "" for name, value in attrs}
        self.styled = tag == "style"
        self.found += _STYLE.findall(values.get("style", ""))
        relations = set(values.get("rel", "").lower().split())
        if tag == "link" and relations and relations <= FOLLOWED:
            return
        for name in LOADING.get(tag, ()):
            self.found += _AWAY.findall(values.get(name, ""))

    def handle_data(self, data: str) -> None:
        """Look at a style sheet inside the page."""
        if self.styled:
            self.found += _STYLE.findall(data)


def loaded_from_elsewhere(path: Path) -> list[str]:
    """Addresses elsewhere that a page, a drawing or a style sheet loads."""
    text = path.read_text("utf-8")
    if path.suffix == ".css":
        return _STYLE.findall(text)
    page = Page()
    page.feed(text)
    return page.found


def main(arguments: list[str] | None = None) -> int:
    site = Path((arguments if arguments is not None else sys.argv[1:])[0])
    files = [path for path in sorted(site.rglob("*")) if path.suffix in (".html", ".css", ".svg")]
    if not any(path.suffix == ".html" for path in files):
        print(f"there are no pages in {site}")
        return 1
    found = [(path, address) for path in files for address in loaded_from_elsewhere(path)]
    for path, address in found:
        print(f"{path.relative_to(site)} loads {address}")
    if not found:
        print(f"{len(files)} pages, drawings and style sheets load nothing from elsewhere")
    return 1 if found else 0


if __name__ == "__main__":
    raise SystemExit(main())
