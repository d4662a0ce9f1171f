"""A mesh of a field, unwrapped onto one picture that shows what the field shows there.

The picture is the atlas of a skin: views of the head from far away, side by side
(`lfportrait.example.draw_atlas`). A face belongs to the chart that shows its middle; where charts
meet, corners are doubled. What no chart sees (behind an ear, in a fold) gets small pieces of
picture of its own below the charts, with the colors of the face's corners.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ...errors import UserError
from ...example import Atlas, draw_atlas
from ...field import Mesh, VoxelField

__all__ = ["TexturedMesh", "bake_texture"]

Float = NDArray[np.float32]

FINER = 1.5
"""Pixels of the picture per texel of a painted field: looking up between pixels blurs a little."""
PLAIN = 1.5
"""Pixels of the picture per lattice point, where the field has no texture."""
LARGEST = 4096
"""Side of the picture at most: what phones show."""
NEAR = 4.0
"""Lattice spacings that a face may lie before a chart's surface or under it."""
PIECE = 4
"""Side in pixels of the piece of a face that no chart shows; its corners lie one pixel inside."""


@dataclass(frozen=True)
class TexturedMesh:
    """A mesh of V corners with a picture on it.

    Attributes
    ----------
    vertices, normals
        float32 [V, 3].
    places
        float32 [V, 2], where in the picture, 0 to 1; x to the right, y down.
    faces
        int32 [F, 3], counter-clockwise from outside.
    picture
        uint8 [H, W, 3], sRGB.
    """

    vertices: Float
    normals: Float
    places: Float
    faces: NDArray[np.int32]
    picture: NDArray[np.uint8]


def bake_texture(field: VoxelField, mesh: Mesh) -> TexturedMesh:
    """Unwrap a mesh of a field and paint its picture.

    Parameters
    ----------
    field
        In the portrait frame.
    mesh
        Of the field (`lfportrait.field.field_mesh`), with less than 5 million faces.
    """
    atlas = _atlas(field)
    chart = _charts(field, atlas, mesh)
    places = _places(atlas, mesh.vertices)
    fits = _inside(atlas, chart, places, mesh.faces)
    chart = np.where(fits, chart, -1)
    picture = _filled(atlas)
    seen, faces = np.flatnonzero(chart >= 0), mesh.faces
    # A corner of each chart that it is used in.
    keys = faces[seen].astype(np.int64) + len(mesh.vertices) * chart[seen, None]
    used, corners = np.unique(keys, return_inverse=True)
    origin = used % len(mesh.vertices)
    at = places[used // len(mesh.vertices), origin]
    hidden = faces[chart < 0]
    pieces, more = _pieces(mesh.colors[hidden], picture.shape[1])
    more[..., 1] += picture.shape[0]
    picture = np.concatenate([picture, pieces])
    origin = np.concatenate([origin, hidden.reshape(-1)])
    at = np.concatenate([at, more.reshape(-1, 2)])
    joined = np.empty(faces.shape, np.int32)
    joined[chart >= 0] = corners.reshape(-1, 3)
    joined[chart < 0] = len(used) + np.arange(hidden.size).reshape(-1, 3)
    size = np.array(picture.shape[1::-1])
    return TexturedMesh(mesh.vertices[origin], mesh.normals[origin],
                        (at / size).astype(np.float32), joined, picture)


def _atlas(field: VoxelField) -> Atlas:
    """The charts, as fine as the field's painting, unless the picture gets too large."""
    pixels = (PLAIN / float(field.spacing.mean()) if field.texture is None
              else FINER * field.texture.pixels)
    for _ in range(8):
        atlas = draw_atlas(field, pixels)
        # Room is left for the pieces.
        largest = max(atlas.depth.shape[1] / LARGEST, atlas.depth.shape[0] / (0.9 * LARGEST))
        if largest <= 1:
            return atlas
        pixels *= 0.98 / largest
    raise UserError("the field is too long and thin for a texture; export it with --texture no")


def _charts(field: VoxelField, atlas: Atlas, mesh: Mesh) -> NDArray[np.int64]:
    """The chart that shows each face's middle, int64 [F]; -1 where none does."""
    middles = mesh.vertices[mesh.faces].mean(axis=1)
    near = NEAR * float(field.spacing.max())
    places, _ = atlas.locate(middles, near, near)
    chart = np.full(len(middles), -1, np.int64)
    for number, (x0, y0, x1, y1, dx, dy) in enumerate(atlas.boxes.tolist()):
        x, y = places.T - np.array([[dx], [dy]])
        chart[(x >= x0) & (x < x1) & (y >= y0) & (y < y1)] = number
    return chart


def _places(atlas: Atlas, vertices: Float) -> NDArray[np.float64]:
    """Where each chart shows each corner, float64 [C, V, 2], in pixels of the atlas."""
    return atlas.cameras.project(vertices.astype(np.float64))[0] + atlas.boxes[:, None, 4:]


def _inside(atlas: Atlas, chart: NDArray[np.int64], places: NDArray[np.float64],
            faces: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Faces whose corners lie within their chart, and that it shows from outside, bool [F]."""
    corners = places[np.maximum(chart, 0)[:, None], faces]
    x0, y0, x1, y1, dx, dy = atlas.boxes[np.maximum(chart, 0)].T[:, :, None]
    x, y = corners[..., 0] - dx, corners[..., 1] - dy
    within = ((x >= x0 + 1) & (x <= x1 - 1) & (y >= y0 + 1) & (y <= y1 - 1)).all(axis=1)
    side, other = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    # Rows run down: what is counter-clockwise in the world turns the other way here.
    facing = side[:, 0] * other[:, 1] - side[:, 1] * other[:, 0] < 0
    return np.asarray((chart >= 0) & within & facing)


def _filled(atlas: Atlas) -> NDArray[np.uint8]:
    """The charts' colors, and beside the surface those of the nearest pixel on it."""
    color = (np.clip(atlas.color, 0, 1) * 255 + 0.5).astype(np.uint8)
    empty = ~np.isfinite(atlas.depth)
    # What lies on the rim is mixed with what is behind: it takes its neighbour's color, too.
    rim = cv2.dilate(empty.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)
    known = ~rim if not rim.all() else ~empty
    _, labels = cv2.distanceTransformWithLabels(
        (~known).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL)
    nearest = np.zeros(int(labels.max()) + 1, np.int64)
    nearest[labels[known]] = np.flatnonzero(known)
    return np.asarray(color.reshape(-1, 3)[nearest[labels]], np.uint8)


def _pieces(colors: NDArray[np.uint8], width: int) -> tuple[NDArray[np.uint8], Float]:
    """Pieces of picture for faces that no chart shows.

    Parameters
    ----------
    colors
        uint8 [K, 3, 3], of their corners.
    width
        Of the picture.

    Returns
    -------
    picture
        uint8 [H, width, 3].
    places
        float32 [K, 3, 2], the corners' places in it.
    """
    across = width // PIECE
    number = np.arange(len(colors))
    left, top = number % across * PIECE, number // across * PIECE
    rows = -(-len(colors) // across)
    first, right, below = (colors[:, n].astype(np.int64) for n in range(3))
    square = np.stack([first, right, below, np.clip(right + below - first, 0, 255)], axis=1)
    # Two by two pixels between which colors run evenly, and a rim of the same.
    inner = square.reshape(-1, 2, 2, 3)
    block = inner.repeat(2, axis=1).repeat(2, axis=2).astype(np.uint8)
    blocks = np.zeros((rows * across, PIECE, PIECE, 3), np.uint8)
    blocks[:len(colors)] = block
    picture = blocks.reshape(rows, across, PIECE, PIECE, 3).swapaxes(1, 2).reshape(
        rows * PIECE, across * PIECE, 3)
    picture = np.pad(picture, [(0, 0), (0, width - across * PIECE), (0, 0)])
    corners = np.array([[1.5, 1.5], [2.5, 1.5], [1.5, 2.5]])
    places = np.stack([left, top], axis=1)[:, None] + corners
    return picture, places.astype(np.float32)
