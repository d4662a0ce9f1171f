"""Count stains on painted heads: paint of other materials on cheek, jaw and throat; bad eyes.

    python scripts/measure_stains.py JOB... --style PAINTING [--style ...] [--sheets FOLDER]

A JOB is the folder of a finished one (``capture/``, ``field.npz``); its head is painted after each
PAINTING and looked at on its surface. Printed for each pair:

- *foreign*: the share of the bare skin, off its borders, whose paint is nearer to the colors of
  the painting's hair, clothes and ground than to those of its skin; and how many patches of it one
  notices.
- *blotches*: the same for paint that is further from the paint around it than any of the painter's
  own skin is, whatever it is made of.
- *eyes*: the contrast of white and iris in the eyes on the picture's left and right, over that of
  the painting's better eye.

With ``--sheets`` a picture of each head is written, from the front, what was counted outlined.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label
from scipy.spatial import cKDTree

from lfportrait.capture import Capture
from lfportrait.example import Exemplar, Painting, Skin, SkinPainter
from lfportrait.example.gaze import eye_contrast
from lfportrait.example.painter.picture_materials import (
    CLOTHES,
    EARS,
    GROUND,
    HAIR,
    NECK,
    SKIN,
    known_shares,
)
from lfportrait.field import VoxelField
from lfportrait.files import write_image
from lfportrait.stylize import StylizeConfig
from lfportrait.stylize.stylization import Painters

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
Bools = NDArray[np.bool_]

BORDER = 0.06
"""So near to anything but bare skin nothing is looked at; over the height from brows to chin."""
LOW, ASIDE = (0.12, 1.35), 75.0
"""Cheek, jaw and throat lie between these (brows 0, chin 1), at most so many degrees aside."""
STROKE, AROUND = 0.015, 0.12
"""Sigmas of the blurs that leave out single strokes, and that say what is around; as `BORDER`."""
COMMON = 0.01
"""A color is one of a material if so large a share of it is nearer."""
CHEEKS = 0.62
"""The painting's skin is that of its face down to here (brows 0, chin 1)."""
UNLIKE = 8.0
"""Paint (Lab) no further from the painting's skin than this is no other material's."""
ODD, LEAST_ODD = 1.3, 9.0
"""A blotch is this much further from what is around it than 99 % of the painter's skin, and so far
at least (Lab)."""
EYES = slice(36, 42), slice(42, 48)
"""Landmarks of both."""
NOTICED = 0.002
"""One notices a patch that is larger than this share of the face's bare skin."""
SMEARED, UNEVEN = 0.5, 0.45
"""Eyes with less of the painting's contrast, or that differ by more of the better one, are bad."""
EVERY = 2
"""Every so many pixels of the atlas are looked at."""
SAMPLES = 3000
"""Colors of a material that paint is compared with."""


@dataclass
class Stains:
    """What was counted on one painted head.

    Attributes
    ----------
    foreign, blotches : float in per cent of the looked-at skin.
    noticed : Patches of both that one notices.
    eyes : Contrast over the painting's better eye, picture's left eye first; NaN if it is shut.
    where : bool [H / EVERY, W / EVERY] of the atlas: what was counted.
    """

    foreign: float
    blotches: float
    noticed: int
    eyes: tuple[float, float]
    where: Bools

    @property
    def bad_eyes(self) -> int:
        """Eyes that are smeared or pale."""
        low = sum(eye < SMEARED for eye in self.eyes)
        uneven = abs(self.eyes[0] - self.eyes[1]) > UNEVEN * max(self.eyes)  # no if one is shut
        return max(low, int(uneven))


def to_lab(color: Float32) -> Float32:
    """Lab of sRGB in [0, 1], float32 [h, w, 3] or [N, 3]."""
    pixels = np.clip(np.asarray(color, np.float32), 0, 1).reshape(-1, 1, 3)
    return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_RGB2LAB).reshape(color.shape), np.float32)


def blurred(planes: Float32, inside: Bools, sigma: float) -> Float32:
    """Planes [h, w, C] blurred by what is inside alone."""
    weight = inside.astype(np.float32)
    total = np.maximum(cv2.GaussianBlur(weight, (0, 0), sigma), np.float32(1e-3))
    soft = cv2.GaussianBlur(planes * weight[..., None], (0, 0), sigma)
    return np.asarray(soft / total[..., None], np.float32)


def looked_at(skin: Skin) -> Bools:
    """Bare cheek, jaw and throat off all borders, bool [N]."""
    labels, names = skin.labels
    bare = labels[:, [names.index("skin"), names.index("neck")]].astype(int).sum(axis=1) > 128
    plane, points = skin.plane, skin.atlas.points.reshape(-1, 3)[skin.index]
    low = skin.flat[:, 1] / plane.height
    aside = np.degrees(np.abs(skin.flat[:, 0]) / plane.radius)
    out = bare & (low > LOW[0]) & (low < LOW[1]) & (aside < ASIDE) & skin.outwards
    near = cKDTree(points[~bare & skin.outwards][::3])
    chosen = np.flatnonzero(out)
    away, _ = near.query(points[chosen], distance_upper_bound=BORDER * plane.height)
    out[chosen[np.isfinite(away)]] = False
    return out


class Palette:
    """The colors of a painting by material, and how much its skin varies.

    Parameters
    ----------
    painter : Of the painting.
    """

    def __init__(self, painter: SkinPainter) -> None:
        exemplar, transfer = painter.exemplar, painter.transfer
        shares = known_shares(exemplar, transfer.regions, transfer.labels)
        lab = to_lab(np.asarray(exemplar.image / np.float32(255), np.float32))
        height = transfer.regions.frame.height
        self._trees = {}
        for name, materials in (("skin", [SKIN, NECK, EARS]), ("hair", [HAIR]),
                                ("clothes", [CLOTHES]), ("ground", [GROUND])):
            inside = shares[..., materials].sum(axis=-1) > 0.6
            if name == "skin":
                # A beard, or shade that was taken for a neck, is no skin.
                down = transfer.regions.frame.local(inside.shape)[1]
                inside &= (transfer.face > 128) & (down < CHEEKS)
            if inside.sum() < 200:
                continue
            soft = blurred(lab, inside, STROKE * height)
            if name == "skin":
                odd = np.linalg.norm(soft - blurred(lab, inside, AROUND * height), axis=-1)
                self.odd = max(LEAST_ODD, ODD * float(np.quantile(odd[inside], 0.99)))
            found = soft[inside]
            self._trees[name] = cKDTree(found[::max(1, len(found) // SAMPLES)])

    def away(self, lab: Float32, name: str) -> Float64:
        """Distance of colors [N, 3] to a material's, [N]; infinite if it is not there."""
        if name not in self._trees:
            return np.full(len(lab), np.inf)
        tree = self._trees[name]
        return np.asarray(tree.query(lab, k=[max(1, int(COMMON * tree.n))])[0][:, 0], np.float64)


def measured(painting: Painting, painter: SkinPainter, palette: Palette, part: Bools) -> Stains:
    """What one notices on a painted head; ``part`` bool [N] is what is looked at."""
    skin = painting.skin
    shape, height = skin.atlas.depth.shape, skin.plane.height * skin.pixels / EVERY
    there = np.zeros(shape, bool)
    there.reshape(-1)[skin.index[part]] = True
    there = there[::EVERY, ::EVERY]
    lab = to_lab(np.ascontiguousarray(painting.color[::EVERY // painting.step,
                                                     ::EVERY // painting.step]))
    soft = blurred(lab, there, STROKE * height)[there]
    odd = np.zeros(there.shape, bool)
    odd[there] = np.linalg.norm(
        soft - blurred(lab, there, AROUND * height)[there], axis=1) > palette.odd
    to_skin = palette.away(soft, "skin")
    to_other = np.min([palette.away(soft, name) for name in ("hair", "clothes", "ground")], axis=0)
    foreign = np.zeros(there.shape, bool)
    foreign[there] = (to_skin > to_other) & (to_skin > UNLIKE)
    either = foreign | odd
    number, _ = label(either)
    sizes = np.bincount(number.reshape(-1))[1:]
    eyes = _eyes(painting, painter)
    area = max(int(there.sum()), 1)
    return Stains(100 * foreign.sum() / area, 100 * odd.sum() / area,
                  int((sizes > NOTICED * area).sum()), eyes, either)


def _eyes(painting: Painting, painter: SkinPainter) -> tuple[float, float]:
    """Contrast of both eyes, over that of the painting's better one; NaN of those that are shut."""
    skin, given = painting.skin, painter.given
    theirs = [eye_contrast(given.image, given.landmarks[eye])
              for eye in EYES]
    # Where the front chart shows them: a landmark may lie a little off the surface.
    pixels, _ = skin.atlas.cameras[0].project(np.nan_to_num(skin.plane.landmarks))
    places = pixels[0] + skin.atlas.boxes[0, 4:]
    ours = [eye_contrast(painting.color, places[eye] / painting.step)
            if not shut else np.nan
            for eye, shut in zip(EYES, painter.exemplar.lids)]
    best = max(*theirs, 1e-3)
    return ours[0] / best, ours[1] / best


def sheet(painting: Painting, found: Stains) -> Float32:
    """The front chart, plain and with what was counted outlined, float32 [h, 2 w, 3]."""
    x0, y0, x1, y1, dx, dy = painting.skin.atlas.boxes[0].tolist()
    part = slice(y0 + dy, y1 + dy), slice(x0 + dx, x1 + dx)
    plain = painting.color[part]
    where = np.kron(found.where, np.ones((EVERY, EVERY), bool))[part].astype(np.uint8)
    edge = (cv2.dilate(where, np.ones((3, 3), np.uint8)) - where) > 0
    marked = plain.copy()
    marked[edge] = (0, 1, 0)
    return np.concatenate([plain, marked], axis=1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("jobs", type=Path, nargs="+", metavar="JOB")
    parser.add_argument("--style", action="append", required=True, metavar="PAINTING")
    parser.add_argument("--sheets", type=Path)
    given = parser.parse_args()
    exemplars = [Exemplar.load(style) for style in given.style]
    painters, config = Painters(), StylizeConfig()
    print("head, painting: foreign %, blotches %, noticed, eyes, bad eyes")
    for job in given.jobs:
        capture = Capture.load(job / "capture")
        if capture.landmarks is None:
            parser.error(f"the capture of {job} has no landmarks")
        skin = Skin.of(VoxelField.load(job / "field.npz"), capture.landmarks, capture.cameras)
        part = looked_at(skin)
        for exemplar in exemplars:
            painter = painters.of(exemplar, skin, config)
            painting = painter.paint(skin)
            found = measured(painting, painter, Palette(painter), part)
            print(f"{job.name}, {exemplar.name}: {found.foreign:.2f}, {found.blotches:.2f}, "
                  f"{found.noticed}, {found.eyes[0]:.2f} {found.eyes[1]:.2f}, {found.bad_eyes}")
            if given.sheets is not None:
                given.sheets.mkdir(parents=True, exist_ok=True)
                write_image(given.sheets / f"{job.name}-{exemplar.name}.png",
                            sheet(painting, found))


if __name__ == "__main__":
    main()
