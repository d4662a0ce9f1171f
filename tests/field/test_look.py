"""Looks at a field that is still trained: from a coarse level on, and without a trace."""

import gc
import weakref

import numpy as np
import pytest

from lfportrait.field import ReconstructConfig, reconstruct_with_figures
from lfportrait.field.training.trainer import Trainer
from tests.field.test_field import ball_capture

CONFIG = ReconstructConfig(resolutions=(10, 14, 20), rays=(0.004, 0.008, 0.02), batch=(512,))


@pytest.fixture(scope="module")
def capture():
    return ball_capture(count=12, size=28)


@pytest.fixture(scope="module")
def untouched(capture):
    return reconstruct_with_figures(capture, CONFIG, device="cpu")[0]


def test_what_trained_a_field_is_freed_with_it(capture, monkeypatch):
    made = []

    class Noted(Trainer):
        def __init__(self, *parts):
            super().__init__(*parts)
            made.append(weakref.ref(self))

    monkeypatch.setattr("lfportrait.field.reconstruction.Trainer", Noted)
    gc.disable()  # what holds itself would be freed by chance
    try:
        field, _ = reconstruct_with_figures(capture, CONFIG, device="cpu",
                                            look=lambda make: make() and None)
        assert len(made) == 1 and made[0]() is None and len(field.density)
    finally:
        gc.enable()


def test_many_looks_change_nothing(capture, untouched):
    points = []
    field, figures = reconstruct_with_figures(
        capture, CONFIG, device="cpu",
        look=lambda make: points.append(round(2.0 / float(make().spacing.mean()))))
    assert points == [14, *[20] * (len(points) - 1)] and len(points) > 3, (
        "after the last level but one, then within the last")
    for name in ("links", "density", "sh"):
        assert np.array_equal(getattr(field, name), getattr(untouched, name)), name
    assert figures["train"]["rays"] == 32256


def test_a_look_may_end_the_training_which_goes_on_later(capture, untouched, tmp_path):
    class Enough(Exception):
        pass

    def end(make):
        raise Enough

    state = tmp_path / "state.npz"
    for _ in range(2):  # the second time before any step
        with pytest.raises(Enough):
            reconstruct_with_figures(capture, CONFIG, checkpoint=state, device="cpu", look=end)
    field = reconstruct_with_figures(capture, CONFIG, checkpoint=state, device="cpu")[0]
    assert np.array_equal(field.density, untouched.density)


def test_a_look_is_as_clean_as_the_finished_field(capture):
    config = CONFIG.resolved(False, 3.0)
    trainer = Trainer(capture, config)
    trainer.run_level()
    before = trainer.lattice
    values = before.density.copy(), before.rows.copy()
    look = trainer.cleaned()
    assert look.count < before.count == len(values[0]) - 1
    assert trainer.lattice is before
    assert np.array_equal(before.density, values[0]) and np.array_equal(before.rows, values[1])
    assert trainer.field(look).density.shape == (look.count,)
    while trainer.level < len(config.resolutions):
        trainer.run_level()
    look = trainer.cleaned()
    trainer.average = None
    trainer.finish()
    assert np.array_equal(trainer.lattice.links, look.links)


def test_the_first_fine_level_is_looked_at(capture):
    def resolutions(*levels):
        found = []
        trainer = Trainer(capture, ReconstructConfig(
            resolutions=levels, rays=(0.001,) * len(levels)).resolved(False, 3.0),
            look=lambda trainer: found.append(levels[trainer.level - 1]))
        for trainer.level in range(len(levels) + 1):
            trainer.offer()
        return found

    assert resolutions(64, 128, 256) == [128]
    assert resolutions(64, 128, 256, 512) == [128, 256]
    assert resolutions(80, 160) == [80] and resolutions(24, 48) == [24]
    assert resolutions(64) == []
