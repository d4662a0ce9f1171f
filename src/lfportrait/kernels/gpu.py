"""The same marching loop for a GPU: one thread a ray, compiled by the one package that is there.

The compiler is picked in this place alone: numba-cuda-mlir, NVIDIA's successor of numba-cuda. The
loop is `make_march` over the one-lane namespace, its functions compiled as device code. No command
uses it yet; a test compiles it to PTX where the ``cuda`` extra is installed, which needs no GPU.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .march import make_march
from .one_lane import one_lane_namespace

__all__ = ["compile_cast", "gpu_compiler"]


def gpu_compiler() -> Any:
    """The module with ``jit`` and ``compile_ptx``.

    Raises
    ------
    ImportError
        If the ``cuda`` extra is not installed.
    """
    from numba_cuda_mlir import cuda

    return cuda


def _cast_kernel(cuda: Any, width: int, count: int) -> Callable[..., Any]:
    """Cast rays [R, 9] (origin, direction, start, end, delta in lattice units) -> out [R, 5]."""
    device = cuda.jit(device=True)
    lanes = one_lane_namespace(device)
    half, zero, middle = lanes.half, np.float32(0.0), np.float32(0.5)

    @device
    def shade(links, rows, base, weights, lane, basis, channel):
        red, green, blue = zero, zero, zero
        for corner in range(8):
            offset = (corner >> 2) * 25 + ((corner >> 1) & 1) * 5 + (corner & 1)
            row = links[base + offset] * width
            for i in range(count):
                share = weights[corner] * basis[i]
                red += share * half(rows[row + i])
                green += share * half(rows[row + count + i])
                blue += share * half(rows[row + 2 * count + i])
        return max(red + middle, zero), max(green + middle, zero), max(blue + middle, zero)

    march = make_march(lanes, shade)
    threshold, stop = np.float32(1e-2), np.float32(1e-3)

    def cast(table, links, density, rows, rays, bases, nx, ny, nz, step, out):
        index = cuda.grid(1)
        if index < rays.shape[0]:
            ray = rays[index]
            red, green, blue, through, depth = march(
                table, links, density, rows, nx, ny, nz, ray[0], ray[1], ray[2], ray[3], ray[4],
                ray[5], ray[6], ray[7], step, ray[8], threshold, stop, bases[index], zero)
            out[index, 0], out[index, 1], out[index, 2] = red, green, blue
            out[index, 3], out[index, 4] = through, depth
    return cast


def compile_cast(width: int = 32, count: int = 9, capability: tuple[int, int] = (9, 0)) -> str:
    """PTX of the casting kernel; needs the ``cuda`` extra, but no GPU.

    Parameters
    ----------
    width, count
        Colour row width and coefficients a channel.
    capability
        Compute capability to compile for.
    """
    from numba_cuda_mlir import tools

    cuda = gpu_compiler()
    if getattr(tools, "_cached_cc", None) is None:
        # Without a driver the compiler can't ask for the device's capability.
        tools._cached_cc = capability

    def array(kind: Any, dimensions: int) -> Any:
        return cuda.types.Array(kind, dimensions, "C")

    f32, i32, u16 = cuda.types.float32, cuda.types.int32, cuda.types.uint16
    text, _ = cuda.compile_ptx(
        _cast_kernel(cuda, width, count),
        (array(i32, 3), array(i32, 1), array(u16, 1), array(u16, 1), array(f32, 2), array(f32, 2),
         i32, i32, i32, f32, array(f32, 2)), cc=capability)
    return str(text)
