"""Warm-up: a tiny painting, to compile the kernels."""

from __future__ import annotations

import numpy as np

from ...labels import MATERIALS
from ..kernels.atlas import exchange, sample_nodes
from ..kernels.labels import largest_share, move_into
from ..kernels.patches import ACTIVE, OUTSIDE
from ..kernels.seeds import nearest_sites
from ..patches import PatchSearch, PatchSource, PatchTarget, synthesise_patches
from ..surface_guide import Sites
from .sitter import Canvas, Skin

__all__ = ["rehearse_painting"]


def rehearse_painting(skin: Skin) -> None:
    """Lay a few patches of the photo on the photo: all kernels of a painting but the face's."""
    canvas = Canvas.of(skin, 2)
    flat = np.stack([skin.index % 32, skin.index // 32 % 32], axis=1).astype(np.float32)
    nodes = np.zeros((2, 2, 3), np.float32)
    sample_nodes(nodes, np.zeros(2), 1.0, flat, np.empty((len(flat), 3), np.float32))
    number = np.empty(len(flat), np.int32)
    sites = Sites.around(flat, 8.0)
    nearest_sites(flat, np.float32(8.0), sites.first, sites.points, number)
    material = np.empty(len(flat), np.int64)
    largest_share(np.zeros((len(flat), len(MATERIALS)), np.float32), material)
    move_into(flat, material, np.zeros((len(MATERIALS), 48, 48), np.int32), np.empty_like(flat))
    places = canvas.spread(flat)
    guides = canvas.spread(np.repeat(skin.tone[:, None], 4, axis=1))
    source = PatchSource.of(np.zeros((48, 48, 3), np.float32), np.zeros((48, 48, 4), np.float32))
    state = np.where(canvas.own, ACTIVE, OUTSIDE).astype(np.uint8)
    weight = canvas.spread(skin.seen[:, None])[..., 0]
    trust = np.stack([weight, weight], axis=-1)
    color = np.zeros((*state.shape, 3), np.float32)
    exchange(canvas.owner, color)
    synthesise_patches(PatchTarget(guides, places, places, places, weight, 9.0, None, trust, state,
                                   canvas.owner, color), source,
                       PatchSearch(levels=2, votes=1, passes=1))
