"""Fit a statistical head to the landmarks of photos: camera, pose, identity, expression.

Regularised least squares by Gauss-Newton steps: landmarks in pixels with Huber's weights (1964),
coefficients of identity in their deviations, expressions of each photo. The jaw's landmarks slide
along the outline that the model has in the pose (Bas et al. 2016); where the matte's outline is
skin, the model's outline is drawn to it, and where it is hair, kept inside. A focal length that no
file notes is found among a few distances, the likeliest of which is that of an arm and a half:
shape and distance of a face look alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from ..arrays import Bool, Float32, Float64, Int32, Int64
from ..errors import UserError
from .detect import face_yaw
from .head_prior import EYES, HeadPrior, with_normals
from .landmarks import MOST_TURNED

SMALLEST = 150.0  # Pixels of a face's width, ear to ear, that it must have.
BROAD = 1.2
"""That width over the height from between the eyes to the chin, of a face that is not turned."""
DISTANCES = (0.45, 0.6, 0.8, 1.05, 1.4)
"""Metres between camera and face that are tried where no focal length is noted."""
LIKELY, SPREAD = 0.8, 0.15  # The likeliest distance, and the deviation of its logarithm.
NOISE = 0.02
"""Deviation of a landmark in the picture, over the distance of the outer corners of the eyes."""
JAW, NEAR_JAW = 2.0, 8.0
"""The jaw's landmarks are so many times less exact; and how much less exact still in a face that is
turned, on the side that is nearer, where they lie along no outline: without that, drawn heads
were seen turned by a tenth too little, and 1.7 instead of 1.0 degrees off."""
VAGUE = {tuple(range(17, 27)): 3.0, (27, 28, 29): 4.0}
"""How many times less exact landmarks are along the face: brows, whose edges people see unlike,
and the bridge, which has no marks."""
HUBER = 2.0  # Deviations from which on an error counts linearly.
EXPRESSION = 0.35  # Deviation of the expressions.
OUTLINE = 0.008  # Deviation of the matte's outline, over the distance of the eyes.
ROUNDS = 14
PLACED, SURFACE, ALIKE = 0.006, 0.003, 40.0
"""Deviation of a place that is found again in another photo, over the distance of the eyes; of the
head's surface there from the model's, metres; and so many places, all together, count as
independent."""
TURNED = 10.0
"""Landmarks and outline of a photo in which places are found are so many times less exact:
detectors see a turned face as turned less, and its outline is of ears and skull, which modes know
less."""
MOST_DEVIATIONS = 3.0  # No coefficient of identity goes further.
LEAST_EXPRESSION, MOST_EXPRESSION = -0.2, 1.2
"""No expression goes further: lips do not pass through each other."""
PIVOTS = 12
"""Rounds in which a step finds what its bounds hold; a few are enough, but they may go in circles.
"""
WORST = 0.09
"""Root mean square of the inner landmarks' errors, over the distance of the eyes' outer corners,
above which the head fits no face."""
STRAINED = 0.05, 2.0
"""The same, and times what it was without the outline, above which that is of something else."""
VAGUE_HAIR = 4.0  # Where hair is the outline, it says so many times less of the skull.
HAIR = 0.008  # Metres that hair is thick at least where it is the outline.
_FLIP = np.diag([1.0, -1.0, -1.0])  # From a head to a camera that looks at it from the front.
ALIKE_ENOUGH = 0.7
"""Cosine of the angle between the model's outline and the matte's from which on these may be the
same."""
BACKWARDS = 110.0  # Degrees by which no face that was found is turned.
_WATCHED = 0.15
"""Outlines further from the matte's than this, over the eyes' distance, are of something else."""


@dataclass(frozen=True)
class Picture:
    """What is known of a photo."""

    size: tuple[int, int]  # Width and height in pixels.
    landmarks: Float64  # float64 [68, 2] in pixels.
    focal: float | None = None  # Focal length in pixels as the camera noted it, or None.
    # float32 [H, W], signed distance in pixels from the matte's outline, positive in the person;
    # None where there is no matte.
    inside: Float32 | None = None
    hair: Float32 | None = None  # float32 [H, W] in [0, 1], or None.
    clothes: Bool | None = None  # bool [H, W], what lies below the ears and is no skin, or None.
    # float64 [17, 2], the jaw's edge beside its landmarks in pixels, NaN where the photo shows
    # none; None if it was not looked for, as under a beard.
    jaw: Float64 | None = None

    @property
    def eyes(self) -> float:
        """Distance of the outer corners of the eyes in pixels."""
        return float(np.linalg.norm(self.landmarks[45] - self.landmarks[36]))


@dataclass(frozen=True)
class Found:
    """Where a photo shows vertices, besides landmarks."""

    vertices: Int64  # int64 [M].
    places: Float64  # float64 [M, 2] in pixels.


@dataclass(frozen=True)
class View:
    """Camera, pose and expression of one photo."""

    # rotation, shift: float64 [3, 3] and [3]: a point X of the head lies at rotation X + shift in
    # the camera's frame (x right, y down, z forward), metres.
    rotation: Float64
    shift: Float64
    focal: float  # Pixels.
    center: Float64  # float64 [2], the principal point in pixels.
    expression: Float64  # float64 [M].

    def to_camera(self, points: Float64) -> Float64:
        """Points [N, 3] of the head in the camera's frame."""
        return np.asarray(points @ self.rotation.T + self.shift, np.float64)

    def project(self, points: Float64) -> Float64:
        """Pixels [N, 2] of points [N, 3] of the head."""
        local = self.to_camera(points)
        return np.asarray(local[:, :2] / local[:, 2:] * self.focal + self.center, np.float64)

    @property
    def angles(self) -> dict[str, float]:
        """Yaw (to the picture's right), pitch (up) and roll of the face in degrees."""
        away = _FLIP @ self.rotation
        return {"yaw": round(float(np.degrees(np.arctan2(away[0, 2], away[2, 2]))), 1),
                "pitch": round(float(np.degrees(np.arcsin(np.clip(away[1, 2], -1, 1)))), 1),
                "roll": round(float(np.degrees(np.arctan2(away[1, 0], away[0, 0]))), 1)}


@dataclass(frozen=True)
class HeadFit:
    """A head that fits photos."""

    prior: HeadPrior  # The model.
    identity: Float64  # float64 [K], in deviations.
    views: list[View]  # One a photo.
    # Root mean square distance in pixels of the landmarks besides the jaw's, one a photo.
    pixels: list[float]
    deviations: float  # Root mean square of the coefficients of identity.

    def vertices(self, view: int) -> Float64:
        """The head in one photo's expression, float64 [N, 3], in its own frame, metres."""
        return self.prior.shape(self.identity, self.views[view].expression)

    def of(self, views: Sequence[int]) -> HeadFit:
        """The same head in some of its photos."""
        return replace(self, views=[self.views[one] for one in views],
                       pixels=[self.pixels[one] for one in views])

    def figures(self) -> dict[str, object]:
        """What ``run.json`` says of the fit."""
        return {"model": self.prior.name, "landmarks_px": [round(one, 2) for one in self.pixels],
                "deviations": round(self.deviations, 2),
                "distance_m": [round(float(view.shift[2]), 2) for view in self.views],
                "angles": [view.angles for view in self.views]}


def deviations_of(identity: Float64) -> float:
    """Root mean square of coefficients of identity, [K]."""
    return float(np.sqrt((identity ** 2).sum() / max(len(identity), 1)))


def check_faces(faces: list[Float64], name: str) -> Float64:
    """The one face of a photo that can be used.

    Parameters
    ----------
    faces : Landmarks [68, 2] of all faces in a photo, the largest first.
    name : Of the photo.

    Raises
    ------
    UserError : If there is none or more than one of that size, or it is too small.
    """
    if not faces:
        raise UserError(f"no face was found in {name}; a portrait needs a photo that shows the "
                        "face from the front, upright and in focus")
    sizes = [ear_to_ear(face) for face in faces]
    others = sum(size > 0.4 * sizes[0] for size in sizes)
    if others > 1:
        raise UserError(f"{name} shows {others} faces; crop it to the one that is meant")
    if sizes[0] < SMALLEST:
        raise UserError(f"the face in {name} is {sizes[0]:.0f} pixels wide, which is too small; it "
                        f"needs {SMALLEST:.0f} at least")
    return faces[0]


def ear_to_ear(face: Float64) -> float:
    """Pixels of a face's width, ear to ear; of a turned one by its height, as it is narrower."""
    height = float(np.linalg.norm(face[8] - face[27]))
    return max(float(np.linalg.norm(face[16] - face[0])), BROAD * height)


def fit_head(prior: HeadPrior, pictures: list[Picture], names: list[str] | None = None) -> HeadFit:
    """Fit a head to photos of one person.

    Parameters
    ----------
    pictures : One a photo.
    names : Of the photos, for messages.

    Raises
    ------
    UserError : If the head does not fit the first photo, or its face is turned too far.
    """
    names = names or [f"photo {number + 1}" for number in range(len(pictures))]
    best: _Solver | None = None
    starts = DISTANCES if all(one.focal is None for one in pictures) else (None,)
    for distance in starts:
        solver = _Solver(prior, pictures, distance)
        solver.solve(ROUNDS // 2, outlines=False)
        if best is None or solver.cost < best.cost:
            best = solver
    assert best is not None
    plain = best.result()
    best.solve(ROUNDS, outlines=True)
    fit = best.result()
    strained = max(STRAINED[0] * pictures[0].eyes, STRAINED[1] * plain.pixels[0])
    if fit.pixels[0] > strained:  # a hand beside a cheek, or a cap, is no outline of the head's
        solver = _Solver(prior, pictures, None, plain)
        solver.solve(ROUNDS, outlines=False)
        fit = solver.result()
    _check_fit(fit, pictures, names)
    return fit


def refit(fit: HeadFit, pictures: list[Picture], found: list[list[Found]], rounds: int = 4,
          ) -> HeadFit:
    """Fit a head further, to what photos show of each other's places, too.

    Parameters
    ----------
    found : For each photo where it shows vertices.
    """
    solver = _Solver(fit.prior, pictures, None, fit)
    solver.found = found
    solver.solve(rounds, outlines=True)
    return solver.result()


def unfit(fit: HeadFit, pictures: list[Picture]) -> list[int]:
    """Photos besides the first that the head of all does not fit."""
    return [index for index, (pixels, picture) in enumerate(zip(fit.pixels, pictures, strict=True))
            if index and pixels > WORST * picture.eyes]


def _check_fit(fit: HeadFit, pictures: list[Picture], names: list[str]) -> None:
    """Refuse what can't be a face seen from the front."""
    odd, turned = fit.pixels[0] > WORST * pictures[0].eyes, abs(fit.views[0].angles["yaw"])
    # A profile is found badly, too: its nose reaches beyond both eyes.
    profile = abs(face_yaw(pictures[0].landmarks)) >= 1
    if turned > MOST_TURNED and (not odd or (profile and turned < BACKWARDS)):
        raise UserError(f"the face in {names[0]} is turned by {turned:.0f} degrees; one photo must "
                        f"show it turned by {MOST_TURNED:.0f} at most")
    if odd:
        raise UserError(f"what was found in {names[0]} fits no face: landmarks are off by "
                        f"{fit.pixels[0]:.0f} pixels; is it covered, or cut off?")


class _Solver:
    """The state of one fit: Gauss-Newton over all photos at once."""

    def __init__(self, prior: HeadPrior, pictures: list[Picture], distance: float | None,
                 start: HeadFit | None = None) -> None:
        pictures = [replace(one, landmarks=prior.vertices_seen(one.landmarks)) for one in pictures]
        self.prior, self.pictures, self.distance = prior, pictures, distance
        self.identity = np.zeros(len(prior.identity)) if start is None else start.identity
        self.cost = np.inf
        self.jaw = [prior.landmarks[:17].copy() for _ in pictures]
        self.views = ([_first_view(prior, picture, distance) for picture in pictures]
                      if start is None else list(start.views))
        self.found: list[list[Found]] = [[] for _ in pictures]

    def result(self) -> HeadFit:
        pixels = []
        for view, picture in zip(self.views, self.pictures, strict=True):
            vertices = self.prior.shape(self.identity, view.expression)
            shown = view.project(vertices[self.prior.landmarks])
            away = (shown - picture.landmarks)[17:]
            pixels.append(float(np.sqrt((away ** 2).sum(axis=1).mean())))
        return HeadFit(self.prior, self.identity, self.views, pixels,
                       deviations_of(self.identity))

    def solve(self, rounds: int, *, outlines: bool) -> None:
        """Some steps; the jaw and the outlines are looked for again before each."""
        for _ in range(rounds):
            blocks = []
            for index in range(len(self.pictures)):
                vertices = self.prior.shape(self.identity, self.views[index].expression)
                normals = with_normals(vertices, self.prior.triangles)
                self.jaw[index][:] = jaw_vertices(self.views[index], self.prior, vertices, normals,
                                                  self.pictures[index].landmarks)
                rows = [self._landmark_rows(index, vertices)]
                if outlines and self.pictures[index].inside is not None:
                    rows.append(self._outline_rows(index, vertices, normals))
                blocks.append(tuple(np.concatenate(part) for part in zip(*rows, strict=True)))
            self._step(blocks, self._shared_rows())

    def _step(self, blocks: list[tuple[Float64, ...]], both: tuple[Float64, Float64]) -> None:
        """One regularised least-squares step of all unknowns."""
        shared, own = len(self.identity), 6 + len(self.prior.expression)
        size = self._size()
        normal, right = np.zeros((size, size)), np.zeros(size)
        cost = 0.0

        def add(rows: Float64, error: Float64) -> None:
            nonlocal normal, right, cost
            length = np.abs(error)
            weight = np.minimum(1.0, HUBER / np.maximum(length, 1e-12))
            cost += float(np.where(length < HUBER, length ** 2,
                                   2 * HUBER * length - HUBER ** 2).sum())
            normal += rows.T @ (weight[:, None] * rows)
            right -= rows.T @ (weight * error)

        for index, (pose, identity, expression, error) in enumerate(blocks):
            add(self._spread(index, pose, identity, expression), error)
        add(*both)
        at = np.concatenate([self.identity, *(np.concatenate([np.zeros(6), view.expression])
                                              for view in self.views)])
        held = np.concatenate([np.ones(shared), *(np.concatenate(
            [np.full(6, 1e-6), np.full(own - 6, EXPRESSION ** -2)]) for _ in blocks)])
        normal[np.diag_indices(size)] += held
        right -= held * at
        low, high = np.full(size, -np.inf), np.full(size, np.inf)
        low[:shared], high[:shared] = -MOST_DEVIATIONS, MOST_DEVIATIONS
        for index in range(len(blocks)):
            expressions = slice(shared + own * index + 6, shared + own * (index + 1))
            low[expressions], high[expressions] = LEAST_EXPRESSION, MOST_EXPRESSION
        change = bounded_step(normal, right, low - at, high - at)
        self.identity = self.identity + change[:shared]
        for index, view in enumerate(self.views):
            part = change[shared + own * index:][:own]
            turn = Rotation.from_rotvec(part[:3]).as_matrix()
            self.views[index] = replace(
                view, rotation=turn @ view.rotation, shift=view.shift + part[3:6],
                expression=view.expression + part[6:])
        cost += float((held * at ** 2).sum())
        if self.distance is not None:
            # Of each photo: errors that photos share would outvote one for all.
            cost += len(self.views) * (np.log(self.distance / LIKELY) / SPREAD) ** 2
        self.cost = cost

    def _rows(self, index: int, vertices: Int64, points: Float64,
              along: Float64) -> tuple[Float64, Float64, Float64]:
        """Derivatives of projected vertices along directions [R, 2]: by pose, by coefficients."""
        view = self.views[index]
        turned = points @ view.rotation.T
        local = turned + view.shift
        # d pixel / d camera point, times the direction.
        x, y, z = local.T
        slope = view.focal * np.stack([
            along[:, 0] / z, along[:, 1] / z,
            -(along[:, 0] * x + along[:, 1] * y) / z ** 2], axis=1)
        pose = np.concatenate([np.cross(turned, slope), slope], axis=1)
        back = slope @ view.rotation
        identity = np.einsum("kni,ni->nk", self.prior.identity[:, vertices], back)
        expression = np.einsum("kni,ni->nk", self.prior.expression[:, vertices], back)
        return pose, identity, expression

    def _landmark_rows(self, index: int, vertices: Float64) -> tuple[Float64, ...]:
        """Rows of the landmarks: two each, and one across the outline for the jaw's."""
        view, picture = self.views[index], self.pictures[index]
        noise = NOISE * picture.eyes
        if index and self.found[index]:
            noise *= TURNED
        inner = np.repeat(self.prior.landmarks[17:], 2)
        chosen = np.concatenate([self.jaw[index], inner])
        # Positive where the jaw's halves face the camera: sin(yaw), by the sides.
        facing = -view.rotation[2, 0] * np.sign(self.prior.mean[self.prior.landmarks[:17], 0])
        inexact = JAW * (1 + NEAR_JAW * np.maximum(facing, 0))
        along = np.concatenate([across_jaw(picture.landmarks) / inexact[:, None],
                                _inner_axes(picture.landmarks)]) / noise
        points = vertices[chosen]
        numbers = np.r_[0:17, np.repeat(np.arange(17, 68), 2)]
        away = view.project(points) - picture.landmarks[numbers]
        return (*self._rows(index, chosen, points, along), (away * along).sum(axis=1))

    def _shared_rows(self) -> tuple[Float64, Float64]:
        """Rows of places that the first photo and another show: four each, of all unknowns.

        A head's surface is further from the model's than places are inexact in a photo. That moves
        them in both photos, along lines that the poses give: off these they are a pixel, along
        them some millimetres.
        """
        rows, errors = [np.zeros((0, self._size()))], [np.zeros(0)]
        pairs = [(other, found) for other in range(1, len(self.views))
                 for found in self.found[other]]
        for base, (other, found) in zip(self.found[0], pairs, strict=True):
            block, lines, away = (np.concatenate(part, axis=1) for part in zip(
                self._half(0, base), self._half(other, found), strict=True))
            spread = np.eye(4) + SURFACE ** 2 * lines @ lines.transpose(0, 2, 1)
            white = np.linalg.inv(np.linalg.cholesky(spread))
            white /= np.sqrt(max(len(away) / ALIKE, 1.0))
            rows.append((white @ block).reshape(-1, block.shape[2]))
            errors.append((white @ away[:, :, None]).ravel())
        return np.concatenate(rows), np.concatenate(errors)

    def _half(self, index: int, found: Found) -> tuple[Float64, Float64, Float64]:
        """One photo's part of `_shared_rows`, in deviations of `PLACED`.

        Derivatives [M, 2, unknowns], those by the vertices themselves [M, 2, 3], errors [M, 2].
        """
        view, count = self.views[index], len(found.vertices)
        vertices = self.prior.shape(self.identity, view.expression)
        chosen = np.repeat(found.vertices, 2)
        noise = PLACED * _eyes_of(view, self.prior)
        along = np.tile(np.eye(2) / noise, (count, 1))
        pose, identity, expression = self._rows(index, chosen, vertices[chosen], along)
        block = self._spread(index, pose, identity, expression)
        away = (view.project(vertices[found.vertices]) - found.places) / noise
        return (block.reshape(count, 2, -1), (pose[:, 3:] @ view.rotation).reshape(count, 2, 3),
                away)

    def _spread(self, index: int, pose: Float64, identity: Float64, expression: Float64) -> Float64:
        """One photo's derivatives (`_rows`) among those by all unknowns, [R, unknowns]."""
        shared, own = len(self.identity), 6 + len(self.prior.expression)
        first = shared + own * index
        rows = np.zeros((len(pose), self._size()))
        rows[:, :shared] = identity
        rows[:, first:first + 6] = pose
        rows[:, first + 6:first + own] = expression
        return rows

    def _size(self) -> int:
        """The number of unknowns."""
        return len(self.identity) + (6 + len(self.prior.expression)) * len(self.views)

    def _outline_rows(self, index: int, vertices: Float64, normals: Float64) -> tuple[Float64, ...]:
        """Rows that draw the model's outline to the matte's, or into hair."""
        view, picture = self.views[index], self.pictures[index]
        assert picture.inside is not None
        rim = outline_vertices(view, self.prior, vertices, normals)
        places = view.project(vertices[rim])
        away, slope, hair = outline_errors(picture, places, view)
        good = np.abs(away) < _WATCHED * picture.eyes
        # A matte that takes ground for the person has an outline, too, which runs elsewhere.
        good &= run_alike(view, normals[rim], slope, ALIKE_ENOUGH)
        rim, away, slope, hair = rim[good], away[good], slope[good], hair[good]
        count = len(rim)
        # Hair may be thicker, but the skull lies within it.
        free = (hair > 0.5) & (away > 0)
        rim, away, slope, hair = rim[~free], away[~free], slope[~free], hair[~free]
        # Neighbours err alike: all together count as some ten.
        noise = OUTLINE * picture.eyes * np.sqrt(max(count / 10.0, 1.0))
        noise = noise * np.where(hair > 0.5, VAGUE_HAIR, 1.0)
        if index and self.found[index]:
            noise = noise * TURNED
        along = slope / noise[:, None]
        return (*self._rows(index, rim, vertices[rim], along), away / noise)


def bounded_step(normal: Float64, right: Float64, low: Float64, high: Float64) -> Float64:
    """The solution [N] of normal equations within bounds (an active set, Kunisch and Rendl 2003).

    What passes a bound stays there, and the others, which counted on it, are solved for again.
    SciPy's `lsq_linear` gives the same, but holds and frees one unknown a round.

    Parameters
    ----------
    normal, right : float64 [N, N], positive definite, and [N].
    low, high : float64 [N], may be infinite.
    """
    out, at_low, at_high = np.zeros(len(right)), *np.zeros((2, len(right)), bool)
    for _ in range(PIVOTS):
        out[at_low], out[at_high] = low[at_low], high[at_high]
        free = ~(at_low | at_high)
        held = right[free] - normal[np.ix_(free, ~free)] @ out[~free]
        out[free] = np.linalg.solve(normal[np.ix_(free, free)], held)
        # What is held at a bound, but would go back within, is let go.
        drawn = right - normal @ out
        lower = (free & (out < low)) | (at_low & (drawn < 0))
        higher = (free & (out > high)) | (at_high & (drawn > 0))
        if (lower == at_low).all() and (higher == at_high).all():
            break
        at_low, at_high = lower, higher
    return np.clip(out, low, high)


def _eyes_of(view: View, prior: HeadPrior) -> float:
    """Pixels that the outer corners of the mean head's eyes are apart if seen squarely."""
    corners = prior.mean[prior.landmarks[[36, 45]]].astype(np.float64)
    return float(np.linalg.norm(corners[1] - corners[0]) * view.focal / view.shift[2])


def jaw_vertices(view: View, prior: HeadPrior, vertices: Float64, normals: Float64,
                 landmarks: Float64) -> Int64:
    """Vertices int64 [17] on the outline of the jaw, as a photo shows it, nearest to landmarks."""
    across = across_jaw(landmarks)
    local = view.to_camera(vertices)
    turned = normals @ view.rotation.T
    facing = np.abs((turned * local).sum(axis=1)) / np.linalg.norm(local, axis=1)
    rim = np.flatnonzero((facing < 0.25) & (prior.part != EYES))
    flat = turned[rim, :2] / np.maximum(np.linalg.norm(turned[rim, :2], axis=1), 1e-9)[:, None]
    places = vertices[rim]
    seen = view.project(places)
    out = prior.landmarks[:17].copy()
    for number, start in enumerate(prior.landmarks[:17]):
        near = np.flatnonzero(flat @ across[number] > 0.7)  # few are left to be measured
        near = near[np.linalg.norm(places[near] - vertices[start], axis=1) < 0.025]
        if len(near):
            away = np.linalg.norm(seen[near] - landmarks[number], axis=1)
            out[number] = rim[near[int(np.argmin(away))]]
    return out


def outline_errors(picture: Picture, places: Float64, view: View,
                   ) -> tuple[Float64, Float64, Float64]:
    """How far places [N, 2] lie inside of where the skull's outline should be, in pixels.

    Returns
    -------
    away, slope, hair : [N] the distances; [N, 2] their derivatives by the place; [N] how much
        hair is there, or clothes.
    """
    assert picture.inside is not None
    height, width = picture.inside.shape
    column = np.clip(np.floor(places[:, 0]).astype(int), 1, width - 2)
    row = np.clip(np.floor(places[:, 1]).astype(int), 1, height - 2)
    inside = picture.inside
    away = inside[row, column].astype(np.float64)
    slope = 0.5 * np.stack([inside[row, column + 1] - inside[row, column - 1],
                            inside[row + 1, column] - inside[row - 1, column]], axis=1)
    slope = slope / np.maximum(np.linalg.norm(slope, axis=1), 1e-6)[:, None]
    hair, deep = np.zeros(len(places)), 0.06 * picture.eyes
    if picture.hair is not None:
        hair = picture.hair[row, column].astype(np.float64)
        # At the outline itself a mask of hair is soft: it is asked a little inside, too.
        inner = np.clip(np.floor(places + slope * deep).astype(int), 0, [width - 1, height - 1])
        hair = np.maximum(hair, picture.hair[inner[:, 1], inner[:, 0]])
    clothed = np.zeros(len(places), bool)
    if picture.clothes is not None:
        outline = places - slope * (away - deep)[:, None]
        column, row = np.clip(np.floor(outline).astype(int), 0, [width - 1, height - 1]).T
        clothed = picture.clothes[row, column]
    away = away - np.where(hair > 0.5, HAIR * view.focal / view.shift[2], 0.0)
    hair[clothed] = 1.0  # of clothes the head lies within, too, be they as thin as they may
    # Beyond the picture nothing is known.
    known = ((places > 2) & (places < np.array([width - 2, height - 2]))).all(axis=1)
    return np.where(known, away, 1e9), slope.astype(np.float64), hair


def run_alike(view: View, normals: Float64, slope: Float64, least: float) -> Bool:
    """Where a head's outline runs as a matte's does, bool [N].

    Parameters
    ----------
    normals : float64 [N, 3], of the outline's vertices, in the model's frame.
    slope : float64 [N, 2], directions into the matte there (`outline_errors`).
    least : Cosine of the angle between the two.
    """
    outward = normals @ view.rotation[:2].T
    return np.asarray(-(outward * slope).sum(axis=1) > least * np.linalg.norm(outward, axis=1))


def outline_vertices(view: View, prior: HeadPrior, vertices: Float64, normals: Float64,
                     neck: bool = False) -> Int64:
    """The numbers of the vertices on the outline of a head in a photo, int64 [K].

    Vertices and normals are float64 [N, 3] in the head's frame, metres. Those of the neck are among
    them only if asked for.
    """
    local = view.to_camera(vertices)
    turned = normals @ view.rotation.T
    facing = np.abs((turned * local).sum(axis=1)) / np.linalg.norm(local, axis=1)
    places = view.project(vertices)
    low = places.min(axis=0) - 8
    scale = 240.0 / float(np.ptp(places, axis=0).max())
    small = (places - low) * scale
    size = np.ceil(small.max(axis=0) + 8 * scale).astype(int) + 4
    cover = np.zeros((size[1], size[0]), np.uint8)
    corners = np.rint(small[prior.triangles]).astype(np.int32)
    cv2.fillPoly(cover, list(_outward(corners)), 1)
    # Where triangles lie behind others they take each other away: the head has no holes.
    outer, _ = cv2.findContours(cover, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(cover, outer, -1, 1, cv2.FILLED)
    away = cv2.distanceTransform(cover, cv2.DIST_L2, 3)
    column, row = np.rint(small).astype(int).T
    on = away[np.clip(row, 0, size[1] - 1), np.clip(column, 0, size[0] - 1)] <= 2.0
    lowest = vertices[prior.landmarks[8], 1] + 0.005
    if neck:
        lowest = vertices[:, 1].min() + 0.012
    shown = on & (facing < 0.35) & (prior.part != EYES)
    return np.flatnonzero(shown & (vertices[:, 1] > lowest))


def _outward(corners: Int32) -> Int32:
    """The triangles [T, 3, 2] of one side: together they cover all of the outline."""
    one, two = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return corners[one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0] < 0]


def across_jaw(landmarks: Float64) -> Float64:
    """Unit directions [17, 2] out of the face, across the line of the jaw."""
    line = landmarks[:17]
    along = np.gradient(line, axis=0)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    across /= np.maximum(np.linalg.norm(across, axis=1), 1e-9)[:, None]
    outward = line - landmarks[27:36].mean(axis=0)
    across *= np.where((across * outward).sum(axis=1) < 0, -1.0, 1.0)[:, None]
    return np.asarray(across, np.float64)


def _inner_axes(landmarks: Float64) -> Float64:
    """Directions [102, 2] in which the inner landmarks are compared, shorter where inexact."""
    across = landmarks[45] - landmarks[36]
    across = across / np.linalg.norm(across)
    axes = np.tile(np.stack([across, [-across[1], across[0]]]), (51, 1, 1))
    for numbers, inexact in VAGUE.items():
        axes[np.array(numbers) - 17, 1] /= inexact
    return axes.reshape(102, 2)


def _first_view(prior: HeadPrior, picture: Picture, distance: float | None) -> View:
    """Pose and camera of a photo by the mean head."""
    center = np.array(picture.size, np.float64) / 2
    model = prior.mean[prior.landmarks].astype(np.float64)
    inner = slice(17, 68)
    turned = model[inner]
    for _ in range(2):  # a face that is turned is narrower than the model from the front
        size = float((picture.landmarks[inner].std(axis=0) / turned[:, :2].std(axis=0)).mean())
        focal = picture.focal if picture.focal is not None else size * (distance or LIKELY)
        matrix = np.array([[focal, 0, center[0]], [0, focal, center[1]], [0, 0, 1.0]])
        _, turns, shifts, _ = cv2.solvePnPGeneric(model[inner], picture.landmarks[inner], matrix,
                                                  None, flags=cv2.SOLVEPNP_SQPNP)
        turn, shift = cv2.solvePnPRefineLM(model[inner], picture.landmarks[inner], matrix, None,
                                           turns[0], shifts[0])
        rotation = Rotation.from_rotvec(np.ravel(turn)).as_matrix()
        turned = model[inner] @ rotation.T
    return View(rotation, np.ravel(shift), float(focal), center,
                np.zeros(len(prior.expression)))
