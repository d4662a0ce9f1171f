"""The people: each has what its model says, and those of the embedded data stay as they are."""

from functools import cache

import numpy as np
import pytest
from scipy import ndimage

from lfportrait.capture import Camera
from modelled_head import PAINTED, PEOPLE, SITTER, landmarks, painted_exemplar, painting, photograph
from modelled_head.kernels.head_worn import worn_distance
from tests.reference import head_hair as reference

ROUND = Camera.arc(np.array([0.0, 40.0, -40.0, 150.0]), distance=4.4, width=112, height=112,
                   focal=235.0, target=(0.0, -0.05, 0.0))
# Landmarks 0, 8, 17, 30, 36, 37, 48 and 57 of the people of the embedded data, measured before
# there were others.
KEPT = {
    "sitter": (
        (-0.403426, 0.003340, 0.120000),
        (0.000000, -0.638140, 0.440000),
        (-0.325800, 0.121128, 0.355602),
        (0.000000, -0.188000, 0.677321),
        (-0.270094, 0.012385, 0.443767),
        (-0.213437, 0.034442, 0.482334),
        (-0.133056, -0.379260, 0.477120),
        (0.000000, -0.452100, 0.540929)),
    "painted": (
        (-0.422442, 0.009153, 0.128000),
        (0.000000, -0.680860, 0.456000),
        (-0.327800, 0.094232, 0.392935),
        (0.000000, -0.218000, 0.699706),
        (-0.264917, -0.000253, 0.442802),
        (-0.214031, 0.019472, 0.476252),
        (-0.149688, -0.414131, 0.455775),
        (0.000000, -0.464850, 0.530123)),
}


# Slow: users have the pictures of them, and not the program.
pytestmark = [pytest.mark.usefixtures("coarse_heads"), pytest.mark.slow]


@pytest.fixture(scope="module", params=PEOPLE)
def model(request):
    """Each person: all tests of one follow on each other, as a head is built once for them."""
    return PEOPLE[request.param]


@cache
def seen(model, view=0):
    """A person's picture, taken once."""
    return photograph(model, ROUND, view)


def openness(model):
    """Height of the eyes over their width."""
    eye = landmarks(model)[36:42]
    height = np.linalg.norm(eye[1] - eye[5]) + np.linalg.norm(eye[2] - eye[4])
    return 0.5 * height / np.linalg.norm(eye[3] - eye[0])


def test_everyone_has_what_the_model_says(model):
    views = [seen(model, view) for view in range(4)]
    front, back = views[0], views[3]
    assert {0, 1, 2} <= set(np.unique(front.surface))
    assert all((view.surface == 4).any() == (model.spectacles > 0) for view in views)
    assert ((front.surface == 3).sum() > 30) == (model.eye_open > 0)
    # From behind hair is most of the head; hair that hangs covers the neck as well.
    bare = (back.surface == 0).sum() / (back.surface == 1).sum()
    assert bare < 0.9
    assert (bare < 0.2) == (model.hair_length > 0)
    for view in views:
        solid = view.image[..., 3] == 255
        assert 0.25 < solid.mean() < 0.6
        assert np.isfinite(view.normal).all() and np.isfinite(view.depth).all()
        # Nothing floats, and nothing has a hole: one piece before one background.
        assert ndimage.label(view.image[..., 3] > 0, np.ones((3, 3)))[1] == 1


def test_landmarks_project_inside_the_silhouette(model):
    camera = Camera.look_at(np.array([[0.0, 0.0, 4.4]]), np.zeros(3), width=96, height=96,
                            focal=180.0)
    alpha = photograph(model, camera).image[..., 3]
    x, y = np.floor(camera.project(landmarks(model))[0][0]).astype(int).T
    assert (alpha[y, x] > 0).all()
    inner = slice(17, 68)
    assert (alpha[y[inner], x[inner]] == 255).all()


def test_nobody_has_eyes_half_closed(model):
    assert np.isfinite(landmarks(model)).all()
    if model.eye_open > 0:
        assert openness(model) > 0.22
    else:
        assert 0 < openness(model) < 0.17


@pytest.mark.parametrize(("name", "model"), [("sitter", SITTER), ("painted", PAINTED)])
def test_people_of_the_embedded_data_stay_as_they_are(name, model):
    chosen = landmarks(model)[[0, 8, 17, 30, 36, 37, 48, 57]]
    np.testing.assert_allclose(chosen, KEPT[name], atol=2e-6)


def test_a_beard_covers_the_chin_but_not_the_lips():
    model = PEOPLE["bearded"]
    with_beard = seen(model)
    without = photograph(model._replace(beard_full=0.0), ROUND)
    x, y = np.floor(ROUND.project(landmarks(model))[0][0]).astype(int).T
    assert with_beard.surface[y[8] - 2, x[8]] == 1
    assert with_beard.surface[y[57] - 1, x[57]] == 0
    assert with_beard.depth[y[8] - 2, x[8]] < without.depth[y[8] - 2, x[8]] - 0.02


def test_spectacles_stand_off_the_face():
    model = PEOPLE["spectacles"]
    dressed, bare = seen(model), photograph(model._replace(spectacles=0.0), ROUND)
    rims = (dressed.surface == 4) & (bare.surface >= 0)
    away = bare.depth[rims] - dressed.depth[rims]
    assert np.median(away) > 0.04
    assert away.min() > -0.02
    assert np.median(dressed.image[rims][:, :3]) < 0.5 * np.median(bare.image[rims][:, :3])


def test_spectacles_agree_with_the_numpy_reference():
    model = PEOPLE["spectacles"]
    x, y, z = np.random.default_rng(2).uniform((-0.6, -0.3, -0.3), (0.6, 0.3, 0.8), (800, 3)).T
    found = [worn_distance(model, *point) for point in zip(x, y, z)]
    np.testing.assert_allclose(found, reference.worn(model, x, y, z), atol=1e-9)


@pytest.mark.parametrize("style", ["fauve", "charcoal", "impression"])
def test_painter_takes_spectacles(style, monkeypatch):
    model = PEOPLE["spectacles"]
    bare = model._replace(spectacles=0.0)
    monkeypatch.setattr(painting, "PAINTED", model)
    dressed = painted_exemplar(style, 120, 160)
    monkeypatch.setattr(painting, "PAINTED", bare)
    difference = np.abs(dressed.image.astype(int) - painted_exemplar(style, 120, 160).image).sum(-1)
    worn = photograph(model, painting.exemplar_camera(120, 160)).surface == 4
    assert difference[worn].mean() > 40
