"""A head is fitted to the landmarks of a photo."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.optimize import lsq_linear
from scipy.spatial.transform import Rotation

from lfportrait.errors import UserError
from lfportrait.face import head_fit
from lfportrait.face.head_fit import (
    Picture,
    View,
    check_faces,
    fit_head,
    outline_errors,
    outline_vertices,
    unfit,
)
from lfportrait.face.head_prior import EYES, FACE, SOCKETS, generic_prior, read_ict, with_normals
from lfportrait.face.one_photo.parts import signed_distance

FLIP = np.diag([1.0, -1.0, -1.0])
FOCAL, SIZE = 900.0, 600


def _seen(yaw: float, pitch: float = 0.0, identity: np.ndarray | None = None, away: float = 0.8,
          ) -> tuple[np.ndarray, np.ndarray]:
    """Landmarks of a head of the generic prior in a picture, and its vertices."""
    prior = generic_prior()
    vertices = prior.shape(np.zeros(0) if identity is None else identity, np.zeros(0))
    turn = FLIP @ Rotation.from_euler("yx", [yaw, -pitch], degrees=True).as_matrix()
    local = vertices @ turn.T + [0, 0, away]
    pixels = local[:, :2] / local[:, 2:] * FOCAL + SIZE / 2
    return pixels[prior.landmarks], vertices


def test_pose_and_shape_are_recovered():
    prior = generic_prior()
    identity = np.zeros(len(prior.identity))
    identity[[1, 4]] = 2.0, -2.5
    landmarks, vertices = _seen(12.0, 4.0, identity)
    fit = fit_head(prior, [Picture((SIZE, SIZE), landmarks, FOCAL)])
    angles = fit.views[0].angles
    assert abs(angles["yaw"] - 12.0) < 2.0 and abs(angles["pitch"] - 4.0) < 3.0
    assert fit.pixels[0] < 2.0
    # Width and jaw may stand for each other; the heads are alike from the front.
    away = np.abs(fit.vertices(0) - vertices)[prior.landmarks[17:], :2]
    assert away.mean() < 0.003


@pytest.mark.slow  # fits a head once more
def test_an_unknown_focal_length_takes_a_usual_distance():
    landmarks, _ = _seen(0.0)
    fit = fit_head(generic_prior(), [Picture((SIZE, SIZE), landmarks)])
    assert 0.5 < fit.views[0].shift[2] < 1.3


@pytest.mark.slow  # fits a head once more
def test_an_outline_that_draws_a_face_from_its_landmarks_is_not_its_own(monkeypatch):
    prior = generic_prior()
    landmarks, vertices = _seen(0.0)
    local = vertices @ FLIP.T + [0, 0, 0.8]
    cover = np.zeros((SIZE, SIZE), np.uint8)
    for corners in np.rint(local[:, :2] / local[:, 2:] * FOCAL + SIZE / 2).astype(
            np.int32)[prior.triangles]:
        cv2.fillConvexPoly(cover, corners, 1)
    cap = cv2.dilate(cover, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (61, 61)))
    cap[int(landmarks[33, 1]):] = cover[int(landmarks[33, 1]):]
    picture = Picture((SIZE, SIZE), landmarks, FOCAL, signed_distance(cap.astype(np.float32)))
    drawn = fit_head(prior, [picture])
    assert drawn.views[0].angles["pitch"] > 3.0
    # The generic head is stiff: the cap draws its face by 0.7 % of the eyes' distance.
    monkeypatch.setattr(head_fit, "STRAINED", (0.005, 2.0))
    found = fit_head(prior, [picture])
    assert abs(found.views[0].angles["pitch"]) < 1.0 and found.pixels[0] < 0.5 * drawn.pixels[0]


def test_two_photos_share_one_shape():
    prior = generic_prior()
    pictures = [Picture((SIZE, SIZE), _seen(yaw)[0], FOCAL) for yaw in (0.0, 40.0)]
    fit = fit_head(prior, pictures)
    assert len(fit.views) == 2 and abs(fit.views[1].angles["yaw"] - 40.0) < 3.0


def test_every_photo_has_a_likely_distance(monkeypatch):
    # What a model can't know, all photos of a head show alike: it must not outvote the distance.
    picture = Picture((SIZE, SIZE), _seen(0.0)[0])

    def unlikely(photos: int) -> float:
        costs = []
        for spread in (0.15, 1e6):
            monkeypatch.setattr(head_fit, "SPREAD", spread)
            solver = head_fit._Solver(generic_prior(), [picture] * photos, 0.6)
            solver.solve(1, outlines=False)
            costs.append(solver.cost)
        return costs[0] - costs[1]

    assert unlikely(1) == pytest.approx((np.log(0.6 / 0.8) / 0.15) ** 2)
    assert unlikely(3) == pytest.approx(3 * unlikely(1))


# The most turned, and one that is raised.
@pytest.mark.parametrize("yaw, pitch, away", [
    (-30, -15, 0.9), (6, 20, 0.5), *(pytest.param(*one, marks=pytest.mark.slow) for one in (
        (-20, 20, 0.5), (0, 0, 0.9), (25, 8, 0.9)))])
def test_no_vertex_within_a_turned_head_is_on_its_outline(yaw, pitch, away):
    # Where ears, nostrils or lips lie one behind the other, a drawing of its triangles has holes.
    prior = generic_prior()
    points = prior.mean.astype(float)
    turn = Rotation.from_euler("yx", [yaw, pitch], degrees=True).as_matrix() @ FLIP
    view = View(turn, np.array([0, 0, away]), 1000 * away, np.array([256.0, 256]), np.zeros(0))
    rim = outline_vertices(view, prior, points, with_normals(points, prior.triangles), neck=True)
    seen = view.project(points)
    cover = np.zeros((512, 512), np.uint8)
    for corners in np.rint(seen[prior.triangles]).astype(np.int32):
        cv2.fillConvexPoly(cover, corners, 1)
    deep = cv2.distanceTransform(cover, cv2.DIST_L2, 5)
    column, row = np.rint(seen[rim]).astype(int).T
    assert len(rim) > 40 and deep[row, column].max() < 6  # pixels; a face is 190 wide


def test_what_can_not_fit_is_refused():
    prior = generic_prior()
    with pytest.raises(UserError, match="turned by"):
        fit_head(prior, [Picture((SIZE, SIZE), _seen(55.0)[0], FOCAL)], ["side.jpg"])
    landmarks, _ = _seen(0.0)
    mixed = landmarks.copy()
    # Nose and eyes stay: by these it is no profile.
    parts = np.r_[17:27, 48:68]
    mixed[parts] = landmarks[parts][np.random.default_rng(1).permutation(len(parts))]
    with pytest.raises(UserError, match="fits no face"):
        fit_head(prior, [Picture((SIZE, SIZE), mixed, FOCAL)], ["odd.jpg"])
    profile = _seen(80.0)[0]
    profile[17:27] += np.random.default_rng(1).normal(0, 40, (10, 2))  # brows that are hidden
    with pytest.raises(UserError, match="turned by"):
        fit_head(prior, [Picture((SIZE, SIZE), profile, FOCAL)], ["profile.jpg"])


@pytest.mark.slow  # fits a head once more
def test_a_photo_of_another_face_is_found_among_several():
    prior = generic_prior()
    pictures = [Picture((SIZE, SIZE), _seen(yaw)[0], FOCAL) for yaw in (0.0, 15.0)]
    odd = pictures[1].landmarks.copy()
    odd[17:] = odd[17:][np.random.default_rng(1).permutation(51)]
    pictures.append(replace(pictures[1], landmarks=odd))
    fit = fit_head(prior, pictures)
    assert unfit(fit, pictures) == [2]


def test_the_mean_has_a_level_of_its_own():
    prior = generic_prior()
    rest = prior.rest
    assert abs(rest[prior.landmarks[8], 1]) < 1e-9
    assert abs(rest[prior.landmarks[[0, 16]], 2].sum()) < 1e-6
    assert 0.09 < rest[prior.landmarks[36], 1] < 0.15


def test_sockets_and_the_backs_of_eyes_are_left_out_of_the_outer_surface():
    prior = generic_prior()
    part = np.full(len(prior.mean), FACE, np.uint8)
    part[:240], part[-400:] = SOCKETS, EYES
    head = replace(prior, part=part)
    left = head.outer
    assert not (part[left] == SOCKETS).any() and len(left) < len(prior.triangles)
    assert len(prior.outer) == len(prior.triangles)


def test_faces_are_checked():
    face = _seen(0.0)[0]
    with pytest.raises(UserError, match="no face was found in a"):
        check_faces([], "a.jpg")
    with pytest.raises(UserError, match="shows 2 faces"):
        check_faces([face, face + 200], "a.jpg")
    with pytest.raises(UserError, match="too small"):
        check_faces([0.3 * face], "a.jpg")
    assert check_faces([face, 0.2 * face], "a.jpg") is face


def test_a_turned_face_is_not_too_small_because_it_is_narrow():
    prior = generic_prior()
    seen = prior.mean[prior.landmarks, :2] * np.array([1.0, -1.0])
    face = np.asarray(seen / np.ptp(seen[:17, 0]) * 200, np.float64)
    turned = face * np.array([0.6, 1.0])
    assert np.linalg.norm(turned[16] - turned[0]) < 150
    assert check_faces([turned], "a.jpg") is turned
    with pytest.raises(UserError, match="too small"):
        check_faces([0.6 * turned], "a.jpg")


def test_the_lean_of_detectors_is_taken_off():
    prior = replace(generic_prior(), lean=np.full((68, 3), 0.1))
    points = np.zeros((68, 2))
    points[45] = 10.0, 0.0
    assert np.allclose(prior.vertices_seen(points)[0], [-1.0, -1.0])


def test_a_repacked_head_is_closed_above_its_neck(tmp_path):
    """A tetrahedron's worth of a file in the form of the real one."""
    rng = np.random.default_rng(0)
    ring = np.array([(np.cos(a), 0.0, np.sin(a)) for a in np.linspace(0, 2 * np.pi, 8)[:-1]])
    mean = np.concatenate([ring, [[0.0, 1.0, 0.0]]]).astype(np.float32)
    triangles = np.array([[k, 7, (k + 1) % 7] for k in range(7)], np.int32)
    names = np.array(["jawOpen"] * 1)
    path = tmp_path / "head.npz"
    np.savez(path, mean=mean, triangles=triangles, part=np.zeros(8, np.uint8),
             landmarks68=np.zeros(68, np.int64), identity=rng.integers(-9, 9, (2, 8, 3)),
             identity_scale=np.ones(2, np.float32), expression=rng.integers(-9, 9, (1, 8, 3)),
             expression_scale=np.ones(1, np.float32), expression_names=names)
    with pytest.raises(UserError, match="damaged"):  # it lacks expressions
        read_ict(path)
    every = np.array(_names())
    np.savez(path, mean=mean, triangles=triangles, part=np.zeros(8, np.uint8),
             landmarks68=np.zeros(68, np.int64), identity=rng.integers(-9, 9, (2, 8, 3)),
             identity_scale=np.ones(2, np.float32),
             expression=rng.integers(-9, 9, (len(every), 8, 3)),
             expression_scale=np.ones(len(every), np.float32), expression_names=every)
    head = read_ict(path)
    assert len(head.mean) == 9 and len(head.triangles) == 14
    edges = np.sort(head.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()


def _names() -> tuple[str, ...]:
    from lfportrait.face import head_prior

    return head_prior._USED


def test_clothes_draw_no_outline():
    view = View(np.eye(3), np.array([0, 0, 0.8]), 800.0, np.array([200.0, 200.0]), np.zeros(0))
    column = np.broadcast_to(np.arange(400, dtype=np.float32), (400, 400))
    inside = 300.0 - column  # the person ends at column 300
    landmarks = np.zeros((68, 2))
    landmarks[45, 0] = 100.0
    bare = Picture((400, 400), landmarks, None, np.asarray(inside, np.float32))
    clothed = np.zeros((400, 400), bool)
    clothed[200:, 280:] = True
    places = np.array([[270.0, 100.0], [270.0, 300.0]])
    assert not outline_errors(bare, places, view)[2].any()
    away, slope, hair = outline_errors(replace(bare, clothes=clothed), places, view)
    assert hair.tolist() == [0, 1] and np.allclose(away, 30)
    assert np.allclose(slope, [[-1, 0], [-1, 0]])


@pytest.mark.slow  # fits a head once more
def test_ground_that_a_matte_takes_for_the_person_bends_no_head():
    prior = generic_prior()
    landmarks, vertices = _seen(0.0)
    pixels = vertices @ FLIP.T + [0, 0, 0.8]
    pixels = pixels[:, :2] / pixels[:, 2:] * FOCAL + SIZE / 2
    matte = np.zeros((int(SIZE), int(SIZE)), np.float32)
    for corners in np.rint(pixels[prior.triangles]).astype(np.int32):
        cv2.fillConvexPoly(matte, corners, 1)
    row = int(landmarks[4, 1])
    fits = []
    for ground in (False, True):
        if ground:  # it lies against both cheeks
            matte[row - 50:] = 1
        picture = Picture((int(SIZE), int(SIZE)), landmarks, FOCAL, signed_distance(matte))
        fits.append(fit_head(prior, [picture], ["photo"]))
    pitch = [fit.views[0].angles["pitch"] for fit in fits]
    assert abs(pitch[0] - pitch[1]) < 1.5, pitch


def test_a_step_within_bounds_knows_what_is_held_there():
    """What is merely cut off at a bound leaves the others where they counted on it."""
    random = np.random.default_rng(0)
    for _ in range(20):
        rows, wanted = random.normal(size=(30, 8)), random.normal(size=30)
        normal, right = rows.T @ rows, rows.T @ wanted
        free = np.linalg.solve(normal, right)
        low, high = np.full(8, -0.05), np.full(8, np.inf)
        low[:2] = -np.inf

        def error(step, rows=rows, wanted=wanted):
            return float(((rows @ step - wanted) ** 2).sum())

        found = head_fit.bounded_step(normal, right, low, high)
        best = lsq_linear(rows, wanted, (low, high)).x
        assert (found >= low).all() and (found <= high).all()
        assert np.allclose(head_fit.bounded_step(normal, right, low - 9, high), free)
        assert (free < low).any()
        assert error(np.clip(free, low, high)) > error(best) + 0.01
        assert error(found) == pytest.approx(error(best), abs=1e-6)
