"""A lattice on the device: bricks, densities, colors in pages, and what is remembered of each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ....arrays import Float32, Int32
from ....gpu import GpuLostError
from ....gpu.device import BINDING, Device

__all__ = ["PAGE", "DeviceLattice", "row_floats"]

PAGE = BINDING
"""Bytes of a page of colors at most."""


def row_floats(basis: int) -> int:
    """Floats of a row of colors on the device: 3 times the harmonics, in whole vectors of four."""
    return -(-3 * basis // 4) * 4


@dataclass
class DeviceLattice:
    """Buffers of a lattice of N points.

    Attributes
    ----------
    bricks
        int32: the table of bricks, then the bricks' links.
    density, states
        float32 [N + 1], and [N + 1, 2]: remembered weight of rays, mean squared slope.
    pages
        float32 [rows of the page, `row_floats`] each: colors.
    bounds
        First row of each page and behind its last.
    after, before
        int32 [N, 3], next and previous rows along x, y, z.
    heads
        uint32 [N + 1], first record of each row's chain; none outside steps.
    table
        int32 [BZ, BY, BX], the table of all bricks.
    count, basis
        N, and harmonics a channel.
    """

    bricks: Any
    density: Any
    states: Any
    pages: list[Any]
    bounds: list[tuple[int, int]]
    after: Any
    before: Any
    heads: Any
    table: Int32
    count: int
    basis: int

    @staticmethod
    def of(device: Device, given: dict[str, Any]) -> DeviceLattice:
        """Copy a lattice to the device.

        Parameters
        ----------
        device
            Where to.
        given
            ``table`` int32 [BZ, BY, BX] and ``links`` int32 [bricks * 128] as of
            `lfportrait.field.kernels.bricks.brick_table`; ``density`` float32 [N + 1]; and to
            train it ``rows`` float32 [N + 1, width], whose last two values are its states,
            ``neighbours`` int32 [N, 6] and ``basis``.

        Raises
        ------
        GpuLostError
            If a part is larger than what a shader can see.
        """
        table, links, density = given["table"], given["links"], given["density"]
        count, basis = len(density) - 1, int(given.get("basis", 1))
        if max(table.nbytes + links.nbytes, 12 * count) > BINDING:
            raise GpuLostError(f"a lattice of {count} points is too large for "
                               f"{device.adapter.title}")
        bricks = device.buffer(table.nbytes + links.nbytes)
        device.write(bricks, table)
        device.write(bricks, links, table.nbytes)
        own = DeviceLattice(bricks, device.buffer(density), None, [], [], None, None, None, table,
                            count, basis)
        if "rows" in given:
            own._fill(device, given["rows"], given["neighbours"])
        return own

    def _fill(self, device: Device, rows: Float32,
              neighbours: Int32) -> None:
        """Copy what is trained."""
        wide, columns = row_floats(self.basis), 3 * self.basis
        self.states = device.buffer(np.ascontiguousarray(rows[:, -2:]))
        together = PAGE // (4 * wide)
        for first in range(0, max(self.count, 1), together):
            last = min(self.count, first + together)
            page = np.zeros((max(1, last - first), wide), np.float32)
            page[:last - first, :columns] = rows[first:last, :columns]
            self.pages.append(device.buffer(page))
            self.bounds.append((first, last))
        self.after = device.buffer(np.ascontiguousarray(neighbours[:, :3]))
        self.before = device.buffer(np.ascontiguousarray(neighbours[:, 3:]))
        self.heads = device.buffer(np.full(self.count + 1, 0xffffffff, np.uint32))

    def write_table(self, device: Device, table: Int32) -> None:
        """Cast rays by another table of the same bricks from now on."""
        device.write(self.bricks, np.ascontiguousarray(table, np.int32))

    def read(self, device: Device, density: Any, pages: list[Any],
             ) -> tuple[Float32, list[Float32]]:
        """Densities [N + 1] and colors, page by page, of such buffers as the lattice's own."""
        wide = row_floats(self.basis)
        return (device.read(density, np.float32, self.count + 1),
                [device.read(page, np.float32, (last - first, wide))
                 for (first, last), page in zip(self.bounds, pages, strict=True)])
