"""Spectacles as a thin layer of their own: wires before the eyes, and a photo without them.

On the skin they would be paint that bends into the sockets when the head is turned. The rims and
the bridge that the photo shows are lifted to where lenses are worn; temples run from there to the
ears, seen or not.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.spatial import cKDTree

from ...arrays import Bool, Float64, box_about
from ...measure import usable_cores
from ..glasses import IN_PHOTOS, Spectacles, drawn_spectacles, find_spectacles
from ..head_fit import View
from ..head_prior import HeadPrior
from .piece import METRES
from .samples import MeshSamples

Bytes = NDArray[np.uint8]

BEFORE, BENT = 0.013, 1.7
"""How far before the lids lenses are worn, and how much they are bent round the face: metres of
depth to a square metre aside."""
EAR = np.array([0.078, 0.118, -0.012])
"""Where a temple lies on the left ear (metres, `HeadPrior.rest`)."""
CLEAR = 0.0008  # Metres between a wire and the skin at least.
ALIKE = 0.006  # Metres along a wire over which its color is a mean.
THIN, THICK = 0.0007, 0.003  # Radii of wires in metres, at least and at most.
HINGE = 25.0  # Degrees above the middle of a rim at which its temple begins.
LEAST = 0.85  # Voxels that a wire's radius has at least: a thinner one would have gaps.
TEMPLE = 0.009  # Metres that a temple may be high in a photo, from which it is taken off the skin.
OF_LINES = 0.08  # What is so surely a line is taken off the photo.


@dataclass(frozen=True)
class Wires:
    """The wires of a pair of spectacles."""

    points: Float64  # float64 [N, 3], places along them, portrait frame.
    colors: Float64  # float64 [N, 3] in [0, 1].
    radius: float  # Portrait units.
    tree: cKDTree  # Of the points.

    def distance(self, points: Float64, reach: float, voxel: float) -> Float64:
        """Distances [N] of points [N, 3] on a lattice; infinite from ``reach`` on."""
        length = self.tree.query(points, distance_upper_bound=reach, workers=usable_cores())[0]
        return np.asarray(length - max(self.radius, LEAST * voxel), np.float64)

    def colors_at(self, points: Float64) -> Float64:
        """Colors [N, 3] of the places nearest to points [N, 3]."""
        return self.colors[self.tree.query(points, workers=usable_cores())[1]]


def wires_of(image: Bytes, landmarks: Float64, prior: HeadPrior, view: View, local: Float64,
             frame: Float64, samples: MeshSamples, hair: NDArray[np.floating] | None = None,
             ) -> tuple[Wires, Bytes] | None:
    """The spectacles that a photo shows, and the photo without them; None where there are none.

    Parameters
    ----------
    image : uint8 [H, W, 3].
    landmarks : float64 [68, 2], pixels.
    prior, view : The fitted head and its pose.
    local : float64 [N, 3], its vertices in the camera's frame, metres.
    frame : float64 [4, 4], from there to the portrait frame.
    samples : Of the head, portrait frame.
    hair : [H, W] in [0, 1], which hides the temples.
    """
    found = find_spectacles(image, landmarks, sure=IN_PHOTOS)
    if found is None:
        return None
    eyes = local[prior.landmarks[36:48]]
    radius = 0.5 * found.width * float(eyes[:, 2].mean()) / view.focal
    radius = float(np.clip(radius, THIN, THICK))
    curves = [*found.curves[:2], *_bridges(found)]
    lifted = [_lifted(_even(one, number < 2), prior, view, local)
              for number, one in enumerate(curves)]
    ears = [prior.rest - np.array([side, 1, 1]) * EAR for side in (-1, 1)]
    # A rim at the picture's left is on the head's right side.
    hinges = [_hinge(one, view.rotation, side) for one, side in zip(lifted, (-1, 1))]
    temples = [np.linspace(hinge, local[np.linalg.norm(away, axis=1).argmin()], 200)
               for hinge, away in zip(hinges, ears, strict=True)]
    rims = [_colors(image, one, view) for one in lifted]
    frame_color = np.median(np.concatenate(rims[:2]), axis=0)
    colors = [*rims, *(np.tile(frame_color, (len(one), 1)) for one in temples)]
    to_eye = [-one / np.linalg.norm(one, axis=1)[:, None] for one in lifted]
    outward = [side * np.tile(view.rotation[:, 0], (len(one), 1))
               for one, side in zip(temples, (-1, 1))]
    places = np.concatenate([*lifted, *temples]) @ frame[:3, :3].T + frame[:3, 3]
    ways = np.concatenate([*to_eye, *outward]) @ frame[:3, :3].T
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    unit = float(np.linalg.norm(frame[:3, 0]))
    places = _outside(places, ways, samples, unit * (radius + CLEAR))
    wires = Wires(places, np.concatenate(colors), unit * radius, cKDTree(places))
    lines = _drawn(image.shape, found) | _drawn_temples(image.shape, temples, view, hair)
    return wires, _taken_off(image, lines, found.width)


def _drawn_temples(shape: tuple[int, ...], temples: list[Float64], view: View,
                   hair: NDArray[np.floating] | None) -> Bool:
    """Where a photo shows temples [n, 3] beside hair, bool [H, W]: broad ones, hinges and all."""
    out = np.zeros(shape[:2], np.uint8)
    for temple in temples:
        pixels = temple[:, :2] / temple[:, 2:] * view.focal + view.center - 0.5
        wide = max(round(TEMPLE * view.focal / float(temple[0, 2])), 1)
        cv2.polylines(out, [np.rint(pixels).astype(np.int32)], False, 1, wide)
    return np.asarray((out > 0) & (hair < 0.5 if hair is not None else True), bool)


def _bridges(found: Spectacles) -> list[Float64]:
    """The lines between two rims; one where they are nearest if none was seen."""
    one, two = found.curves[:2]
    middles = np.array([one.mean(axis=0), two.mean(axis=0)])
    across = middles[1] - middles[0]
    seen = [curve for curve in found.curves[2:]
            if 0.2 < ((curve.mean(axis=0) - middles[0]) @ across) / (across @ across) < 0.8]
    if seen:
        return seen
    away = np.linalg.norm(one[:, None] - two[None], axis=2)
    first, second = np.unravel_index(int(away.argmin()), away.shape)
    return [np.stack([one[first], two[second]])]


def _even(curve: Float64, closed: bool) -> Float64:
    """Places at equal distances along a curve [n, 2], about a pixel apart."""
    line = np.concatenate([curve, curve[:1]]) if closed else np.asarray(curve, np.float64)
    length = np.r_[0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))]
    at = np.linspace(0, length[-1], max(int(2 * length[-1]), 16))
    return np.stack([np.interp(at, length, line[:, axis]) for axis in (0, 1)], axis=1)


def _lifted(pixels: Float64, prior: HeadPrior, view: View, local: Float64) -> Float64:
    """Where rays through pixels [n, 2] meet the surface on which lenses are worn, [n, 3]."""
    turn = view.rotation
    middle = local[prior.landmarks[36:48]].mean(axis=0)
    lids = (local[prior.landmarks[36:48]] - middle) @ turn
    front = lids[:, 2].max() + BEFORE + BENT * np.abs(lids[:, 0]).mean() ** 2
    rays = np.column_stack([(pixels - view.center) / view.focal, np.ones(len(pixels))])
    along, origin = rays @ turn, -middle @ turn
    far = np.full(len(pixels), float(middle[2]))
    for _ in range(8):
        aside = origin[0] + far * along[:, 0]
        far = (front - BENT * aside ** 2 - origin[2]) / along[:, 2]
    return rays * far[:, None]


def _hinge(rim: Float64, turn: Float64, side: float) -> Float64:
    """Where the temple of a rim [n, 3] begins; ``side`` is that of the picture."""
    away = (rim - rim.mean(axis=0)) @ turn
    angle = np.degrees(np.arctan2(away[:, 1], side * away[:, 0]))
    return rim[np.abs(angle - HINGE).argmin()]


def _colors(image: Bytes, wire: Float64, view: View) -> Float64:
    """What a photo shows along a wire, [n, 3] in [0, 1], evened along it."""
    pixels = (wire[:, :2] / wire[:, 2:] * view.focal + view.center - 0.5).astype(np.float32)
    seen = cv2.remap(image, pixels[:, None, 0], pixels[:, None, 1], cv2.INTER_LINEAR,
                     borderMode=cv2.BORDER_REPLICATE)[:, 0] / 255.0
    step = float(np.linalg.norm(np.diff(wire, axis=0), axis=1).mean())
    return np.asarray(uniform_filter1d(seen, max(int(ALIKE / max(step, 1e-6)), 1), axis=0))


def _outside(places: Float64, ways: Float64, samples: MeshSamples, least: float) -> Float64:
    """Places [N, 3] moved along their ways until they lie so far outside of the head."""
    out = places.copy()
    for _ in range(12):
        missing = least - samples.distance(out, 0.05 / METRES)
        if not (missing > 0).any():
            break
        out += np.clip(missing, 0, 0.01 / METRES)[:, None] * ways
    return out


def without_wires(image: Bytes, landmarks: Float64) -> Bytes:
    """A photo, uint8 [H, W, 3], without the lines of the spectacles that are worn, if any are."""
    found = find_spectacles(image, landmarks, sure=IN_PHOTOS)
    if found is None:
        return image
    return _taken_off(image, _drawn(image.shape, found), found.width)


def _drawn(shape: tuple[int, ...], found: Spectacles) -> Bool:
    """Lines of spectacles, bool [H, W]."""
    return np.asarray(drawn_spectacles(found, (shape[0], shape[1])) > OF_LINES)


def _taken_off(image: Bytes, lines: Bool, width: float) -> Bytes:
    """A photo without lines [H, W] of a width, filled from beside them."""
    part = box_about(lines, round(6 * width) + 8)
    assert part is not None
    out = image.copy()
    out[part] = cv2.inpaint(np.ascontiguousarray(image[part]), lines[part].astype(np.uint8),
                            max(width, 3.0), cv2.INPAINT_TELEA)
    return out
