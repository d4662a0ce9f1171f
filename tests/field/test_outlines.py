"""Mattes laid anew by what the field shows."""

import functools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import ndimage

from lfportrait.capture import Capture
from lfportrait.field import ReconstructConfig, reconstruct_with_figures
from lfportrait.field.geometry.mattes import refined_mattes
from lfportrait.field.training import trainer
from lfportrait.field.training.trainer import Trainer
from tests.field.test_field import ball_capture

SMALL = ReconstructConfig(resolutions=(24, 40), rays=(0.15, 0.2), batch=(1024,))


@functools.cache
def photos() -> Capture:
    """A ball before walls of other colors, with what is behind it in the photos. Not to be changed.
    """
    capture = ball_capture(count=24, size=72)
    random = np.random.default_rng(1)
    images = []
    for image, alpha in zip(capture.images, capture.alphas):
        share = alpha[..., None] / 255.0
        wall = random.integers(0, 256, 3)
        images.append(np.uint8(image * share + wall * (1.0 - share) + 0.5))
    return replace(capture, images=images, figures={"mattes": "network"})


def with_wrong_mattes(capture: Capture) -> Capture:
    """Training mattes with bites and lumps of 4 to 7 pixels, elsewhere in each."""
    random = np.random.default_rng(2)
    alphas = list(capture.alphas)
    row, column = np.mgrid[:72, :72]
    for view in capture.training():
        person = alphas[view] > 127
        outline = np.argwhere(person & ~ndimage.binary_erosion(person))
        matte = alphas[view].copy()
        for number in range(4):
            y, x = outline[random.integers(len(outline))]
            patch = np.hypot(row - y, column - x) < random.uniform(4, 7)
            matte[patch] = 255 * (number % 2)
        alphas[view] = matte
    return replace(capture, alphas=alphas)


def wrong(mattes, truth) -> float:
    """Share of pixels on the wrong side of the outline."""
    return float(np.mean([(a > 127) != (b > 127) for a, b in zip(mattes, truth)]))


def reconstruct_recording(capture, config, monkeypatch):
    """The field, its figures, and the capture that the trainer had at its end."""
    ends = []
    finish = Trainer.finish
    with monkeypatch.context() as patch:
        patch.setattr(Trainer, "finish",
                      lambda run: (ends.append(run.capture), finish(run))[1])
        field, figures = reconstruct_with_figures(capture, config)
    return field, figures, ends[0]


@pytest.fixture(scope="module")
def mended():
    """A field from wrong mattes, its figures, and the capture that the trainer had at its end."""
    with pytest.MonkeyPatch.context() as patch:
        return reconstruct_recording(with_wrong_mattes(photos()), SMALL, patch)


def test_bites_and_lumps_are_mended(mended, monkeypatch):
    truth = photos()
    given = with_wrong_mattes(truth)
    _, without, _ = reconstruct_recording(given, replace(SMALL, refine_mattes="no"), monkeypatch)
    _, figures, end = mended
    views = truth.training()
    before, after = (wrong([c.alphas[v] for v in views], [truth.alphas[v] for v in views])
                     for c in (given, end))
    assert after < 0.3 * before
    # Held-out mattes are the true ones here.
    assert figures["test"]["psnr_at_given_mattes"] > without["test"]["psnr"] + 2.0
    assert figures["test"]["psnr"] > without["test"]["psnr"] + 2.0
    assert "psnr_at_given_mattes" not in without["test"]


def test_a_gap_that_a_field_fills_stays_in_the_mattes_of_an_arc(mended):
    truth, (field, *_) = photos(), mended
    alphas, images = list(truth.alphas), list(truth.images)
    gap = np.s_[30:42, 26:46]
    alphas[0], images[0] = alphas[0].copy(), images[0].copy()
    alphas[0][gap], images[0][gap] = 0, images[0][0, 0]
    inner = np.s_[33:39, 30:42]
    capture = replace(truth, alphas=alphas, images=images)
    assert refined_mattes(field, capture)[0][inner].min() > 127
    kept = refined_mattes(field, capture, alphas)
    assert kept[0][inner].max() == 0
    assert wrong(kept[1:], truth.alphas[1:]) < 0.01
    # Where photos show what is behind the person, the trainer asks for that.
    run = Trainer(capture, SMALL.resolved(False, 3.0))
    for surface, gone in ((None, False), (SimpleNamespace(span=120.0), False),
                          (SimpleNamespace(span=30.0), True)):
        run.__dict__["surface"] = surface
        assert bool(run.refined_mattes(field)[0][inner].max() == 0) is gone


@pytest.mark.parametrize(("how", "choice", "laid"), [
    (None, "auto", False), ("given", "auto", False), ("network", "auto", True),
    ("geometry", "auto", True), ("network", "no", False), (None, "yes", True)])
def test_given_mattes_are_believed(how, choice, laid):
    capture = replace(photos(), figures={} if how is None else {"mattes": how})
    config = replace(SMALL, mvs_init=False).resolved(False, 3.0)
    assert Trainer(capture, replace(config, refine_mattes=choice)).lays_mattes is laid


def test_mattes_that_were_right_stay_right(monkeypatch):
    truth = photos()
    *_, end = reconstruct_recording(truth, SMALL, monkeypatch)
    assert wrong(end.alphas, truth.alphas) < 0.003


# The one that still has mattes to correct; the other reads what the first has written.
@pytest.mark.parametrize(("step", "left"), [
    (10, 1), pytest.param(120, 0, marks=pytest.mark.slow)])
def test_a_stopped_run_goes_on_with_the_mattes_it_had(step, left, mended, tmp_path, monkeypatch):
    capture, first = with_wrong_mattes(photos()), mended[0]
    checkpoint = tmp_path / "state.npz"

    def stop(run):
        if run.level == 1 and run.step == step:
            run.save()
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Trainer, "save_now_and_then", stop)
        with pytest.raises(KeyboardInterrupt):
            reconstruct_with_figures(capture, SMALL, checkpoint=checkpoint)
    laid = []
    with monkeypatch.context() as patch:
        patch.setattr(trainer, "refined_mattes",
                      lambda *given: (laid.append(1), refined_mattes(*given))[1])
        second, _ = reconstruct_with_figures(capture, SMALL, checkpoint=checkpoint)
    assert len(laid) == left
    assert np.array_equal(first.links, second.links)
    assert np.array_equal(first.density, second.density)
    assert np.array_equal(first.sh, second.sh)


def test_a_photo_without_the_person_keeps_its_empty_matte(monkeypatch):
    truth = photos()
    view = int(truth.training()[3])
    away = truth.cameras.pose.copy()
    away[view, :3, 3] += 40.0 * away[view, :3, 0]
    alphas = list(truth.alphas)
    alphas[view] = np.zeros_like(alphas[view])
    capture = replace(truth, alphas=alphas, cameras=replace(truth.cameras, pose=away))
    *_, end = reconstruct_recording(capture, SMALL, monkeypatch)
    assert not end.alphas[view].any()
