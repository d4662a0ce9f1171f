"""Turned faces, handled with a generic head: frontal pictures of paintings, and guides of photos.

Guides lead from a head to the place of a painting that shows the same; of a turned face there is no
such place for one half. So a painting whose face is turned is unrolled first
(docs/turned-faces.md): every place of a frontal picture is a place of a generic head with the
painted person's proportions; the head's pose leads from there to the painting, and a smooth warp
takes what is left of the landmarks' residuals. What turns away from the painter, or lies behind
nose or brow, is taken from its mirror image, with the light of the side where it comes to lie
(`frontal_light`; Hassner et al. 2015). The seam runs where the two differ least (graph cut: Kwatra
et al. 2003). An eye that can be seen at all is kept; the rest of the gaze is shifted, not mirrored,
so that both eyes look the same way.

Of photos of faces that are turned far (`FaceAside`), landmarks behind nose, brow and cheek fall
onto what hides them, where the guide would fold. The pose of the face (`lfportrait.face.face_pose`)
tells which; they are moved out to the outline, where their surface disappears, and the guide
follows what is seen of the generic head.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from scipy import ndimage
from scipy.ndimage import map_coordinates

from ..arrays import Array, Bool, Float32, Float64, Floats, UInt8
from ..errors import UserError
from ..face import (
    GENERIC_LANDMARKS,
    FacePose,
    face_pose,
    face_yaw,
    generic_depth,
    symmetric_landmarks,
)
from .exemplar import Exemplar
from .frontal_light import Sides, blurred, relit
from .guides.filters import smaller
from .guides.regions import FaceFrame, polygon

STEP, HARDLY = 0.02, 0.1
"""Step for the slope of the head's surface, in its units; and how little a place may move in the
painting, over its way on the head, squared, before that is held back."""
RELIEF = 0.01  # Distance of the points of the relief that hides parts of the head, in its units.


def painted_places(points: Float64, painted: Float64, pose: FacePose,
                   head: Float64 = GENERIC_LANDMARKS) -> Float64:
    """Where a painting with landmarks [68, 2] has points [h, w, 3] of a head, [h, w, 2].

    By the pose, and by a smooth warp of what it leaves over of the landmarks. ``head`` [68, 3] are
    the head's own.
    """
    from scipy.interpolate import RBFInterpolator

    known = np.isfinite(painted).all(axis=1)
    # On the far side the jaw's landmarks slide along the outline: the pose knows better.
    far = GENERIC_LANDMARKS[:, 0] * np.sign(pose.rotation[2, 0]) < 0
    known &= ~(far & (np.arange(68) < 17))
    left = painted[known] - pose.project(head[known])
    warp = RBFInterpolator(head[known, :2], left, kernel="thin_plate_spline", smoothing=2e-3)
    flat = points.reshape(-1, 3)
    moves = warp(flat[:, :2]).reshape(*points.shape[:2], 2)
    # Outside the face the residuals fade: there is nothing that they were measured on.
    low, high = head[8, 1], head[17:27, 1].max()
    reach = np.sqrt((points[..., 0] / head[16, 0]) ** 2
                    + ((points[..., 1] - (low + high) / 2) / (0.5 * (high - low))) ** 2)
    fade = np.exp(-(np.maximum(reach - 1.1, 0) / 0.5) ** 2)
    limit = 0.3 * pose.scale
    return np.asarray(pose.project(points)
                      + fade[..., None] * np.clip(moves, -limit, limit), np.float64)


def in_front(way: Floats, painted: Floats, pose: FacePose) -> Float64:
    """How far places beside landmarks lie from these in the frontal picture, float64 [68, 2].

    ``way`` [68, 2] leads from the landmarks ``painted`` to the places in the painting, in pixels.
    """
    head = symmetric_landmarks(painted, pose)
    x, y = head[:, 0], head[:, 1]
    turn = pose.rotation[:2]
    # How a place in the painting moves with one on the head's surface, seen from the front.
    along = np.stack([turn[:, k] + turn[:, 2] * (
        generic_depth(x + dx, y + dy, head) - generic_depth(x - dx, y - dy, head))[:, None] / (
            2 * STEP) for k, (dx, dy) in enumerate(((STEP, 0.0), (0.0, STEP)))], axis=-1)
    along *= np.outer([1.0, -1.0], [1.0, -1.0])  # pixels count downwards
    # What is hardly seen from there would move far.
    back = np.swapaxes(along, 1, 2)
    found = np.linalg.solve(back @ along + HARDLY * np.eye(2), back @ np.asarray(way)[..., None])
    return np.asarray(found[..., 0], np.float64)


def clearness(points: Float64, pose: FacePose, head: Float64 = GENERIC_LANDMARKS) -> Float64:
    """How clearly the painter saw points [h, w, 3]: cosine to his direction, 0 if hidden, [h, w].

    The points are a height field, rows downwards, of the head with landmarks ``head`` [68, 3].
    """
    facing = np.asarray(_normals(points) @ pose.rotation[2], np.float64)
    facing[_hidden(points, pose, head)] = 0.0
    return facing


def _normals(points: Float64) -> Float64:
    """Unit normals of a height field of points [h, w, 3], +z outwards; rows run downwards."""
    down, across = np.gradient(points, axis=0), np.gradient(points, axis=1)
    normal = np.cross(-down, across) * -1.0
    return np.asarray(normal / np.linalg.norm(normal, axis=-1, keepdims=True), np.float64)


def _hidden(points: Float64, pose: FacePose, head: Float64) -> Bool:
    """Which points [h, w, 3] the painter sees something else before, bool [h, w]."""
    surface, low = _relief(head.tobytes())
    out = np.zeros(points.shape[:2], bool)
    for along in np.arange(0.02, 1.2, 2 * RELIEF):
        ahead = points + along * pose.rotation[2]
        inside = head_oval(ahead[..., 0], ahead[..., 1], 0.47, 0.02, 0.7) < 1
        ahead = ahead[inside]
        row, column = ((ahead[:, axis] - low[axis]) / RELIEF for axis in (1, 0))
        found = ndimage.map_coordinates(surface, [row, column], order=1, cval=-np.inf)
        out[inside] |= found - ahead[:, 2] > 0.005
    return out


@lru_cache(maxsize=4)
def _relief(head: bytes) -> tuple[Float64, tuple[float, float]]:
    """Depth of a head every `RELIEF` units, [y, x], and (x, y) of its first point.

    ``head`` are the bytes of its landmarks, float64 [68, 3].
    """
    low = (-0.55, -0.8)
    x, y = np.meshgrid(np.arange(low[0], 0.56, RELIEF), np.arange(low[1], 0.81, RELIEF))
    return generic_depth(x, y, np.frombuffer(head).reshape(68, 3)), low


def head_oval(x: Float64, y: Float64, wide: float, middle: float, high: float) -> Float64:
    """Distance of places (x, y) from the middle of an oval about the axis x = 0, 1 on it.

    Float64 [...], as the places; ``wide`` and ``high`` are half of its axes, ``middle`` its y.
    """
    return np.asarray(np.sqrt((x / wide) ** 2 + ((y - middle) / high) ** 2), np.float64)


FRONTAL = 9.0
"""Faces turned by less than this, in degrees, are used unchanged."""
PROFILE = 62.0
"""Faces turned further show too little of their other half."""
CLEAR = 0.5  # Cosine to the painter's direction from which on a place is taken as he painted it.
FULL = 0.85
"""The same from which on its mirror image is not thought of: the seam lies between the two."""
ALIKE = 0.85
"""A place is taken as he painted it, too, if it is at least this clear over its mirror image: the
seam does not lie on the axis itself, where it would be seen in the middle of the lips."""
CUT = 160.0  # Pixels a unit of the head in the pictures that the seam is looked for in.
FEATURE = 0.22  # The same for eyes and brows, which would else look like a mirror's.
BASE = 0.45
"""The same for the base of the nose, whose shade lies on one side: mirrored it is a dark bar."""
SURE = 0.15  # The same for telling its light from that of its mirror image.
OUTLINE = 0.015
"""Paint so near to a cheek's outline, in units of the head, is mixed with what lies behind."""
COARSE = 6  # The maps are computed every Nth pixel.


@dataclass(frozen=True)
class Frontal:
    """A painting's face from the front."""

    image: UInt8  # uint8 [h, w, 3], sRGB.
    landmarks: Float64  # float64 [68, 2], pixels.
    mirrored: Float32  # float32 [h, w] in [0, 1]: what comes from the other side.
    # float32 [h, w, 2], (x, y) in the painting of what is shown, its mirror images included.
    places: Float32
    mask: Float32 | None  # float32 [h, w], the painting's mask of the person, or None.
    pose: FacePose  # Of the face in the painting.


def frontalised(exemplar: Exemplar, pose: FacePose | None = None) -> Exemplar:
    """An exemplar from the front: itself, if its face is turned by less than `FRONTAL` degrees.

    ``pose`` is its face's, if it is known.
    """
    pose = pose or exemplar.pose()
    if abs(pose.yaw) < FRONTAL:
        return exemplar
    if abs(pose.yaw) > PROFILE:
        side = "right" if pose.yaw > 0 else "left"
        raise UserError(f"the face in {exemplar.name} is turned to the picture's {side} by "
                        f"{abs(pose.yaw):.0f} degrees; use a painting that shows both eyes, "
                        f"turned by {PROFILE:.0f} degrees at most")
    found = frontal_view(exemplar, pose)
    by_hand = None
    if exemplar.by_hand is not None:
        x, y = (np.ascontiguousarray(found.places[..., axis]) - np.float32(0.5)
                for axis in range(2))
        by_hand = np.asarray(cv2.remap(exemplar.by_hand, x, y, cv2.INTER_NEAREST), np.uint8)
    return Exemplar(found.image, found.landmarks, exemplar.name, found.mask, by_hand=by_hand)


def suited(exemplar: Exemplar, landmarks: Floats) -> Exemplar:
    """The exemplar's version that fits a photo with landmarks [68, 2].

    That is the original or the frontal one, whichever has the closer pose.
    """
    painted = exemplar.pose().yaw
    photo = face_pose(landmarks).yaw
    return exemplar if abs(painted - photo) <= abs(photo) else frontalised(exemplar)


def frontal_view(exemplar: Exemplar, pose: FacePose) -> Frontal:
    """The frontal picture of an exemplar's face, with the paint's size as it is.

    Where the exemplar has no mask the person is segmented: a place of the head that falls beside
    it was not painted.
    """
    regions = exemplar.regions()
    person = regions.person if exemplar.mask is None else exemplar.mask
    head = _Head(exemplar, pose)
    own, clear = head.places, head.clear
    # A little within the outline: paint there is mixed with what lies behind.
    side = 2 * int(0.035 * pose.scale) + 1
    within = cv2.erode(np.asarray(person, np.float32), np.ones((side, side), np.uint8))
    beside = 1 - np.clip(2 * _sampled(within, own), 0, 1)
    clear = clear * (1 - beside * head.inside)
    clear = clear * (1 - _beyond(exemplar, pose, own) * head.inside)
    hair = None if regions.hair is None else _sampled(regions.hair, own)
    if hair is not None:
        clear = clear * (1 - _over_the_cheek(hair, head))
    ours = _sampled(exemplar.image, own)
    other, theirs = _mirror_image(exemplar.image, own, head.landmarks, pose.scale)
    share = _own_share(ours, theirs, clear, clear[:, ::-1], head.needed, pose.scale)
    both = head.face * ((clear > SURE) & (clear[:, ::-1] > SURE))
    theirs = relit(Sides(ours, theirs, share, both, head.face, head.inside, hair,
                         _features(head.landmarks, share.shape), pose.scale))
    image = share[..., None] * ours + (1 - share[..., None]) * theirs
    mask = None
    if exemplar.mask is not None:
        values = [_sampled(exemplar.mask, places) for places in (own, other)]
        mask = _one_person(np.asarray(share * values[0] + (1 - share) * values[1], np.float32),
                           head.landmarks)
    places = np.where(share[..., None] > 0.5, own, other)
    return Frontal(np.asarray(np.clip(image, 0, 255) + 0.5, np.uint8), head.landmarks,
                   1 - share, np.asarray(places, np.float32), mask, pose)


def _beyond(exemplar: Exemplar, pose: FacePose, own: Float32) -> Float32:
    """Which places [h, w, 2] of a painting lie beyond the far cheek's outline; float32 [h, w].

    There a turned jaw's landmarks run along the outline. What follows may be linen, a scarf or
    hair, which the person's mask does not tell from a face.
    """
    jaw = exemplar.landmarks[:17]
    frame = FaceFrame.of(exemplar.landmarks)
    far = np.sign(pose.yaw) * frame.right
    # From the brows' height down to the chin; above and on the near side all is the head's.
    line = jaw[8:] if pose.yaw > 0 else jaw[8::-1]
    wide = 4 * frame.height
    corners = [line[-1] - wide * frame.down, line[-1] - wide * (frame.down + far),
               line[0] + wide * (frame.down - far), line[0] + wide * frame.down]
    inside = polygon(exemplar.image.shape, np.concatenate([line, corners]))
    side = 2 * int(OUTLINE * pose.scale) + 1
    within = cv2.erode(inside, np.ones((side, side), np.uint8))
    return np.asarray(1 - np.clip(_sampled(within, own), 0, 1), np.float32)


def _over_the_cheek(hair: Float32, head: _Head) -> Float32:
    """Where hair [h, w] hangs over the far cheek, but not over the near one; float32 [h, w].

    A head whose hair does not hang there would have a dark patch.
    """
    height, width = hair.shape
    below = np.arange(height)[:, None] > head.landmarks[36:48, 1].max()
    away = np.arange(width)[None] + 0.5 - head.center[0]
    far = below & (away * head.pose.rotation[2, 0] < 0)
    return np.asarray(far * head.face * np.clip(2 * (hair - hair[:, ::-1]), 0, 1), np.float32)


def _features(landmarks: Float64, shape: tuple[int, ...]) -> Float32:
    """From the brows to the mouth, float32 [h, w]."""
    corners = cv2.convexHull(np.asarray(landmarks[17:60], np.float32))[:, 0]
    return polygon(shape, np.asarray(corners, np.float64))


def _one_person(mask: Float32, landmarks: Float64) -> Float32:
    """A mask [h, w] without pieces that do not hang together with the face."""
    pieces = ndimage.label(mask > 0.5)[0]
    x, y = np.clip(landmarks[30].astype(int), 0, np.array(mask.shape[::-1]) - 1)
    person = ndimage.distance_transform_edt(pieces != pieces[y, x])
    # Soft edges belong to the nearest piece.
    other = ndimage.distance_transform_edt((pieces == 0) | (pieces == pieces[y, x]))
    return np.asarray(np.where(other < person, 0, mask), np.float32)


class _Head:
    """The generic head seen from the front, and where a painting has what it shows.

    The frontal picture has the painting's size; the head's axis is its middle.
    """

    def __init__(self, exemplar: Exemplar, pose: FacePose) -> None:
        height, width = exemplar.image.shape[:2]
        self.pose, self.size = pose, (width, height)
        self.center = np.array([width / 2, pose.shift[1]])
        own = symmetric_landmarks(exemplar.landmarks, pose)
        self.landmarks = self.center + pose.scale * own[:, :2] * [1.0, -1.0]
        # Every few pixels, symmetric about the axis, a little over the border.
        columns, rows = -(-width // COARSE) + 1, -(-height // COARSE) + 1
        across = (np.arange(columns) - (columns - 1) / 2) * COARSE
        down = np.arange(rows) * COARSE
        x, y = np.meshgrid(across / pose.scale, (self.center[1] - down) / pose.scale)
        points = np.stack([x, y, generic_depth(x, y, own)], axis=-1)
        self.places = self._full(painted_places(points, exemplar.landmarks, pose, own))
        self.clear = self._full(clearness(points, pose, own))[..., 0]
        self.needed = self._full(_needed(x, y, own))[..., 0]
        self.inside = self._full(_oval(x, y, 0.45, 0.02, 0.66))[..., 0]
        self.face = self._full(_oval(x, y, 0.4, -0.06, 0.58))[..., 0]

    def _full(self, values: Float64) -> Float32:
        """Values of the coarse grid at every pixel, float32 [h, w, C]."""
        width, height = self.size
        columns = values.shape[1]
        x = (np.arange(width) + 0.5 - width / 2) / COARSE + (columns - 1) / 2
        y = (np.arange(height) + 0.5) / COARSE
        grid_x, grid_y = (np.asarray(axis, np.float32) for axis in np.meshgrid(x, y))
        found = cv2.remap(np.asarray(values, np.float32), grid_x, grid_y, cv2.INTER_LINEAR,
                          borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(found.reshape(height, width, -1), np.float32)


def _needed(x: Float64, y: Float64, head: Float64) -> Float64:
    """How clearly a place must be seen to be taken as it was painted, float64 as ``x``.

    Less in eyes and brows, and a little less at the nose's base.

    ``head`` [68, 3] are the head's landmarks.
    """
    out = np.full(x.shape, CLEAR)
    for numbers, wide, high, least in (
            (range(36, 42), 0.12, 0.075, FEATURE), (range(42, 48), 0.12, 0.075, FEATURE),
            (range(17, 22), 0.13, 0.05, FEATURE), (range(22, 27), 0.13, 0.05, FEATURE),
            (range(31, 36), 0.12, 0.045, BASE)):
        middle = head[list(numbers), :2].mean(axis=0)
        away = np.hypot((x - middle[0]) / wide, (y - middle[1]) / high)
        out -= (CLEAR - least) * np.clip((1.5 - away) / 0.5, 0, 1)
    return np.maximum(out, FEATURE)


def _oval(x: Float64, y: Float64, wide: float, middle: float, high: float) -> Float64:
    """1 in an oval about the axis, 0 around it, soft between."""
    return np.asarray(np.clip((1.05 - head_oval(x, y, wide, middle, high)) / 0.1, 0, 1), np.float64)


def _mirror_image(image: UInt8, own: Float32, landmarks: Float64, scale: float,
                  ) -> tuple[Float32, Float32]:
    """Places [h, w, 2] of what lies across the axis, and its paint [h, w, 3].

    An eye's white and iris are the other eye's shifted, not mirrored: both look the same way.
    """
    places = np.ascontiguousarray(own[:, ::-1])
    paint = _sampled(image, places)
    height, width = own.shape[:2]
    for eye, twin in ((slice(36, 42), slice(42, 48)), (slice(42, 48), slice(36, 42))):
        opening = np.zeros((height, width), np.float32)
        cv2.fillPoly(opening, [np.round(landmarks[eye]).astype(np.int32)], 1.0)
        x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
        away = landmarks[twin].mean(axis=0) - landmarks[eye].mean(axis=0)
        shifted = np.asarray(cv2.remap(own, x + np.float32(away[0]), y + np.float32(away[1]),
                                       cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE),
                             np.float32)
        soft = blurred(opening, max(0.01 * scale, 0.5))[..., None]
        paint = np.asarray(paint + soft * (_sampled(image, shifted) - paint), np.float32)
        places = np.where(soft > 0.5, shifted, places)
    return places, paint


def _own_share(ours: Float32, theirs: Float32, clear: Float32, mirrored: Float32,
               needed: Float32, scale: float) -> Float32:
    """Share of what the painter showed at a place, against its mirror image, float32 [h, w].

    Where he saw it clearly it is his, where he hardly did it is the mirror image's. Between the
    two runs the seam, along which they differ least: not across a lock of hair or a shadow's edge.
    """
    never = (clear <= needed) & (clear < ALIKE * mirrored)
    always = (clear > np.where(needed < CLEAR, needed, FULL)) | (clear >= ALIKE * mirrored)
    shrink = min(1.0, CUT / scale)
    size = tuple(max(int(side * shrink), 8) for side in clear.shape[::-1])
    images = [smaller(blurred(one, 0.02 * scale), size) for one in (ours, theirs)]
    masks = [np.asarray(cv2.resize(np.asarray(~never_here, np.uint8) * 255, size,
                                   interpolation=cv2.INTER_NEAREST), np.uint8)
             for never_here in (never, always)]
    finder: Any = cv2.detail.GraphCutSeamFinder("COST_COLOR")
    kept = finder.find(images, [(0, 0), (0, 0)], masks)[0].get() > 0  # finds UMats
    cut = cv2.resize(np.asarray(kept, np.float32), clear.shape[::-1])
    own: Float32 = np.asarray(np.where(always, 1.0, np.where(never, 0.0, cut)), np.float32)
    # No islands; and an edge that is soft over a stroke, not over a feature.
    side = 2 * int(0.03 * scale) + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    for step in (cv2.MORPH_OPEN, cv2.MORPH_CLOSE):
        own = np.asarray(cv2.morphologyEx(own, step, kernel), np.float32)
    return blurred(own, 0.015 * scale)


def _sampled(picture: Array, places: Float32) -> Float32:
    """A picture [H, W(, 3)] at places (x, y), reflected beyond its border, float32."""
    x, y = (np.ascontiguousarray(places[..., axis]) - np.float32(0.5) for axis in range(2))
    return np.asarray(cv2.remap(np.asarray(picture, np.float32), x, y, cv2.INTER_CUBIC,
                                borderMode=cv2.BORDER_REFLECT_101), np.float32)


_SPACING = 0.07  # Distance of the mesh's lines in the head's units: a dozen across the face.


def head_mesh(landmarks: Floats, pose: FacePose) -> list[Float64]:
    """Lines of the generic face on a painting, as far as its painter saw them.

    Lines down and across the face, float64 [K, 2] pixels (x, y) each, K at least 2.
    """
    every = max(1, round(_SPACING * pose.scale / COARSE))
    # The face's middle is on a line.
    half = every * max(1, int(0.4 * pose.scale / COARSE / every))
    x, y = np.meshgrid(np.arange(-half, half + 1) * COARSE / pose.scale,
                       np.arange(0.5, -0.62, -COARSE / pose.scale))
    points = np.stack([x, y, generic_depth(x, y)], axis=-1)
    places = painted_places(points, np.asarray(landmarks, np.float64), pose)
    seen = (clearness(points, pose) > 0.05) & ((x / 0.4) ** 2 + ((y + 0.06) / 0.58) ** 2 < 1)
    lines: list[Float64] = []
    for line, shown in [*zip(places[::every], seen[::every]),
                        *zip(places[:, ::every].swapaxes(0, 1), seen[:, ::every].T)]:
        ends = np.flatnonzero(np.diff(shown, prepend=False, append=False))
        lines += [line[first:last] for first, last in zip(ends[::2], ends[1::2])
                  if last - first > 1]
    return lines


RAMP = 10.0
"""Degrees over which a turning head's guide goes over to what is seen of the generic head."""
SPACING = 0.03  # Distance of the grid's points, in the generic head's units.
EVERY = 2  # A control point every Nth of them.
BEHIND = 0.08  # Cosine to the camera from which on a landmark is seen.
SLIGHT = 0.01
"""The nose's place between the eyes' corners (`face_yaw`) changes by 0.02 a degree: where it has
not changed by this for each degree of the limit, no pose is asked for."""
PLAIN = 0.2
"""The same for control points: nearer to the outline a small error is a long way on the head."""


@dataclass(frozen=True)
class FaceAside:
    """A face that is turned far to one side."""

    landmarks: Float64  # float64 [68, 2], pixels; those that are hidden lie on the outline.
    hidden: Bool  # bool [68].
    points: Float64  # float64 [M, 3], what is seen of the generic head, in its frame.
    places: Float64  # float64 [M, 2], where the photo shows it, pixels.
    pose: FacePose  # Of the face.
    # How far these points replace the landmarks as control points, in (0, 1]: a head that turns in
    # a video does not jump.
    share: float

    def in_exemplar(self, landmarks: Float64) -> Float64:
        """Where an exemplar with landmarks [68, 2] has the points, [M, 2]; NaN where hidden."""
        pose = face_pose(landmarks)
        grid = _grid()
        places = painted_places(grid, landmarks, pose)
        places[clearness(grid, pose) < PLAIN / 2] = np.nan
        return _at_head_places(places, self.points)


def face_aside(landmarks: Floats, least: float) -> FaceAside | None:
    """What is seen of a face that is turned by more than ``least`` degrees, else None.

    ``landmarks`` are [68, 2] in pixels; rows with NaN are unknown.
    """
    found = np.asarray(landmarks, np.float64)
    # A pose takes as long as half of a small frame: most faces are seen to be frontal without it.
    if not np.isfinite(found).all() or abs(face_yaw(found)) < SLIGHT * least:
        return None
    pose = face_pose(found)
    share = min((abs(pose.yaw) - least) / RAMP, 1.0)
    if share <= 0:
        return None
    grid = _grid()
    places, clear = painted_places(grid, found, pose), clearness(grid, pose)
    hidden = _at_head_places(clear, GENERIC_LANDMARKS) < BEHIND
    far = np.sign(pose.yaw) * pose.rotation[:2, 0] * [1.0, -1.0]
    moved = found + share * hidden[:, None] * (_outline(places, far) - found)
    thin = slice(None, None, EVERY), slice(None, None, EVERY)
    part = (clear[thin] > PLAIN) & ((grid[thin][..., 0] / 0.42) ** 2
                                    + ((grid[thin][..., 1] + 0.06) / 0.6) ** 2 < 1)
    return FaceAside(moved, hidden, grid[thin][part], places[thin][part], pose, share)


@lru_cache(maxsize=1)
def _grid() -> Float64:
    """Points of the generic face, rows downwards, [h, w, 3]."""
    x, y = np.meshgrid(np.arange(-16, 17) * SPACING, np.arange(18, -25, -1) * SPACING)
    return np.stack([x, y, generic_depth(x, y)], axis=-1)


def _at_head_places(values: Float64, points: Float64) -> Float64:
    """Values of the grid [h, w(, C)] at points [M, 3] of the head."""
    grid = _grid()
    row = (grid[0, 0, 1] - points[:, 1]) / SPACING
    column = (points[:, 0] - grid[0, 0, 0]) / SPACING
    planes = values.reshape(*values.shape[:2], -1)
    found = np.stack([map_coordinates(planes[..., n], [row, column], order=1, mode="nearest")
                      for n in range(planes.shape[2])], axis=-1)
    return found.reshape(len(points), *values.shape[2:])


def _outline(places: Float64, far: Float64) -> Float64:
    """Where the surface ends in the photo at the height of each landmark, [68, 2].

    ``places`` [h, w, 2] of the grid; ``far`` is the photo's direction to the far side.
    """
    ends = np.argmax(places @ far, axis=1)
    edge = np.repeat(places[np.arange(len(ends)), ends][:, None], places.shape[1], axis=1)
    return _at_head_places(edge, GENERIC_LANDMARKS)
