"""Tiny sittings, paintings and displays on the disk, and a small batch that was made of them."""

import fcntl
import hashlib
import os
import pickle
import shutil
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from lfportrait.demo import demo_capture, demo_exemplar
from lfportrait.files import write_image
from lfportrait.job.batch import BatchConfig, batch
from lfportrait.lightfield import Display

from .inline import Inline, single_thread

PANEL = Display(96, 64, views=9, pitch=6.3, slant=0.15, cone=40, quilt=(3, 2),
                quilt_size=(96, 64), name="tiny")
JOBS = """
[defaults]
sweep_size = 48
[defaults.reconstruct]
resolutions = [16, 32]
rays = [0.04, 0.08]
batch = [1024]
[defaults.stylize]
pixels = 48.0
fit_iterations = 1
steps = 1
content_network = "embedded"
style_network = "embedded"

[[sitter]]
photos = "sittings/*"

# Without refinement: a process that paints nothing else does not import torch.
[[style]]
painting = "ken.png"
stylize.steps = 0
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


def write_studio(folder: Path) -> None:
    """A folder with two sittings, two paintings, a display and a file of jobs."""
    anna = demo_capture(size=48, views=10)
    anna.save(folder / "sittings" / "anna")
    darker = [picture // 2 for picture in anna.images]
    replace(anna, images=darker).save(folder / "sittings" / "bert")
    write_painting(folder / "ken.png", "fauve")
    write_painting(folder / "chalk.png", "charcoal")
    PANEL.save(folder / "tiny.toml")
    (folder / "jobs.toml").write_text(JOBS)


@contextmanager
def for_all(tmp_path_factory):
    """A folder of all test processes, which one of them has for itself at a time."""
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    folder /= "batch"
    folder.mkdir(exist_ok=True)
    with open(folder / "lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield folder


@pytest.fixture(scope="session")
def studio(tmp_path_factory):
    """A folder with two sittings, two paintings, a display and a file of jobs."""
    with for_all(tmp_path_factory) as folder:
        if not (folder / "studio" / "jobs.toml").exists():  # it is written last
            write_studio(folder / "studio")
    return folder / "studio"


def made_once(folder: Path, jobs: Path, results: Path) -> tuple[Path, dict, list[dict]]:
    """A batch, undisturbed: made by the first test process that asks, which holds `for_all`."""
    kept = folder / f"{results.name}.pickle"
    if not kept.exists():
        events: list[dict] = []
        # Without processes, which import all again; slow tests make the same by those.
        with single_thread(), pytest.MonkeyPatch.context() as patch:
            patch.setattr("lfportrait.job.batch.driver.LocalRunner", Inline)
            figures = batch(jobs, results, BatchConfig(cores=1), watchers=[events.append])
        assert not figures["failed"], figures["failed"]
        kept.write_bytes(pickle.dumps((figures, events)))
    return results, *pickle.loads(kept.read_bytes())


@pytest.fixture(scope="session")
def anna(studio):
    """Jobs of one of the sitters alone: half of the batch."""
    path = studio / f"anna-{os.getpid()}.toml"
    path.write_text((studio / "jobs.toml").read_text().replace("sittings/*", "sittings/anna"))
    return path


def of_anna(found: dict[str, str]) -> dict[str, str]:
    """What `digests` found, of that sitter alone."""
    return {name: digest for name, digest in found.items() if name.startswith("anna/")}


@pytest.fixture(scope="session")
def made(studio, tmp_path_factory):
    """The studio's batch, undisturbed: its folder, figures and events. Not to be changed."""
    with for_all(tmp_path_factory) as folder:
        return made_once(folder, studio / "jobs.toml", folder / "results")


@pytest.fixture(scope="session")
def small(studio, tmp_path_factory):
    """A batch of one sitter, style and display, as `made` has it; its file is ``one.toml``.

    A third of the work: quick tests make no other.
    """
    with for_all(tmp_path_factory) as folder:
        text = (studio / "jobs.toml").read_text().replace("sittings/*", "sittings/anna")
        text = text.partition('[[style]]\npainting = "chalk.png"')[0] + (
            '[[display]]\nname = "desk"\npanel = "tiny.toml"\n')
        if not (studio / "one.toml").exists():
            (studio / "one.new").write_text(text)
            (studio / "one.new").rename(studio / "one.toml")
        return made_once(folder, studio / "one.toml", folder / "results-of-one")


@pytest.fixture(params=["small", pytest.param("made", marks=pytest.mark.slow)])
def either(request):
    """A batch of one, and one of all: its folder, figures and events. Not to be changed."""
    return request.getfixturevalue(request.param)


@pytest.fixture
def copy(made, tmp_path):
    """A copy of the batch that a test may spoil."""
    return Path(shutil.copytree(made[0], tmp_path / "results"))
