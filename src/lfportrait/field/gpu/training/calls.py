"""What the training process asks of the device's process, by name (`lfportrait.gpu.GpuProcess`)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....arrays import Bool, Float32, Int32
from ....gpu.device import Device
from .shaders import BINDINGS, source
from .steps import Steps, largest_weights

__all__ = ["begin", "end", "fetch", "fetch_shells", "fetch_table", "largest", "measure", "place",
           "prepare", "put_average", "take"]

_KEY = "field training"


def begin(device: Device, given: dict[str, Any]) -> None:
    """Begin a level; what `Steps` takes, and perhaps a ``bright`` table to go on with."""
    device.kept.pop(_KEY, None)
    steps = device.kept[_KEY] = Steps(device, given)
    if given.get("bright") is not None:
        steps.lattice.write_table(device, given["bright"])


def prepare(device: Device) -> None:
    """Compile the kernels that every training needs, while the training still gets ready."""
    for entry, (file, _) in BINDINGS.items():
        if file not in ("shells", "colors"):
            device.kernel(source(file), entry)


def end(device: Device) -> None:
    """Forget the level."""
    device.kept.pop(_KEY, None)


def place(device: Device, cameras: Float32) -> None:
    """Cast the rays from other cameras, float32 [V, 32], from now on."""
    device.write(device.kept[_KEY].buffers["cameras"], cameras)


def take(device: Device, steps: NDArray[Any], inputs: NDArray[np.uint32],
         averaged: Bool, looks: Bool) -> Float32:
    """Take some steps (`Steps.take`); their tiles' squared errors, float32 [K, T]."""
    return np.asarray(device.kept[_KEY].take(steps, inputs, averaged, looks))


def measure(device: Device, steps: NDArray[Any], inputs: NDArray[np.uint32], repeats: int,
            ) -> dict[str, Any]:
    """What a step's kernels take (`Steps.measure`); the level is of no use afterwards."""
    return dict(device.kept[_KEY].measure(steps, inputs, repeats))


def fetch_table(device: Device) -> Int32:
    """The table of bricks that rays are cast by, int32 [BZ, BY, BX]."""
    return np.asarray(device.kept[_KEY].table())


def fetch(device: Device, sums: bool = False,
          ) -> tuple[Float32, list[Float32], Float32 | None]:
    """Densities [N + 1], pages of colors [rows, `row_floats`], states [N + 1, 2].

    Or the sums of the average, without states.
    """
    steps: Steps = device.kept[_KEY]
    lattice = steps.lattice
    if sums:
        return *lattice.read(device, steps.sums[0], steps.sums[1:]), None
    return (*lattice.read(device, lattice.density, lattice.pages),
            device.read(lattice.states, np.float32, (lattice.count + 1, 2)))


def fetch_shells(device: Device) -> tuple[Float32, Float32]:
    """Values of the spheres behind the lattice, and their mean squared slopes (`Shells.read`)."""
    return device.kept[_KEY].shells.read(device)


def put_average(device: Device, density: Float32, rows: Float32) -> None:
    """Go on with sums of an average, [N + 1] and [N + 1, columns]."""
    device.kept[_KEY].put_sums(density, rows)


def largest(device: Device, given: dict[str, Any], steps: NDArray[Any],
            inputs: NDArray[np.uint32]) -> Float32:
    """The largest weight of each row on the rays of tiles (`largest_weights`)."""
    return largest_weights(device, given, steps, inputs)
