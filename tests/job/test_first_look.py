"""The first look: a page while the field is trained, which changes nothing else of the job."""

import hashlib
import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from lfportrait import models
from lfportrait.capture import Camera
from lfportrait.demo import demo_capture, demo_exemplar
from lfportrait.errors import UserError
from lfportrait.face.one_photo import portrait
from lfportrait.job import first_look, work
from lfportrait.job.first_look import KERNELS, FirstLook, LookTaken, painted_roughly
from lfportrait.job.pipeline import make
from lfportrait.progress import Progress
from lfportrait.stylize import StyledField, StylizeConfig
from tests.job import test_pipeline
from tests.job.test_pipeline import FILES, PANEL
from tests.recordings import photographs

CONFIG = replace(test_pipeline.CONFIG, stylize=replace(test_pipeline.CONFIG.stylize, steps=0))
"""Without refinement nothing imports torch."""
LOOK = b"a first look"


@pytest.fixture(scope="module")
def capture():
    return demo_capture(size=72, views=16)


@pytest.fixture(scope="module")
def painting():
    return demo_exemplar(width=180, height=240)


@pytest.fixture(scope="module", autouse=True)
def short_reports():
    """Files without content: a report takes as long as the painting, and shows no look.

    Posters of a quarter of their size, for the same reason.
    """
    def none(task, results, *_):
        (results / task.folder / "hero.png").touch()
        return None, 0.0

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("lfportrait.job.summary._report", none)
        patch.setattr("lfportrait.job.summary.write_report", lambda path, _: path.touch())
        patch.setattr("lfportrait.share.page.assembly._HEIGHT", 250)
        yield


@pytest.fixture(scope="module")
def job(capture, painting):
    """Runs the job into a folder."""
    def run(out, painting=painting, **how):
        return make(capture, painting, out, PANEL, CONFIG, offline=True, device="cpu", **how)

    return run


@pytest.fixture(scope="module")
def plain(capture, painting, tmp_path_factory):
    """A finished job without a first look."""
    out = tmp_path_factory.mktemp("plain") / "out"
    run = make(capture, painting, out, PANEL, CONFIG, offline=True, device="cpu", first_look=False)
    assert "first_look" not in run
    return out


def counting(patch):
    """The fields that looks are taken of from now on."""
    found = []

    def counted(field, *others):
        found.append(field)
        return painted_roughly(field, *others)

    patch.setattr(first_look, "painted_roughly", counted)
    return found


@pytest.fixture
def looks(monkeypatch):
    """The fields that looks were taken of."""
    return counting(monkeypatch)


@pytest.fixture(scope="module")
def quick(job, tmp_path_factory):
    """A job that ended at its look: its folder, its figures, the fields that were looked at."""
    out = tmp_path_factory.mktemp("quick") / "out"
    with pytest.MonkeyPatch.context() as patch:
        seen = counting(patch)
        return out, job(out, quick=True), seen


@pytest.fixture(scope="module")
def looked(job, tmp_path_factory):
    """A job with a look to its end, as `quick` is, and the pages before the painting."""
    out, early = tmp_path_factory.mktemp("looked") / "out", []

    def watched(*given, **more):
        early.append((out / "portrait.html").read_bytes())
        return paint(*given, **more)

    paint = work.write_styled
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(work, "write_styled", watched)
        seen = counting(patch)
        return out, job(out), seen, early


def digests(out: Path) -> dict[str, str]:
    return {name: hashlib.sha256((out / name).read_bytes()).hexdigest() for name in FILES}


@pytest.mark.slow  # whole jobs; one is in test_pipeline.py, which has a look
def test_the_page_is_there_before_the_painting_and_leaves_no_trace(looked, plain):
    out, run, looks, early = looked
    assert LOOK in early[0] and b"data-stream" in early[0]
    assert len(early[0]) < 2e6
    assert digests(out) == digests(plain)
    assert run == json.loads((out / "run.json").read_text())
    assert 0 < run["first_look"]["cost_seconds"] < run["first_look"]["seconds"]
    assert set(run["seconds"]) == {"total", "capture", "reconstruct", "stylize", "encode", "share"}
    assert len(looks) == 1 and max(looks[0].links.shape) < 48, "of the coarse level"


@pytest.mark.slow  # whole jobs
def test_quick_ends_there_and_the_same_without_it_goes_on(job, plain, looks, tmp_path):
    out = tmp_path / "out"
    run = job(out, quick=True)
    page = (out / "portrait.html").read_bytes()
    assert LOOK in page and not (out / "field.npz").exists()
    assert (out / ".stages/reconstruct.npz").is_file(), "the training goes on from here"
    assert "reconstruct" not in run["seconds"] and run["first_look"]["seconds"] > 0

    again = job(out, quick=True)
    assert again["first_look"] == run["first_look"] and len(looks) == 1
    assert (out / "portrait.html").read_bytes() == page

    whole = job(out)
    assert digests(out) == digests(plain)
    assert whole["first_look"] == run["first_look"] and len(looks) == 1
    finished = job(out, quick=True)
    assert set(finished["seconds"]) == set(whole["seconds"])
    assert digests(out) == digests(plain) and len(looks) == 1


@pytest.mark.slow  # whole jobs
def test_a_page_that_is_missing_is_made_again(job, quick, looks, tmp_path):
    out = Path(shutil.copytree(quick[0], tmp_path / "out"))
    (out / "portrait.html").unlink()
    job(out, quick=True)
    assert LOOK in (out / "portrait.html").read_bytes() and len(looks) == 1


@pytest.mark.slow  # whole jobs
def test_the_look_at_another_painting_is_not_taken_for_the_finished_page(job, plain, looked,
                                                                         looks, tmp_path):
    out = Path(shutil.copytree(looked[0], tmp_path / "out"))
    other = demo_exemplar("charcoal", width=180, height=240)
    run = job(out, other, quick=True)
    assert LOOK in (out / "portrait.html").read_bytes()
    assert run["resumed"] == ["capture", "reconstruct"]
    assert len(looks) == 1 and max(looks[0].links.shape) >= 40, "the finished field"
    job(out, first_look=False)
    assert digests(out) == digests(plain)


@pytest.mark.slow  # whole jobs
@pytest.mark.skipif(models.missing(["face-landmarker"]) != [],
                    reason="the network for landmarks is not here")
def test_one_photo_is_looked_at_before_its_field_is_made(painting, looks, tmp_path, monkeypatch,
                                                         capsys):
    monkeypatch.setattr(portrait, "ROUGH", 48)
    camera = Camera.arc(np.zeros(1), distance=4.4, width=440, height=440, focal=860.0)
    Image.fromarray(photographs("front", camera)[0].image).save(tmp_path / "her.png")
    fine = replace(CONFIG, reconstruct=replace(CONFIG.reconstruct, resolution=64))
    out = tmp_path / "out"
    run = make(tmp_path / "her.png", painting, out, PANEL, fine, offline=True, device="cpu",
               quick=True, quiet=False)
    page = out / "portrait.html"
    assert LOOK in page.read_bytes() and not (out / "field.npz").exists()
    assert f"a first look after {run['first_look']['seconds']:.0f} s: {page}" in (
        capsys.readouterr().err)
    assert len(looks) == 1 and max(looks[0].links.shape) < 80 and looks[0].cone == 40
    whole = make(tmp_path / "her.png", painting, out, PANEL, fine, offline=True, device="cpu")
    assert whole["resumed"] == ["capture"] and whole["first_look"] == run["first_look"]
    assert LOOK not in page.read_bytes() and len(looks) == 1


@pytest.mark.slow  # whole jobs
@pytest.mark.parametrize("error", [
    UserError("the field shows no surface"), IndexError("7")])
def test_a_look_that_fails_is_one_line(job, plain, tmp_path, monkeypatch, capsys, error):
    def fail(*_):
        raise error

    def stop(*_, **__):
        raise UserError("as far as the painting")

    monkeypatch.setattr(first_look, "painted_roughly", fail)
    if isinstance(error, UserError):
        with pytest.raises(UserError, match="no first look: the field shows no surface; leave out"):
            job(tmp_path / "out", quick=True)
    monkeypatch.setattr(work, "write_styled", stop)
    with pytest.raises(UserError, match="as far as the painting"):
        job(tmp_path / "out", quiet=False)
    said = [line for line in capsys.readouterr().err.splitlines() if "no first look: " in line]
    kind = "" if isinstance(error, UserError) else "IndexError: "
    assert said == [f"reconstruct: no first look: {kind}{error}"]
    assert (tmp_path / "out/field.npz").read_bytes() == (plain / "field.npz").read_bytes()


class Kernels:
    """Kernels that are compiled when they are waited for."""

    def __init__(self):
        self.there = False

    def ready(self, names):
        assert names == KERNELS
        return self.there

    def wait(self, names, progress=None):
        self.there = True


class Shown(FirstLook):
    """A look that is kept."""

    def show(self, portrait):
        self.portrait = portrait
        return ""


def test_it_waits_for_kernels_only_if_it_is_all_that_is_wanted(capture, painting):
    def offered(look, **how):
        made = []
        try:
            look.offer(Progress("", enabled=False), capture, lambda: made.append(1) or field, **how)
        except LookTaken:
            assert look.only
        return bool(made)

    from lfportrait.job.warmup import ball_field

    field, paper = ball_field(1), StylizeConfig(method="paper")
    look = Shown(painting, paper, 0.0)
    look.warmup = Kernels()
    assert not offered(look) and not look.over
    look.warmup.there = True
    assert offered(look) and look.over and not offered(look)
    assert look.portrait is field, "what is not painted on the skin is shown as it is"
    for how, only in (({"wait": True}, False), ({}, True)):
        look = Shown(painting, paper, 0.0, only=only)
        look.warmup = Kernels()
        assert offered(look, **how) and look.figures


def test_of_a_head_that_is_not_trained_the_rough_field_is_kept(capture, painting):
    from lfportrait.job.warmup import ball_field

    field = ball_field(1)
    for figures, kept in ((capture.figures, None), ({**capture.figures, "head_fit": {}}, field)):
        look = Shown(painting, StylizeConfig(method="paper"), 0.0)
        look.warmup = Kernels()
        look.offer(Progress("", enabled=False), replace(capture, figures=figures), lambda: field)
        assert look.rough is kept and not look.over
        # A head that can't be made so is left to the job.
        look.rough = None
        look.offer(Progress("", enabled=False), replace(capture, figures=figures), lambda: 1 // 0)
        assert look.rough is None and not look.over


@pytest.mark.slow  # whole jobs
def test_a_rough_field_is_painted_with_its_ground(quick, capture, painting):
    styled = painted_roughly(quick[2][0], capture, painting, CONFIG.stylize)
    assert isinstance(styled, StyledField) and styled.styles == ("fauve",)
    assert styled.backdrop is not None
