"""Deep shade at the edge of a painted face is not copied with the face."""

from dataclasses import replace

import numpy as np
import pytest

from lfportrait.example import Transfer
from lfportrait.example.guides.regions import Regions
from lfportrait.example.skin.face import CopiedFace, deep_shade
from tests.portraits import drawn_face

SIDE = 14  # Half of that of the shade, in pixels: a tenth of the face at most.


@pytest.fixture(scope="module")
def shaded():
    """Gives the transfer of a face that is darkened around a place, and that place's pixels."""
    face = drawn_face(320, 240)

    def made(x, y, share=0.5):
        part = np.zeros(face.image.shape[:2], bool)
        part[int(y) - SIDE:int(y) + SIDE, int(x) - SIDE:int(x) + SIDE] = True
        image = face.image.copy()
        image[part] = np.uint8(image[part] * share)
        regions = Regions(face.landmarks, face.mask, None)
        return Transfer(replace(face, image=image), regions=regions), part

    return made


def found(transfer, bearded=None):
    """Share of the face's pixels that are deep shade, and those pixels."""
    inside = transfer.face > 240
    nothing = np.zeros(inside.shape, np.float32)
    shade = deep_shade(transfer, inside, nothing if bearded is None else bearded) & inside
    return shade.sum() / inside.sum(), shade


def jaw(points):
    """A place of the cheek at the jaw, below the mouth's corner."""
    return points[12] * 0.8 + points[54] * 0.2


def test_shade_at_the_jaw_is_found(shaded):
    points = drawn_face(320, 240).landmarks
    transfer, part = shaded(*jaw(points))
    share, shade = found(transfer)
    assert 0.01 < share < 0.15
    assert part[shade].mean() > 0.7  # a rim goes with it
    assert shade[part & (transfer.face > 240)].mean() > 0.6
    empty = np.zeros(part.shape, np.float32)
    face = CopiedFace(transfer, empty, empty, empty)
    assert not face.planes[shade, 0].any()
    # Nor is a piece of the rest taken from there.
    assert (face.labels[shade, -1] == 255).all() and face.planes[..., 0].any()


def test_what_is_no_deep_shade_at_the_edge(shaded):
    points = drawn_face(320, 240).landmarks
    low = jaw(points)
    # Where the face ends elsewhere, it is light.
    assert found(shaded(*points[[30, 33]].mean(axis=0))[0])[0] == 0
    assert found(shaded(*low, share=0.9)[0])[0] == 0
    # The shade of a side reaches the eyes, and a beard is no shade.
    transfer, _ = shaded(*(points[15] * 0.35 + points[45] * 0.65))
    assert found(transfer)[0] == 0
    transfer.labels[..., :2] = 0
    assert found(transfer)[0] > 0.01
    transfer, part = shaded(*low)
    assert found(transfer, part.astype(np.float32))[0] == 0
