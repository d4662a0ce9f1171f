"""The embedded capture: the modelled head, its landmarks and its photographs; what tests keep."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lfportrait.capture import Camera
from lfportrait.demo import demo_capture
from modelled_head import (
    PAINTED,
    PEOPLE,
    SITTER,
    landmarks,
    photograph,
    studio_cameras,
    studio_capture,
)
from modelled_head.kernels.head import surfaces
from tests import recordings
from tests.reference import head as reference

pytestmark = pytest.mark.slow  # users have pictures of them, tests too

EVERYONE = [pytest.param(model, id=name) for name, model in PEOPLE.items()]
# Pairs of landmarks that mirror each other.
MIRROR = [16 - i for i in range(17)] + [26 - i for i in range(10)] + list(range(27, 31)) + [
    35, 34, 33, 32, 31, 45, 44, 43, 42, 47, 46, 39, 38, 37, 36, 41, 40,
    54, 53, 52, 51, 50, 49, 48, 59, 58, 57, 56, 55, 64, 63, 62, 61, 60, 67, 66, 65]


@pytest.fixture(scope="module")
def capture():
    return studio_capture(size=72, views=8)


@pytest.mark.parametrize("model", EVERYONE)
def test_distance_agrees_with_the_numpy_reference(model):
    rng = np.random.default_rng(1)
    spread = rng.uniform(-1.05, 1.05, (1500, 3))
    on_face = rng.uniform((-0.45, -0.7, 0.2), (0.45, 0.5, 0.75), (2500, 3))
    points = np.concatenate([spread, on_face, np.zeros((1, 3))])
    found = np.array([surfaces(model, *point) for point in points])
    np.testing.assert_allclose(found, reference.surfaces(model, points), atol=1e-9)


@settings(deadline=None, max_examples=60)
@given(x=st.floats(0, 1), y=st.floats(-1, 1), z=st.floats(-1, 1))
def test_skin_cloth_and_eyes_are_symmetric(x, y, z):
    left, right = surfaces(PAINTED, x, y, z), surfaces(PAINTED, -x, y, z)
    assert left[0] == right[0]
    assert left[3] == right[3]


@pytest.mark.parametrize("model", EVERYONE)
def test_landmarks_lie_on_the_surface(model):
    points = landmarks(model)
    assert points.shape == (68, 3)
    distance = np.array([surfaces(model, *point) for point in points])
    assert np.abs(np.minimum(distance[:, 0], distance[:, 3])).max() < 2e-3
    np.testing.assert_allclose(points[MIRROR] * (-1, 1, 1), points, atol=1e-6)


@pytest.mark.parametrize("model", EVERYONE)
def test_landmarks_are_a_face(model):
    x, y, z = landmarks(model).T
    assert np.all(np.diff(x[:17]) > -0.01), "the line of the chin runs from right to left ear"
    assert np.argmin(y) == 8, "the chin is the lowest point"
    assert np.argmax(z) == 30, "the tip of the nose is the foremost point"
    assert y[17:27].min() > y[36:48].max() > y[36:48].min() > y[31:36].max() > y[48:68].max()
    assert np.all(x[42:48] > 0)
    assert np.all(x[36:42] < 0)
    assert 0.30 < np.hypot(x[42:48].mean() - x[36:42].mean(), 0) < 0.45


def test_silhouette_agrees_with_the_reference(capture):
    for view in (0, 3, 7):
        origins, directions = capture.cameras.rays(view)
        steps = np.linspace(3.3, 5.6, 320)
        rng = np.random.default_rng(view)
        pixels = rng.choice(len(directions), 250, replace=False)
        points = origins[pixels, None] + steps[:, None] * directions[pixels, None]
        nearest = reference.surfaces(SITTER, points.reshape(-1, 3)).min(axis=-1)
        nearest = nearest.reshape(len(pixels), -1).min(axis=1)
        alpha = capture.alphas[view].ravel()[pixels]
        # A pixel is 0.03 units wide: clear of the border, coverage must be all or nothing.
        assert (alpha[nearest < -0.03] == 255).all()
        assert (alpha[nearest > 0.03] == 0).all()
        assert (nearest < -0.03).sum() > 20


def test_capture_is_complete_and_deterministic(capture):
    again = studio_capture(size=72, views=8)
    for one, other in zip(capture.images + capture.alphas, again.images + again.alphas):
        assert one.tobytes() == other.tobytes()
    assert len(capture) == 8
    assert capture.held_out.sum() == 1
    np.testing.assert_array_equal(capture.frame, np.eye(4))
    yaw = np.degrees(np.arctan2(capture.cameras.position[:, 0], capture.cameras.position[:, 2]))
    assert yaw.min() < -85
    assert yaw.max() > 85
    cover = [np.mean(alpha > 127) for alpha in capture.alphas]
    assert min(cover) > 0.2
    assert np.abs(capture.cameras.position).max() > 2.0


def test_the_demos_photos_are_of_this_model():
    """Else the model changed: `scripts/make_demo_data.py` makes them again."""
    shipped, cameras = demo_capture(size=72), studio_cameras(72, 60)
    np.testing.assert_allclose(shipped.cameras.pose, cameras.pose, atol=1e-9)
    np.testing.assert_allclose(shipped.cameras.focal, cameras.focal)
    np.testing.assert_allclose(shipped.landmarks, landmarks(SITTER), atol=1e-9)
    for view in (12, 50):
        photo = photograph(SITTER, cameras, view).image
        np.testing.assert_allclose(shipped.alphas[view].astype(int), photo[..., 3], atol=140)
        assert np.abs(shipped.alphas[view].astype(int) - photo[..., 3]).mean() < 3
        solid = photo[..., 3] == 255
        error = (shipped.images[view].astype(float) - photo[..., :3])[solid]
        assert 10 * np.log10(255 ** 2 / (error ** 2).mean()) > 25


def test_every_surface_is_seen_and_lit():
    camera = Camera.look_at(np.array([[0.0, 0.0, 4.4]]), np.zeros(3), width=160, height=160,
                            focal=330.0)
    picture = photograph(SITTER, camera)
    assert set(np.unique(picture.surface)) == {-1, 0, 1, 2, 3}
    inside = picture.image[..., 3] == 255
    length = np.linalg.norm(picture.normal[inside], axis=-1)
    np.testing.assert_allclose(length, 1.0, atol=1e-3)
    skin = picture.image[..., :3][inside & (picture.surface == 0)].astype(float)
    assert 90 < skin.mean() < 210, "neither drowned nor burnt out"
    assert (skin[:, 0] > skin[:, 2]).mean() > 0.99, "skin is warm"
    assert (skin == 255).mean() < 0.01
    assert (picture.normal[..., 2][inside] > -0.1).mean() > 0.995, "normals face the camera"


@pytest.mark.parametrize("path", sorted(recordings.FOLDER.glob("*.npz")), ids=lambda one: one.stem)
def test_what_tests_keep_is_what_the_model_gives(path):
    """Else the model changed: tests with ``LFPORTRAIT_RECORD=1`` record it again."""
    with np.load(path) as data:
        kept = {name: data[name] for name in data.files}
    if "person" in kept:
        made, least = recordings.make_form(str(kept["person"])), 40
    elif "style" in kept:
        height, width = kept["image"].shape[:2]
        made = recordings.make_painting(str(kept["style"]), width, height, float(kept["turn"]))
        least = 25  # a stroke more or less changes those that follow
        np.testing.assert_allclose(kept["landmarks"], made["landmarks"], atol=1e-6)
    else:
        cameras = Camera(**{name: kept[name] for name in ("pose", "focal", "center", "width",
                                                          "height")})
        made = recordings.make_photographs(cameras, *{"surface", "depth"} & set(kept))
        least = 40
    assert set(kept) == set(made)
    for name in {"image", "mask", "density", "depth", "surface"} & set(kept):
        one, other = (np.asarray(side[name], np.float64) for side in (kept, made))
        error = max(float(((one - other) ** 2).mean()), 1e-9)
        assert 20 * np.log10(max(np.abs(one).max(), 1) / np.sqrt(error)) > least, name
