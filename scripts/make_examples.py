"""Write the pages of the examples and of the public names; draw the examples' pictures.

The examples are the one source: title, text and code of a page are those of the program, and the
picture is the one that it wrote. The page of the API says of each name of ``lfportrait`` what it
is, by the first line of its docstring, and which examples use it.

Run: python scripts/make_examples.py                writes docs/examples/ and docs/api/index.md
     python scripts/make_examples.py --check        exit code 1 if a page is not up to date
     python scripts/make_examples.py --run FOLDER   also runs all examples and takes their pictures
"""

from __future__ import annotations

import ast
import inspect
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

import lfportrait
from house import STAGES

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = ROOT / "examples"
PAGES = ROOT / "docs" / "examples"
NAMES = ROOT / "docs" / "api" / "index.md"
PICTURES = ROOT / "docs" / "images" / "examples"
WIDEST = 1200
"""Pixels of a picture on a page."""

INDEX = """# Examples

<!-- Written by scripts/make_examples.py from examples/; don't edit this page. -->

Short programs that use the public names of `import lfportrait as lf` and no others. They run on the
head that the package brings; the first writes the files that the others read. The tests run all of
them on small data.
"""
NOTE = "<!-- Written by scripts/make_examples.py from examples/{file}; don't edit this page. -->"

API = """---
search:
  boost: 0.2
---

# API

<!-- Written by scripts/make_examples.py from src/lfportrait/__init__.py; don't edit this page. -->

These are the public names: those of `import lfportrait as lf`. What is promised of them is under
"Versions and deprecation" in [CONTRIBUTING.md](../../CONTRIBUTING.md#versions-and-deprecation).
Each stage has its own page with the names of its package, for those who work on it; these, and all
other names, may change without notice. The fields of the configuration classes are also listed
under [Parameters](../parameters.md).
"""


@dataclass(frozen=True)
class Example:
    """What a page shows of an example.

    Attributes
    ----------
    path : The program.
    title, subtitle : Of its first line, before and after the colon.
    text : The rest of its docstring: key concepts, and what it writes.
    run : The command.
    code : The program without its docstring.
    """

    path: Path
    title: str
    subtitle: str
    text: str
    run: str
    code: str

    @staticmethod
    def read(path: Path) -> Example:
        """An example, by its file."""
        source = path.read_text("utf-8")
        tree = ast.parse(source)
        head, text, run = (ast.get_docstring(tree) or "").split("\n\n")
        title, _, subtitle = head.rstrip(".").partition(": ")
        end = tree.body[0].end_lineno or 0
        code = "\n".join(source.splitlines()[end:]).strip("\n")
        return Example(path, title, subtitle, " ".join(text.split()), run.removeprefix("Run: "),
                       code)

    @property
    def name(self) -> str:
        """Of its page and its picture: that of the file without the number."""
        return self.path.stem.partition("_")[2]

    @property
    def picture(self) -> str:
        """File that it writes and its page shows: the last one that its docstring names."""
        return re.findall(r"\b[\w.]+\.png\b", self.text)[-1]

    @property
    def drawn(self) -> bool:
        """Whether its picture was taken (``--run``); without one its page has none."""
        return (PICTURES / f"{self.name}.jpg").is_file()

    def page(self) -> str:
        """Its page, as Markdown."""
        subtitle = self.subtitle[:1].upper() + self.subtitle[1:]
        return "\n\n".join([
            f"# {self.title}", NOTE.format(file=self.path.name), f"{subtitle}.",
            *([f"![{self.title}](../images/examples/{self.name}.jpg)"] if self.drawn else []),
            self.text,
            f"[examples/{self.path.name}](../../examples/{self.path.name})",
            f"```\n{self.run}\n```", f"```python\n{self.code}\n```"]) + "\n"


def examples() -> list[Example]:
    """All examples, in their order."""
    return [Example.read(path) for path in sorted(EXAMPLES.glob("[0-9]*.py"))]


def pages() -> dict[Path, str]:
    """All pages."""
    found = examples()
    rows = ["| | |", "| --- | --- |", *(
        f"| {f'[![{one.title}](../images/examples/{one.name}.jpg)]({one.name}.md)' * one.drawn} "
        f"| [**{one.title}**]({one.name}.md)<br>{one.subtitle} |" for one in found)]
    return {NAMES: names_page(), PAGES / "index.md": INDEX + "\n" + "\n".join(rows) + "\n",
            **{PAGES / f"{one.name}.md": one.page() for one in found}}


def home(name: str) -> str:
    """The stage that a public name is from, or "" for the shared modules."""
    thing = getattr(lfportrait, name)
    module = getattr(thing, "__module__", None) or getattr(thing, "__name__", "")
    package = f"{module}..".split(".")[1]
    return package if package in STAGES else ""


def meaning(name: str) -> str:
    """The first sentence of a public name's docstring."""
    thing = getattr(lfportrait, name)
    if inspect.ismodule(thing):  # a stage that stands for its function
        thing = getattr(thing, name)
    text = inspect.getdoc(thing) or ""
    return " ".join(text.split("\n\n")[0].split()).replace("|", "\\|")


def names_page() -> str:
    """The page of the public names."""
    found = examples()
    parts = [API]
    for package in (*STAGES, ""):
        names = [name for name in lfportrait.__all__ if name != "__version__"
                 and home(name) == package]
        if not names:
            continue
        parts += [f"## [`{package}`]({package}.md)\n" if package else "## Shared modules\n",
                  "| name | what it is | used by |", "| --- | --- | --- |"]
        for name in sorted(names, key=str.lower):
            users = ", ".join(f"[{one.name}](../examples/{one.name}.md)" for one in found
                              if re.search(rf"\blf\.{name}\b", one.code))
            parts.append(f"| `lf.{name}` | {meaning(name)} | {users} |")
        parts.append("")
    return "\n".join([*parts, "::: lfportrait", ""])


def draw(folder: Path) -> None:
    """Run all examples, and take their pictures."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    for one in examples():
        print(one.path.name, flush=True)
        code = ("import runpy, sys, pathlib; "
                "runpy.run_path(sys.argv[1])['main'](pathlib.Path(sys.argv[2]))")
        subprocess.run([sys.executable, "-c", code, str(one.path), str(folder)], check=True)
        with Image.open(folder / one.picture) as picture:
            picture.thumbnail((WIDEST, WIDEST), Image.Resampling.LANCZOS)
            picture.convert("RGB").save(PICTURES / f"{one.name}.jpg", quality=88, optimize=True)


def main(arguments: list[str]) -> int:
    if arguments[:1] == ["--run"]:
        draw(Path(arguments[1]))
    stale = [path for path, text in pages().items()
             if not path.is_file() or path.read_text("utf-8") != text]
    if arguments == ["--check"]:
        for path in stale:
            print(f"{path.relative_to(ROOT)} is not up to date: run scripts/make_examples.py")
        return 1 if stale else 0
    PAGES.mkdir(exist_ok=True)
    written = pages()
    for path in stale:
        path.write_text(written[path], "utf-8")
        print(path.relative_to(ROOT))
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
