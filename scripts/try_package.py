"""Build the package, install it as a stranger would, and run it there.

All happens in a folder outside the checkout and in a virtual environment of its own, so that a file
that lies in the checkout but not in the package is missed here and not by a user. The wheel must
hold each file that git knows below src/, and the source distribution must build the same wheel.

Run: python scripts/try_package.py            builds, compares, installs, runs `demo --quick`,
                                          as a user without a home, too
     python scripts/try_package.py --build    only builds and compares
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
import venv
import zipfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
CONSTRAINTS = ROOT / "constraints.txt"


def say(text: str) -> None:
    print(f"{time.strftime('%H:%M:%S')} {text}", flush=True)


def run(*words: str | Path, folder: Path) -> None:
    """Run a program; nothing of ours is found but what is installed."""
    hidden = ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "NUMBA_CACHE_DIR")
    settings = {name: value for name, value in os.environ.items() if name not in hidden}
    subprocess.run([str(word) for word in words], cwd=folder, env=settings, check=True)


def environment(folder: Path, *packages: str | Path) -> Path:
    """The folder of programs of a new virtual environment with these packages."""
    venv.create(folder, with_pip=True)
    programs = folder / ("Scripts" if os.name == "nt" else "bin")
    run(programs / "python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check",
        "-c", CONSTRAINTS, *packages, folder=folder)
    return programs


def tracked(*folders: str) -> list[str]:
    """The files that git knows, as they are in the checkout."""
    listed = subprocess.run(["git", "ls-files", "-z", *folders], cwd=ROOT, check=True,
                            capture_output=True, text=True).stdout
    return [name for name in listed.split("\0") if name and (ROOT / name).is_file()]


def contents(wheel: Path) -> dict[str, bytes]:
    """The package's files in a wheel, without what tells about it."""
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist()
                if ".dist-info/" not in name}


def build(python: Path, source: Path, out: Path, kind: str) -> Path:
    """Build a wheel or a source distribution from a folder; the file."""
    run(python, "-m", "build", "--quiet", f"--{kind}", "--outdir", out, source, folder=source)
    return next(out.glob("*.whl" if kind == "wheel" else "*.tar.gz"))


def same(found: dict[str, bytes], expected: dict[str, bytes], what: str) -> None:
    """Stop with the differing names where two sets of files are not the same."""
    wrong = sorted(name for name in found.keys() | expected.keys()
                   if found.get(name) != expected.get(name))
    if wrong:
        sys.exit(f"{what} differ in: {', '.join(wrong)}")


def built(folder: Path) -> Path:
    """Build wheel and source distribution, and compare what they hold; the wheel."""
    python = environment(folder / "builder", "build") / "python"
    # Files of former builds that lie in the checkout would come into the wheel.
    tree = folder / "tree"
    for name in tracked():
        (tree / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, tree / name)
    sources = build(python, tree, folder / "sdist", "sdist")
    wheel = build(python, tree, folder / "wheel", "wheel")
    same(contents(wheel), _files("lfportrait"), "the wheel and src/lfportrait")
    # A distribution of its own: what users install does not bring it.
    other = build(python, tree / "src" / "lfportrait_eval", folder / "evaluation", "wheel")
    same(contents(other), _files("lfportrait_eval"), "its wheel and src/lfportrait_eval")
    with tarfile.open(sources) as archive:
        archive.extractall(folder / "unpacked", filter="data")
    again = build(python, next((folder / "unpacked").iterdir()), folder / "again", "wheel")
    same(contents(again), contents(wheel), "the wheels of the source distribution and the checkout")
    say(f"{wheel.name}: {len(contents(wheel))} files, {wheel.stat().st_size / 1e6:.1f} MB; "
        "the source distribution builds the same")
    return wheel


def _files(package: str) -> dict[str, bytes]:
    """What a package's wheel is to hold."""
    return {name.removeprefix("src/"): (ROOT / name).read_bytes()
            for name in tracked(f"src/{package}") if not name.endswith("/pyproject.toml")}


def tried(wheel: Path, folder: Path) -> None:
    """Install the wheel into an empty environment and run it in an empty folder."""
    lfportrait = environment(folder / "user", wheel) / "lfportrait"
    say("installed")
    empty = folder / "empty"
    empty.mkdir()
    run(lfportrait, "--version", folder=empty)
    run(lfportrait, "doctor", folder=empty)
    run(lfportrait, "devices", folder=empty)  # without wgpu
    told = subprocess.run([lfportrait, "evaluate", "job"], cwd=empty, check=False,
                          capture_output=True, text=True)
    if told.returncode != 2 or "pip install lfportrait-eval" not in told.stderr:
        sys.exit(f"evaluate without its package says: {told.stderr}")
    run(lfportrait, "demo", "--quick", "--quiet", "--out", "demo", folder=empty)
    for name in ("lightfield.png", "portrait.html", "report.html"):
        if not (empty / "demo" / name).is_file():
            sys.exit(f"the demo of the installed package wrote no {name}")
    say("the installed package runs its demo")
    without_home(lfportrait, folder)


def without_home(lfportrait: Path, folder: Path) -> None:
    """Run the demo as an ordinary user without a home, who may not write to the installation."""
    if not hasattr(os, "geteuid") or os.geteuid() != 0:
        say("not tried as a user without a home: only root can drop its rights")
        return
    nobody, place = 65534, folder / "nobody"
    place.mkdir()
    os.chown(place, nobody, nobody)
    for part in (folder, folder / "user"):
        part.chmod(0o755)
    as_nobody: dict[str, Any] = {"user": nobody, "group": nobody, "extra_groups": [], "cwd": place,
                                 "env": {"PATH": os.environ["PATH"], "HOME": "/nonexistent",
                                         "TMPDIR": str(place)}}
    try:
        subprocess.run([lfportrait, "--version"], check=True, **as_nobody)
    except OSError:
        say("not tried as a user without a home: this Python is root's alone")
        return
    subprocess.run([lfportrait, "demo", "--quick", "--quiet", "--out", "demo"], check=True,
                   **as_nobody)
    if not (place / "demo" / "lightfield.png").is_file():
        sys.exit("the demo of a user without a home wrote no lightfield.png")
    say("a user without a home runs the demo of an installation that is read-only")


def main() -> int:
    with tempfile.TemporaryDirectory(prefix="lfportrait-") as name:
        wheel = built(Path(name))
        if "--build" not in sys.argv[1:]:
            tried(wheel, Path(name))
    return 0


if __name__ == "__main__":
    sys.exit(main())
