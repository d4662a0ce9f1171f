"""Training on a GPU: the steps of `lfportrait.field.training` as compute shaders.

A step casts a batch of packets, 16 rays each, forward and backward, and takes up what they found.
Nothing is added by floating-point atomics, and the result does not depend on the order in which
the GPU works: as on the CPU, packets leave *records*, one a lattice point, and each row takes up
its records one after the other, in the order of the CPU's threads.

===================  =======================================================  ================
Kernel               Work                                                     One thread for
===================  =======================================================  ================
``march``            densities along the rays; notes *blocks* of 16 x 8       a sample
                     samples with something visible
``shells_forward``   colors of spheres behind the lattice, for a room         a ray
``points``           lattice points of each block, each once: its records     a sample
``color``            color of each record for its packet's direction          a record
``blend``            color of each sample                                     a sample
``composite``        rays' colors, errors, and slopes of all samples          a sample
``gather``           slopes of each record from the samples around it         a record
``settle``           densities (RMSProp), weights of colors (SART), in order  a row with records
``paint``            colors                                                   a coefficient
``vary``,            total variation of the density on a run of rows          a row
``smooth_run``
``vary_colors``,     the same of the colors, for a room                       a coefficient
``smooth_colors``
``bright``,          the table of bricks with visible density, every 400      a brick
``along_x``, ...     steps
``shells_backward``  slopes of the spheres, as sums of integers               a ray
``shells_step``      the spheres (RMSProp)                                    a value
===================  =======================================================  ================

A step takes as long as its kernels take to begin and to wait for memory, one after the other
(docs/gpu.md).

Buffers of the lattice hold bricks, densities, colors in pages, each within what a shader can see,
and what is remembered of each. Notes of a step are packets, blocks, samples and records, with room
for what steps need as a rule; a step that needs more, and all that were sent off behind it, do
nothing, and are taken once more with more room.

The functions at the end are what the training process asks of the device's process, by name
(`lfportrait.gpu.GpuProcess`).
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from typing import Any

import numpy as np

from ....arrays import Array, Bool, Float32, Int32, UInt32
from ....gpu import BINDING, Device, GpuLostError, Kernel

PAGE = BINDING  # Bytes of a page of colors at most.


def row_floats(basis: int) -> int:
    """Floats of a row of colors on the device: 3 times the harmonics, in whole vectors of four."""
    return -(-3 * basis // 4) * 4


@dataclass
class DeviceLattice:
    """Buffers of a lattice of N points."""

    bricks: Any  # int32: the table of bricks, then the bricks' links.
    # density, states: float32 [N + 1], and [N + 1, 2]: remembered weight of rays, mean squared
    # slope.
    density: Any
    states: Any
    pages: list[Any]  # float32 [rows of the page, `row_floats`] each: colors.
    bounds: list[tuple[int, int]]  # First row of each page and behind its last.
    # after, before: int32 [N, 3], next and previous rows along x, y, z.
    after: Any
    before: Any
    heads: Any  # uint32 [N + 1], first record of each row's chain; none outside steps.
    table: Int32  # int32 [BZ, BY, BX], the table of all bricks.
    # count, basis: N, and harmonics a channel.
    count: int
    basis: int

    @staticmethod
    def of(device: Device, given: dict[str, Any]) -> DeviceLattice:
        """Copy a lattice to the device: ``table``, ``links``, ``density`` and, to train it, more.

        ``table`` int32 [BZ, BY, BX] and ``links`` int32 [bricks * 128] are as of
        `lfportrait.field.kernels.bricks.brick_table`, ``density`` float32 [N + 1]; to be trained
        ``rows`` are float32 [N + 1, width], whose last two values are its states, ``neighbours``
        int32 [N, 6], and there is ``basis``. Raises `GpuLostError` if a part is larger than what a
        shader can see.
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

    def read(self, device: Device, density: Any, pages: list[Any]) -> tuple[Float32, list[Float32]]:
        """Densities [N + 1] and colors, page by page, of such buffers as the lattice's own."""
        wide = row_floats(self.basis)
        return (device.read(density, np.float32, self.count + 1),
                [device.read(page, np.float32, (last - first, wide))
                 for (first, last), page in zip(self.bounds, pages, strict=True)])


_HEADER, _BLOCK, _LIST = 8, 20, 100
"""Words of the blocks' header, of a block, and of a packet before its list of blocks."""
_SAMPLES = 128  # Samples of a block.


def blocks_of_a_packet(shape: tuple[int, ...], pace: float) -> int:
    """Most blocks of a packet: its longest ray's, through a lattice of ``shape`` points."""
    longest = float(np.sqrt(sum(float(side) ** 2 for side in shape)))
    return 2 * (int(np.ceil(longest / pace / 16.0)) + 2)


@dataclass
class Notes:
    """Buffers of a step's notes (``common.wgsl`` has their layout)."""

    tiles: int  # Packets that there is room for.
    packet: int  # Words of a packet's notes.
    # block_room, record_room: Blocks and records that there is room for.
    block_room: int
    record_room: int
    buffers: dict[str, Any] = field(default_factory=dict)  # By the names of the shaders' bindings.

    @staticmethod
    def of(device: Device, tiles: int, blocks: int, block_room: int, record_room: int) -> Notes:
        """Room for ``tiles`` packets of so many blocks, and the blocks and records of a step.

        Raises `GpuLostError` if it would be more than a shader can see.
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

    def filled(self, steps: Array, lattice: DeviceLattice, shape: Sequence[int]) -> Array:
        """Steps with what only the device's side knows: sizes, room, and where things are."""
        steps = steps.copy()
        steps["size"], steps["bricks"] = shape[::-1], lattice.table.shape[::-1]
        steps["tiles"], steps["links"] = self.tiles, lattice.table.size
        steps["share"] = 1.0 / (16.0 * self.tiles)
        steps["input"] = 20 * self.tiles * np.arange(len(steps))
        steps["output"] = self.tiles * np.arange(len(steps))
        steps["packet"], steps["empty"] = self.packet, lattice.count
        steps["block_room"], steps["record_room"] = self.block_room, self.record_room
        steps["basis"], steps["row"] = lattice.basis, row_floats(lattice.basis)
        return steps

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
    """Buffers of a background (`lfportrait.field.background.Background`) that is trained."""

    count: int  # Values of four numbers: places on the map times layers.
    # By the names of the shaders' bindings: the map, its values, their mean squared slopes, and
    # sums of slopes as integers, zero between steps.
    buffers: dict[str, Any]

    @staticmethod
    def of(device: Device, links: Int32, data: Float32, mean_square: Float32) -> Shells:
        """Copy a background to the device.

        ``links`` int32 [2 R, R], ``data`` float32 [N, layers, 4], ``mean_square`` [N * layers, 4].
        Raises `GpuLostError` if it is larger than what a shader can see.
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


BINDINGS: dict[str, tuple[str, tuple[str, ...]]] = {
    "march": ("march", ("step", "bricks", "density", "cameras", "inputs", "packets", "blocks",
                        "samples")),
    "points": ("points", ("step", "bricks", "packets", "blocks", "samples", "corners", "records")),
    "color": ("color", ("step", "rows", "records", "packets", "blocks", "values", "page")),
    "blend": ("blend", ("step", "packets", "blocks", "samples", "corners", "values")),
    "composite": ("composite", ("step", "packets", "blocks", "samples", "sides", "cameras",
                                "inputs", "errors", "grounds")),
    "gather": ("gather", ("step", "packets", "blocks", "samples", "sides", "records", "values",
                          "heads")),
    "settle": ("settle", ("step", "density", "states", "heads", "records", "values", "lines",
                          "blocks")),
    "paint": ("paint", ("step", "rows", "records", "values", "lines", "packets", "blocks",
                        "page")),
    "vary": ("variation", ("step", "density", "", "after", "before", "slopes", "blocks")),
    "smooth_run": ("variation", ("step", "density", "states", "", "", "slopes", "blocks")),
    "vary_colors": ("colors", ("step", "rows", "rows_before", "rows_behind", "after", "before",
                               "color_slopes", "blocks", "page")),
    "smooth_colors": ("colors", ("step", "", "", "", "", "", "color_slopes", "blocks", "page",
                                 "rows", "states")),
    "shells_forward": ("shells", ("step", "packets", "blocks", "map", "spheres", "grounds")),
    "shells_backward": ("shells", ("step", "packets", "blocks", "map", "spheres", "grounds",
                                   "shell_sums")),
    "shells_step": ("shells", ("step", "", "blocks", "", "spheres", "", "shell_sums",
                               "shell_squares")),
    "largest": ("largest", ("step", "bricks", "packets", "blocks", "samples", "most")),
    "next_band": ("largest", ("", "", "", "blocks")),
    "bright": ("table", ("step", "bricks", "density", "whole", "near", "", "blocks")),
    "along_x": ("table", ("step", "", "", "", "near", "nearer", "blocks")),
    "along_y": ("table", ("step", "", "", "", "near", "nearer", "blocks")),
    "along_z": ("table", ("step", "bricks", "", "whole", "near", "nearer", "blocks")),
    "add": ("sums", ("", "given", "sums", "blocks")),
}
"""Of each entry point: its file, and the names of its bindings in their order ("": none)."""

STEP = np.dtype([
    ("size", "<u4", 3), ("tiles", "<u4"), ("bricks", "<u4", 3), ("links", "<u4"),
    ("pace", "<f4"), ("threshold", "<f4"), ("stop", "<f4"), ("near", "<f4"),
    ("alpha_weight", "<f4"), ("narrow", "<f4"), ("share", "<f4"),
    ("rate", "<f4"), ("decay", "<f4"), ("lowest", "<f4"), ("memory", "<f4"),
    ("tv_weight", "<f4"), ("tv_scale", "<f4"), ("tv_first", "<u4"), ("tv_last", "<u4"),
    ("input", "<u4"), ("output", "<u4"), ("packet", "<u4"), ("empty", "<u4"),
    ("block_room", "<u4"), ("record_room", "<u4"), ("workers", "<u4"), ("basis", "<u4"),
    ("row", "<u4"), ("gain", "<f4"), ("layers", "<u4"), ("tv_color", "<f4"), ("high", "<u4"),
    ("grey", "<f4"), ("rate_shell", "<f4"), ("rate_shell_density", "<f4"), ("", "V100")])
"""The uniform ``Step`` of ``common.wgsl``, in slots of 256 bytes."""


@functools.cache
def source(file: str) -> str:
    """The text of a shader, with what all have in common."""
    folder = resources.files(__package__)
    return "\n".join((folder / f"{name}.wgsl").read_text(encoding="utf-8")
                     for name in ("common", file))


SLOTS = 64  # Steps that are sent off together.
_SUBMITTED = 8
"""Steps a submission: the device works on the first while the others are written down."""
_PAGED = ("color", "paint", "vary_colors", "smooth_colors")
"""Kernels that are run for each page of colors."""
_BAND = 512  # Packets whose largest weights are found in one dispatch.

Dispatch = tuple[Kernel, Any, tuple[int, int, int]]


def _bound(device: Device, entry: str, resources: Mapping[str, Any]) -> tuple[Kernel, Any]:
    """A kernel and what it is bound to, by the names of its bindings."""
    file, names = BINDINGS[entry]
    kernel = device.kernel(source(file), entry)
    return kernel, device.bind(kernel, {number: resources[name]
                                        for number, name in enumerate(names) if name})


def _grid(count: int, size: int) -> tuple[int, int, int]:
    """Workgroups for ``count`` threads, in two dimensions where one is too short."""
    groups = max(1, -(-count // size))
    across = min(groups, 32768)
    return across, -(-groups // across), 1


class Steps:
    """A level's training on the device.

    Parameters
    ----------
    device : Where.
    given : What `DeviceLattice.of` takes to train it, and ``shape`` (lattice points along z, y,
        x), ``cameras`` float32 [V, 32], ``tiles`` (packets a step) and ``run`` (rows of total
        variation a step), ``smooths_colors`` (whether that of colors is wanted), ``pace``
        (distance between samples), ``shells`` (what `Shells.of` takes of spheres behind the
        lattice, if there are any).
    """

    def __init__(self, device: Device, given: dict[str, Any]) -> None:
        self.device = device
        self.lattice = DeviceLattice.of(device, given)
        self.shape, self.tiles, self.run = given["shape"], int(given["tiles"]), int(given["run"])
        most = blocks_of_a_packet(self.shape, float(given["pace"]))
        room = max(512, 6 * self.tiles)
        self.notes = Notes.of(device, self.tiles, most, room, 192 * room)
        self.uniform = device.buffer(STEP.itemsize * SLOTS, uniform=True)
        self.buffers = {
            "cameras": device.buffer(given["cameras"]),
            "inputs": device.buffer(4 * 20 * self.tiles * SLOTS),
            "errors": device.buffer(4 * self.tiles * SLOTS),
            "slopes": device.buffer(4 * self.run), "grounds": device.buffer(512 * self.tiles)}
        if given.get("smooths_colors"):
            self.buffers["color_slopes"] = device.buffer(128 * self.run)
        before = 0
        self.page_bounds = []
        for first, last in self.lattice.bounds:
            self.page_bounds.append(device.buffer(np.array([first, last, before, 0], np.uint32),
                                                  uniform=True))
            before = first
        self.shells = (Shells.of(device, **given["shells"]) if given.get("shells") is not None
                       else None)
        self.smooths_colors = bool(given.get("smooths_colors"))
        self.sums: list[Any] = []
        self.slots: list[list[Dispatch]] = []
        # Groups that share the blocks and records; enough to fill a card, few for software.
        self.groups = 1024 if device.adapter.real else 48

    # -- what runs --------------------------------------------------------------------------------

    def _slot(self, number: int) -> list[Dispatch]:
        """The kernels of the step in one slot of the uniforms."""
        lattice = self.lattice
        resources: dict[str, Any] = {
            **self.buffers, **self.notes.buffers, "bricks": lattice.bricks,
            "density": lattice.density, "states": lattice.states, "heads": lattice.heads,
            "after": lattice.after, "before": lattice.before,
            "step": (self.uniform, STEP.itemsize * number, STEP.itemsize)}
        device, groups = self.device, (self.groups, 1, 1)
        sizes = {"march": (self.tiles, 1, 1), "composite": (self.tiles, 1, 1),
                 "vary": _grid(self.run, 64), "smooth_run": _grid(self.run, 64),
                 "vary_colors": _grid(32 * self.run, 256),
                 "smooth_colors": _grid(32 * self.run, 256),
                 "shells_forward": _grid(16 * self.tiles, 64),
                 "shells_backward": _grid(16 * self.tiles, 64)}
        if self.shells is not None:
            resources |= self.shells.buffers
            sizes["shells_step"] = _grid(self.shells.count, 256)
        pages = {name: iter(self._pages()) for name in _PAGED}
        return [(*_bound(device, name, {**resources, **next(pages[name], {})} if name in pages
                         else resources), sizes.get(name, groups)) for name in self.names()]

    def _pages(self) -> list[dict[str, Any]]:
        """What is bound for each page of colors: it, the pages beside it, its bounds."""
        pages, last = self.lattice.pages, len(self.lattice.pages) - 1
        return [{"rows": page, "rows_before": pages[max(0, number - 1)],
                 "rows_behind": pages[min(last, number + 1)], "page": self.page_bounds[number]}
                for number, page in enumerate(pages)]

    def dispatches(self, number: int) -> list[Dispatch]:
        """The same, bound once."""
        while len(self.slots) <= number:
            self.slots.append(self._slot(len(self.slots)))
        return self.slots[number]

    def take(self, steps: Array, inputs: UInt32, averaged: Bool, looks: Bool) -> Float32:
        """Take some steps.

        Parameters
        ----------
        steps : `STEP` [K], at most `SLOTS`.
        inputs : uint32 [K, T, 20], tiles: view, row, column, grey as a float32's bits, 16
            pixels.
        averaged : bool [K], whether the state after a step counts for the average.
        looks : bool [K], whether it is looked for bright bricks before a step: rays leap over
            others from then on.

        Returns
        -------
        errors : float32 [K, T], squared errors of the tiles.
        """
        device, done = self.device, 0
        device.write(self.buffers["inputs"], inputs)
        while True:
            device.write(self.uniform, self.notes.filled(steps, self.lattice, self.shape))
            self.notes.clear(device)
            self._send(averaged, looks, done)
            header = self.notes.header(device)
            done += header["done"]
            if not header["failed"]:
                break
            # All steps from the failed one on did nothing.
            self.notes = self.notes.larger(device, header)
            self.slots = []
        return device.read(self.buffers["errors"], np.float32, (len(steps), self.tiles)).copy()

    def _send(self, averaged: Bool, looks: Bool, done: int) -> None:
        """Send off the steps from the first that is not ``done`` on."""
        waiting: list[Dispatch] = []
        for number in range(done, len(averaged)):
            if looks[number]:
                waiting += self._looked(number)
            waiting += self.dispatches(number)
            if averaged[number]:
                waiting += self._added()
            if (number - done) % _SUBMITTED == _SUBMITTED - 1:
                self.device.run(*waiting)
                waiting = []
        if waiting:
            self.device.run(*waiting)

    def _make_sums(self) -> list[Any]:
        """Sums of the lattice's density and pages, zero at first; what they are the sums of."""
        given = [self.lattice.density, *self.lattice.pages]
        if not self.sums:
            self.sums = [self.device.buffer(buffer.size) for buffer in given]
        return given

    def put_average(self, density: Float32, rows: Float32) -> None:
        """Go on with sums [N + 1] of densities and [N + 1, 3 B] of colors."""
        self._make_sums()
        self.device.write(self.sums[0], density)
        for (first, last), sums in zip(self.lattice.bounds, self.sums[1:], strict=True):
            page = np.zeros((last - first, row_floats(self.lattice.basis)), np.float32)
            page[:, :rows.shape[1]] = rows[first:last]
            self.device.write(sums, page)

    def _added(self) -> list[Dispatch]:
        """Kernels that add the lattice's state to the sums."""
        given = self._make_sums()
        return [(*_bound(self.device, "add", {"given": buffer, "sums": sums,
                                              "blocks": self.notes.buffers["blocks"]}),
                 _grid(buffer.size // 4, 256))
                for buffer, sums in zip(given, self.sums, strict=True)]

    def _looked(self, number: int) -> list[Dispatch]:
        """Kernels that find the table of bright bricks by the step in a slot."""
        lattice, cells = self.lattice, self.lattice.table.size
        if "whole" not in self.buffers:
            self.buffers |= {"whole": self.device.buffer(lattice.table),
                             "near": self.device.buffer(4 * cells),
                             "nearer": self.device.buffer(4 * cells)}
        resources = {**self.buffers, "bricks": lattice.bricks, "density": lattice.density,
                     "blocks": self.notes.buffers["blocks"],
                     "step": (self.uniform, STEP.itemsize * number, STEP.itemsize)}
        return [(*_bound(self.device, name, resources), _grid(cells, 64))
                for name in ("bright", "along_x", "along_y", "along_z")]

    # -- what else is asked for -------------------------------------------------------------------

    def place(self, cameras: Float32) -> None:
        """Cast the rays from other cameras, float32 [V, 32], from now on."""
        self.device.write(self.buffers["cameras"], cameras)

    def fetch_table(self) -> Int32:
        """The table of bricks that rays are cast by, int32 [BZ, BY, BX]."""
        whole = self.lattice.table
        return self.device.read(self.lattice.bricks, np.int32, whole.shape).copy()

    def fetch(self, sums: bool = False) -> tuple[Float32, list[Float32], Float32 | None]:
        """Densities [N + 1], pages of colors [rows, `row_floats`], states [N + 1, 2].

        Or the sums of the average, without states.
        """
        lattice = self.lattice
        if sums:
            return *lattice.read(self.device, self.sums[0], self.sums[1:]), None
        return (*lattice.read(self.device, lattice.density, lattice.pages),
                self.device.read(lattice.states, np.float32, (lattice.count + 1, 2)))

    def fetch_shells(self) -> tuple[Float32, Float32]:
        """Values of the spheres behind the lattice, and mean squared slopes (`Shells.read`)."""
        assert self.shells is not None
        return self.shells.read(self.device)

    def measure(self, steps: Array, inputs: UInt32, repeats: int) -> dict[str, Any]:
        """Time what a step's kernels take, each run so often; the lattice is of no use afterwards.

        Of one step, as for `take`: ``seconds``, ``kernels`` (name and seconds of each, in their
        order), ``blocks``, ``records`` and visible ``samples``.
        """
        # Once, for room and for compiled kernels.
        self.take(steps[:1], inputs[:1], np.zeros(1, bool), np.ones(1, bool))
        device, names = self.device, [*self.names()]
        device.write(self.uniform, self.notes.filled(steps[:1], self.lattice, self.shape))
        dispatches, spent = self.dispatches(0), []
        # From the whole step down: what comes after a kernel puts right what it leaves behind.
        for count in range(len(dispatches), 0, -1):
            device.wait()
            start = time.perf_counter()
            for _ in range(repeats):
                self.notes.clear(device)
                device.run(*dispatches[:count])
            device.wait()
            spent.append((time.perf_counter() - start) / repeats)
            if count == len(dispatches):
                header = self.notes.header(device)
                visible = device.read(self.notes.buffers["sides"], np.float32,
                                      (header["most_blocks"], 128, 2))[..., 1]
        spent.append(0.0)
        return {"seconds": spent[0], "blocks": header["most_blocks"],
                "records": header["most_records"], "samples": int(np.count_nonzero(visible)),
                "kernels": [(name, spent[place] - spent[place + 1])
                            for place, name in enumerate(reversed(names))][::-1]}

    def names(self) -> list[str]:
        """Names of a step's kernels in their order."""
        pages = len(self.lattice.pages)
        before = ["shells_forward"] if self.shells is not None else []
        behind = ["shells_backward", "shells_step"] if self.shells is not None else []
        if self.smooths_colors:
            behind = [*["vary_colors"] * pages, *["smooth_colors"] * pages, *behind]
        return ["march", *before, "points", *["color"] * pages, "blend", "composite", "gather",
                "settle", *["paint"] * pages, "vary", *behind, "smooth_run"]


def largest(device: Device, given: dict[str, Any], steps: Array, inputs: UInt32) -> Float32:
    """The largest weight of each row on the rays of tiles, uint32 [T, 20]: float32 [N + 1].

    ``given`` has ``table``, ``links``, ``density``, ``shape`` and ``cameras`` as `Steps` takes
    them; of ``steps``, `STEP` [1], the rays' numbers count.
    """
    lattice = DeviceLattice.of(device, given)
    band = min(_BAND, len(inputs))
    bands = -(-len(inputs) // band)
    # The last band is filled up with a tile that was there before: it changes no maximum.
    inputs = np.concatenate([inputs, np.repeat(inputs[-1:], bands * band - len(inputs), axis=0)])
    notes = Notes.of(device, band, blocks_of_a_packet(given["shape"], float(steps["pace"][0])),
                     16 * band, 1)
    uniform = device.buffer(STEP.itemsize, uniform=True)
    resources = {"step": uniform, "bricks": lattice.bricks, "density": lattice.density,
                 "cameras": device.buffer(given["cameras"]),
                 "inputs": device.buffer(4 * 20 * band),
                 "most": device.buffer(4 * len(given["density"]))}
    done = 0
    while done < bands:
        resources |= notes.buffers
        device.write(uniform, notes.filled(steps, lattice, given["shape"]))
        runs = [(*_bound(device, entry, resources), (groups, 1, 1))
                for entry, groups in (("march", band), ("largest", band), ("next_band", 1))]
        notes.clear(device)
        for number in range(done, min(bands, done + SLOTS)):
            device.write(resources["inputs"], inputs[number * band:(number + 1) * band])
            device.run(*runs)
        header = notes.header(device)
        done += header["done"]
        if header["failed"]:
            notes = notes.larger(device, header)
    return device.read(resources["most"], np.float32, len(given["density"])).copy()


_KEY = "field training"


def begin(device: Device, given: dict[str, Any]) -> None:
    """Begin a level; what `Steps` takes, and perhaps a ``bright`` table to go on with."""
    device.kept.pop(_KEY, None)
    steps = device.kept[_KEY] = Steps(device, given)
    if given.get("bright") is not None:
        device.write(steps.lattice.bricks, np.ascontiguousarray(given["bright"], np.int32))


def prepare(device: Device) -> None:
    """Compile the kernels that every training needs, while the training still gets ready."""
    for entry, (file, _) in BINDINGS.items():
        if file not in ("shells", "colors"):
            device.kernel(source(file), entry)


def end(device: Device) -> None:
    """Forget the level."""
    device.kept.pop(_KEY, None)


def _of_level(method: Any) -> Callable[..., Any]:
    """A method of the level that was begun, as a function of its device."""
    return lambda device, *arguments: method(device.kept[_KEY], *arguments)


place, take, measure, put_average, fetch, fetch_table, fetch_shells = map(_of_level, (
    Steps.place, Steps.take, Steps.measure, Steps.put_average, Steps.fetch, Steps.fetch_table,
    Steps.fetch_shells))
