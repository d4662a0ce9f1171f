"""The painted exemplars and the brush."""

import numpy as np
import pytest
from scipy import ndimage

from lfportrait.errors import UserError
from modelled_head import PAINTED, STYLES, exemplar_camera, painted_exemplar, painting, photograph
from modelled_head.kernels.brush import lay, plan, trace
from tests.reference import brush as reference

SIZE = (192, 256)

pytestmark = pytest.mark.slow  # of a script that no user runs


@pytest.fixture(scope="module", params=STYLES)
def exemplar(request):
    return painted_exemplar(request.param, *SIZE)


def test_what_styles_share_is_left_as_it_was():
    """The sitter is photographed once for all of them."""
    for name in STYLES:
        painting._sitting.cache_clear()
        alone = painted_exemplar(name, 96, 128)
        for other in STYLES:
            shown = painted_exemplar(other, 96, 128)
            shown.landmarks[:], shown.mask[:] = 0, 0
        after = painted_exemplar(name, 96, 128)
        assert np.array_equal(after.image, alone.image)
        assert np.array_equal(after.landmarks, alone.landmarks)
        assert np.array_equal(after.mask, alone.mask)


def _strokes(rng, count=12):
    paths = np.cumsum(rng.normal(0, 5, (count, 6, 2)), axis=1) + rng.uniform(5, 45, (count, 1, 2))
    counts = rng.integers(1, 7, count)
    return paths.astype(np.float32), counts, rng.random((count, 3)).astype(np.float32)


@pytest.mark.parametrize(("radius", "dry", "rough"), [(2.0, 0.0, 0.0), (6.5, 0.8, 1.0)])
def test_laying_strokes_agrees_with_the_reference(radius, dry, rough):
    rng = np.random.default_rng(3)
    paths, counts, colors = _strokes(rng)
    canvas = rng.random((50, 54, 3)).astype(np.float32)
    relief, tooth = np.zeros((50, 54), np.float32), rng.random((50, 54)).astype(np.float32)
    wanted = reference.lay(canvas, relief, tooth, paths, counts, colors, radius, 0.9, dry, rough)
    lay(canvas, relief, tooth, paths, counts, colors, radius, 0.9, dry, rough)
    np.testing.assert_allclose(canvas, wanted[0], atol=2e-4)
    np.testing.assert_allclose(relief, wanted[1], atol=2e-4)


def test_planned_strokes_start_where_the_canvas_is_wrong_and_stay_in_their_region():
    height, width = 60, 80
    reference_picture = np.zeros((height, width, 3), np.float32)
    reference_picture[:, 40:] = 1.0
    canvas = np.zeros_like(reference_picture)
    label = np.zeros((height, width), np.int8)
    label[:, 40:] = 1
    field = np.zeros((height, width, 2), np.float32)
    field[..., 0] = 1.0
    paths, counts = plan(reference_picture, canvas, field, label, 4.0, 0.1, 2, 6, 1.0)
    assert len(paths) == 10 * 15
    assert (paths[:, 0, 0] >= 40).all()
    for path, count in zip(paths, counts):
        assert 1 <= count <= 7
        steps = np.diff(path[:count], axis=0)
        np.testing.assert_allclose(np.linalg.norm(steps, axis=1), 4.0, rtol=1e-5)
    nothing, _ = plan(canvas, canvas, field, label, 4.0, 0.1, 2, 6, 1.0)
    assert len(nothing) == 0


def test_traced_paths_follow_the_field():
    height, width = 90, 90
    y, x = np.mgrid[:height, :width] + 0.5 - 45.0
    field = np.stack([-y, x], axis=-1) / (np.hypot(x, y)[..., None] + 1e-9)
    starts = np.array([[75.0, 45.0], [45.0, 20.0]], np.float32)
    paths, counts = trace(starts, field.astype(np.float32), np.zeros((height, width), np.int8), 2.0,
                          25, 1.0)
    for path, count in zip(paths, counts):
        assert count == 26
        radius = np.linalg.norm(path[:count] - 45.0, axis=1)
        assert np.ptp(radius) < 3.0


def test_exemplar_is_complete(exemplar):
    width, height = SIZE
    assert exemplar.image.shape == (height, width, 3)
    assert exemplar.landmarks.shape == (68, 2)
    assert (exemplar.landmarks > 0).all()
    assert (exemplar.landmarks < SIZE).all()
    assert exemplar.mask.shape == (height, width)
    x, y = exemplar.landmarks[17:].astype(int).T
    assert (exemplar.mask[y, x] == 1.0).all()


def test_exemplar_is_deterministic(exemplar):
    again = painted_exemplar(exemplar.name, *SIZE)
    assert again.image.tobytes() == exemplar.image.tobytes()
    other = painted_exemplar(exemplar.name, *SIZE, seed=6)
    assert other.image.tobytes() != exemplar.image.tobytes()
    np.testing.assert_array_equal(other.landmarks, exemplar.landmarks)


def test_exemplar_is_painted(exemplar):
    photo = photograph(PAINTED, exemplar_camera(*SIZE)).image
    inside = (photo[..., 3] == 255) & (exemplar.mask == 1.0)

    def texture(image):
        grey = image[..., :3].astype(float).mean(axis=-1)
        fine = grey - ndimage.gaussian_filter(grey, 2.0)
        return np.sqrt(ndimage.gaussian_filter(fine * fine, 4.0))

    calm = inside & (texture(photo) < np.percentile(texture(photo)[inside], 20))
    assert np.median(texture(exemplar.image)[calm]) > 2.0 * np.median(texture(photo)[calm])
    apart = np.abs(exemplar.image.astype(float) - photo[..., :3]).mean(axis=-1)
    assert apart[inside].mean() > 20.0


def test_fauve_palette_is_strong():
    image = painted_exemplar("fauve", *SIZE).image.astype(float)
    photo = photograph(PAINTED, exemplar_camera(*SIZE)).image
    inside = photo[..., 3] == 255

    def colorful(values):
        return np.mean(values.max(axis=-1) - values.min(axis=-1))

    assert colorful(image[inside]) > 1.5 * colorful(photo[..., :3][inside].astype(float))
    assert (image[..., 0] > image[..., 2] + 60).mean() > 0.15, "much orange"
    assert (image[..., 2] > image[..., 0] + 60).mean() > 0.15, "much blue and teal"


def test_unknown_style_is_told_plainly():
    with pytest.raises(UserError, match="fauve, charcoal, impression"):
        painted_exemplar("cubist")
