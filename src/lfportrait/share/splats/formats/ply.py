"""PLY of splats, with the names that Kerbl et al. 2023 gave to its columns."""

from __future__ import annotations

from typing import BinaryIO

import numpy as np

from ....version import __version__
from ..cloud import Splats
from .numbers import logit

__all__ = ["write_ply"]


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
