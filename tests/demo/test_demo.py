"""The embedded data: what is shipped is complete, and options only take away from it."""

import numpy as np
import pytest
from scipy import ndimage

from lfportrait.capture import Capture
from lfportrait.demo import (
    DATA,
    demo_capture,
    demo_exemplar,
    demo_head,
    demo_landmarks,
    demo_photo,
    demo_styles,
    embedded_sittings,
)
from lfportrait.errors import UserError


@pytest.fixture(scope="module")
def whole():
    return demo_capture()


def test_data_are_small():
    files = [path for path in DATA.rglob("*") if path.is_file()]
    assert sum(path.stat().st_size for path in files) < 3e6


def test_the_capture_is_complete(whole):
    assert len(whole) == 60 and whole.held_out.sum() == 7
    assert whole.landmarks.shape == (68, 3) and np.isfinite(whole.landmarks).all()
    np.testing.assert_array_equal(demo_landmarks(), whole.landmarks)
    np.testing.assert_array_equal(whole.frame, np.eye(4))
    yaw = np.degrees(np.arctan2(whole.cameras.position[:, 0], whole.cameras.position[:, 2]))
    assert yaw.min() < -85 and yaw.max() > 85
    for image, alpha in zip(whole.images, whole.alphas):
        assert image.shape == (384, 384, 3) and 0.2 < (alpha > 127).mean() < 0.6
        assert not image[alpha == 0].any()


def test_fewer_and_smaller_photos_are_taken_from_the_same(whole):
    few = demo_capture(size=96, views=12)
    assert len(few) == 12 and few.images[0].shape == (96, 96, 3)
    assert few.held_out.tolist() == [view == 4 for view in range(12)]
    chosen = [int(name.removeprefix("view_")) for name in few.names]
    assert sorted(set(chosen)) == chosen
    np.testing.assert_array_equal(few.cameras.pose, whole.cameras.pose[chosen])
    pitch = np.degrees(np.arcsin(few.cameras.position[:, 1]
                                 / np.linalg.norm(few.cameras.position, axis=1)))
    assert pitch.min() < -10 and pitch.max() > 35, "of all arcs"
    # Four by four pixels are averaged: all of the person's, none of what lies around.
    alpha = whole.alphas[chosen[5]].astype(float)
    color = whole.images[chosen[5]] * alpha[..., None]
    cells = [plane.reshape(96, 4, 96, 4, -1).mean(axis=(1, 3)) for plane in (color, alpha)]
    np.testing.assert_allclose(few.alphas[5], cells[1][..., 0], atol=1)
    seen = few.alphas[5] > 60
    np.testing.assert_allclose(few.images[5][seen], (cells[0] / np.maximum(cells[1], 1))[seen],
                               atol=4)


def test_landmarks_fall_on_the_small_photos():
    few = demo_capture(size=48, views=8)
    places = few.cameras.project(few.landmarks)[0]
    for view in range(8):
        x, y = places[view].astype(int).T
        assert (few.alphas[view][y, x] > 0).mean() > 0.9


@pytest.mark.parametrize("options", [{"size": 400}, {"size": 8}, {"views": 61}, {"views": 3}])
def test_there_are_no_larger_photos_and_no_more(options):
    with pytest.raises(UserError, match=f"--{next(iter(options))}.*not"):
        demo_capture(**options)


def test_it_is_a_capture_that_others_can_open():
    assert len(Capture.load(DATA / "capture")) == 60


def test_the_field_looks_like_the_photos(whole):
    head = demo_head()
    for view in (4, 12, 50):
        photo = whole.image_float(view)
        alpha = whole.alphas[view] / 255
        seen = head.render(whole.cameras, view, background=1.0)
        within = ndimage.binary_erosion(alpha == 1, iterations=6) & (seen.alpha > 0.99)
        assert within.mean() > 0.1
        assert -10 * np.log10(((seen.color - photo)[within] ** 2).mean()) > 24
        assert np.abs(seen.alpha - alpha).mean() < 0.02


@pytest.mark.parametrize("style", demo_styles())
def test_paintings_have_landmarks_and_mask_at_each_size(style):
    large, small = demo_exemplar(style), demo_exemplar(style, 192, 256)
    assert large.name == small.name == style
    assert large.image.shape == (1024, 768, 3) and small.image.shape == (256, 192, 3)
    np.testing.assert_allclose(4 * small.landmarks, large.landmarks)
    assert small.mask.shape == (256, 192) and small.mask.dtype == np.float32
    for one in (large, small):
        x, y = one.landmarks[17:].astype(int).T
        assert (one.mask[y, x] > 0.98).all()
    cells = large.image.reshape(256, 4, 192, 4, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(small.image, cells, atol=1)


def test_an_unknown_style_is_told_plainly():
    with pytest.raises(UserError, match="fauve, charcoal, impression"):
        demo_exemplar("cubist")


def test_the_single_photo_has_its_landmarks():
    photo, points = demo_photo(256)
    assert photo.shape == (256, 192, 4)
    x, y = points.astype(int).T
    assert (photo[y, x, 3] > 0).all() and (photo[y[17:], x[17:], 3] == 255).all()


def test_sittings_are_many_people_with_landmarks():
    sittings = embedded_sittings(16, 96, 0)
    for number, (photo, points) in enumerate(sittings):
        assert photo.shape == (96, 72, 3) and points.shape == (68, 2)
        assert (points > 0).all() and (points < (72, 96)).all()
        for other, _ in sittings[:number]:
            assert np.abs(photo.astype(float) - other).mean() > 5
    again = embedded_sittings(2, 96, 0)
    assert np.array_equal(again[1][0], sittings[1][0])
    assert not np.array_equal(embedded_sittings(1, 96, 1)[0][0], sittings[0][0])
