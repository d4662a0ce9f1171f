"""The generic head has the proportions of an average adult."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from lfportrait.face.head_prior import FACE, generic_face, generic_prior, with_normals
from lfportrait.face.landmarks import MIRRORED


def test_landmarks_lie_on_the_surface_and_are_symmetric():
    prior, face = generic_prior(), generic_face()
    assert np.allclose(face[MIRRORED], face * [-1, 1, 1])
    seen = prior.mean[prior.landmarks]
    assert np.linalg.norm(seen - face, axis=1).max() < 0.0025
    eyes = np.linalg.norm(seen[45] - seen[36])
    assert 0.084 < eyes < 0.092  # the outer corners of an adult's eyes


@pytest.mark.parametrize(("place", "most"), [
    ((0.046, -0.040, 0.075), 0.003),  # a cheek is not hollow
    ((0.0, 0.045, 0.094), 0.003),  # the forehead above the brows is no hump
    ((0.0, 0.035, -0.099), 0.004),  # the back of the head
])
def test_the_surface_goes_through_a_face(place, most):
    prior = generic_prior()
    away, near = cKDTree(prior.mean).query(place)
    normal = with_normals(prior.mean.astype(np.float64), prior.triangles)[near]
    assert away < 0.008
    assert abs(normal @ (prior.mean[near] - np.array(place))) < most


def test_ears_stand_out_and_are_no_face():
    prior = generic_prior()
    widest = np.argmax(np.abs(prior.mean[:, 0]) * (np.abs(prior.mean[:, 1]) < 0.04))
    assert 0.083 < abs(prior.mean[widest, 0]) < 0.1
    assert prior.part[widest] != FACE
    assert prior.part[prior.landmarks[17:]].max() == FACE


def test_a_deviation_of_identity_moves_a_head_by_millimetres():
    prior = generic_prior()
    most = np.linalg.norm(prior.identity, axis=2).max(axis=1)
    assert ((most > 0.0007) & (most < 0.015)).all()
