"""Photos have the last word on matter that was added to a trained head."""

from dataclasses import replace

import numpy as np
import pytest

from lfportrait.capture import Capture
from lfportrait.field import ReconstructConfig
from lfportrait.field.training.level import settled
from lfportrait.field.training.meter import held_out_quality
from lfportrait.field.training.trainer import Trainer
from tests.field.test_field import ball_capture


@pytest.fixture(scope="module")
def trained() -> Trainer:
    capture = ball_capture()
    assert isinstance(capture, Capture)
    config = ReconstructConfig(resolutions=(24, 48), rays=(0.1, 0.4), batch=(512, 512), seed=3)
    trainer = Trainer(capture, config.resolved(False, 4.0, capture.cameras.pixel, False))
    for _ in range(2):
        trainer.run_level()
    trainer.finish()
    return trainer


def quality(trainer, field):
    return held_out_quality(field, trainer.capture, 1.0, None)["psnr"]


def test_what_photos_see_is_made_right(trained):
    field = trained.field()
    points = field.lattice_points()
    wrong = points[:, 2] > 0.2
    spoilt = replace(field, sh=np.where(wrong[:, None, None], 0, field.sh).astype(np.float32))
    found = settled(trained, spoilt)
    assert np.array_equal(found.links, field.links)
    before, after = quality(trained, spoilt), quality(trained, found)
    assert after > before + 5
    assert after > quality(trained, field) - 1.0


def test_what_is_right_stays_right_and_the_trainer_as_it_is(trained):
    field = trained.field()
    found = settled(trained, field)
    assert quality(trained, found) > quality(trained, field) - 0.2
    again = trained.field()
    assert np.array_equal(again.density, field.density) and np.array_equal(again.sh, field.sh)
    assert np.array_equal(settled(trained, field).sh, found.sh)
