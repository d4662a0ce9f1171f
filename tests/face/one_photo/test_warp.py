"""A fitted head is laid over its photos."""

from dataclasses import replace

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from lfportrait.face.head_fit import HeadFit, Picture, View
from lfportrait.face.head_prior import HeadPrior, generic_prior
from lfportrait.face.one_photo.ears import laid_on, shows
from lfportrait.face.one_photo.parts import signed_distance
from lfportrait.face.one_photo.solid import STANDS, ear_light, scalp, standing_out
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


def test_the_chin_lies_on_the_edge_that_a_photo_shows():
    """Where it shows none landmarks say where it is."""
    prior = generic_prior()
    view, vertices = _view(prior, 0.0), prior.shape(np.zeros(0), np.zeros(0))
    landmarks = view.project(vertices)[prior.landmarks]
    jaw = landmarks[:17].copy()
    jaw[5:12, 1] += 12.0
    for edge, least, most in ((jaw, 8.0, 16.0), (np.full((17, 2), np.nan), -3.0, 3.0)):
        points = warped(prior, view, vertices, Picture((SIZE, SIZE), landmarks, FOCAL, jaw=edge))
        moved = points[:, :2] / points[:, 2:] * FOCAL + SIZE / 2 - view.project(vertices)
        assert least < moved[prior.landmarks[8], 1] < most


def _with_ears(prior: HeadPrior, view: View, stretch: float) -> tuple[Picture, np.ndarray]:
    """A photo of a head whose ears stand out so many times as far, and its vertices."""
    true = prior.shape(np.zeros(0), np.zeros(0))
    true[:, 0] += np.sign(true[:, 0]) * (stretch - 1) * standing_out(prior.rest)
    seen = view.project(true)
    matte = np.zeros((SIZE, SIZE), np.uint8)
    for corners in np.rint(seen[prior.triangles]).astype(np.int32):
        cv2.fillConvexPoly(matte, corners, 1)
    return Picture((SIZE, SIZE), seen[prior.landmarks], FOCAL, signed_distance(matte)), true


def _ears(prior: HeadPrior, side: int) -> np.ndarray:
    return (standing_out(prior.rest) > STANDS) & (side * prior.rest[:, 0] > 0)


def test_flat_ears_are_laid_back_without_folds():
    prior, view = generic_prior(), _view(generic_prior(), 0.0)
    picture, true = _with_ears(prior, view, 0.5)
    vertices = prior.shape(np.zeros(0), np.zeros(0))
    points = warped(prior, view, vertices, picture)
    for side in (-1, 1):
        ear = _ears(prior, side)
        tips = ear & (standing_out(prior.rest) > 0.8 * standing_out(prior.rest)[ear].max())
        start, end, goal = (side * one[tips, 0].mean() for one in
                            (vertices, points, true))
        assert abs(end - goal) < 0.4 * abs(start - goal)
        # What stands out farther still does: every millimeter moves by less than itself.
        line = np.polyfit(standing_out(prior.rest)[ear], side * (points - vertices)[ear, 0], 1)
        left = side * (points - vertices)[ear, 0] - np.polyval(line, standing_out(prior.rest)[ear])
        assert -0.7 < line[0] < -0.2 and np.abs(left).max() < 0.003


def test_an_ear_before_hair_is_laid_on_what_is_bare():
    prior, view = generic_prior(), _view(generic_prior(), 0.0)
    plain, true = _with_ears(prior, view, 1.5)
    hair = (plain.inside < 0) & (np.arange(SIZE)[:, None] < SIZE / 2 + 60)
    hanging = replace(plain, inside=signed_distance((hair | (plain.inside > 0)).astype(np.float32)),
                      hair=hair.astype(np.float32))
    vertices = prior.shape(np.zeros(0), np.zeros(0))
    points = warped(prior, view, vertices, hanging)
    for side in (-1, 1):
        ear = _ears(prior, side)
        tips = ear & (standing_out(prior.rest) > 0.8 * standing_out(prior.rest)[ear].max())
        start, end, goal = (side * one[tips, 0].mean() for one in (vertices, points, true))
        assert abs(end - goal) < 0.4 * abs(start - goal)


def test_an_ear_that_the_photo_cuts_off_is_not_drawn_into_it():
    prior, view = generic_prior(), _view(generic_prior(), 0.0)
    plain, true = _with_ears(prior, view, 1.0)
    seen, ear = view.project(true), _ears(prior, 1)
    first, last = seen[ear, 0].min(), seen[ear, 0].max()
    bases = np.zeros((4, len(seen)))
    bases[0] = 1.0
    for part in (0.25, 0.6, 1.5):
        cut = replace(plain, inside=plain.inside[:, :int(first + part * (last - first))])
        moves = laid_on(prior, seen, bases, float(np.ptp(seen[ear, 1])), 1, cut)
        assert moves is None or np.abs(moves[:2]).max() < 0.1, part
    away = replace(plain, inside=plain.inside[:, :int(first)])
    assert laid_on(prior, seen, bases, float(np.ptp(seen[ear, 1])), 1, away) is None


def test_an_ear_under_hair_stays():
    prior, view = generic_prior(), _view(generic_prior(), 0.0)
    plain, _ = _with_ears(prior, view, 1.5)
    seen = view.project(prior.shape(np.zeros(0), np.zeros(0)))
    over = np.abs(np.arange(SIZE) - SIZE / 2) > np.abs(seen[prior.landmarks[16], 0] - SIZE / 2)
    hidden = replace(plain, inside=np.maximum(plain.inside, 5.0),
                     hair=np.broadcast_to(over, (SIZE, SIZE)).astype(np.float32))
    ear = _ears(prior, 1)
    bases = np.zeros((4, len(seen)))
    bases[0] = 1.0
    assert laid_on(prior, seen, bases, float(np.ptp(seen[ear, 1])), 1, hidden) is None


def test_a_narrow_face_shows_its_ears_beside_it():
    prior, view = generic_prior(), _view(generic_prior(), 0.0)
    plain, true = _with_ears(prior, view, 1.0)
    landmarks = plain.landmarks.copy()
    inward = np.array([6.0] * 3 + [-6.0] * 3)
    landmarks[[0, 1, 2, 14, 15, 16], 0] += inward
    points = warped(prior, view, true, replace(plain, landmarks=landmarks))
    assert shows(prior, view.project(true), 1) > 0.5
    moved = points[:, :2] / points[:, 2:] * FOCAL + SIZE / 2 - view.project(true)
    cheeks = (np.abs(prior.rest[:, 0]) > 0.06) & (np.abs(prior.rest[:, 2] - 0.01) < 0.006)
    cheeks &= (prior.rest[:, 1] > 0.06) & (prior.rest[:, 1] < 0.1)
    assert (moved[cheeks, 0] * -np.sign(prior.rest[cheeks, 0])).mean() > 2.0


def test_an_ear_that_is_not_seen_is_like_the_other():
    prior, view = generic_prior(), _view(generic_prior(), 35.0)
    picture, _ = _with_ears(prior, view, 1.6)
    vertices = prior.shape(np.zeros(0), np.zeros(0))
    moved = (warped(prior, view, vertices, picture) - view.to_camera(vertices)) @ view.rotation
    one, two = (side * moved[_ears(prior, side), 0].mean() for side in (-1, 1))
    assert max(one, two) > 0.002
    assert min(one, two) > 0.25 * max(one, two)


def test_hollows_of_ears_are_darker_than_their_rims():
    rest = generic_prior().rest
    hollow = np.linalg.norm(rest[:, 1:] - [0.10, -0.02], axis=1) < 0.006
    hollow &= np.abs(rest[:, 0]) > 0.07
    rest[hollow, 0] -= np.sign(rest[hollow, 0]) * 0.003
    light, rims = ear_light(rest, rest), standing_out(rest) > 0.01
    assert np.median(light[hollow]) < 0.97
    assert np.median(light[rims]) > 1
    # Faces, cheeks and skulls keep theirs.
    assert (light[np.abs(rest[:, 0]) < 0.05] == 1).all()


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
