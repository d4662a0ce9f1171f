"""The generic head as samples: two thirds of a second, so made once for all tests of a process."""

import functools

import numpy as np
from numpy.typing import NDArray

from lfportrait.face.head_prior import generic_prior
from lfportrait.face.one_photo.piece import METRES
from lfportrait.face.one_photo.samples import MeshSamples


@functools.cache
def generic_head() -> tuple[NDArray[np.float64], MeshSamples]:
    """Its vertices [N, 3] in units of the portrait frame, about z = 0, and its samples.

    Neither is to be changed.
    """
    prior = generic_prior()
    points = prior.mean.astype(float) / METRES
    points[:, 2] -= points[:, 2].mean()
    points.setflags(write=False)
    return points, MeshSamples.of(points, prior.outer, prior.rest)
