"""The 68 landmarks of a face (iBUG order): files, MediaPipe's points, generic head, pose, symmetry.

0-16 the jaw from the ear on the picture's left to the other, 17-21 and 22-26 the brows, 27-30 the
bridge of the nose, 31-35 its base, 36-41 and 42-47 the eyes, 48-59 the lips outside, 60-67 inside.

The generic head stands in the portrait frame (+x to the sitter's left, +y up, +z out of the face);
the face is about 0.8 wide. Across, its landmarks are those of the embedded head, in depth they
follow common proportions. Between them depth is a thin-plate spline; around them lies an egg for
skull and hair; below the chin a neck, and what is further away is a plane through the middle.

A painter's picture is taken for one in weak perspective (scale, rotation, shift). What the
landmarks leave over is how the person differs from the generic head (`face_pose`). Each pair of
mirrored landmarks has four numbers in the picture and three in space, so it determines the person's
proportions and, where the face is turned enough, its depth (`symmetric_landmarks`).
"""

import functools
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array, Float64, Floats
from ..errors import UserError
from ..files import atomic_write

FROM_MEDIAPIPE = np.array([
    127, 234, 132, 58, 172, 136, 149, 148, 152, 377, 378, 365, 397, 288, 361, 454, 356,  # jaw
    70, 63, 105, 66, 107, 336, 296, 334, 293, 300,  # brows
    168, 197, 5, 4, 75, 97, 2, 326, 305,  # nose
    33, 160, 158, 133, 153, 144, 362, 385, 387, 263, 373, 380,  # eyes
    61, 40, 37, 0, 267, 270, 291, 321, 314, 17, 84, 91,  # lips, outside
    78, 82, 13, 312, 308, 317, 14, 87,  # lips, inside
])
"""For each of the 68 points, the number of the MediaPipe face-mesh vertex that stands for it.

Mirror images of each other on both sides; among the vertices near each point those that lie nearest
to the landmarks of 14 painted and sculpted portraits. The jaw's are all on the mesh's outline.
"""


def mouth_opening(points: Floats) -> float:
    """Height of the gap between the lips over the mouth's width, from landmarks [68, 2 or 3]."""
    gaps = [np.linalg.norm(points[a] - points[b]) for a, b in ((61, 67), (62, 66), (63, 65))]
    return float(np.mean(gaps)) / max(float(np.linalg.norm(points[48] - points[54])), 1e-9)


_LEAN = {
    17: (1.2, -5.0), 18: (0.1, -1.2), 19: (-2.9, -0.6), 20: (-4.0, -1.6), 21: (-4.5, -4.9),  # brow
    28: (0.0, 2.5), 29: (0.0, 2.9),  # nose
    36: (2.2, -1.2), 40: (0.9, -2.0), 41: (1.0, -2.0),  # eye
    49: (-1.9, 0.2), 59: (-1.9, -1.5),  # lips
}


def centred(points: Float64) -> Float64:
    """Landmarks [68, 2] that both networks found, without the lean that their mean has.

    Where the networks put brows, lids and bridge differs from where people put them. The table
    holds the median differences over 13 painted and sculpted portraits, made symmetric, in
    hundredths of the distance of the outer eye corners along the line of the eyes and across. On a
    portrait left out of the medians the inner landmarks' mean error falls from 2.8 to 2.5 of these.
    """
    lean = np.zeros((68, 2))
    for k, (along, across) in _LEAN.items():
        lean[MIRRORED[k]] = -along, across
        lean[k] = along, across
    x, y = 0.01 * (points[45] - points[36])
    return np.asarray(points - lean @ np.array([[x, y], [-y, x]]), np.float64)


def read_landmarks(path: str | Path) -> Float64:
    """Read 68 landmarks, ``x y`` a line, in pixels: float64 [68, 2] (x right, y down).

    Raises `UserError` if the file is missing or does not hold 68 pairs of numbers.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
        lines = [line.replace(",", " ").split() for line in text.splitlines()]
        points = np.array([[float(value) for value in line] for line in lines if line])
    except OSError as error:
        raise UserError(f"can't read {path}: {error.strerror}") from error
    except ValueError as error:
        raise UserError(f"{path} does not hold landmarks: write 68 lines of `x y`") from error
    if points.shape != (68, 2) or not np.isfinite(points).all():
        raise UserError(f"{path} does not hold 68 landmarks: write 68 lines of `x y` in iBUG order")
    return points


def write_landmarks(path: str | Path, points: Array) -> None:
    """Write landmarks [68, 2], ``x y`` a line, in pixels."""
    with atomic_write(path) as stream:
        stream.write("".join(f"{x:.2f} {y:.2f}\n" for x, y in points).encode())


GENERIC_LANDMARKS: Float64 = np.array([
    (-0.403, 0.003, 0.180), (-0.402, -0.065, 0.190), (-0.369, -0.146, 0.210),
    (-0.343, -0.240, 0.250), (-0.329, -0.345, 0.320), (-0.288, -0.447, 0.410),
    (-0.208, -0.529, 0.500), (-0.109, -0.592, 0.555), (0.000, -0.638, 0.575),
    (0.109, -0.592, 0.555), (0.208, -0.529, 0.500), (0.288, -0.447, 0.410),
    (0.329, -0.345, 0.320), (0.343, -0.240, 0.250), (0.369, -0.146, 0.210),
    (0.402, -0.065, 0.190), (0.403, 0.003, 0.180), (-0.326, 0.121, 0.410),
    (-0.264, 0.142, 0.470), (-0.200, 0.151, 0.510), (-0.135, 0.146, 0.540),
    (-0.076, 0.129, 0.555), (0.076, 0.129, 0.555), (0.135, 0.146, 0.540),
    (0.200, 0.151, 0.510), (0.264, 0.142, 0.470), (0.326, 0.121, 0.410),
    (0.000, 0.008, 0.535), (0.000, -0.065, 0.580), (0.000, -0.127, 0.630),
    (0.000, -0.188, 0.680), (-0.060, -0.240, 0.575), (-0.025, -0.248, 0.605),
    (0.000, -0.252, 0.630), (0.025, -0.248, 0.605), (0.060, -0.240, 0.575),
    (-0.270, 0.012, 0.430), (-0.213, 0.034, 0.475), (-0.147, 0.033, 0.485),
    (-0.090, 0.000, 0.480), (-0.147, -0.024, 0.475), (-0.213, -0.023, 0.465),
    (0.090, 0.000, 0.480), (0.147, 0.033, 0.485), (0.213, 0.034, 0.475),
    (0.270, 0.012, 0.430), (0.213, -0.023, 0.465), (0.147, -0.024, 0.475),
    (-0.133, -0.379, 0.550), (-0.083, -0.361, 0.600), (-0.032, -0.347, 0.635),
    (0.000, -0.357, 0.635), (0.032, -0.347, 0.635), (0.083, -0.361, 0.600),
    (0.133, -0.379, 0.550), (0.083, -0.422, 0.600), (0.038, -0.443, 0.625),
    (0.000, -0.452, 0.630), (-0.038, -0.443, 0.625), (-0.083, -0.422, 0.600),
    (-0.116, -0.381, 0.560), (-0.054, -0.389, 0.610), (0.000, -0.396, 0.620),
    (0.054, -0.389, 0.610), (0.116, -0.381, 0.560), (0.054, -0.393, 0.610),
    (0.000, -0.400, 0.620), (-0.054, -0.393, 0.610),
])
"""float64 [68, 3], iBUG order, mirror-symmetric."""

MIRRORED = np.array([
    *range(16, -1, -1), *range(26, 16, -1), 27, 28, 29, 30, 35, 34, 33, 32, 31,
    45, 44, 43, 42, 47, 46, 39, 38, 37, 36, 41, 40, 54, 53, 52, 51, 50, 49, 48,
    59, 58, 57, 56, 55, 64, 63, 62, 61, 60, 67, 66, 65])
"""Number of each landmark's mirror image."""

_SKULL = np.array([0.0, 0.12, 0.0])
EGG = np.array([0.47, 0.68, 0.52])  # Half axes of the egg for skull and hair.
_BEHIND = -0.05  # Depth of what lies around the head.


def generic_depth(x: Float64, y: Float64, landmarks: Float64 = GENERIC_LANDMARKS) -> Float64:
    """Depth of the head's front surface at places (x, y), any one shape, float64.

    Continuous; the face's where there is a face, the egg's around it, next to none beyond.
    ``landmarks`` [68, 3] are of a face of other proportions.
    """
    from scipy.interpolate import RBFInterpolator

    egg = 1 - ((x - _SKULL[0]) / EGG[0]) ** 2 - ((y - _SKULL[1]) / EGG[1]) ** 2
    skull = np.where(egg > 0, _SKULL[2] + EGG[2] * np.sqrt(np.maximum(egg, 0)), _BEHIND)
    # The face ends where its landmarks end; the brows' line goes on a little into the forehead.
    spline = RBFInterpolator(landmarks[:, :2], landmarks[:, 2],
                             kernel="thin_plate_spline", smoothing=1e-4)
    low, high = landmarks[8, 1], landmarks[17:27, 1].max()
    middle, half = (low + high) / 2, (high - low) / 2
    away = np.sqrt((x / landmarks[16, 0]) ** 2 + ((y - middle) / (1.25 * half)) ** 2)
    share = np.clip((1.15 - away) / 0.3, 0, 1)
    share = share * share * (3 - 2 * share)
    face, near = np.zeros(np.shape(x)), share > 0
    if near.any():
        face[near] = spline(np.stack([x[near], y[near]], axis=1))
    return np.asarray(share * face + (1 - share) * np.maximum(skull, _BEHIND), np.float64)


_JAW = 0.5  # Weight of the jaw's landmarks: on a turned face they slide along the outline.
_STEP = float(np.finfo(np.float64).eps ** 0.5)  # Step for slopes, of each value.


@dataclass(frozen=True)
class FacePose:
    """Weak perspective of a face in a picture."""

    # float64 [3, 3], from the portrait frame to the painter's (+x right, +y up, +z to him).
    rotation: Float64
    scale: float  # Pixels per unit of the generic head.
    shift: Float64  # float64 [2], pixels (x, y) of the frame's origin.
    # Root mean square distance in pixels of the landmarks that are left over, jaw excluded.
    residual: float

    @property
    def yaw(self) -> float:
        """Degrees that the face is turned to the picture's right."""
        return float(np.degrees(np.arctan2(self.rotation[0, 2], self.rotation[2, 2])))

    @property
    def pitch(self) -> float:
        """Degrees that the face looks up."""
        return float(np.degrees(np.arcsin(np.clip(self.rotation[1, 2], -1, 1))))

    @property
    def roll(self) -> float:
        """Degrees that the head leans to the picture's left."""
        return float(np.degrees(np.arctan2(self.rotation[1, 0], self.rotation[0, 0])))

    @property
    def angles(self) -> dict[str, float]:
        """Yaw, pitch and roll in degrees, rounded, for figures."""
        return {name: round(getattr(self, name), 1) for name in ("yaw", "pitch", "roll")}

    def project(self, points: Float64) -> Float64:
        """Pixels [..., 2] of points [..., 3] of the generic head."""
        seen = points @ self.rotation[:2].T
        return np.asarray(self.scale * seen * [1.0, -1.0] + self.shift, np.float64)

    def depth(self, points: Float64) -> Float64:
        """How near to the painter points [..., 3] lie, [...], in the head's units."""
        return np.asarray(points @ self.rotation[2], np.float64)


def face_pose(landmarks: Floats) -> FacePose:
    """The pose of a face by its landmarks [68, 2], pixels (x right, y down); NaN rows are unknown.

    It is shared with those who asked before: its arrays can't be written to. Raises `ValueError` if
    fewer than 20 are known, or the landmarks have another shape.
    """
    if np.shape(landmarks) != (68, 2):
        raise ValueError(f"landmarks must be [68, 2], not {list(np.shape(landmarks))}")
    return _pose_of(np.ascontiguousarray(landmarks, np.float64).tobytes())


@functools.lru_cache(maxsize=64)  # a twentieth of a second, and several steps ask for one face's
def _pose_of(content: bytes) -> FacePose:
    """`face_pose` of the bytes of landmarks, float64 [68, 2]."""
    # Here: they take a tenth of a second to import, and most poses are known (`Exemplar.pose`).
    from scipy.optimize import least_squares
    from scipy.spatial.transform import Rotation

    found = np.frombuffer(content).reshape(68, 2)
    known = np.isfinite(found).all(axis=1)
    if known.sum() < 20:
        raise ValueError("a pose needs 20 landmarks at least")
    head, seen = GENERIC_LANDMARKS[known], found[known]
    weights = np.where(np.flatnonzero(known) < 17, _JAW, 1.0)
    middle, size = seen.mean(axis=0), float(seen.std())
    start = size / float(head[:, :2].std())

    def left_over(values: Float64) -> Float64:
        """Of one pose [6], or of several at once [K, 6]: one after the other takes K times."""
        rotation = Rotation.from_rotvec(values[..., :3]).as_matrix()
        scale = (start * np.exp(values[..., 3]))[..., None, None]
        shown = scale * (head @ np.swapaxes(rotation[..., :2, :], -1, -2)) * [1.0, -1.0]
        away = shown + middle + size * values[..., None, 4:6] - seen
        return np.asarray((weights[:, None] * away).reshape(*values.shape[:-1], -1) / size,
                          np.float64)

    def slopes(values: Float64) -> Float64:
        """By differences, as `least_squares` takes them."""
        steps = np.where(values < 0, -1.0, 1.0) * np.maximum(1.0, np.abs(values)) * _STEP
        moved = values + np.diag(steps)
        change = left_over(moved) - left_over(values)
        return np.asarray((change / (np.diagonal(moved) - values)[:, None]).T, np.float64)

    best = min((least_squares(left_over, np.array([0.0, yaw, 0, 0, 0, 0]), slopes, loss="soft_l1",
                              f_scale=0.1) for yaw in (-0.6, 0.0, 0.6)),
               key=lambda one: float(one.cost))
    values = best.x
    pose = FacePose(Rotation.from_rotvec(values[:3]).as_matrix(), start * float(np.exp(values[3])),
                    middle + size * values[4:6], 0.0)
    away = (pose.project(head) - seen)[np.flatnonzero(known) >= 17]
    residual = float(np.sqrt((away ** 2).sum(axis=1).mean())) if len(away) else 0.0
    for array in (pose.rotation, pose.shift):
        array.setflags(write=False)
    return FacePose(pose.rotation, pose.scale, pose.shift, residual)


JAW = 17  # The first landmarks are the jaw's.
HELD = 0.1
"""How inexact landmarks are in the picture, over how far a face's depth is from the generic
head's."""


def symmetric_landmarks(landmarks: Floats, pose: FacePose) -> Float64:
    """Landmarks in space, mirror-symmetric, in the frame of the generic head; float64 [68, 3].

    From [68, 2] in pixels, by the pose (`face_pose`); rows with NaN are unknown, and those that are
    on both sides are the generic head's.
    """
    seen = (np.asarray(landmarks, np.float64) - pose.shift) / pose.scale * [1.0, -1.0]
    known = np.isfinite(seen).all(axis=1)
    # On the far side the jaw's landmarks slide along the outline.
    far = GENERIC_LANDMARKS[:, 0] * np.sign(pose.rotation[2, 0]) < 0
    known &= ~(far & (np.arange(68) < JAW))
    out = GENERIC_LANDMARKS.copy()
    for one, other in enumerate(MIRRORED):
        sides = [(n, side) for n, side in ((one, 1.0), (other, -1.0)) if known[n]]
        if not sides:
            continue
        rows = [pose.rotation[:2] * [side, 1.0, 1.0] for _, side in sides]
        values = [seen[n] for n, _ in sides]
        rows.append(np.array([[0.0, 0.0, HELD]]))
        values.append(np.array([HELD * GENERIC_LANDMARKS[one, 2]]))
        # What is its own mirror image lies in the middle.
        free = slice(1, None) if one == other else slice(None)
        point = np.linalg.lstsq(np.concatenate(rows)[:, free], np.concatenate(values), rcond=None)
        out[one] = 0.0
        out[one, free] = point[0]
    return out


PORTRAIT_CONE = 40.0
"""Degrees in all."""
MOST_TURNED = 35.0
"""Degrees that a face may be turned in its photo."""
FIT = "head_fit"  # Key of a capture's figures under which the fit of a head is kept.


def is_portrait(capture: Any) -> bool:
    """Whether a capture's head was fitted to its photos (`one_photo`)."""
    return FIT in capture.figures
