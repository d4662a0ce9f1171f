"""Faces that are turned: their pose, and what their frontal picture shows, against a known head."""

from functools import cache, lru_cache

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some
from scipy.interpolate import RBFInterpolator
from scipy.ndimage import label
from scipy.spatial.transform import Rotation

from lfportrait.errors import UserError
from lfportrait.example import Exemplar
from lfportrait.example.frontal import (
    FRONTAL,
    _normals,
    clearness,
    frontal_view,
    frontalised,
    in_front,
    suited,
)
from lfportrait.face import FacePose, face_pose
from lfportrait.face.landmarks import EGG, GENERIC_LANDMARKS, MIRRORED, generic_depth

SIZE = 240
SCALE = 130.0


def some_sides(*quick, slow):
    """Turns to try; slow ones are of the other side, and a mirrored painting is tried below."""
    return pytest.mark.parametrize("yaw", [*quick, *(
        pytest.param(yaw, marks=pytest.mark.slow) for yaw in slow)])


def posed(yaw, pitch=0.0, roll=0.0, scale=SCALE, shift=(120.0, 110.0)):
    """A pose by its angles, as `FacePose` tells them."""
    turn = Rotation.from_euler("zxy", [roll, -pitch, yaw], degrees=True).as_matrix()
    return FacePose(turn, scale, np.asarray(shift, float), 0.0)


def paint(x, y):
    """What is painted on the head: waves, different on either side."""
    waves = [np.sin(9 * x + 5 * y + 1), np.sin(7 * y - 4 * x), np.cos(8 * x)]
    return 128 + 80 * np.stack(waves, axis=-1)


@lru_cache(maxsize=1)
def surface():
    """Points of the generic head, several for each pixel of a portrait, [N, 3]."""
    x, y = np.meshgrid(np.linspace(-0.47, 0.47, 500), np.linspace(-0.62, 0.6, 640))
    points = np.stack([x, y, generic_depth(x, y)], axis=-1).reshape(-1, 3)
    return points[(points[:, 0] / 0.42) ** 2 + (points[:, 1] / 0.62) ** 2 < 1]


def portrait(pose):
    """The painted generic head in a pose, its far points first, on grey; and where it is seen."""
    points = surface()
    points = points[np.argsort(pose.depth(points))]
    place = np.floor(pose.project(points)).astype(int)
    kept = ((place >= 0) & (place < SIZE)).all(axis=1)
    image = np.full((SIZE, SIZE, 3), 90.0)
    image[place[kept, 1], place[kept, 0]] = paint(points[kept, 0], points[kept, 1])
    mask = np.zeros((SIZE, SIZE), np.float32)
    mask[place[kept, 1], place[kept, 0]] = 1
    mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    return Exemplar(image.astype(np.uint8), pose.project(GENERIC_LANDMARKS), "turned", mask)


@cache
def frontal(yaw):
    """The head turned by so many degrees, and its frontal picture. Not to be changed."""
    exemplar = portrait(posed(yaw))
    return exemplar, frontal_view(exemplar, face_pose(exemplar.landmarks))


def test_the_frontal_mask_is_one_person():
    exemplar = portrait(posed(30.0))
    exemplar.mask[205:230, 5:30] = 1  # somebody's hand
    mask = frontal_view(exemplar, face_pose(exemplar.landmarks)).mask
    assert mask[110, 120] > 0.99
    assert label(mask > 0.5)[1] == 1


@settings(max_examples=10, deadline=None)
@given(some.floats(-55, 55), some.floats(-20, 20), some.floats(-25, 25), some.floats(30, 400))
def test_a_pose_comes_back_from_its_landmarks(yaw, pitch, roll, scale):
    pose = posed(yaw, pitch, roll, scale)
    found = face_pose(pose.project(GENERIC_LANDMARKS))
    assert np.abs(found.rotation - pose.rotation).max() < 1e-3
    assert abs(found.scale / scale - 1) < 1e-3 and found.residual < 1e-3 * scale
    assert np.abs(found.shift - pose.shift).max() < 1e-2 * scale


def test_angles_are_told_as_they_are_meant():
    for name in ("yaw", "pitch", "roll"):
        pose = posed(**{"yaw": 0.0, name: 20.0})
        assert abs(getattr(pose, name) - 20) < 1e-6
        assert all(abs(getattr(pose, other)) < 1e-6 for other in {"yaw", "pitch", "roll"} - {name})
    nose = posed(20.0).project(np.array([0.0, 0.0, 1.0])) - posed(20.0).project(np.zeros(3))
    assert nose[0] > 0 and abs(nose[1]) < 1e-9
    assert posed(0.0, pitch=20.0).project(np.array([0.0, 0.0, 1.0]))[1] < 110


def test_the_depth_of_a_head_is_that_of_a_spline_which_is_asked_everywhere():
    """Where no face is, the spline is not asked."""
    random = np.random.default_rng(4)
    head = GENERIC_LANDMARKS + random.normal(0, 0.01, (68, 3))
    x, y = random.uniform(-1.2, 1.2, (2, 40, 30))
    spline = RBFInterpolator(head[:, :2], head[:, 2], kernel="thin_plate_spline", smoothing=1e-4)
    low, high = head[8, 1], head[17:27, 1].max()
    away = np.hypot(x / head[16, 0], (y - (low + high) / 2) / (0.625 * (high - low)))
    share = np.clip((1.15 - away) / 0.3, 0, 1)
    share = share ** 2 * (3 - 2 * share)
    egg = np.maximum(1 - (x / EGG[0]) ** 2 - ((y - 0.12) / EGG[1]) ** 2, 0)
    around = np.where(egg > 0, EGG[2] * np.sqrt(egg), -0.05)
    face = spline(np.stack([x.ravel(), y.ravel()], axis=1)).reshape(x.shape)
    np.testing.assert_allclose(generic_depth(x, y, head), share * face + (1 - share) * around,
                               atol=1e-12)
    assert 0.1 < (share > 0).mean() < 0.6


def test_the_generic_head_is_symmetric_and_its_depth_is_that_of_its_landmarks():
    assert np.abs(GENERIC_LANDMARKS[MIRRORED] * [-1, 1, 1] - GENERIC_LANDMARKS).max() < 2e-3
    inner = GENERIC_LANDMARKS[17:]
    assert np.abs(generic_depth(inner[:, 0], inner[:, 1]) - inner[:, 2]).max() < 0.04
    x, y = np.meshgrid(np.linspace(-1, 1, 41), np.linspace(-1, 1, 41))
    assert np.abs(generic_depth(x, y) - generic_depth(-x, y)).max() < 0.01


@some_sides(-40.0, slow=(-20.0, 20.0, 40.0))
def test_the_side_that_was_painted_is_shown_as_it_was_painted(yaw):
    exemplar = portrait(posed(yaw))
    found = frontal_view(exemplar, face_pose(exemplar.landmarks))
    # A place of the frontal picture is one of the head.
    across = (np.arange(SIZE) + 0.5 - SIZE / 2) / found.pose.scale
    down = (found.pose.shift[1] - np.arange(SIZE) - 0.5) / found.pose.scale
    x, y = np.meshgrid(across, down)
    face = (x / 0.34) ** 2 + ((y + 0.1) / 0.4) ** 2 < 1
    shown = face & (found.mirrored < 0.01)
    towards = np.sign(yaw) * x < 0  # turned to the right, the painter sees the left side
    assert shown[face & towards].mean() > 0.95
    error = (found.image - paint(x, y))[shown]
    assert 20 * np.log10(255 / np.sqrt((error ** 2).mean())) > 25


@some_sides(45.0, slow=(-45.0,))
def test_the_side_that_was_not_painted_is_the_other_one_mirrored(yaw):
    exemplar = portrait(posed(yaw))
    found = frontal_view(exemplar, face_pose(exemplar.landmarks))
    mirrored = found.mirrored > 0.99
    x = (np.arange(SIZE) + 0.5 - SIZE / 2) / found.pose.scale
    rows, columns = np.nonzero(mirrored)
    assert len(rows) > 500 and (np.sign(yaw) * x[columns] > 0).mean() > 0.9
    there = found.places[rows, columns]
    back = found.places[rows, SIZE - 1 - columns]
    away = np.abs(there - back).max(axis=1)
    eyes = [found.landmarks[eye] for eye in (slice(36, 42), slice(42, 48))]
    near = [np.hypot(columns - eye[:, 0].mean(), rows - eye[:, 1].mean()) for eye in eyes]
    assert away[np.minimum(*near) > 0.14 * found.pose.scale].max() < 1.0


@some_sides(-30.0, slow=(30.0,))
def test_both_eyes_look_where_the_painter_made_them_look(yaw):
    _, found = frontal(yaw)
    for eye in (slice(36, 42), slice(42, 48)):
        column, row = found.landmarks[eye].mean(axis=0).astype(int)
        assert found.mirrored[row, column] < 0.05


@some_sides(-30.0, 15.0, slow=(-15.0, 30.0))
def test_the_far_half_of_a_mouth_is_its_near_half_mirrored(yaw):
    exemplar, found = frontal(yaw)
    far, near = (54, 48) if yaw > 0 else (48, 54)
    column, row = np.floor(found.landmarks[far]).astype(int)
    assert found.mirrored[row, column] > 0.95
    assert np.abs(found.places[row, column] - exemplar.landmarks[near]).max() < 3
    column, row = np.floor(found.landmarks[near]).astype(int)
    assert found.mirrored[row, column] < 0.05


def test_a_shade_on_one_side_below_the_nose_is_not_mirrored():
    exemplar = portrait(posed(-16.0))
    marks = exemplar.landmarks
    # From just beyond the middle to the near side's wing of the nose.
    low = np.round(marks[33] + [0, 1]).astype(int)
    image = np.full_like(exemplar.image, 190)
    image[low[1]:low[1] + 4, low[0] - 4:low[0] + 18] = 40
    shaded = Exemplar(image, marks, "shaded", exemplar.mask)
    found = frontal_view(shaded, face_pose(marks))
    rows, middle = slice(int(found.landmarks[33, 1]), int(found.landmarks[33, 1]) + 6), SIZE // 2
    dark = (found.image[rows] < 100).all(axis=-1).sum(axis=0)
    near, far = dark[middle + 1:middle + 22].sum(), dark[middle - 22:middle - 1].sum()
    assert near > 40 and far < 0.5 * near


@some_sides(60.0, slow=(-60.0,))
def test_an_eye_that_was_not_painted_looks_where_the_other_looks(yaw):
    exemplar = portrait(posed(yaw))
    found = frontal_view(exemplar, face_pose(exemplar.landmarks))
    hidden, seen = (slice(42, 48), slice(36, 42)) if yaw > 0 else (slice(36, 42), slice(42, 48))
    middle, twin = (found.landmarks[eye].mean(axis=0) for eye in (hidden, seen))
    # The outer half is turned away from the painter; its paint is the other eye's, shifted.
    steps = np.sign(yaw) * np.arange(3, 7)
    row, column = int(middle[1]), np.round(middle[0] + steps).astype(int)
    assert (found.mirrored[row, column] > 0.9).all()
    there = found.places[row, column]
    wanted = found.places[row, np.round(twin[0] + steps).astype(int)]
    assert np.abs(there - wanted).max() < 1.0
    assert (np.diff(there[:, 0]) * np.sign(yaw) > 0).all()


def test_the_seam_goes_around_what_differs():
    # A dark lock on the far side's border: the cut passes before it, not through it.
    exemplar, plain = frontal(30.0)
    even = Exemplar(np.full_like(exemplar.image, 180), exemplar.landmarks, "even", exemplar.mask)
    lock = even.image.copy()
    rows = np.nonzero(plain.mirrored[:, 150] > 0)[0]
    assert len(rows)
    near = plain.places[60:90, 136:142].reshape(-1, 2).astype(int)
    lock[near[:, 1], near[:, 0]] = 20
    marked = Exemplar(lock, exemplar.landmarks, "lock", exemplar.mask)
    found = frontal_view(marked, face_pose(exemplar.landmarks))
    own = found.mirrored[60:90, 120:160] < 0.5
    edge = own.sum(axis=1) + 120
    assert ((edge < 137) | (edge > 141)).mean() > 0.9


def test_a_mirrored_painting_gives_the_mirrored_picture():
    exemplar = portrait(posed(30.0, 5.0, -4.0))
    mirror = Exemplar(exemplar.image[:, ::-1], (exemplar.landmarks * [-1, 1] + [SIZE, 0])[MIRRORED],
                      "mirror", np.ascontiguousarray(exemplar.mask[:, ::-1]))
    one, two = (frontal_view(each, face_pose(each.landmarks)) for each in (exemplar, mirror))
    assert np.abs(one.landmarks * [-1, 1] + [SIZE, 0] - two.landmarks[MIRRORED]).max() < 0.6
    away = np.abs(one.image[:, ::-1].astype(float) - two.image)
    # Outlines are a pixel's business.
    assert np.median(away) < 2 and (away > 40).mean() < 0.02


def test_a_photo_gets_the_painting_that_is_turned_more_alike():
    exemplar = portrait(posed(25.0))
    for yaw, alike in ((0.0, False), (-20.0, False), (20.0, True), (35.0, True)):
        chosen = suited(exemplar, posed(yaw).project(GENERIC_LANDMARKS))
        assert (chosen is exemplar) == alike
        assert alike or abs(face_pose(chosen.landmarks).yaw) < 1


@settings(max_examples=25, deadline=None)
@given(some.floats(-45, 45), some.floats(-15, 15), some.integers(17, 67),
       some.floats(-2, 2), some.floats(-2, 2))
def test_a_way_in_a_painting_is_one_in_its_frontal_picture(yaw, pitch, number, right, down):
    pose = posed(yaw, pitch)
    painted = pose.project(GENERIC_LANDMARKS)
    way = np.zeros((68, 2))
    way[number] = right, down
    found = in_front(way, painted, pose)
    assert not found[np.arange(68) != number].any()
    # There it leads to what the painting shows at the way's end.
    x, y = (GENERIC_LANDMARKS[number, :2]
            + np.outer([0, 1 / pose.scale], found[number]) * [1, -1]).T
    places = pose.project(np.stack([x, y, generic_depth(x, y)], axis=-1))
    # On the far side, which is hardly seen, it is held back.
    near = GENERIC_LANDMARKS[number, 0] * pose.rotation[2, 0] >= 0
    left = np.hypot(*(np.diff(places, axis=0)[0] - way[number]))
    assert left < (0.65 if near else 1) * np.hypot(right, down) + 0.1


def test_frontal_faces_stay_as_they_are_and_profiles_are_told():
    plain = portrait(posed(FRONTAL - 2))
    assert frontalised(plain) is plain
    turned = frontalised(portrait(posed(25.0)))
    assert abs(face_pose(turned.landmarks).yaw) < 1 and turned.mask is not None
    profile = portrait(posed(20.0))
    profile.landmarks = posed(75.0).project(GENERIC_LANDMARKS)
    with pytest.raises(UserError, match=r"to the picture's right by 7\d degrees"):
        frontalised(profile)


@pytest.mark.slow  # rays: tests/field
@pytest.mark.parametrize("yaw", [20.0, -40.0, 58.0])
def test_what_a_painter_saw_is_what_rays_reach(yaw):
    pose = posed(yaw, pitch=6.0)
    x, y = np.meshgrid(np.arange(-0.44, 0.44, 0.02), np.arange(0.6, -0.62, -0.02))
    points = np.stack([x, y, generic_depth(x, y)], axis=-1)
    seen = clearness(points, pose) > 0
    # A ray towards the painter meets the head where it runs below its surface.
    reached = np.ones(x.shape, bool)
    for step in np.linspace(0.003, 1.2, 200):
        ahead = points + step * pose.rotation[2]
        deep = generic_depth(ahead[..., 0], ahead[..., 1]) - ahead[..., 2]
        within = (ahead[..., 0] / 0.47) ** 2 + ((ahead[..., 1] - 0.02) / 0.7) ** 2 < 1
        reached &= ~((deep > 0.001) & within)
    # Not on the outline itself, where rays graze.
    grazing = np.abs(_normals(points) @ pose.rotation[2]) < 0.06
    head = ((x / 0.42) ** 2 + ((y + 0.02) / 0.58) ** 2 < 1) & ~grazing
    assert abs(yaw) < 30 or 0.05 < (~reached[head]).mean() < 0.6
    assert (seen == reached)[head].mean() > 0.99


@some_sides(-30.0, slow=(30.0,))
def test_what_lies_beyond_the_far_cheek_is_not_drawn_into_the_face(yaw):
    # A bonnet, which the person's mask does not tell from the face, of a head narrower than most.
    exemplar = portrait(posed(yaw))
    points, side = exemplar.landmarks.copy(), np.sign(yaw)
    far = np.arange(9, 17) if yaw > 0 else np.arange(7, -1, -1)
    points[far, 0] -= side * 0.09 * SCALE * np.clip(np.arange(8) / 3, 0, 1)
    line = [*points[far], points[far[-1]] - [0, 200], [points[far[-1], 0] + side * 200, -90],
            [points[8, 0] + side * 200, 240], points[8]]
    image = exemplar.image.copy()
    cv2.fillPoly(image, [np.round(line).astype(np.int32)], (255, 255, 255))
    dressed = Exemplar(image, points, "bonnet", np.ones_like(exemplar.mask))
    found = frontal_view(dressed, face_pose(exemplar.landmarks))
    rows, columns = np.mgrid[:SIZE, :SIZE] + 0.5
    marks = found.landmarks
    half = (marks[:17, 0].max() - marks[:17, 0].min()) / 2
    below = rows - marks[36:48, 1].mean()
    inside = np.hypot((columns - marks[8, 0]) / half, below / (marks[8, 1] - marks[36, 1])) < 0.9
    white = (found.image > 240).all(axis=-1)
    assert white[inside & (below > 0)].mean() < 0.002
