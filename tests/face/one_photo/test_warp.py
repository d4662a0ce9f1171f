"""A fitted head is laid over its photos."""

import numpy as np
from scipy.spatial.transform import Rotation

from lfportrait.face.head_fit import HeadFit, Picture, View
from lfportrait.face.head_prior import HeadPrior, generic_prior
from lfportrait.face.one_photo.solid import scalp
from lfportrait.face.one_photo.warp import warped, warped_together

FLIP = np.diag([1.0, -1.0, -1.0])
FOCAL, SIZE = 900.0, 600
NOSE = 7
"""Mode of the generic head."""


def _view(prior: HeadPrior, yaw: float) -> View:
    turn = FLIP @ Rotation.from_euler("y", yaw, degrees=True).as_matrix()
    return View(turn, np.array([0, 0, 0.8]), FOCAL, np.full(2, SIZE / 2),
                np.zeros(len(prior.expression)))


def test_the_chin_follows_its_landmarks():
    prior = generic_prior()
    view, vertices = _view(prior, 0.0), prior.shape(np.zeros(0), np.zeros(0))
    landmarks = view.project(vertices)[prior.landmarks]
    landmarks[5:12, 1] += 12.0
    points = warped(prior, view, vertices, Picture((SIZE, SIZE), landmarks, FOCAL))
    moved = points[:, :2] / points[:, 2:] * FOCAL + SIZE / 2 - view.project(vertices)
    assert 8.0 < moved[prior.landmarks[8], 1] < 16.0
    assert np.abs(moved[prior.landmarks[36:48]]).max() < 2.0
    # Depths stay the model's.
    assert np.allclose(points[:, 2], view.to_camera(vertices)[:, 2])


def test_photos_from_two_sides_say_how_deep_a_face_is():
    prior = generic_prior()
    identity = np.zeros(len(prior.identity))
    identity[NOSE] = 3.0  # a centimetre longer
    true, views = prior.shape(identity, np.zeros(0)), [_view(prior, yaw) for yaw in (0.0, 40.0)]
    pictures = [Picture((SIZE, SIZE), view.project(true)[prior.landmarks], FOCAL)
                for view in views]
    fit = HeadFit(prior, np.zeros(len(prior.identity)), views, [0.0, 0.0], 0.0)
    tip = prior.landmarks[30]
    start, end = fit.vertices(0)[tip, 2], true[tip, 2]
    depth = 0.8 - warped_together(fit, pictures)[tip, 2]
    assert abs(depth - end) < 0.5 * abs(start - end)
    one = warped_together(HeadFit(prior, fit.identity, views[:1], [0.0], 0.0), pictures[:1])
    assert np.isclose(0.8 - one[tip, 2], start)


def test_hair_grows_on_crown_and_nape_and_neither_on_ears_nor_on_the_face():
    places = np.array([(0.0, 0.21, 0.0), (0.0, 0.06, -0.10), (0.07, 0.15, -0.02),
                       (0.088, 0.09, -0.03), (0.03, 0.11, 0.06), (0.0, 0.15, 0.08),
                       (0.05, 0.0, -0.05)])
    assert scalp(places).tolist() == [True, True, True, False, False, False, False]
