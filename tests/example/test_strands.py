"""What of an exemplar's face is no skin: loose strands over a cheek, and its dark outline."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from lfportrait.example import Transfer, TransferConfig
from lfportrait.example.guides.regions import find_regions, soft_face
from lfportrait.example.painter.picture_materials import FEATURES, SKIN
from lfportrait.example.painter.plain_skin import mask_strands, outline, strands
from tests.portraits import drawn_face

HEIGHT, WIDTH = 540, 450
STROKE = (50, 34, 26)


def drawn(*lines, thick=2):
    """A face with lines, each a list of points over the face's frame: x right, y down from it."""
    face = drawn_face(HEIGHT, WIDTH, seed=2)
    image = face.image.copy()
    low, high = face.landmarks[8], face.landmarks[27]
    scale = (low - high)[1]
    for line in lines:
        points = np.rint(high + np.array(line) * scale).astype(np.int32)
        cv2.polylines(image, [points], False, STROKE, thick, cv2.LINE_AA)
    return replace(face, image=image)


def found(face):
    regions = find_regions(face.image, face.landmarks, face.mask, networks=False)
    return strands(face, np.asarray(regions.hair, np.float32), regions.labels())


LOCK = [(0.62, -0.15), (0.5, 0.2), (0.42, 0.4), (0.32, 0.45)]
"""From the hair at the temple down a cheek, and back up a little."""
WRINKLE = [(0.14, 0.38), (0.2, 0.46), (0.21, 0.56)]


def test_a_lock_over_a_cheek_is_a_strand():
    face = drawn(LOCK)
    strand = found(face)
    cheek = soft_face(face.image.shape, face.landmarks) > 200
    drawn_there = cheek & (np.abs(np.int32(face.image) - STROKE).max(axis=-1) < 45)
    drawn_there[:int(face.landmarks[27, 1])] = False
    drawn_there[:, :int(face.landmarks[27, 0] + 50)] = False
    assert drawn_there.sum() > 80
    assert strand[drawn_there].mean() > 0.9
    assert strand[cheek].mean() < 0.15
    assert strand[:, :int(face.landmarks[27, 0])].max() == 0


@pytest.mark.parametrize("face", [
    drawn(),  # a plain face
    drawn(WRINKLE),  # what does not come from the hair
    # a drawing's manner: hatching all over
    drawn(*[[(x, -0.1), (x - 0.05, 0.75)] for x in np.arange(-0.6, 0.65, 0.07)], thick=2),
])
def test_wrinkles_and_hatching_are_none(face):
    assert found(face).max() == 0


def test_what_is_under_a_strand_is_painted_nowhere():
    shares = np.zeros((4, 4, 7), np.float32)
    shares[..., SKIN] = 1
    strand = np.eye(4, dtype=np.float32)
    mask_strands(shares, strand)
    assert (shares[..., SKIN] == 1 - strand).all() and (shares[..., FEATURES] == strand).all()


@pytest.mark.slow  # nor is a lock: test_photo_face.py
def test_a_strand_is_not_copied_onto_a_bare_cheek():
    sitter = drawn_face(HEIGHT, WIDTH, seed=5)
    regions = find_regions(sitter.image, sitter.landmarks, sitter.mask, networks=False)
    made = Transfer(drawn(LOCK), TransferConfig(quality="best")).apply(
        sitter.image, sitter.landmarks, regions=regions).image
    luma = made.mean(axis=-1)
    cheek = soft_face(sitter.image.shape, sitter.landmarks) > 220
    cheek &= regions.labels()[..., :4].max(axis=-1) < 10
    cheek[:int(sitter.landmarks[29, 1])] = False
    assert cheek.sum() > 2000
    assert (luma[cheek] < 0.45).mean() < 0.002


def test_a_dark_stroke_along_the_jaw_is_outline_and_a_plain_jaw_is_none():
    plain, face = drawn_face(HEIGHT, WIDTH, seed=2), drawn_face(HEIGHT, WIDTH, seed=2)
    image = face.image.copy()
    jaw = np.rint(face.landmarks[2:15] - [0, 2]).astype(np.int32)
    cv2.polylines(image, [jaw], False, STROKE, 4, cv2.LINE_AA)
    stroke = np.zeros(image.shape[:2], np.uint8)
    cv2.polylines(stroke, [jaw], False, 1, 2)
    inside = soft_face(image.shape, face.landmarks) > 140
    there = outline(replace(face, image=image))
    assert there[(stroke > 0) & inside].mean() > 0.9
    low = np.indices(inside.shape)[0] > face.landmarks[30, 1]
    middle = inside & low & (soft_face(image.shape, face.landmarks) > 250)
    assert not there[middle].any()
    assert outline(plain)[cv2.erode(inside.astype(np.uint8), np.ones((9, 9))) > 0].mean() < 0.02
