"""Photos have the last word on matter that was added to a trained head."""

from dataclasses import replace

import numpy as np
import pytest

from lfportrait.capture import Capture
from lfportrait.field import ReconstructConfig
from lfportrait.field.training.meter import held_out_quality
from lfportrait.field.training.trainer import Trainer, settled
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


def test_only_what_is_new_is_looked_at(trained):
    field = trained.field()
    points = field.lattice_points()
    wrong = (points[:, 2] > 0.2) & (points[:, 1] > 0.1)
    spoilt = replace(field, sh=np.where(wrong[:, None, None], 0, field.sh).astype(np.float32))
    places = points[wrong & (field.density > 8)]
    outwards = places / np.linalg.norm(places, axis=1, keepdims=True)
    found, everywhere = settled(trained, spoilt, 0.05, new=(places, outwards)), settled(
        trained, spoilt, 0.05)
    near = wrong & (field.density > 8) & (np.linalg.norm(points, axis=1) > 0.55)
    left = [np.abs(one.sh - field.sh)[near, :, 0].mean() for one in (found, everywhere)]
    assert left[0] < 0.8 * left[1]


def test_tiles_that_show_a_place_or_its_outline(trained):
    data = trained.data
    found = data.showing(np.array([[0.0, 0.0, 0.5]]), np.array([[0.0, 0.0, 1.0]]))
    views = np.unique(found[:, 0])
    front = [view for view, camera in enumerate(data.cameras)
             if camera[[3, 7, 11]] @ [0.0, 0.0, 1.0] > 0.6]
    behind = [view for view, camera in enumerate(data.cameras)
              if camera[[3, 7, 11]] @ [0.0, 0.0, 1.0] < -0.3]
    assert set(front) <= set(views) and not set(behind) & set(views)
    assert {tuple(tile) for tile in found} <= {tuple(tile) for tile in data.tiles}
    for view in front:
        camera = trained.capture.cameras[int(trained.views[view])]
        x, y = camera.project(np.array([[0.0, 0.0, 0.5]]))[0][0][0]
        tiles = found[found[:, 0] == view]
        assert (np.abs(tiles[:, 1:] + 2 - (y, x)) <= 12).all()
        assert ((tiles[:, 1] == y // 4 * 4) & (tiles[:, 2] == x // 4 * 4)).any()
    assert not len(data.showing(np.zeros((0, 3)), np.zeros((0, 3))))
    nothing = np.zeros((0, 3))
    assert settled(trained, trained.field(), new=(nothing, nothing)).density.shape
