"""Photos of faces turned far: what is hidden, where the outline is, and where the guide leads."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some
from scipy.ndimage import distance_transform_edt

from lfportrait.example.frontal import face_aside
from lfportrait.example.guides.regions import Regions
from lfportrait.example.photo_guide import FlatGuide
from lfportrait.face.landmarks import GENERIC_LANDMARKS, MIRRORED
from tests.example.test_turned import SCALE, SIZE, portrait, posed, surface

LEAST = 20.0
EYES = SCALE * (GENERIC_LANDMARKS[45, 0] - GENERIC_LANDMARKS[36, 0])


def landmarks_of(yaw, pitch=0.0, roll=0.0):
    return posed(yaw, pitch, roll).project(GENERIC_LANDMARKS)


# Of the other side: slow, and a mirrored face is tried below.
@pytest.mark.parametrize("yaw", [-60.0, pytest.param(60.0, marks=pytest.mark.slow)])
def test_the_far_side_is_hidden_and_lies_on_the_outline(yaw):
    points = landmarks_of(yaw)
    found = face_aside(points, LEAST)
    far, near = (range(10, 17), range(7)) if yaw > 0 else (range(7), range(10, 17))
    assert found.hidden[list(far)].all() and not found.hidden[list(near)].any()
    assert not found.hidden[[27, 28, 29, 30]].any()  # the ridge of the nose
    assert np.array_equal(found.landmarks[~found.hidden], points[~found.hidden])
    # Of what is drawn: distance from the edge, on either side of it.
    mask = portrait(posed(yaw)).mask > 0.5
    edge = distance_transform_edt(mask) + distance_transform_edt(~mask)
    column, row = np.floor(found.landmarks[found.hidden]).astype(int).T
    assert edge[row, column].max() < 0.04 * SCALE
    # The jaw's own landmarks lie in the cheek.
    column, row = np.floor(points[list(far)]).astype(int).T
    assert edge[row, column].max() > 0.15 * SCALE


@pytest.mark.parametrize("yaw", [-65.0, *(
    pytest.param(yaw, marks=pytest.mark.slow) for yaw in (-45.0, 45.0, 65.0))])
def test_the_guide_leads_to_the_same_place_of_the_head(yaw):
    pose, frontal = posed(yaw), portrait(posed(0.0))
    painted = Regions(frontal.landmarks, frontal.mask, None)
    guide = FlatGuide(frontal, painted, painted.labels())
    photo = portrait(pose)
    aside = face_aside(photo.landmarks, LEAST)
    points = surface()
    near = points[:, 0] * np.sign(yaw) < 0.02
    face = points[near & ((points[:, 0] / 0.33) ** 2 + ((points[:, 1] + 0.1) / 0.42) ** 2 < 1)]
    column, row = np.floor(pose.project(face)).astype(int).T
    wanted = posed(0.0).project(face)

    def error(landmarks, seen):
        regions = Regions(landmarks, photo.mask, None)
        position = guide(np.ones((SIZE, SIZE), np.float32), landmarks, regions, regions.labels(),
                         True, seen)
        return np.linalg.norm(position[row, column] - wanted, axis=1) / EYES

    now, before = error(aside.landmarks, aside), error(photo.landmarks, None)
    assert np.median(now) < 0.04 and np.quantile(now, 0.9) < 0.17
    assert np.median(now) < 0.5 * np.median(before)


@settings(max_examples=8, deadline=None)
@given(some.floats(32, 70), some.floats(-12, 12), some.floats(-15, 15))
def test_a_mirrored_face_gives_the_mirrored_points(yaw, pitch, roll):
    points = landmarks_of(yaw, pitch, roll)
    mirrored = (points * [-1, 1] + [SIZE, 0])[MIRRORED]
    one, other = face_aside(points, LEAST), face_aside(mirrored, LEAST)
    assert np.array_equal(one.hidden, other.hidden[MIRRORED])
    back = (other.landmarks * [-1, 1] + [SIZE, 0])[MIRRORED]
    assert np.abs(back - one.landmarks).max() < 0.02 * SCALE
    assert len(one.points) == len(other.points)
    order, twin = (np.lexsort((p[:, 0] * side, -p[:, 1])) for p, side in (
        (one.points, 1), (other.points, -1)))
    assert np.abs(one.points[order] * [-1, 1, 1] - other.points[twin]).max() < 0.01
    there = other.places[twin] * [-1, 1] + [SIZE, 0]
    assert np.abs(there - one.places[order]).max() < 0.02 * SCALE


def test_a_turning_head_goes_over_step_by_step():
    assert face_aside(landmarks_of(0.0), LEAST) is None
    assert face_aside(landmarks_of(LEAST - 1), LEAST) is None
    shares = [face_aside(landmarks_of(yaw), LEAST).share for yaw in (20.5, 23.0, 27.0, 31.0, 60.0)]
    assert shares == sorted(shares) and shares[0] < 0.1 and shares[-2:] == [1.0, 1.0]
    assert face_aside(landmarks_of(60.0), 90.0) is None


def test_unknown_landmarks_are_no_reason_to_fail():
    points = landmarks_of(60.0)
    points[40] = np.nan
    assert face_aside(points, LEAST) is None


def test_what_the_exemplar_hides_is_no_control_point():
    aside = face_aside(landmarks_of(60.0), LEAST)
    places = aside.in_exemplar(landmarks_of(-50.0))
    known = np.isfinite(places).all(axis=1)
    assert 0.1 < known.mean() < 0.9
    assert aside.points[~known, 0].mean() < aside.points[known, 0].mean()
