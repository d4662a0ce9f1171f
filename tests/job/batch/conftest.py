"""Tiny sittings, paintings and displays on the disk, and a small batch that was made of them."""

import hashlib
import shutil
from pathlib import Path

import pytest

from lfportrait.demo import PAINTED, SITTER, demo_capture, demo_exemplar
from lfportrait.files import write_image
from lfportrait.job.batch import BatchConfig, batch
from lfportrait.lightfield import Display

PANEL = Display(96, 64, views=9, pitch=6.3, slant=0.15, cone=40, quilt=(3, 2),
                quilt_size=(96, 64), name="tiny")
JOBS = """
[defaults]
sweep_size = 48
[defaults.reconstruct]
resolutions = [16, 32]
rays = [0.04, 0.08]
batch = [1024]
sh_degree = 0
[defaults.stylize]
pixels = 48.0
fit_iterations = 1
steps = 1
content_network = "embedded"
style_network = "embedded"

[[sitter]]
photos = "sittings/*"

[[style]]
painting = "ken.png"
[[style]]
painting = "chalk.png"

[[display]]
name = "desk"
panel = "tiny.toml"
[[display]]
name = "wall"
panel = "tiny.toml"
encode.size = 0.6
"""


def write_painting(path: Path, style: str) -> None:
    """A painting with its landmarks beside it."""
    exemplar = demo_exemplar(style, width=120, height=160)
    write_image(path, exemplar.image)
    lines = [f"{x} {y}" for x, y in exemplar.landmarks]
    path.with_suffix(".landmarks.txt").write_text("\n".join(lines))


def digests(results: Path) -> dict[str, str]:
    """Hashes of all that a batch made, without its own notes (which hold times)."""
    return {str(path.relative_to(results)): hashlib.sha256(path.read_bytes()).hexdigest()
            for path in sorted(results.rglob("*")) if path.is_file()
            and not any(part.startswith(".") for part in path.relative_to(results).parts)
            and path.name not in ("index.html", "results.json")}


@pytest.fixture(scope="session")
def studio(tmp_path_factory):
    """A folder with two sittings, two paintings, a display and a file of jobs."""
    folder = tmp_path_factory.mktemp("studio")
    for name, model in (("anna", SITTER), ("bert", PAINTED)):
        demo_capture(size=48, views=10, model=model).save(folder / "sittings" / name)
    write_painting(folder / "ken.png", "fauve")
    write_painting(folder / "chalk.png", "charcoal")
    PANEL.save(folder / "tiny.toml")
    (folder / "jobs.toml").write_text(JOBS)
    return folder


@pytest.fixture(scope="session")
def made(studio, tmp_path_factory):
    """The studio's batch, undisturbed: its folder, figures and events."""
    results = tmp_path_factory.mktemp("made") / "results"
    events = []
    figures = batch(studio / "jobs.toml", results, BatchConfig(cores=1),
                    watchers=[events.append])
    assert not figures["failed"], figures["failed"]
    return results, figures, events


@pytest.fixture
def copy(made, tmp_path):
    """A copy of the batch that a test may spoil."""
    return Path(shutil.copytree(made[0], tmp_path / "results"))
