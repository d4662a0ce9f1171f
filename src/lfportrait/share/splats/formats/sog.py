"""SOG, version 2 (PlayCanvas): lossless WebP pictures with a pixel for each splat, and a JSON."""

from __future__ import annotations

import io
import json
import zipfile
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ....version import __version__
from ..cloud import Splats
from .numbers import smallest_three, to_bytes

__all__ = ["write_sog"]

Bytes = NDArray[np.uint8]

PALETTE = 4096
"""Sets of coefficients above degree 0 that a file holds at most."""
SAMPLE = 40_000
"""Splats from which those sets are chosen."""
EPOCH = (1980, 1, 1, 0, 0, 0)
"""The time of a zip file's members: the same splats give the same file."""


def write_sog(stream: BinaryIO, splats: Splats) -> None:
    """Write splats, in an order in which neighbours in the world are neighbours in the pictures."""
    order = _along_a_curve(splats.positions)
    # Sizes in an archive matter more than those in memory: the curve makes them a third smaller.
    positions = splats.positions[order].astype(np.float64)
    logs = np.sign(positions) * np.log1p(np.abs(positions))
    low, high = logs.min(axis=0), logs.max(axis=0)
    fixed = np.rint((logs - low) / np.maximum(high - low, 1e-9) * 65535).astype(np.uint16)
    scales, scale_book = _indexed(np.log(splats.scales[order]))
    colors, color_book = _indexed(splats.sh[order, :, 0])
    # Of w, x, y, z; bytes 252 to 255 say which is left out.
    largest, others = smallest_three(splats.turns[order])
    turns = to_bytes((others / np.sqrt(2) + 0.5) * 255)
    pictures = {
        "means_l": (fixed & 255).astype(np.uint8), "means_u": (fixed >> 8).astype(np.uint8),
        "scales": scales, "quats": np.column_stack([turns, 252 + largest.astype(np.uint8)]),
        "sh0": np.column_stack([colors, to_bytes(255 * splats.opacity[order])])}
    meta: dict[str, Any] = {
        "version": 2, "asset": {"generator": f"lfportrait {__version__}"}, "count": len(splats),
        "antialias": False,
        "means": {"mins": low.tolist(), "maxs": high.tolist(),
                  "files": ["means_l.webp", "means_u.webp"]},
        "scales": {"codebook": scale_book, "files": ["scales.webp"]},
        "quats": {"files": ["quats.webp"]},
        "sh0": {"codebook": color_book, "files": ["sh0.webp"]}}
    shapes = {name: _picture(pixels) for name, pixels in pictures.items()}
    if splats.degree:
        meta["shN"], more = _palette(splats.sh[order, :, 1:], splats.degree)
        shapes.update(more)
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED) as archive:
        _add(archive, "meta.json", json.dumps(meta, separators=(",", ":")).encode())
        for name, pixels in shapes.items():
            _add(archive, f"{name}.webp", _webp(pixels))


def _along_a_curve(positions: NDArray[np.float32]) -> NDArray[np.int64]:
    """An order along a Z-curve (Morton), int64 [N]."""
    low, high = positions.min(axis=0), positions.max(axis=0)
    cells = ((positions - low) / max(float((high - low).max()), 1e-9) * 1023).astype(np.uint64)
    code = np.zeros(len(positions), np.uint64)
    for bit in range(10):
        for axis in range(3):
            code |= (cells[:, axis] >> np.uint64(bit) & np.uint64(1)) << np.uint64(3 * bit + axis)
    return np.argsort(code, kind="stable")


def _indexed(values: NDArray[np.float32]) -> tuple[Bytes, list[float]]:
    """Values [N, 3] as indices uint8 [N, 3] into 256 numbers, chosen by Lloyd's iteration."""
    flat = np.sort(values.reshape(-1).astype(np.float64))
    # Half of the numbers where values are many, half evenly: a few odd ones are kept, too.
    book = np.sort(np.concatenate([np.quantile(flat, np.linspace(0, 1, 128)),
                                   np.linspace(flat[0], flat[-1], 128)]))
    sums = np.concatenate([[0.0], np.cumsum(flat)])
    for _ in range(12):
        edges = np.searchsorted(flat, (book[1:] + book[:-1]) / 2)
        edges = np.concatenate([[0], edges, [len(flat)]])
        count = np.diff(edges)
        mean = np.diff(sums[edges]) / np.maximum(count, 1)
        book = np.where(count > 0, mean, book)
    book = np.sort(book)
    return (np.searchsorted((book[1:] + book[:-1]) / 2, values).astype(np.uint8),
            [float(number) for number in book.astype(np.float32)])


def _palette(rest: NDArray[np.float32], degree: int) -> tuple[dict[str, Any], dict[str, Bytes]]:
    """Coefficients [N, 3, K] as a palette (k-means) and an index for each splat."""
    from scipy.cluster.vq import kmeans2
    from scipy.spatial import cKDTree

    rows = rest.reshape(len(rest), -1).astype(np.float64)
    random = np.random.default_rng(0)
    sample = rows[random.permutation(len(rows))[:SAMPLE]]
    count = min(PALETTE, len(np.unique(sample, axis=0)))
    start = np.unique(sample, axis=0)[random.permutation(count)] if count < PALETTE else sample[
        :count]
    centers, _ = kmeans2(sample, start, iter=5, minit="matrix", missing="warn")
    labels = cKDTree(centers).query(rows)[1]
    indices, book = _indexed(centers.astype(np.float32))
    # A row of the picture holds 64 sets, each one pixel a coefficient.
    width = 64 * rest.shape[2]
    pixels = np.moveaxis(indices.reshape(count, 3, -1), 1, 2).reshape(-1, 3)
    picture = np.zeros((-(-len(pixels) // width) * width, 3), np.uint8)
    picture[:len(pixels)] = pixels
    label = np.column_stack([labels & 255, labels >> 8, np.zeros_like(labels)]).astype(np.uint8)
    meta = {"count": count, "bands": degree, "codebook": book,
            "files": ["shN_centroids.webp", "shN_labels.webp"]}
    return meta, {"shN_centroids": picture.reshape(-1, width, 3), "shN_labels": _picture(label)}


def _picture(pixels: Bytes) -> Bytes:
    """Rows of pixels [N, C] as a nearly square picture [H, W, C]; the last ones are repeated."""
    width = 4 * int(np.ceil(np.sqrt(len(pixels)) / 4))
    height = -(-len(pixels) // width)
    more = width * height - len(pixels)
    return np.concatenate([pixels, np.repeat(pixels[-1:], more, axis=0)]).reshape(
        height, width, -1)


def _webp(pixels: Bytes) -> bytes:
    """A lossless WebP file; also the colors of transparent pixels are kept."""
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "WEBP", lossless=True, exact=True, method=4, quality=80)
    return stream.getvalue()


def _add(archive: zipfile.ZipFile, name: str, content: bytes) -> None:
    archive.writestr(zipfile.ZipInfo(name, EPOCH), content)
