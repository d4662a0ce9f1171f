"""Files of splats, one writer for each format.

PLY has the names that Kerbl et al. 2023 gave to its columns; SPZ, version 3 (Niantic), numbers in
few bits, one attribute after the other, deflated; SOG, version 2 (PlayCanvas), lossless WebP
pictures with a pixel for each splat, and a JSON; binary glTF the extension
``KHR_gaussian_splatting``.
"""

from __future__ import annotations

import gzip
import io
import json
import struct
import zipfile
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ...arrays import Float32, Int64, UInt8
from ...color import linear_light
from ...errors import UserError
from ...field import C0
from ...version import __version__
from ..gltf import Glb
from .cloud import Splats


def logit(opacity: Float32) -> Float32:
    """The logit of opacities [N]; finite, as 0 and 1 are moved inwards a little."""
    value = np.clip(opacity.astype(np.float64), 1e-4, 1 - 1e-4)
    return np.log(value / (1 - value)).astype(np.float32)


def to_bytes(values: NDArray[np.floating]) -> UInt8:
    """The nearest whole numbers from 0 to 255."""
    return np.asarray(np.clip(np.rint(values), 0, 255), np.uint8)


def smallest_three(turns: Float32) -> tuple[Int64, Float32]:
    """Quaternions without their largest component, which is made positive and follows from these.

    Parameters
    ----------
    turns
        float32 [N, 4].

    Returns
    -------
    largest
        int64 [N], which component that is.
    others
        float32 [N, 3], in order, within 1 / sqrt(2) of 0.
    """
    largest = np.abs(turns).argmax(axis=1)
    sign = np.sign(turns[np.arange(len(turns)), largest])
    places = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])[largest]
    return largest, np.take_along_axis(turns, places, axis=1) * sign[:, None]


NAME = "KHR_gaussian_splatting"


def write_glb(stream: BinaryIO, splats: Splats) -> None:
    """Write splats; programs without the extension show them as colored points."""
    glb = Glb([NAME])
    attributes = {"POSITION": glb.add(splats.positions, bounds=True),
                  "COLOR_0": glb.add(_fallback(splats), normalized=True),
                  f"{NAME}:ROTATION": glb.add(np.roll(splats.turns, -1, axis=1)),
                  f"{NAME}:SCALE": glb.add(splats.scales),
                  f"{NAME}:OPACITY": glb.add(splats.opacity)}
    for place in range(splats.sh.shape[2]):
        degree = int(np.sqrt(place))
        attributes[f"{NAME}:SH_DEGREE_{degree}_COEF_{place - degree ** 2}"] = glb.add(
            splats.sh[:, :, place])
    # Colors are mixed as sRGB, as the field's are.
    glb.scene["meshes"] = [{"primitives": [{
        "attributes": attributes, "mode": 0,
        "extensions": {NAME: {"kernel": "ellipse", "colorSpace": "srgb_rec709_display",
                              "sortingMethod": "cameraDistance", "projection": "perspective"}}}]}]
    glb.write(stream)


def _fallback(splats: Splats) -> np.ndarray:
    """Colors and opacities of points, linear light, uint8 [N, 4]."""
    color = linear_light(np.clip(C0 * splats.sh[:, :, 0] + 0.5, 0, 1))
    return np.rint(255 * np.column_stack([color, splats.opacity])).astype(np.uint8)


def write_ply(stream: BinaryIO, splats: Splats) -> None:
    """Write splats; opacities as logits, scales as logarithms, quaternions as (w, x, y, z)."""
    # Channel by channel: all red coefficients, all green, all blue ones.
    rest = splats.sh[:, :, 1:].reshape(len(splats), -1)
    columns = np.concatenate([
        splats.positions, splats.normals, splats.sh[:, :, 0], rest, logit(splats.opacity)[:, None],
        np.log(splats.scales), splats.turns], axis=1)
    names = ["x", "y", "z", "nx", "ny", "nz", *(f"f_dc_{n}" for n in range(3)),
             *(f"f_rest_{n}" for n in range(rest.shape[1])), "opacity",
             *(f"scale_{n}" for n in range(3)), *(f"rot_{n}" for n in range(4))]
    header = ["ply", "format binary_little_endian 1.0", f"comment lfportrait {__version__}",
              f"element vertex {len(splats)}", *(f"property float {name}" for name in names),
              "end_header"]
    stream.write(("\n".join(header) + "\n").encode())
    stream.write(columns.astype("<f4").tobytes())



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


def _along_a_curve(positions: Float32) -> Int64:
    """An order along a Z-curve (Morton), int64 [N]."""
    low, high = positions.min(axis=0), positions.max(axis=0)
    cells = ((positions - low) / max(float((high - low).max()), 1e-9) * 1023).astype(np.uint64)
    code = np.zeros(len(positions), np.uint64)
    for bit in range(10):
        for axis in range(3):
            code |= (cells[:, axis] >> np.uint64(bit) & np.uint64(1)) << np.uint64(3 * bit + axis)
    return np.argsort(code, kind="stable")


def _indexed(values: Float32) -> tuple[UInt8, list[float]]:
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


def _palette(rest: Float32, degree: int) -> tuple[dict[str, Any], dict[str, UInt8]]:
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


def _picture(pixels: UInt8) -> UInt8:
    """Rows of pixels [N, C] as a nearly square picture [H, W, C]; the last ones are repeated."""
    width = 4 * int(np.ceil(np.sqrt(len(pixels)) / 4))
    height = -(-len(pixels) // width)
    more = width * height - len(pixels)
    return np.concatenate([pixels, np.repeat(pixels[-1:], more, axis=0)]).reshape(
        height, width, -1)


def _webp(pixels: UInt8) -> bytes:
    """A lossless WebP file; also the colors of transparent pixels are kept."""
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "WEBP", lossless=True, exact=True, method=4, quality=80)
    return stream.getvalue()


def _add(archive: zipfile.ZipFile, name: str, content: bytes) -> None:
    archive.writestr(zipfile.ZipInfo(name, EPOCH), content)


COLOR = 0.15
"""Coefficients of degree 0 are multiplied by this, as colors beyond black and white occur."""
BITS = 18
"""Binary places of positions, at most: 4 millionths of a world unit."""
HALF_TURN = 511 * np.sqrt(2)
"""What a component of a quaternion is multiplied with: nine bits and a sign."""
STEPS = (2, 4)
"""Steps of the coefficients of degree 1, and of those above, in 128ths: finer than usual."""


def write_spz(stream: BinaryIO, splats: Splats) -> None:
    """Write splats.

    Raises
    ------
    UserError
        If they lie too far away for its numbers.
    """
    reach = float(np.abs(splats.positions).max())
    bits = min(BITS, int(np.floor(np.log2((2 ** 23 - 1) / max(reach, 1e-9)))))
    if bits < 0:
        raise UserError("an .spz file can't hold coordinates beyond 8 million; leave --world at "
                        "portrait")
    fixed = np.rint(splats.positions.astype(np.float64) * 2.0 ** bits).astype("<i4")
    parts = [struct.pack("<4sIIBBBB", b"NGSP", 3, len(splats), splats.degree, bits, 0, 0),
             np.ascontiguousarray(fixed[:, :, None].view(np.uint8)[:, :, :3]).tobytes(),
             to_bytes(255 * splats.opacity).tobytes(),
             to_bytes(255 * (COLOR * splats.sh[:, :, 0] + 0.5)).tobytes(),
             to_bytes(16 * (np.log(splats.scales) + 10)).tobytes(),
             _turns(splats).tobytes()]
    if splats.degree:
        step = np.full(splats.sh.shape[2] - 1, STEPS[1])
        step[:3] = STEPS[0]
        # Coefficient by coefficient, red, green and blue side by side; 128 is nothing.
        rest = np.rint(np.moveaxis(splats.sh[:, :, 1:], 2, 1) * 128 / step[:, None])
        parts.append(to_bytes(rest * step[:, None] + 128).tobytes())
    with gzip.GzipFile(fileobj=stream, mode="wb", filename="", mtime=0) as packed:
        for part in parts:
            packed.write(part)


def _turns(splats: Splats) -> np.ndarray:
    """Quaternions as uint32: which component is left out (of x, y, z, w), then three others."""
    largest, others = smallest_three(np.roll(splats.turns, -1, axis=1))
    size = np.minimum(np.rint(np.abs(others) * HALF_TURN), 511).astype("<u4")
    word = largest.astype("<u4")
    for axis in range(3):
        word = word << 10 | (others[:, axis] < 0).astype("<u4") << 9 | size[:, axis]
    return word.astype("<u4")


SPLAT_WRITERS = {".ply": write_ply, ".glb": write_glb, ".spz": write_spz, ".sog": write_sog}
"""By the file's suffix: functions (stream, splats)."""
