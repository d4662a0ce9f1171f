"""Painted eyes that look the same way.

A painter's far eye, seen from the front, and an eye that he placed by feeling look a little apart
from the other: one hardly sees it in the painting, but on another person's face it is a squint. So
both irises are moved within their lids, each by half of it, until they are as parallel as those of
people are.

Where they look is found twice: by MediaPipe's landmarker, which reports a part of an iris's move
only and is misled by paint, and by the dark discs between the lids, which are misled by glints and
shade. Eyes are moved to the side by as much as both agree on.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from .. import face, models
from ..cache import kept_arrays, key_of
from .exemplar import Exemplar
from .irises import irises_found
from .turned import FRONTAL

__all__ = ["agreed", "looking_apart", "with_parallel_eyes"]

Float64 = NDArray[np.float64]

FULL = 45.0
"""Degrees by which an eye is turned whose iris lies at a corner, about."""
USUAL = 9.0, 0.0
"""Degrees (right, down) that irises of parallel eyes seem apart, as the inner corners of eyes reach
further from them: the median of photos of nine people, between 7 and 10."""
DISCS_USUAL = 10.0
"""The same to the right for dark discs between the landmarker's corners: the median of photos of
nine people was 10.2, between 5.6 and 13.9, of thirteen paintings 9.0."""
FOLLOWED = 0.5
"""Share of an iris's move that the landmarker reports, in photos and in paintings: 0.1 to 0.7. Of
the discs it is 0.4 to 0.9."""
LITTLE, MOST = 2.0, 10.0
"""Eyes less apart than this stay, as people's own seem to be; more apart than that, an iris was not
seen right."""
CLOSED = 0.12
"""An eye less open than this, height over width, shows too little of its iris."""
REACH = 0.33, 0.25
"""The iris and what is moved with it: half its width and height, over the width of the eye."""
SIDE, ROOM = 768, 1.56
"""Side of the picture of a face that is looked at, and its width over that of the landmarks."""
EYES = ((33, 133, 468, 159, 145), (362, 263, 473, 386, 374))
"""Left and right corner, middle of the iris, upper and lower lid in MediaPipe's mesh; the picture's
left eye first."""


def with_parallel_eyes(exemplar: Exemplar) -> Exemplar:
    """The exemplar with eyes that look the same way; itself where they do, or nothing is known.

    Faces that are turned stay as they are: there, parallel eyes seem apart. So do all where
    MediaPipe's landmarker is not at hand.
    """
    if abs(exemplar.pose().yaw) >= FRONTAL or not models.available("face-landmarker"):
        return exemplar

    def find() -> dict[str, NDArray[Any]]:
        mesh = _mesh(exemplar.image, exemplar.landmarks)
        discs = irises_found(exemplar.image, exemplar.landmarks)
        return {"eyes": np.empty((0, 5, 2)) if mesh is None else mesh[np.array(EYES)],
                "discs": np.empty((0, 2)) if discs is None else discs}

    key = key_of(__name__, face.detectors_key(), exemplar.image,
                 exemplar.landmarks)
    found = kept_arrays("gazes", key, find)
    eyes, discs = found["eyes"], found["discs"]
    if not len(eyes) or not len(discs) or _opening(eyes) < CLOSED:
        return exemplar
    away = agreed(eyes, discs)
    if abs(away) < LITTLE:
        return exemplar
    image = exemplar.image
    for eye, disc, share in zip(eyes, discs, (0.5, -0.5)):
        image = _moved(image, eye, disc, share * away)
    return replace(exemplar, image=image, opened=exemplar)


def agreed(eyes: Float64, discs: Float64) -> float:
    """Degrees by which the picture's right eye surely looks further right than the left one.

    Parameters
    ----------
    eyes
        As `looking_apart`.
    discs
        float64 [2, 2] pixels, both irises as `irises_found` has them.

    Returns
    -------
    degrees
        The lesser of what both kinds of irises show; 0 where one shows the contrary, or eyes more
        than `MOST` degrees apart.
    """
    turned = [_turned(disc, eye[0], eye[1])[0] for eye, disc in zip(eyes, discs)]
    by_discs = float(turned[1] - turned[0]) - DISCS_USUAL
    by_mesh = float(looking_apart(eyes)[0])
    if by_discs * by_mesh <= 0 or max(abs(by_discs), abs(by_mesh)) > MOST:
        return 0.0
    return float(np.sign(by_discs)) * min(abs(by_discs), abs(by_mesh) / FOLLOWED)


def looking_apart(eyes: Float64) -> Float64:
    """Degrees [2], right and down, that the picture's right eye looks away from the left one.

    Parameters
    ----------
    eyes
        float64 [2, 5, 2] pixels: left and right corner, iris, upper and lower lid of each.
    """
    gaze = [_turned(iris, left, right) for left, right, iris, *_ in eyes]
    return np.asarray(gaze[1] - gaze[0] - USUAL, np.float64)


def _turned(iris: Float64, left: Float64, right: Float64) -> Float64:
    """Degrees [2], to the right and downwards, of an iris between an eye's corners, [2] each."""
    along = 0.5 * (right - left)
    away = iris - 0.5 * (left + right)
    across = np.array([-along[1], along[0]])
    return FULL * np.array([away @ along, away @ across]) / max(float(along @ along), 1e-9)


def _opening(eyes: Float64) -> float:
    """Height over width of the eye [2, 5, 2] that is less open."""
    return min(float(np.linalg.norm(upper - lower)) / max(float(np.linalg.norm(right - left)), 1e-9)
               for left, right, _, upper, lower in eyes)


def _mesh(image: NDArray[np.uint8], landmarks: Float64) -> Float64 | None:
    """MediaPipe's mesh [478, 2] of the face with these landmarks [68, 2], pixels of the picture."""
    low, high = landmarks.min(axis=0), landmarks.max(axis=0)
    half = 0.5 * ROOM * float((high - low).max())
    first = 0.5 * (low + high) - [0.0, 0.1 * (high[1] - low[1])] - half
    step = 2 * half / SIDE
    # From the middle of the close picture's first pixel, in pixels of the picture.
    way = np.array([[step, 0, first[0] + 0.5 * step - 0.5], [0, step, first[1] + 0.5 * step - 0.5]])
    close = cv2.warpAffine(image, way, (SIDE, SIDE), flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP,
                           borderMode=cv2.BORDER_REPLICATE)
    mesh = face.face_mesh(np.asarray(close, np.uint8))
    return None if mesh is None else np.asarray(first + step * mesh, np.float64)


def _moved(image: NDArray[np.uint8], eye: Float64, iris: Float64, degrees: float,
           ) -> NDArray[np.uint8]:
    """A picture [H, W, 3] whose ``iris`` [2] of an eye [5, 2] is turned to the right by degrees.

    What is around it moves less and less; corners and lids stay.
    """
    along = 0.5 * (eye[1] - eye[0])
    across = np.array([-along[1], along[0]])
    width = 2 * float(np.linalg.norm(along))
    shift = degrees * along / FULL
    low = np.maximum(np.floor(iris - width), 0).astype(int)
    high = np.minimum(np.ceil(iris + width), image.shape[1::-1]).astype(int)
    if (high <= low).any():
        return image
    rows, columns = np.mgrid[low[1]:high[1], low[0]:high[0]]
    places = np.stack([columns, rows], axis=-1) + 0.5
    away = (places - iris - shift) @ np.stack([along, across], axis=1) / (0.5 * width ** 2)
    weight = np.exp(-np.hypot(away[..., 0] / REACH[0], away[..., 1] / REACH[1]) ** 4)
    weight[weight < 1e-3] = 0
    source = (places - weight[..., None] * shift - 0.5).astype(np.float32)
    moved = cv2.remap(image, source[..., 0], source[..., 1], cv2.INTER_CUBIC,
                      borderMode=cv2.BORDER_REPLICATE)
    out = image.copy()
    part = out[low[1]:high[1], low[0]:high[0]]
    # Where nothing moves nothing is resampled.
    part[weight > 0] = moved[weight > 0]
    return out
