"""Buffers of a training on the device: the lattice, notes of a step, spheres behind the lattice.

Of the lattice: bricks, densities, colors in pages, and what is remembered of each. Notes are
packets, blocks, samples and records, with room that grows when it is needed.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ....arrays import Float32, Int32
from ....gpu import GpuLostError
from ....gpu.device import BINDING, Device

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
    bricks : int32: the table of bricks, then the bricks' links.
    density, states : float32 [N + 1], and [N + 1, 2]: remembered weight of rays, mean squared
        slope.
    pages : float32 [rows of the page, `row_floats`] each: colors.
    bounds : First row of each page and behind its last.
    after, before : int32 [N, 3], next and previous rows along x, y, z.
    heads : uint32 [N + 1], first record of each row's chain; none outside steps.
    table : int32 [BZ, BY, BX], the table of all bricks.
    count, basis : N, and harmonics a channel.
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
        device : Where to.
        given : ``table`` int32 [BZ, BY, BX] and ``links`` int32 [bricks * 128] as of
            `lfportrait.field.kernels.bricks.brick_table`; ``density`` float32 [N + 1]; and to train
            it ``rows`` float32 [N + 1, width], whose last two values are its states, ``neighbours``
            int32 [N, 6] and ``basis``.

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

    def _fill(self, device: Device, rows: Float32, neighbours: Int32) -> None:
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

    def read(self, device: Device, density: Any, pages: list[Any]) -> tuple[Float32, list[Float32]]:
        """Densities [N + 1] and colors, page by page, of such buffers as the lattice's own."""
        wide = row_floats(self.basis)
        return (device.read(density, np.float32, self.count + 1),
                [device.read(page, np.float32, (last - first, wide))
                 for (first, last), page in zip(self.bounds, pages, strict=True)])


_HEADER, _BLOCK, _LIST = 8, 20, 100
"""Words of the blocks' header, of a block, and of a packet before its list of blocks."""
_SAMPLES = 128
"""Samples of a block."""


def blocks_of_a_packet(shape: tuple[int, ...], pace: float) -> int:
    """Most blocks of a packet: its longest ray's, through a lattice of ``shape`` points."""
    longest = float(np.sqrt(sum(float(side) ** 2 for side in shape)))
    return 2 * (int(np.ceil(longest / pace / 16.0)) + 2)


@dataclass
class Notes:
    """Buffers of a step's notes (``common.wgsl`` has their layout).

    Attributes
    ----------
    tiles : Packets that there is room for.
    packet : Words of a packet's notes.
    block_room, record_room : Blocks and records that there is room for.
    buffers : By the names of the shaders' bindings.
    """

    tiles: int
    packet: int
    block_room: int
    record_room: int
    buffers: dict[str, Any] = field(default_factory=dict)

    @staticmethod
    def of(device: Device, tiles: int, blocks: int, block_room: int, record_room: int) -> Notes:
        """Make room.

        Parameters
        ----------
        device : Where.
        tiles : Packets of a step.
        blocks : Most blocks of a packet (`blocks_of_a_packet`).
        block_room, record_room : Blocks and records of a step.

        Raises
        ------
        GpuLostError
            If it would be more than a shader can see.
        """
        notes = Notes(tiles, _LIST + blocks, block_room, record_room)
        sizes = {"packets": 4 * tiles * notes.packet,
                 "blocks": 4 * (_HEADER + _BLOCK * block_room),
                 "samples": 16 * _SAMPLES * block_room, "sides": 8 * _SAMPLES * block_room,
                 "corners": 16 * _SAMPLES * block_room, "records": 16 * record_room,
                 "values": 32 * record_room, "lines": 8 * record_room}
        if max(sizes.values()) > BINDING:
            raise GpuLostError(f"{device.adapter.title} has too little memory for a step of "
                               f"{16 * tiles} rays")
        notes.buffers = {name: device.buffer(size) for name, size in sizes.items()}
        return notes

    def header(self, device: Device) -> dict[str, int]:
        """Counts: blocks and records begun, whether a step failed, steps done, most of both."""
        found = device.read(self.buffers["blocks"], np.uint32, _HEADER)
        return dict(zip(("count", "records", "failed", "done", "most_blocks", "most_records"),
                        map(int, found), strict=False))

    def clear(self, device: Device) -> None:
        """Set all counts to zero."""
        device.write(self.buffers["blocks"], np.zeros(_HEADER, np.uint32))

    def larger(self, device: Device, header: dict[str, int]) -> Notes:
        """Room for what the failed step needed, as far as it is known, and half as much again."""
        room = []
        for size, needed in ((self.block_room, header["count"]),
                             (self.record_room, header["records"])):
            room.append(max(2 * size, 3 * needed // 2) if needed > size else size)
        return Notes.of(device, self.tiles, self.packet - _LIST, *room)


@dataclass(frozen=True)
class Shells:
    """Buffers of a background (`lfportrait.field.background.Background`) that is trained.

    Attributes
    ----------
    count : Values of four numbers: places on the map times layers.
    buffers : By the names of the shaders' bindings: the map, its values, their mean squared slopes,
        and sums of slopes as integers, zero between steps.
    """

    count: int
    buffers: dict[str, Any]

    @staticmethod
    def of(device: Device, links: Int32, data: Float32, mean_square: Float32) -> Shells:
        """Copy a background to the device.

        Parameters
        ----------
        device : Where to.
        links : int32 [2 R, R].
        data, mean_square : float32 [N, layers, 4] and [N * layers, 4].

        Raises
        ------
        GpuLostError
            If it is larger than what a shader can see.
        """
        if max(links.nbytes, data.nbytes) > BINDING:
            raise GpuLostError(f"the background is too large for {device.adapter.title}")
        return Shells(data.size // 4, {
            "map": device.buffer(links), "spheres": device.buffer(data),
            "shell_squares": device.buffer(mean_square), "shell_sums": device.buffer(data.nbytes)})

    def read(self, device: Device) -> tuple[Float32, Float32]:
        """Values and mean squared slopes, float32 [N * layers, 4] each."""
        data, square = (device.read(self.buffers[name], np.float32, (self.count, 4)).copy()
                        for name in ("spheres", "shell_squares"))
        return data, square
