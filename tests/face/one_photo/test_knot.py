"""A knot of hair above the head: found by its outline, and put behind the crown."""

import cv2
import numpy as np
import pytest

from lfportrait.capture import Camera
from lfportrait.face.head_prior import generic_prior
from lfportrait.face.one_photo.hair import knot_of, without_knot
from lfportrait.face.one_photo.parts import Parts, parts_of
from lfportrait.face.one_photo.samples import depth_maps
from lfportrait.face.one_photo.solid import HAIR, solid_of

from .generic import generic_head

SIDE, RADIUS = 320, 0.16


def drawn(points: np.ndarray, middle: float | None, aside: float = 0.0, tall: float = 1.0,
          ) -> Parts:
    """The generic head's maps, with a crown of hair, and a knot whose middle is so far over it."""
    camera = Camera.arc(np.zeros(1), distance=4.0, width=SIDE, height=SIDE, focal=560.0,
                        target=(0, -0.1, 0), pitch=0.0)
    matte = np.zeros((SIDE, SIDE), np.uint8)
    for corners in np.rint(camera.project(points)[0][0][generic_prior().triangles]).astype(int):
        cv2.fillConvexPoly(matte, corners.astype(np.int32), 1)
    hair = matte.copy()
    top = points[:, 1].max()
    hair[int(camera.project(np.array([[0, top - 0.25, 0]]))[0][0, 0, 1]):] = 0
    if middle is not None:
        x, y = np.rint(camera.project(np.array([[aside, top + middle, 0.0]]))[0][0, 0]).astype(int)
        wide = round(RADIUS * 140)
        for one in (matte, hair):
            cv2.ellipse(one, (int(x), int(y)), (wide, round(tall * wide)), 0, 0, 360, 1, -1)
    return parts_of(camera, matte.astype(np.float32), hair.astype(np.float32), 4.0)


@pytest.mark.parametrize("middle", [0.0, 0.1])
def test_a_knot_is_found_by_its_outline(middle):
    points, samples = generic_head()
    parts = drawn(points, middle)
    knot = knot_of(parts, depth_maps(samples, parts)[0])
    assert knot is not None
    assert knot.radius * parts.cell == pytest.approx(RADIUS, rel=0.2)
    rest = without_knot(parts, knot)
    assert not (rest.hair & knot.shown).any()
    assert (rest.inside <= parts.inside + 1e-6).all()


@pytest.mark.slow  # one that is seen: here, too
def test_no_knot_is_seen_in_other_heads():
    points, samples = generic_head()
    for parts in (drawn(points, None), drawn(points, -0.14), drawn(points, 0.1, 0.45),
                  drawn(points, 0.1, tall=3.0), drawn(points, -0.2, 0.32)):
        assert knot_of(parts, depth_maps(samples, parts)[0]) is None


def test_a_knot_stands_behind_the_crown():
    points, samples = generic_head()
    parts = drawn(points, 0.0)
    solid = solid_of(parts, samples)
    top = float(points[:, 1].max())
    crown = float(points[points[:, 1].argmax(), 2])
    z = np.linspace(-1.5, 1.5, 601)
    line = np.column_stack([np.zeros(601), np.full(601, top + 0.09), z])
    away, owner = solid.distance(line, 0.3)
    inside = away < 0
    assert inside.any() and (owner[inside] == HAIR).all()
    assert z[inside].mean() < crown - 0.05
    # It is a ball, no ridge that runs forwards.
    assert np.ptp(z[inside]) < 2.2 * RADIUS
