"""What the skin shows says how a head is turned to several photos."""

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from lfportrait.face.head_fit import Found, HeadFit, Picture, View, refit
from lfportrait.face.head_prior import EYES, generic_prior, with_normals
from lfportrait.face.one_photo.matches import found_again, of_one_moment

FLIP = np.diag([1.0, -1.0, -1.0])
FOCAL, SIZE = 560.0, 300
TURNED = 30.0


def _view(yaw):
    turn = FLIP @ Rotation.from_euler("y", yaw, degrees=True).as_matrix()
    return View(turn, np.array([0, 0, 0.8]), FOCAL, np.full(2, SIZE / 2), np.zeros(0))


def _photo(prior, vertices, view, skin, finer=1):
    """A picture of a head whose vertices have grey values, drawn from behind to the front.

    ``finer``: drawn so many times as large.
    """
    local = view.to_camera(vertices)
    towards = (with_normals(vertices, prior.triangles) @ view.rotation.T * local).sum(axis=1) < 0
    image = np.zeros((finer * SIZE, finer * SIZE), np.uint8)
    shown = prior.triangles[towards[prior.triangles].all(axis=1)]
    corners = np.rint(view.project(vertices) * 16 * finer).astype(np.int32)
    for triangle in shown[np.argsort(-local[shown, 2].mean(axis=1))]:
        cv2.fillConvexPoly(image, corners[triangle], int(skin[triangle].mean()), cv2.LINE_8, 4)
    image = cv2.resize(image, (SIZE, SIZE), interpolation=cv2.INTER_AREA)
    return np.repeat(image[..., None], 3, axis=2)


def _grainy(vertices, seed):
    """Grey values of vertices [N, 3] in skin with freckles."""
    grain = gaussian_filter(np.random.default_rng(seed).normal(size=(80, 80, 80)), 1.5)
    grain *= 60 / grain.std()
    places = np.clip((vertices / 0.006).astype(int) + 40, 0, 79)
    return np.clip(128 + grain[tuple(places.T)], 20, 235)


def test_a_face_that_is_seen_as_turned_too_little_is_turned_by_what_its_skin_shows():
    prior = generic_prior()
    vertices = prior.shape(np.zeros(0), np.zeros(0))
    skin = _grainy(vertices, 0)
    true = [_view(0.0), _view(TURNED)]
    seen = [_view(0.0), _view(TURNED - 4.0)]  # as detectors do
    images = [_photo(prior, vertices, view, skin) for view in true]
    pictures = [Picture((SIZE, SIZE), view.project(vertices)[prior.landmarks], FOCAL)
                for view in seen]
    fit = HeadFit(prior, np.zeros(len(prior.identity)), seen, [0.0, 0.0], 0.0)
    found = found_again(fit, pictures, images)
    first, = found[0]
    other, = found[1]
    assert len(first.vertices) > 20 and (prior.part[first.vertices] != EYES).all()
    assert np.array_equal(first.vertices, other.vertices)
    # The first photo shows them where the head is; the other one where they truly are.
    assert np.allclose(first.places, seen[0].project(vertices)[first.vertices])
    away = other.places - true[1].project(vertices)[other.vertices]
    assert np.median(np.linalg.norm(away, axis=1)) < 1.0
    yaw = refit(fit, pictures, found).views[1].angles["yaw"]
    assert abs(abs(yaw) - TURNED) < 1.5


def test_photos_that_show_nothing_alike_say_nothing():
    prior = generic_prior()
    vertices = prior.shape(np.zeros(0), np.zeros(0))
    views = [_view(0.0), _view(TURNED)]
    pictures = [Picture((SIZE, SIZE), view.project(vertices)[prior.landmarks], FOCAL)
                for view in views]
    fit = HeadFit(prior, np.zeros(len(prior.identity)), views, [0.0, 0.0], 0.0)
    blank = np.full((SIZE, SIZE, 3), 128, np.uint8)
    assert found_again(fit, pictures, [blank, blank]) == [[], []]


def test_photos_of_another_day_are_known_by_what_they_show():
    prior = generic_prior()
    vertices = prior.shape(np.zeros(0), np.zeros(0))
    views = [_view(yaw) for yaw in (0.0, 20.0, 50.0)]
    pictures = [Picture((SIZE, SIZE), view.project(vertices)[prior.landmarks], FOCAL)
                for view in views]
    fit = HeadFit(prior, np.zeros(len(prior.identity)), views, [0.0] * 3, 0.0)
    first, aside, far = (_photo(prior, vertices, view, _grainy(vertices, 0), 2) for view in views)
    other = _photo(prior, vertices, views[1], _grainy(vertices, 1), 2)
    assert of_one_moment(fit, pictures, [first, other, far]) == [True, False, True]
    # In other light, and half as bright, it is of the same moment; where nothing is seen, of none.
    darker = np.asarray(aside * np.linspace(0.3, 0.6, SIZE)[:, None, None], np.uint8)
    blank = np.full_like(darker, 128)
    assert of_one_moment(fit, pictures, [first, darker, blank]) == [True, True, False]


def test_a_surface_unlike_the_models_turns_no_photo():
    prior = generic_prior()
    vertices = prior.shape(np.zeros(0), np.zeros(0)).astype(float)
    face = np.flatnonzero((vertices[:, 2] > np.quantile(vertices[:, 2], 0.7))
                          & (prior.part != EYES))
    chosen = np.sort(np.random.default_rng(0).choice(face, 120, replace=False))
    # A chin that recedes, which no mode has: from the front nothing of it is seen.
    true = vertices.copy()
    true[:, 2] += 0.15 * (true[:, 1] - true[chosen, 1].mean())
    views = [_view(0.0), _view(40.0)]
    places = [view.project(true) for view in views]
    pictures = [Picture((SIZE, SIZE), shown[prior.landmarks], FOCAL) for shown in places]
    fit = HeadFit(prior, np.zeros(len(prior.identity)), views, [0.0, 0.0], 0.0)
    first, other = (Found(chosen, shown[chosen]) for shown in places)
    again = refit(fit, pictures, [[first], [other]], rounds=8)
    turn = again.views[1].rotation @ again.views[0].rotation.T
    away = Rotation.from_matrix(turn @ (views[1].rotation @ views[0].rotation.T).T)
    assert np.degrees(away.magnitude()) < 1.5
