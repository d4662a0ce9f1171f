"""Notes of a step: packets, blocks, samples and records, with room that grows when it is needed."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ....gpu import GpuLostError
from ....gpu.device import BINDING, Device

__all__ = ["Notes", "blocks_of_a_packet"]

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
    tiles
        Packets that there is room for.
    packet
        Words of a packet's notes.
    block_room, record_room
        Blocks and records that there is room for.
    buffers
        By the names of the shaders' bindings.
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
        device
            Where.
        tiles
            Packets of a step.
        blocks
            Most blocks of a packet (`blocks_of_a_packet`).
        block_room, record_room
            Blocks and records of a step.

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
