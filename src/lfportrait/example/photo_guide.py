"""Position guide of a photo, from landmarks and contours, with matched outlines.

A photo has its landmarks, the rays to hairline and outline, and signed distances from the edges of
its regions. From the front the exemplar's own neck and shoulders fit below the face: a neck is made
longer. In videos, and for turned heads, neck and body are laid onto the exemplar's by their edges,
and what is person or background is held on its side of the exemplar's outline.

Rays find the outline and the hairline every 15 degrees; between them moving least squares only
guesses. So signed distances from the edge of a region are compared in both pictures, and places
near the edge move along the exemplar's distance until both agree.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from ..arrays import Float32, Float64, UInt8
from ..labels import PICTURE_LABELS
from .exemplar import Exemplar, face_size
from .frontal import SPACING, FaceAside
from .guides.filters import gaussian_blur, grey, shrunk
from .guides.position import ControlPoints, fold_inside, folded_position_guide
from .guides.regions import RAYS, Regions, missing_labels
from .kernels.guides import distances, snap
from .kernels.labels import own_body, shrink_label
from .styleblit import label_words

FAR = 250.0  # Distances are known up to so many cells.


def signed_distance(mask: Float32, cell: int = 4) -> Float32:
    """Signed distance in pixels from the edge of ``mask`` [H, W], positive inside.

    float32 [ceil(H / cell), ceil(W / cell)], at the middles of blocks of ``cell`` pixels.
    """
    small = np.ascontiguousarray(shrunk(np.ascontiguousarray(mask, np.float32), cell))
    return signed_distances(small[None], [FAR])[0] * np.float32(cell)


def signed_distances(masks: Float32, far: Sequence[float]) -> Float32:
    """Signed distances in cells from the edges of several masks [K, h, w], up to ``far`` each."""
    out = np.empty_like(masks)
    distances(masks, np.minimum(far, FAR).astype(np.float32), out)
    return out


@dataclass
class EdgeMatch:
    """The exemplar's side of the match."""

    distance: Float32  # float32 [h, w], the exemplar's signed distances, slightly smoothed.
    # reach, most: See `example.kernels.outline.snap`, in exemplar pixels.
    reach: float
    most: float
    cell: int = 4  # Side of a cell of ``distance`` in pixels.

    @staticmethod
    def of(mask: Float32, reach: float, most: float, cell: int = 4) -> EdgeMatch | None:
        """The match to the edge of ``mask`` [H, W]; None where it has none."""
        if not 0.01 < float(mask.mean()) < 0.99:
            return None
        # Unevenness finer than the strokes would tear the guide.
        return EdgeMatch(gaussian_blur(signed_distance(mask, cell), 1.0), reach, most, cell)

    def move(self, nodes: Float32, mask: Float32, grid: int, scale: float) -> None:
        """Move the guide's nodes in place.

        ``nodes`` float32 [h, w, 2] are places in exemplar pixels of every ``grid``-th target pixel,
        of which ``scale`` exemplar pixels are one; ``mask`` float32 [H, W] is the same region in
        the target.
        """
        self.pull(nodes, signed_distance(mask, grid), grid, scale)

    def far(self, grid: int, scale: float) -> float:
        """Distance in cells of ``grid`` target pixels beyond which nothing moves."""
        return 3.1 * self.reach / (scale * grid) + 4.0

    def pull(self, nodes: Float32, distance: Float32, grid: int, scale: float,
             keep: float = 0.0) -> None:
        """`move` by the target's signed distances in pixels, [ceil(H / grid), ceil(W / grid)].

        For ``keep`` see `example.kernels.outline.snap`, in exemplar pixels.
        """
        # As smooth as the exemplar's.
        sigma = max(self.cell / (scale * grid), 0.5)
        own = gaussian_blur(distance, sigma) * np.float32(scale)
        # Cells lie around the pixels (i + 0.5) * grid, nodes at i * grid + 0.5.
        rows, columns = nodes.shape[:2]
        share = np.float32(0.5 - 0.5 / grid)
        more = max(0, rows - own.shape[0]), max(0, columns - own.shape[1])
        padded = np.pad(own, ((1, more[0]), (1, more[1])), mode="edge")[:rows + 1, :columns + 1]
        along = padded[:, :-1] * share + padded[:, 1:] * (1 - share)
        wanted = np.ascontiguousarray(along[:-1] * share + along[1:] * (1 - share))
        before = nodes.copy()
        snap(nodes, wanted, self.distance, self.cell, np.float32(self.reach),
             np.float32(self.most), np.float32(keep), 4)
        for c in range(2):
            moved = np.ascontiguousarray(nodes[..., c] - before[..., c])
            nodes[..., c] = before[..., c] + gaussian_blur(moved, 1.0)


LINES = 12  # Lines across neck and body on which the edges are looked for.
BELOW = 1.02, 1.27
"""Depths below the brows (the chin is 1) between which the face gives way to the body."""

UNDER_CHIN, LOWEST_NECK = 0.015, 0.1
"""The neck's plainest strip begins so far below the chin, over the face's height."""
STRIP = 0.15  # Its height over what the exemplar shows below it.


def match_regions(landmarks: Float64, regions: Regions, style_landmarks: Float64,
                  style_regions: Regions) -> ControlPoints:
    """Control points of the position guide: landmarks, hairline and outline.

    Sources and targets [M, 2] in the target and in the exemplar, of which only points known on both
    sides count; their weights and softness [M] (`guides.mls_similarity`).
    """
    sources, targets = [landmarks], [style_landmarks]
    weights = [np.ones(68)]
    for name, weight in (("outline", 2.0), ("hairline", 1.0)):
        sources.append(getattr(regions, name)())
        targets.append(getattr(style_regions, name)())
        weights.append(np.full(len(RAYS), weight))
    source = np.concatenate(sources)
    softness = np.full(len(source), 0.05 * regions.frame.height)
    softness[:68] = 0.0
    return source, np.concatenate(targets), np.concatenate(weights), softness


def plain_neck(picture: Float32, landmarks: Float64) -> tuple[float, float]:
    """The plainest strip of an exemplar's neck: first and last row, in pixels below the chin."""
    height = float(landmarks[8, 1] - landmarks[17:27, 1].mean())
    chin, half = landmarks[8], 0.15 * height
    left, right = (int(np.clip(chin[0] + side * half, 0, picture.shape[1])) for side in (-1, 1))
    rows = np.asarray(picture[int(max(chin[1], 0)):, left:right], np.float64)
    shown = len(rows) - 2.0
    if right - left < 2 or shown < 8:
        return 0.0, max(shown, 1.0)
    change = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(rows, axis=0)).mean(axis=1))])
    # The line below the chin belongs to the face.
    least = int(min(UNDER_CHIN * height, 0.5 * shown))
    first = np.arange(least, max(int(min(LOWEST_NECK * height, 0.6 * shown)), least + 1))
    last = np.minimum(first + STRIP * (shown - first), shown).astype(np.int64)
    # The lower the strip, the sooner it cuts a collar.
    cost = (change[last] - change[first]) / np.maximum(last - first, 1) * (1 + first / height * 10)
    best = int(np.argmin(cost))
    return float(first[best]), float(last[best])


def lengthen_neck(nodes: Float32, chin: float, style_height: int,
                  neck: tuple[float, float], scale: float, grid: int) -> None:
    """Keep the target's lower border on the exemplar's where it shows more of the chest, in place.

    Else the guide would run off the exemplar's lower border. What it shows above the border moves
    as one, so that collars and shoulders stay whole; what is missing is made up for below the chin,
    where the neck is plain. Nothing changes where the exemplar shows enough.

    Parameters
    ----------
    nodes, grid, scale : As for `EdgeMatch.move`.
    chin : Row of the target's chin.
    style_height, neck : Of the exemplar, in pixels; see `plain_neck`.
    """
    below = (np.arange(nodes.shape[0]) * grid + 0.5 - chin) * scale
    beyond = np.maximum(nodes[-1, :, 1] - np.float32(style_height - 2), 0)
    longer = neck[1] - neck[0] + float(beyond.max(initial=0))
    ramp = np.clip((below - neck[0]) / max(longer, 1.0), 0.0, 1.0)
    nodes[..., 1] -= beyond * ramp[:, None].astype(np.float32)


def lay_body(nodes: Float32, grid: int, regions: Regions, style_regions: Regions) -> None:
    """Lay neck and body onto those of the exemplar, in place in ``nodes`` (`EdgeMatch.move`).

    The landmarks end at the chin, and a turned head lies beside its neck. So below the chin a place
    is matched by how far down it is, and by where it lies between the left and the right edge of
    the body; beside the body, by how far it is from the edge. Where the exemplar shows less below
    the chin than the target does, that is spread over all of it.
    """
    frame, style_frame = regions.frame, style_regions.frame
    lowest, style_lowest = regions.lowest(), style_regions.lowest()
    first, last = BELOW
    places = np.moveaxis(np.indices(nodes.shape[:2], np.float64), 0, -1)[..., ::-1] * grid + 0.5
    local = (places - frame.origin) / frame.height
    right, down = local @ frame.right, local @ frame.down
    below = down > first
    if not below.any():
        return
    right, down = right[below], down[below]
    depths = np.linspace(first, max(lowest, last), LINES)
    shrink = min(1.0, (style_lowest - first) / max(lowest - first, 1e-6))
    style_depths = first + shrink * (depths - first)
    spans, style_spans = _spans(regions, depths), _spans(style_regions, style_depths)
    left, end, style_left, style_end = (
        np.interp(down, depths, spans[:, n])
        for spans in (spans, style_spans) for n in (0, 1))
    beyond = np.maximum(right - end, 0) + np.minimum(right - left, 0)
    share = np.clip((right - left) / (end - left), 0, 1)
    across = style_left + share * (style_end - style_left) + beyond
    laid = style_frame.point(across, first + shrink * (down - first))
    blend = np.clip((down - first) / (last - first), 0, 1)
    blend = (blend * blend * (3 - 2 * blend))[:, None]
    nodes[below] += blend * (laid - nodes[below])


def _spans(regions: Regions, depths: Float64) -> Float64:
    """Left and right edge of the body at some depths, smoothed along them, [D, 2]."""
    return gaussian_filter1d(regions.spans(depths), 1.0, axis=0, mode="nearest")


EDGES = (("background", True), ("hair", False))
"""Regions whose edges are made to meet, by label: all that is not background, and the hair."""
KEEP = 8.0
"""What is further from the outline stays on its side of the exemplar's by so much, in units."""
TURNED = 0.5
"""Heads turned this much against the exemplar (`FaceFrame.turn`) hide or show other parts."""
GRID = 4  # The guide is evaluated every Nth pixel and bilinear between: it changes slowly.


class FlatGuide:
    """The map from photos to one exemplar, with its regions and labels."""

    def __init__(self, exemplar: Exemplar, regions: Regions, labels: UInt8) -> None:
        self.exemplar, self.regions = exemplar, regions
        self._words = label_words(labels)
        self._box = regions.box()
        self._neck = plain_neck(grey(exemplar.image), exemplar.landmarks)
        self._turn = regions.frame.turn(exemplar.landmarks)
        self._body = "body" not in missing_labels(labels)
        self._unit = unit = exemplar.size / 50.0
        edges = [np.float32(1) - plane if invert else plane for plane, invert in (
            (_label(labels, name), invert) for name, invert in EDGES)]
        self._edges = (EdgeMatch.of(edges[0], 8 * unit, 6 * unit),
                       EdgeMatch.of(edges[1], 4 * unit, 5 * unit))

    def turned(self, landmarks: Float64, regions: Regions) -> bool:
        """Whether a head is turned against the exemplar's."""
        return abs(regions.frame.turn(landmarks) - self._turn) > TURNED

    def __call__(self, cover: Float32, landmarks: Float64, regions: Regions,
                 labels: UInt8, hold: bool = False,
                 aside: FaceAside | None = None) -> Float32:
        """Position guide of a photo, float32 [H, W, 2]; NaN where ``cover`` [H, W] is 0.

        Parameters
        ----------
        landmarks, regions, labels : Of the photo.
        hold : Lay neck and body onto the exemplar's, and hold person and background on their sides.
        aside : What is seen of a face that is turned far to one side; ``landmarks`` are its own.
        """
        points = match_regions(landmarks, regions, self.exemplar.landmarks, self.regions)
        if aside is not None:
            points = self._seen(aside, *points)
        scale, shape = self.exemplar.size / face_size(landmarks), self.exemplar.image.shape

        def move(nodes: Float32) -> None:
            if hold and self._body:
                lay_body(nodes, GRID, regions, self.regions)
            else:
                lengthen_neck(nodes, float(landmarks[8, 1]), shape[0], self._neck, scale, GRID)
            if hold:
                fold_inside(nodes, shape, self._box, nodes)
            self._meet(nodes, labels, scale, KEEP * self._unit if hold else 0.0)

        return folded_position_guide(cover, points, shape, self._box, GRID, move)

    def _seen(self, aside: FaceAside, sources: Float64, targets: Float64, weights: Float64,
              softness: Float64) -> ControlPoints:
        """Control points with those of what is seen of a turned face, without those hidden."""
        more = aside.in_exemplar(self.exemplar.landmarks)
        weights = weights.copy()
        weights[:68][aside.hidden] *= 1 - aside.share
        kept = weights > 0
        soft = np.full(len(more), 0.5 * SPACING * aside.pose.scale)
        return (np.concatenate([sources[kept], aside.places]),
                np.concatenate([targets[kept], more]),
                np.concatenate([weights[kept], np.full(len(more), aside.share)]),
                np.concatenate([softness[kept], soft]))

    def _meet(self, nodes: Float32, labels: UInt8, scale: float, keep: float) -> None:
        """Move the guide's nodes so that outlines and hairlines meet."""
        known = [(match, edge) for match, edge in zip(self._edges, EDGES) if match is not None]
        small = np.empty((len(known), *(-(-n // GRID) for n in labels.shape[:2])), np.float32)
        for plane, (_, (name, invert)) in zip(small, known):
            shrink_label(labels, PICTURE_LABELS.index(name), invert, GRID, plane)
        away = signed_distances(small, [match.far(GRID, scale) for match, _ in known])
        for distance, (match, (name, _)) in zip(away, known):
            match.pull(nodes, distance * np.float32(GRID), GRID, scale,
                       keep if name == "background" else 0.0)

    def own_shoulders(self, position: Float32, landmarks: Float64, labels: UInt8,
                      person: Float32) -> Float32:
        """Let the exemplar's body have its own outline below the chin.

        Shoulders differ too much to be made to meet: where the photo's labels insist on a body that
        the exemplar does not have at the guided place, chunks of it stand out as ledges. The
        photo's ``labels`` are changed in place; returns another ``person`` [H, W], with the
        exemplar's body. ``position`` is the guide.
        """
        person = person.copy()
        own_body(position, self._words, max(int(landmarks[8, 1]), 0), label_words(labels), person)
        return person


def _label(labels: UInt8, name: str) -> Float32:
    """One label of [H, W, len(PICTURE_LABELS)], float32 [H, W] in [0, 1]."""
    return labels[..., PICTURE_LABELS.index(name)].astype(np.float32) * np.float32(1 / 255)
