"""Colors of a solid from its photo, and of what the photo does not show.

A place has the photo's color as far as the photo looks at it squarely, lies beside no edge of a
turned face, and does not show the other side's much more so; beyond, that fades into what lies
around, by parts (hair, beard, clothes, skin): the mirrored side's colors, with their light
matched, then means over ever wider surroundings (pull and push, Gortler et al. 1996).

Hair that no photo shows has strands that run down from the crown, as strong as those it shows; it
would else be as smooth as a helmet. They are noise that is long in the direction in which hair
falls, in octaves of a strand's width, each with its contrast in the photo. Fine ones are copied
from what it shows (`locks`). Short hair has tufts (`tufts`). Skin, and hair between locks, is lit
as it lies (`shade`).
"""

from __future__ import annotations

import itertools
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from ...arrays import Bool, Float32, Float64, UInt8
from ...capture import Camera
from ...field import C0, VoxelField
from .beard import BEARD
from .collar import spread_around
from .hair import NAPE
from .lattice import Shell
from .locks import Chart
from .parts import Parts
from .piece import METRES
from .shade import Hue, Light, open_around
from .solid import BODY, HAIR, HEAD, WORN
from .tufts import aligned, tufts

LOOSE, FIRM = (0.25, 0.45), (0.15, 0.35)
"""Cosines of incidence of hair and beards, and of all else: below the first (75 and 81 degrees) a
photo says nothing, from the second on all. Loose hair lets the ground through, and has no surface.
"""
GROOVE = (0.35, 0.6)
"""Cosines of what lies around a place: from the first on its photo's color may count however
it lies itself, from the second on it does (`_broad`)."""
SPECK = (0.2, 0.35)
"""Shares of hair, or of skin, around a place that no photo shows: with less than the first it is
the other, from the second on as it is."""
LEAST = 0.25  # No slope is taken for steeper than at this cosine (`_Depths.beside_edge`).
CELL = 0.03  # Of the finest lattice that colors are spread on, portrait units.
UPWARDS = 1.8  # Colors come from the sides rather than from above or below.
HIDDEN = 0.3  # How little a photo shows of what it says little of.
PURE = 0.02
"""Hair and skin mix so far on both sides of a hairline, portrait units: what lies there says
nothing of what no photo shows."""
MIRRORED = 0.25  # Weight of what the other side shows.
UNEVEN = 0.3  # Logarithm of how unlike both sides' light is from place to place, at most.
SQUARER = (0.3, 0.6)
"""Differences of cosines of incidence, the other side's less its own, from which on, and from which
on in full, a place of a head has the other side's color."""
STRANDS = 0.15  # How far below the nape hair hangs that has strands in full, portrait units.
UNLIKE = 0.1, 0.2
"""Differences of logarithms of colors from which on, and from which on in full, two photos that
are laid over each other show different things."""
SQUARE = 6  # Power by which one of several photos that looks more squarely counts more.
WIDTHS = (0.016, 0.032, 0.064, 0.128)  # Widths of strands (3 to 26 mm), portrait units.
LENGTH = 12.0  # How long they are over their widths.
CROWN, AROUND = -0.25, 0.5
"""Where they start (depth, forward), and how far from there they are as wide as that."""
DARKEST = 0.02  # Added to luminance before its logarithm.
FEWEST = 100  # So few places say nothing of their light.
DEPTHS, DEEPEST = 0.8, 0.2
"""Power of how open hair lies that its brightness goes with, and the least open it is taken for."""
GRAINS: tuple[tuple[int, tuple[float, ...]], ...] = (1, (0.8, 0.8)), (2, (0.5,))
"""Beards and skin, which of `_parts` they are, and how uneven what no photo shows of them is over
what it shows, in the finest octaves of `WIDTHS`: half of it is features of a face."""
FINE = 2  # Octaves of strands that are copied from what a photo shows, of `WIDTHS`.
STRONGEST = 2.5  # So many standard deviations what is copied is brighter or darker, at most.
UNDER = 0.008 / METRES
"""How far under a chin a beard goes on beside what hangs down of it, portrait units."""
BAY, BAY_CELL = 0.010 / METRES, 0.0025 / METRES
"""Hair has no bays narrower than twice this where no photo sees them; and cells that this is looked
at in, portrait units."""
GAP, WIDE = 0.1, 3 * BAY
"""Nor gaps that photos show to be less bare than the first, in the mean, and that are less than
twice the second wide."""
LEDGE, EXACT = 0.006 / METRES, 0.0025 / METRES
"""Beside the edge of a turned nose, or of hair, what lies so much farther or nearer than something
within the second in the photo may have that one's color: no fitted head meets its photo more
exactly."""
DEEP, ABOUT = 0.006 / METRES, 0.012 / METRES
"""What lies so much farther behind a face than its outline, and in the photo less than the second
beside it, may have the face's color: no fitted jaw ends exactly where the photo's does."""
RIM = (0.55, 0.7)
"""Hair that hangs before something has that one's color along its edge: where a photo shows less
hair than the first it says nothing of it, from the second on all."""
SQUARELY = 0.2  # Third powers of cosines from which on a face is squarely seen.
LINE = (CELL, 2 * CELL)
"""Up to so far from bare skin that is squarely seen, hair that no photo shows is as the hair's
surface beside it, hair or bare; from the second on it is hair. Portrait units."""
TURNED = (4.0, 10.0)  # Degrees from which on, and from which on in full, a face hides itself so.
UNDERSIDE = -0.3  # What faces down by more, as the underside of a nose, is the photo's at an edge.
LIP = 0.025 / METRES
"""So far behind what a photo shows of an open mouth things are of the same color."""
CLOSE_BY, EDGE_BY = (0.1, 0.3), (0.03, 0.15)
"""Up to so far from what a photo shows clothes and their edge go on as what is around them, from
the second on as what lies as far from the neck's end (`collar`), portrait units."""
LIT = 3
"""Power by which clothes that are seen squarely count more there: along outlines lies other light.
"""
SEEN = 6e-4  # How much of a neck must be seen to say what it wears, portrait units squared.
HEM = 6.0  # How many times as sharp as a mean over surroundings the edge of clothes is.
SHARPER = 5.0
"""Around a neck, where skin and clothes meet almost at a tangent, that edge is as even as means
over twice `CELL` are, and so many times as sharp."""
FINEST = 0.22
"""Standard deviation, in voxels, of the mean that a point of a lattice takes from a photo."""
SHARPEST = 0.25
"""Contrast of one octave at most: beyond, a photo shows highlights rather than strands."""


@dataclass(frozen=True)
class Shot:
    """A photo that colors a solid."""

    camera: Camera  # One view.
    colors: Float32  # float32 [H, W, 3] in [0, 1], the person's alone (`clean_colors`).
    # float32 [H, W], 1 in hair, 0 elsewhere, in between along a hairline; or None.
    hair: Float32 | None = None
    # float32 [H, W], how much it shows something else where skin lies (`not_skin`); or None.
    other: Float32 | None = None
    # float32 [H, W], how much it shows a beard, and what lies below one (`beard`); or None.
    beard: Float32 | None = None
    beneath: Float32 | None = None
    # float32 [H, W], where lips and what is between them are seen, however slanted; or None.
    mouth: Float32 | None = None
    clothes: Float32 | None = None  # float32 [H, W], how much it shows clothes (`cloth`); or None.

    @staticmethod
    def of(camera: Camera, colors: Float32, hair: Float32 | None, other: Float32 | None = None,
           beard: Float32 | None = None, beneath: Float32 | None = None,
           mouth: Float32 | None = None, clothes: Float32 | None = None) -> Shot:
        """A photo whose hairlines are made as wide as hair and skin mix there."""
        if hair is None or not (hair > 0.5).any():
            return Shot(camera, colors, None, other, beard, beneath, mouth, clothes)
        pixels = PURE * float(camera.focal[0, 0]) / float(np.linalg.norm(camera.position[0]))
        mask = (hair > 0.5).astype(np.uint8)
        inner, outer = (cv2.distanceTransform(part, cv2.DIST_L2, 5) for part in (mask, 1 - mask))
        away = np.where(mask > 0, inner, -outer) / max(pixels, 1.0)
        soft = np.asarray(np.clip(0.5 + 0.5 * away, 0, 1), np.float32)
        return Shot(camera, colors, soft, other, beard, beneath, mouth, clothes)

    def contrast(self) -> tuple[Float64, float]:
        """How strong strands of hair are in it (`strand_contrast`), and how much `aligned`."""
        assert self.hair is not None
        unit = float(self.camera.focal[0, 0]) / float(np.linalg.norm(self.camera.position[0]))
        within = self.hair > 0.99
        return (strand_contrast(self.colors, within, unit),
                aligned(self.colors, within, unit, WIDTHS[0]))

    def as_fine_as(self, voxel: float) -> Shot:
        """It without what is finer than a lattice: between its points that would be dots."""
        unit = float(self.camera.focal[0, 0]) / float(np.linalg.norm(self.camera.position[0]))
        sigma = FINEST * voxel * unit
        if sigma < 0.3:  # less than a pixel's neighbors
            return self
        return replace(self, colors=np.asarray(cv2.GaussianBlur(self.colors, (0, 0), sigma),
                                               np.float32))

    def look(self, points: Float64, normals: Float64, solid: _Depths, voxel: float,
             owner: NDArray[np.uint8], broad: Float64 | None = None) -> Look:
        """What the photo shows of places [N, 3].

        ``solid`` is how deep all lies in the photo; what is three times ``voxel`` (portrait units)
        deeper is hidden. ``owner`` is what they belong to: on a head nothing but skin counts, in a
        beard nothing below it. ``broad`` is how what lies around them faces [N, 3] (`_broad`).
        """
        pixels, far = self.camera.project(points)
        pixels, far = pixels[0], far[0]
        size = np.array(self.colors.shape[1::-1])
        at = pixels[:, ::-1].T - 0.5
        colors = Parts.at(self.colors, at)
        hair = np.zeros(len(points)) if self.hair is None else Parts.at(self.hair, at)
        to_eye = self.camera.position[0] - points
        to_eye /= np.linalg.norm(to_eye, axis=1)[:, None]
        cosine = (normals * to_eye).sum(axis=1)
        loose = (owner == HAIR) | (owner == BEARD)
        least, full = (np.where(loose, *ends) for ends in zip(LOOSE, FIRM, strict=True))
        share = np.clip((cosine - least) / (full - least), 0, 1)
        groove, slant = np.zeros(len(points)), cosine
        if broad is not None:
            around = (broad * to_eye).sum(axis=1)
            groove = np.clip((around - GROOVE[0]) / (GROOVE[1] - GROOVE[0]), 0, 1)
            share, cosine = np.maximum(share, groove), np.maximum(cosine, around)
        cells = np.array(solid.all.shape[::-1])
        small = np.floor(pixels / size * cells).astype(np.int64)
        within = (small >= 0).all(axis=1) & (small < cells).all(axis=1)
        small = np.clip(small, 0, cells - 1)
        behind = np.where(within, far - solid.all[small[:, 1], small[:, 0]], np.inf)
        weight = np.where(behind < 3.0 * voxel, share * share * (3 - 2 * share), 0.0)
        head = np.flatnonzero((owner == HEAD) & (weight > 0))
        weight[head] *= 1 - solid.beside_edge(small[head], far[head], slant[head],
                                              normals[head, 1] < UNDERSIDE)
        # In a face seen from the front what lies behind it is a groove of its own.
        own = np.where(owner == HAIR, 1.0, groove * (1 - solid.turned))
        weight *= 1 - (1 - own) * solid.behind_face(small, far)
        curls = np.flatnonzero((owner == HAIR) & (weight > 0))
        bare = np.clip((RIM[1] - hair[curls]) / (RIM[1] - RIM[0]), 0, 1)
        weight[curls] *= 1 - bare * solid.before_gap(small[curls], far[curls])
        kept = np.where((owner == HEAD) | (owner == HAIR), 0.0, 1.0)
        if self.mouth is not None:
            # Above teeth lies the underside of a lip, which the photo may not see.
            lips = (behind < LIP) * Parts.at(self.mouth, at)
            weight, kept = np.maximum(weight, lips), np.maximum(kept, lips)
        for kind, wrong in ((HEAD, self.other), (BEARD, self.beneath)):
            if wrong is not None:
                weight *= 1 - np.where(owner == kind, Parts.at(wrong, at), 0.0)
        beard = None if self.beard is None else Parts.at(self.beard, at).astype(np.float64)
        worn = None if self.clothes is None else Parts.at(self.clothes, at).astype(np.float64)
        sure = np.where(behind > -3.0 * voxel, weight, 0.0)
        return Look(colors.astype(np.float64), hair.astype(np.float64), beard, worn, weight,
                    np.clip(cosine, 0, 1), sure, kept)


class _Depths(NamedTuple):
    """How deep things lie in a photo, float64 [h, w] each, along its optical axis.

    Of all, and of the nearest and the farthest within `EXACT` of a pixel, infinite beside the
    person; of the face's nearest place, and how near that is: 1 within the face, 0 from `ABOUT`
    beside it, or if none is seen. How far the second two look, portrait units, and how much a face
    that is turned so hides itself.
    """

    all: Float64
    nearest: Float64
    farthest: Float64
    face: Float64
    near: Float64
    reach: float
    turned: float

    @staticmethod
    def of(solid: VoxelField, face: VoxelField, camera: Camera, voxel: float) -> _Depths:
        """Those of a field and of its face alone; ``voxel`` as in `Shot.look`."""
        eye = camera.position[0]
        unit = float(camera.focal[0, 0]) / float(np.linalg.norm(eye))
        alpha, depth = solid.depth(camera, 0)
        whole = np.where(alpha > 0.5, depth, np.inf).astype(np.float64)
        alpha, depth = face.depth(camera, 0)
        # From below one looks into a face that has no throat.
        shown = (alpha > 0.5) & (depth < whole + 3.0 * voxel)
        away, beside = np.full(shown.shape, np.inf), np.full(shown.shape, np.inf)
        if shown.any():
            away, nearest = ndimage.distance_transform_edt(~shown, return_indices=True)
            beside = np.asarray(depth, np.float64)[tuple(nearest)]
        around = max(1, int(np.ceil(EXACT * unit)))
        disc = np.hypot(*np.mgrid[-around:around + 1, -around:around + 1]) <= around + 0.5
        inner = np.where(np.isfinite(whole), whole, -np.inf)
        yaw = float(np.degrees(np.arcsin(abs(eye[0]) / np.linalg.norm(eye))))
        return _Depths(_nearest(whole), ndimage.minimum_filter(whole, footprint=disc),
                       ndimage.maximum_filter(inner, footprint=disc), beside,
                       np.clip(1 - away / (ABOUT * unit), 0, 1), (around + 0.5) / unit,
                       float(np.clip((yaw - TURNED[0]) / (TURNED[1] - TURNED[0]), 0, 1)))

    def beside_edge(self, at: NDArray[np.int64], far: Float64, cosine: Float64, under: Bool,
                    ) -> Float64:
        """How much places [N] of a turned head lie beside an edge, where depths jump, [N].

        ``at`` [N, 2] are their columns and rows, ``far`` and ``cosine`` [N] their own depth and
        incidence: what is slanted is no edge. What lies ``under`` something is none itself.
        """
        if self.turned == 0:
            return np.zeros(len(far))
        place = at[:, 1], at[:, 0]
        cosine = np.clip(cosine, LEAST, 1)
        slope = self.reach * np.sqrt(1 - cosine ** 2) / cosine
        before = np.where(under, 0.0, self.farthest[place] - far)
        excess = np.maximum(far - self.nearest[place], before) - slope
        return self.turned * np.clip(excess / LEDGE - 1, 0, 1)

    def before_gap(self, at: NDArray[np.int64], far: Float64) -> Float64:
        """How much places [N] at columns and rows [N, 2] stand before what is beside them, [N]."""
        return np.clip((self.farthest[at[:, 1], at[:, 0]] - far) / LEDGE - 1, 0, 1)

    def behind_face(self, at: NDArray[np.int64], far: Float64) -> Float64:
        """How much the face may lie before places [N] at columns and rows [N, 2], [N]."""
        place = at[:, 1], at[:, 0]
        return self.near[place] * np.clip((far - self.face[place]) / DEEP - 1, 0, 1)


class Look(NamedTuple):
    """What a photo shows of places [N].

    Colors [N, 3], how much hair, and beard and clothes if these are known, how well it is seen (0
    to 1), cosines of incidence, how well it is seen where nothing but itself lies there, and how
    much it is never the other side's.
    """

    colors: Float64
    hair: Float64
    beard: Float64 | None
    clothes: Float64 | None
    weight: Float64
    cosine: Float64
    sure: Float64
    kept: Float64

    def beside(self, mirrored: Look) -> Look:
        """It without what is seen much more squarely on the other side, and is the same there."""
        better = np.clip((mirrored.cosine - self.cosine - SQUARER[0])
                         / (SQUARER[1] - SQUARER[0]), 0, 1) * mirrored.sure * (1 - self.kept)
        for one, two in ((self.hair, mirrored.hair), (self.beard, mirrored.beard),
                         (self.clothes, mirrored.clothes)):
            if one is not None and two is not None:
                better *= 1 - np.abs(one - two)
        return self._replace(weight=self.weight * (1 - better))


class _Mean:
    """Means of colors, hair and beard over photos."""

    def __init__(self, count: int) -> None:
        self.total, self.weights = np.zeros((count, 4)), np.zeros(count)
        # Beard, and how much is known of it: not every photo shows enough of a chin.
        self.bearded = np.zeros((count, 2))
        self.worn = np.zeros(count)
        self.best, self.square = np.zeros((2, count))

    def add(self, colors: Float64, look: Look, weight: Float64) -> None:
        self.total += weight[:, None] * np.column_stack([colors, look.hair])
        self.weights += weight
        if look.beard is not None:
            self.bearded += weight[:, None] * np.stack([look.beard, np.ones(len(weight))], axis=1)
        if look.clothes is not None:
            self.worn += weight * look.clothes
        self.best = np.maximum(self.best, look.weight)
        self.square = np.maximum(self.square, look.weight * look.cosine ** LIT)

    @property
    def colors(self) -> Float64:
        return np.asarray(self.total[:, :3] / np.maximum(self.weights, 1e-9)[:, None])

    @property
    def share(self) -> Float64:
        """How much of what is seen is hair, [N]."""
        return np.asarray(self.total[:, 3] / np.maximum(self.weights, 1e-9))

    @property
    def beard(self) -> Float64:
        """How much of what is seen is beard, [N], as far as photos say."""
        return np.asarray(self.bearded[:, 0] / np.maximum(self.bearded[:, 1], 1e-9))

    @property
    def clothes(self) -> Float64:
        """How much of what is seen is clothes, [N]."""
        return np.asarray(self.worn / np.maximum(self.weights, 1e-9))

    def pure(self, kind: int) -> Float64:
        """How well places are seen that have a material, one of `_fill`, [N]."""
        share = _parts(self.share, self.beard, self.clothes)[kind]
        return np.asarray(self.best * np.clip(2 * share - 1, 0, 1))


class Relief(NamedTuple):
    """How a surface lies in the light, and how long its hair is."""

    normals: Float64  # float64 [N, 3].
    free: Float64  # float64 [N], how open places lie (`shade.open_around`).
    long: float = 0.0  # 1 if it hangs down far below the nape, 0 if it does not.


class Paint(NamedTuple):
    """Of a shell's points: coefficients, and of how much of what they are (255: all of it).

    Coefficients are float32 [N, 3, 1]; hair uint8 [N]; clothes uint8 [N], None if they are not
    known.
    """

    sh: Float32
    hair: UInt8
    clothes: UInt8 | None


def painted(shell: Shell, shots: list[Shot]) -> Paint:
    """The colors of a shell's points, and which of these are hair or clothes.

    The first shot's light is everybody's.
    """
    points, normals = shell.on, shell.normals
    colorless = np.zeros((len(points), 3, 1), np.float32)
    unworn, faces = shell.field(colorless), shell.field(colorless)
    unworn.density[shell.owner == WORN] = 0.0  # the photos are without it
    faces.density[~shell.whole_face] = 0.0
    own, other = _Mean(len(points)), _Mean(len(points))
    mirror, skin = np.array([-1.0, 1.0, 1.0]), shell.owner == HEAD
    broad = _broad(shell)
    for shot in shots:
        factor = min(1.0, 1.0 / (shell.voxel * float(shot.camera.focal[0, 0])
                                 / float(np.linalg.norm(shot.camera.position[0]))))
        depths = _Depths.of(unworn, faces, shot.camera.scaled(factor), shell.voxel)
        fine = shot.as_fine_as(shell.voxel)
        with ThreadPoolExecutor(2) as pool:
            coming = pool.submit(fine.look, points * mirror, normals * mirror, depths, shell.voxel,
                                 shell.owner, broad * mirror)
            look = fine.look(points, normals, depths, shell.voxel, shell.owner, broad)
        mirrored = coming.result()
        light = _light(points, look.colors, look.weight, own.colors, own.best)
        look = look.beside(mirrored)
        # Photos never lie on each other exactly: the squarest look decides, and where they differ
        # the first one that sees a place.
        square = look.weight * (1.0 if len(shots) == 1 else look.cosine ** SQUARE)
        if shot is not shots[0]:
            square *= 1 - own.best * _unlike(shell, look, light, own)
        own.add(np.clip(look.colors * light, 0, 1), look, square)
        other.add(np.clip(mirrored.colors * light, 0, 1), mirrored, mirrored.weight)
    hair = _hairy(shell, own, other)
    # A little skin that a photo shows in passing is no line through hair.
    own.best *= 1 - skin * hair * (1 - own.share)
    bearded = shell.owner == BEARD
    beard = np.zeros(len(points))
    if bearded.any():
        beard = _bearded(shell, own)
    else:  # one without a shape is skin's color
        own.bearded[:], other.bearded[:] = 0.0, 0.0
    worn = np.zeros(len(points))
    known = all(shot.clothes is not None for shot in shots)
    if known:
        worn = _clothed(shell, own)
    else:
        own.worn[:], other.worn[:] = 0.0, 0.0
    relief = Relief(normals, open_around(shell.points, normals, shell.away, shell.voxel),
                    _long(points[hair > 0.5]))
    parts = _parts(hair, beard, worn)
    fill = _fill(points, own, other, parts, skin,
                 shell.collar.around(points) if known else None, relief)
    for kind, strength in GRAINS:
        like = np.ones(len(points), bool) if known else shell.owner != BODY
        asked = (parts[kind] > 0) & (own.best < 1) & (other.best < 1) & like
        if asked.any():
            grain = _grain(points, normals, own.colors, own.pure(kind) * like, asked, strength)
            share = parts[kind] ** 2 * (1 - other.best)  # a beard's edge is soft
            fill[asked] *= grain[:, None] ** share[asked, None]
    if hair.any():
        grown = (hair > 0.5) & (own.best < 1) & (other.best < 1)
        fill[grown] *= (_grown(shell, shots[0], own, hair > 0.5, grown)
                        ** (1 - other.best[grown, None]))
    # An ear that no photo shows is not flat.
    fill *= (other.best + (1 - other.best) * shell.light)[:, None]
    share = own.best[:, None]
    out = np.clip(share * own.colors + (1 - share) * fill, 0, 1)
    sh = np.asarray((out - 0.5) / C0, np.float32)[:, :, None]
    clothes = _whole(worn) if known else None
    if not (hair.any() or bearded.any()):
        return Paint(sh, np.zeros(len(sh), np.uint8), clothes)
    # A photo's own hairline is finer than that of the pieces.
    shown = own.best * np.maximum(own.share, shell.owner == HAIR)
    grown = np.maximum(shown + (1 - own.best) * hair, beard)
    return Paint(sh, _whole(grown), clothes)


def _broad(shell: Shell) -> Float64:
    """How what lies around a shell's points faces, float64 [N, 3]; 0 where it does not count.

    Rims of lids, wings of noses and the front of hairlines are narrower than what a photo is
    stretched over. Ears and necks are as they lie.
    """
    out = np.zeros_like(shell.on)
    part = (shell.face & (shell.light == 1)) | (shell.owner == HAIR)
    if part.any():
        mean = _spread(shell.on[part], shell.normals[part], np.ones(int(part.sum())), 1)
        out[part] = mean / np.maximum(np.linalg.norm(mean, axis=1), 1e-9)[:, None]
    return out


def _grain(points: Float64, normals: Float64, colors: Float64, weight: Float64, asked: Bool,
           strength: tuple[float, ...]) -> Float64:
    """Factors [M] of the brightness of places [N, 3] of a material, where it is asked for.

    They are so many times as uneven as what is seen of the material, in octaves of `WIDTHS`.
    """
    contrast, seen = np.zeros(len(WIDTHS)), weight > 0.5
    if seen.sum() > FEWEST:
        logs = np.log(colors[seen].mean(axis=1) + DARKEST)
        for octave, share in enumerate(strength):
            mean = _spread(points[seen], logs[:, None], weight[seen], octave)[:, 0]
            # What differs by more than most of it is an edge, or a feature of a face.
            uneven = 1.5 * float(np.median(np.abs(logs - mean)))
            contrast[octave] = share * min(SHARPEST, uneven)
            logs = mean
    return tufts(points[asked], normals[asked], WIDTHS, contrast, 0.0)


def _long(hair: Float64) -> float:
    """Whether hair, places [N, 3], hangs down below the nape, 0 to 1."""
    if not len(hair):
        return 0.0
    return float(np.clip((NAPE - np.percentile(hair[:, 1], 1)) / STRANDS, 0, 1))


def _grown(shell: Shell, shot: Shot, own: _Mean, hair: Bool, asked: Bool) -> Float64:
    """Factors [M, 3] of the colors of hair [N] that the photos do not show, where it is asked for.

    Fine detail of long hair is what they show of it, broad strands and short hair's tufts are noise
    of its contrast.
    """
    points, normals, weight = shell.on, shell.normals, own.pure(0)
    # Short hair is too fine for strands.
    long = _long(points[hair])
    contrast, coherence = shot.contrast()
    at, facing, out = points[asked], normals[asked], np.ones((int(asked.sum()), 3))
    seen, copied = np.where(hair, weight * own.square, 0.0), np.zeros(len(at))
    used = seen > 0
    if long > 0 and seen.sum() > FEWEST:
        logs = np.log(own.colors[used] + DARKEST)
        fine = logs - _spread(points[used], logs, seen[used], 1)
        most = STRONGEST * np.sqrt(seen[used] @ fine ** 2 / seen.sum()) + 1e-9
        chart = Chart.of(points[used], most * np.tanh(fine / most), weight[used], shell.voxel)
        found, copied = chart.at(at)
        copied *= long
        out *= np.exp(copied[:, None] * found)
    octaves = [(contrast, np.ones(len(at)))]
    if copied.any():
        fine_ones = np.arange(len(WIDTHS)) < FINE
        octaves = [(contrast * fine_ones, 1 - copied), (contrast * ~fine_ones, np.ones(len(at)))]
    for part, share in octaves:
        noise = strands(at, long * part) * tufts(at, facing, WIDTHS, (1 - long) * part, coherence)
        out *= noise[:, None] ** share[:, None]
    return out


def _unlike(shell: Shell, look: Look, light: Float64, own: _Mean) -> Float64:
    """How much a photo shows other things than those before it around a shell's points, [N]."""
    known = np.minimum(look.weight, own.best)
    colors = np.clip(look.colors * light, 0, 1)
    apart = np.abs(np.log((colors + DARKEST) / (own.colors + DARKEST))).mean(axis=1)
    out = np.zeros(len(known))
    for kind in np.unique(shell.owner):
        part = shell.owner == kind
        around = _spread(shell.on[part], apart[part][:, None], known[part], 0)[:, 0]
        out[part] = np.clip((around - UNLIKE[0]) / (UNLIKE[1] - UNLIKE[0]), 0, 1)
    return out


def _parts(hair: Float64, beard: Float64, clothes: Float64) -> tuple[Float64, ...]:
    """How much of places [N] is hair, beard, skin and clothes, by what covers what, [N] each."""
    rest = (1 - hair) * (1 - beard)
    return hair, (1 - hair) * beard, rest * (1 - clothes), rest * clothes


def _whole(shares: Float64) -> UInt8:
    """Shares [N] of 1 as shares of 255."""
    return np.asarray(255 * np.clip(shares, 0, 1) + 0.5, np.uint8)


def _clothed(shell: Shell, own: _Mean) -> Float64:
    """How much of a shell's points is clothes, or would be where it is hair, [N].

    What no photo shows of a body goes on around the neck, a neck as what it shows of one; a head
    wears none.
    """
    out, part = np.zeros(len(shell.on)), np.ones(len(shell.on), bool)
    part[shell.face] = False
    part &= ~shell.scalp & (shell.owner != WORN)
    neck = part & (shell.owner == HEAD)
    known = own.best * np.clip(1 - 2 * own.share, 0, 1)
    for asked in (neck, part & ~neck):
        if not asked.any():
            continue
        # Of a collar beside a neck it has nothing.
        enough = asked is neck and known[neck].sum() * shell.voxel ** 2 > SEEN
        used = asked if enough else part
        on, shares, sure = shell.on[used], own.clothes[used][:, None], known[used]
        places = shell.collar.around(on)
        if asked is neck:
            places[:, 1] = 0  # all around as it is in the mean: not as what is before one side
        around, far = _spread(on, shares, sure, 0)[:, 0], _far(on, sure, EDGE_BY)
        around += far * (spread_around(places, shares, sure)[:, 0] - around)
        seen = own.best[asked]
        out[asked] = (seen * own.clothes[asked] + (1 - seen)
                      * np.clip(HEM * (around[asked[used]] - 0.5) + 0.5, 0, 1))
    if neck.any():
        # What lies beside the neck's end: more of a body than that has no edge there.
        beside = part & (shell.on[:, 1] > shell.on[neck, 1].min() - 2 * CELL)
        mean = _spread(shell.on[beside], out[beside][:, None], np.ones(beside.sum()), 1)[:, 0]
        even = np.clip(SHARPER * (mean - 0.5) + 0.5, 0, 1)
        out[beside] += (1 - own.best[beside]) * (even - out[beside])
    return out


def _bearded(shell: Shell, own: _Mean) -> Float64:
    """How much of a shell's points is beard, [N]."""
    seen = own.best * own.bearded[:, 1] / np.maximum(own.weights, 1e-9)
    out = np.where(shell.owner == HEAD, seen * own.beard, shell.owner == BEARD)
    # What no photo shows of a jaw goes on as what lies before it; behind a beard there is a throat.
    face, known = shell.face, seen[shell.face]
    around = _spread(shell.on[face], own.beard[face][:, None], known, 0)[:, 0]
    out[face] += (1 - known) * np.clip(2 * around - 0.5, 0, 1)
    # So does what lies right beside the beard under a chin.
    under = np.flatnonzero((shell.owner == HEAD) & ~face)
    away = cKDTree(shell.on[shell.owner == BEARD]).query(
        shell.on[under], distance_upper_bound=2 * UNDER)[0]
    out[under] += (1 - seen[under]) * np.clip(2 - away / UNDER, 0, 1)
    return np.clip(out, 0, 1)


def _hairy(shell: Shell, own: _Mean, other: _Mean) -> Float64:
    """How much of a shell's points is hair, [N] in [0, 1]."""
    part = shell.owner == HAIR
    hair = np.asarray(part, np.float64)
    if not hair.any():
        return hair
    # What no photo shows has hair, too, where it has on the other side, or where hair grows; so has
    # what shows through.
    unseen = np.clip(1 - own.best / HIDDEN, 0, 1)
    shown = np.clip(2 * own.share - 0.5, 0, 1)
    alike = np.clip(2 * other.best - 1, 0, 1) * shell.face
    grown = alike * np.clip(2 * other.share - 0.5, 0, 1) + (1 - alike) * shell.scalp
    out = np.maximum(hair, np.maximum(grown * unseen, shell.scalp * shown))
    # At a temple that a photo hardly sees the outline of hair has bays.
    head = (shell.owner == HEAD) | (shell.owner == HAIR)
    bare = np.maximum(own.best * (1 - own.share), alike * (1 - other.share))
    # What lies deep within skin may be hair's, and is none.
    near = np.abs(shell.away[head]) < 1.5 * shell.voxel
    within = _closed(shell.on[head], near & (out[head] > 0.5), bare[head], shell.voxel)
    out[head] = np.maximum(out[head], within * unseen[head])
    # The underside of hair whose edge lies on a bare forehead is none, or a dark line across that.
    bald = (own.square > SQUARELY) & shell.face & (own.share < 0.5)
    if bald.any():
        close = 1 - _far(shell.on, bald.astype(np.float64), LINE)[part]
        shown = _spread(shell.on[part], own.share[part][:, None], own.best[part], 0)[:, 0]
        out[part] -= unseen[part] * close * (1 - np.clip(2 * shown - 0.5, 0, 1))
    return _without_specks(shell, out, unseen)


def _without_specks(shell: Shell, hair: Float64, unseen: Float64) -> Float64:
    """Shares of hair [N] without what is small of hair in a face, or of a face in hair.

    Where hair lies on a cheek at a tangent there are specks and threads of each in the other.
    """
    met = (shell.owner == HAIR) | (shell.face & (shell.light == 1))
    met &= np.abs(shell.away) < 1.5 * shell.voxel
    out = hair.copy()
    if met.any():
        mean = _spread(shell.on[met], hair[met][:, None], np.ones(int(met.sum())), 1)[:, 0]
        least, most = (np.clip((share - SPECK[0]) / (SPECK[1] - SPECK[0]), 0, 1)
                       for share in (1 - mean, mean))
        out[met] += unseen[met] * (np.clip(out[met], 1 - least, most) - out[met])
    return out


def _closed(points: Float64, inside: Bool, bare: Float64, voxel: float = 0.0) -> Float64:
    """How far a surface's points [N, 3] belong to a part without bays narrower than twice `BAY`.

    By cells: what is near the part, but for what is as near to anything that is not. Nor does it
    have small gaps that photos hardly show ``bare``, [N]; ``voxel`` apart, points are one surface.
    [N] in [0, 1].
    """
    places = ((points - points.min(axis=0)) / BAY_CELL + 1).T
    cells = tuple(np.round(places).astype(int))
    size = tuple(int(axis.max()) + 2 for axis in cells)
    surface, part = np.zeros(size, bool), np.zeros(size, bool)
    surface[cells] = True
    part[tuple(axis[inside] for axis in cells)] = True
    reach = BAY / BAY_CELL
    deep = ndimage.distance_transform_edt(~part)
    beyond = surface & (deep > reach)
    coarse = int(np.ceil(voxel / BAY_CELL)) - 1
    near = ndimage.binary_dilation(beyond, iterations=coarse) if coarse > 0 else beyond
    pieces, count = ndimage.label(near, np.ones((3, 3, 3)))
    at = pieces[cells]
    shown = np.bincount(at, bare, count + 1) >= GAP * np.bincount(at, minlength=count + 1)
    shown |= ndimage.maximum(deep, pieces, np.arange(count + 1)) > WIDE / BAY_CELL
    beyond &= shown[pieces]
    if not beyond.any():
        return np.ones(len(points))
    away = ndimage.map_coordinates(ndimage.distance_transform_edt(~beyond), places, order=1)
    return np.clip((away - reach) / 2 + 0.5, 0, 1)


def _fill(points: Float64, own: _Mean, other: _Mean, parts: tuple[Float64, ...], head: Bool,
          ring: Float64 | None = None, relief: Relief | None = None) -> Float64:
    """Colors [N, 3] of what the photos do not show: of each of the parts (`_parts`) by its own.

    What is no clothes on the ``head`` goes on by itself: where clothes are not known they are seen
    on no cheek, but necks go on in skin. ``ring`` is where places are around the neck [N, 2]
    (`Collar.around`), if clothes are known: they go on around it. Skin goes on in its light if the
    ``relief`` is known.
    """
    def filled(kind: int) -> Float64:
        out, place = np.zeros_like(points), parts[kind] > 0
        if not place.any():
            return out
        weight, known = (mean.pure(kind)[place] for mean in (own, other))
        at, photo, mirrored = points[place], own.colors[place], other.colors[place]
        light = np.ones((len(at), 3))
        if kind == 2 and relief is not None:
            light = _lit(at, relief.normals[place], relief.free[place], photo,
                         weight if ring is not None else weight * head[place])
            if ring is None:  # a body may be clothes, which have colors of their own
                light[~head[place]] = 1.0
            photo, mirrored = photo / light, mirrored / light
        # The light of head and body is one.
        matched = np.clip(mirrored * _light(at, mirrored, known, photo, weight, near=True),
                          0, 1 / light)
        found = _filled(at, photo, weight, matched, known)
        if kind == 0 and relief is not None:
            if relief.long:
                cosine = (own.square[place] / np.maximum(own.best[place], 1e-9)) ** (1 / LIT)
                around = _squarely(at, photo, weight * cosine, found)
                found += relief.long * (1 - known[:, None]) * (around - found)
            # A hairline's own edge, and a lock's, are as light as what is seen beside them.
            shade = _deep(at, relief.free[place])
            if (weight > 0.5).any():  # else none of it is seen well
                shade = shade ** _far(at, weight, LINE)[:, None]
            found *= known[:, None] + (1 - known[:, None]) * shade
        if ring is not None and kind == 3:
            far = _far(at, weight, CLOSE_BY)[:, None]
            along = spread_around(ring[place], photo, weight * own.square[place])
            found += far * (1 - known)[:, None] * (along - found)
        bare = head[place]
        if kind == 2 and bare.any():
            found[bare] = _filled(*(part[bare] for part in (at, photo, weight, matched, known)))
            if ring is not None and not bare.all():
                # What is bare of a body goes on from the neck.
                shown, whole = weight[bare, None], photo.copy()
                whole[bare] = shown * photo[bare] + (1 - shown) * found[bare]
                found[~bare] = _spread(at, whole, np.maximum(weight, 0.5 * bare), 0)[~bare]
        found *= light
        if kind == 2 and relief is not None:
            like = np.ones(len(at), bool) if ring is not None else bare
            hue = Hue.of(own.colors[place][like], (weight * own.square[place])[like])
            if hue is not None:
                found[like] = hue.held(found[like])
        out[place] = parts[kind][place, None] * found
        return out

    with ThreadPoolExecutor(2) as pool:
        return np.asarray(sum(pool.map(filled, range(len(parts)))))


def _squarely(points: Float64, photo: Float64, square: Float64, found: Float64) -> Float64:
    """Colors [N, 3] of what is seen squarely around: at outlines hair is mixed with its ground."""
    return _spread(points, photo, square, 0) if square.sum() > FEWEST else found


def _deep(points: Float64, free: Float64) -> Float64:
    """How dark hair is where it lies so deep between locks, factors [N, 1]."""
    smooth = _spread(points, np.log(free)[:, None], np.ones(len(points)), 0)
    return np.asarray(np.exp(DEPTHS * np.clip(smooth, np.log(DEEPEST), 0)))


def _lit(points: Float64, normals: Float64, free: Float64, photo: Float64, weight: Float64,
         ) -> Float64:
    """The light on places [N, 3] of skin, factors [N, 3], by what the photo shows so well."""
    if weight.sum() <= FEWEST:
        return np.ones_like(photo)
    # Eyelids and nostrils are smaller than what light tells of a head.
    smooth = _spread(points, np.column_stack([normals, np.log(free)]), np.ones(len(points)), 0)
    normals, free = smooth[:, :3], np.exp(smooth[:, 3])
    return Light.of(normals, free, photo, weight).at(normals, free)


def _light(points: Float64, colors: Float64, weight: Float64, others: Float64, known: Float64,
           *, near: bool = False) -> Float64:
    """What colors [N, 3] are to be multiplied with to have the light of others.

    By wide means; if ``near``, what these leave over by narrower ones, too, up to `UNEVEN`.
    """
    both = np.minimum(weight, known)
    if both.sum() <= FEWEST:
        return np.ones_like(colors)
    ratio = np.log(np.clip((others + 0.02) / (colors + 0.02), 0.3, 3.0))
    wide = _spread(points, ratio, both, 3)
    if not near:
        return np.asarray(np.exp(wide))
    # The corner of a mouth beside a cheek is no light.
    left = np.clip(ratio - wide, -UNEVEN, UNEVEN)
    return np.asarray(np.exp(wide + _spread(points, left, both, 1)))


def _nearest(depth: NDArray[np.floating]) -> Float64:
    """A depth map whose outline is a pixel wider: there a place lies behind nothing."""
    return np.asarray(np.where(np.isfinite(depth), depth, ndimage.minimum_filter(depth, 3)),
                      np.float64)


def _filled(points: Float64, photo: Float64, weight: Float64, matched: Float64,
            known: Float64) -> Float64:
    """Colors [N, 3] of places by those around them and on the other side, in their light."""
    own = MIRRORED * known * (1 - weight)
    both_weights = weight + own
    mixed = ((weight[:, None] * photo + own[:, None] * matched)
             / np.maximum(both_weights, 1e-9)[:, None])
    if both_weights.sum() < 10:
        return np.broadcast_to(photo.mean(axis=0), photo.shape).copy()
    around = _spread(points, mixed, both_weights, 0)
    # Where the other side is seen well, its detail.
    return np.asarray(known[:, None] * matched + (1 - known[:, None]) * around)


def _far(points: Float64, known: Float64, between: tuple[float, float]) -> Float64:
    """How much places [N, 3] are far from what is known, [N]: 0 to 1 between two distances."""
    place = np.rint((points - points.min(axis=0)) / CELL).astype(int).T
    unknown = np.ones(place.max(axis=1) + 1, bool)
    unknown[tuple(place[:, known > 0.5])] = False
    if unknown.all():
        return np.zeros(len(points))
    away = CELL * ndimage.distance_transform_edt(unknown)[tuple(place)]
    return np.clip((away - between[0]) / (between[1] - between[0]), 0, 1)


def _spread(points: Float64, values: Float64, weights: Float64, finest: int) -> Float64:
    """Values [N, C] everywhere: means of known ones over ever wider octaves, from ``finest`` on."""
    scaled = points * np.array([1.0, UPWARDS, 1.0]) / (CELL * 2 ** finest)
    first = scaled.min(axis=0) - 2
    place = (scaled - first).T
    size = 16 * np.ceil((place.max(axis=1) + 3) / 16).astype(int)
    flat = np.ravel_multi_index(tuple(np.rint(place).astype(int)), tuple(size))
    sums = [np.bincount(flat, weights * values[:, k], int(size.prod())).reshape(size)
            for k in range(values.shape[1])]
    grid = np.stack([*sums, np.bincount(flat, weights, int(size.prod())).reshape(size)], axis=-1)
    result = _pushed(grid)
    return np.stack([ndimage.map_coordinates(result[..., k], place, order=1, mode="nearest")
                     for k in range(values.shape[1])], axis=1)


def _pushed(grid: Float64) -> Float64:
    """Means of a lattice [x, y, z, C + 1] of sums and weights, its gaps filled from coarser."""
    weight = grid[..., -1:]
    if min(grid.shape[:3]) < 2 or any(side % 2 for side in grid.shape[:3]):
        total = grid.reshape(-1, grid.shape[-1]).sum(axis=0)
        coarse = np.broadcast_to(total[:-1] / max(total[-1], 1e-9), (*grid.shape[:3],
                                                                    grid.shape[-1] - 1))
    else:
        x, y, z, c = grid.shape
        halves = grid.reshape(x // 2, 2, y // 2, 2, z // 2, 2, c).sum(axis=(1, 3, 5))
        small = _pushed(halves)
        places = np.meshgrid(*((np.arange(side) - 0.5) / 2 for side in (x, y, z)), indexing="ij")
        coarse = np.stack([ndimage.map_coordinates(small[..., k], places, order=1, mode="nearest")
                           for k in range(c - 1)], axis=-1)
    trust = weight / (weight + 2.0)
    return np.asarray(trust * grid[..., :-1] / np.maximum(weight, 1e-9) + (1 - trust) * coarse)


def strand_contrast(colors: NDArray[np.floating], hair: Bool, pixels: float) -> Float64:
    """Standard deviations of the logarithm of hair's luminance by octaves of `WIDTHS`, [4].

    Parameters
    ----------
    colors : [H, W, 3] in [0, 1].
    hair : bool [H, W].
    pixels : Of a portrait unit.
    """
    factor = min(1.0, 4.0 / (WIDTHS[0] * pixels))
    size = tuple(max(2, round(side * factor)) for side in hair.shape[::-1])
    light = cv2.resize(np.asarray(colors, np.float32).mean(axis=2), size,
                       interpolation=cv2.INTER_AREA)
    light = np.log(light + np.float32(DARKEST))
    inside = cv2.resize(hair.astype(np.float32), size, interpolation=cv2.INTER_AREA) > 0.99
    known = inside.astype(np.float32)

    def mean(width: float) -> Float32:
        sigma = 0.3 * width * pixels * factor
        return np.asarray(cv2.GaussianBlur(light * known, (0, 0), sigma)
                          / np.maximum(cv2.GaussianBlur(known, (0, 0), sigma), 1e-3), np.float32)

    if not inside.any():
        return np.zeros(len(WIDTHS))
    means = [mean(width) for width in (*WIDTHS, 2 * WIDTHS[-1])]
    # What differs by more than most of it is no strand, but a parting or an edge.
    return np.array([min(SHARPEST, 1.5 * float(np.median(np.abs((fine - wide)[inside]))))
                     for fine, wide in itertools.pairwise(means)])


def strands(points: Float64, contrast: Float64) -> Float64:
    """Factors [N] of the brightness of places [N, 3] (portrait frame) in hair."""
    turn = np.arctan2(points[:, 0], CROWN - points[:, 2]) / (2 * np.pi) + 0.5
    out = np.zeros(len(points))
    random = np.random.default_rng(7)
    for width, strength in zip(WIDTHS, contrast, strict=True):
        # A period of noise is about two widths: a strand and the next.
        across = max(4, round(2 * np.pi * AROUND / width))
        down = (2.0 - points[:, 1]) / (LENGTH * width)
        lattice = random.standard_normal((int(4.0 / (LENGTH * width)) + 3, across))
        lattice = np.pad(lattice, ((0, 0), (2, 2)), mode="wrap")
        at = np.stack([np.clip(down, 0, len(lattice) - 1), turn * across + 2])
        out += strength * ndimage.map_coordinates(lattice, at, order=2, mode="nearest")
    return np.asarray(np.exp(out))
