"""GPUs of any maker, by WebGPU: adapters, one device, its buffers and kernels, one process.

A stage keeps its shaders and the functions that run them in a folder ``gpu/`` of its own; such a
function takes a `Device` first, then arrays, and returns arrays. Buffers and textures are wgpu's
own objects, for the stages to hold. Kernels are compiled once for each source, entry point and set
of constants.

A driver that resets takes its process's device with it, one that hangs takes the process. So GPU
work runs in a child (`main`), and stages call it by its name (`GpuProcess.call`). A child that dies
or takes too long is ended and started again once; after that `GpuLostError` is raised, and the
caller computes on the CPU.

All of it stays inside WebGPU's default limits, whatever a card could do, so that what runs in the
tests on a software adapter runs on every card. Only this module calls wgpu, and imports it when it
is first used.
"""

import atexit
import contextlib
import functools
import importlib
import importlib.util
import math
import os
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from .arrays import Array
from .errors import UserError
from .graphics import lacking
from .runner import Child, Pipe

_KINDS = {"DiscreteGPU": "discrete", "IntegratedGPU": "integrated", "CPU": "software"}
_ORDER = ("discrete", "integrated", "other", "software")
_BACKENDS = ("Vulkan", "Metal", "D3D12")
"""OpenGL's compute shaders differ from driver to driver: it is left out."""
_TIMEOUT = 120.0  # Seconds after which a call is taken to hang.


@dataclass(frozen=True)
class Adapter:
    """A GPU, or software that stands in for one."""

    name: str  # As its driver calls it.
    kind: str  # ``"discrete"``, ``"integrated"``, ``"software"`` (the CPU computes) or ``"other"``.
    backend: str  # ``"Vulkan"``, ``"Metal"`` or ``"D3D12"``.
    # vendor, driver: What the driver says of itself.
    vendor: str = ""
    driver: str = ""
    memory: int = 0  # Bytes of its own memory; 0 = not reported (WebGPU does not say).
    # Names and values of its limits.
    limits: dict[str, int] = field(default_factory=dict, compare=False)

    @property
    def real(self) -> bool:
        """Whether it is more than software."""
        return self.kind != "software"

    @property
    def title(self) -> str:
        """Name and backend, as figures give them."""
        return f"{self.name} ({self.backend})"


@contextlib.contextmanager
def quiet_driver() -> Iterator[None]:
    """Keep drivers, which write to the process's standard error, from speaking to the user."""
    if os.name == "posix" and not os.environ.get("XDG_RUNTIME_DIR"):
        os.environ["XDG_RUNTIME_DIR"] = tempfile.gettempdir()
    sys.stderr.flush()
    try:
        kept = os.dup(2)
    except OSError:
        yield
        return
    try:
        with open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def _memory_of(info: Any) -> int:
    """Bytes of a card's memory, where the system tells: NVIDIA's and AMD's drivers on Linux."""
    for file in Path("/sys/class/drm").glob("card*/device/mem_info_vram_total"):
        with contextlib.suppress(OSError, ValueError):
            vendor = int((file.parent / "vendor").read_text(encoding="ascii"), 16)
            if vendor == int(info.get("vendor_id", 0)):
                return int(file.read_text(encoding="ascii"))
    return 0


@functools.cache
def _handles() -> list[tuple[Adapter, Any]]:
    """Every adapter and wgpu's object for it, the best first."""
    if importlib.util.find_spec("wgpu") is None:
        return []
    try:
        with quiet_driver():
            import wgpu

            found = wgpu.gpu.enumerate_adapters_sync()
    except Exception:  # whatever a broken loader or driver raises: there is no GPU then
        return []
    out: list[tuple[Adapter, Any]] = []
    for handle in found:
        info = handle.info
        backend = str(info.get("backend_type", ""))
        if backend not in _BACKENDS:
            continue
        kind = _KINDS.get(str(info.get("adapter_type", "")), "other")
        adapter = Adapter(str(info.get("device", "")) or "unnamed", kind, backend,
                          str(info.get("vendor", "")), str(info.get("description", "")),
                          _memory_of(info) if kind == "discrete" else 0,
                          {str(name): int(value) for name, value in handle.limits.items()})
        out.append((adapter, handle))
    return sorted(out, key=lambda entry: _ORDER.index(entry[0].kind))


def adapters() -> list[Adapter]:
    """The adapters of this machine, the best first; empty where wgpu or a driver is missing."""
    return [adapter for adapter, _ in _handles()]


def handle_of(adapter: Adapter) -> Any:
    """The object of wgpu's for an adapter; `LookupError` where this process does not see it."""
    for own, handle in _handles():
        if own == adapter:
            return handle
    raise LookupError(f"no adapter {adapter.title}")


def missing() -> str | None:
    """What keeps WebGPU from finding an adapter, and the remedy, in one line; None: nothing."""
    if adapters():
        return None
    for lack in lacking():
        return f"{lack.what}: {lack.remedy}"
    return "no adapter was found: update the graphics card's driver"


def chosen(choice: str) -> Adapter | None:
    """The adapter for the user's choice of ``--device``; None: the CPU.

    ``"auto"`` takes the best real GPU and never software, ``"gpu"`` the best of all, ``"gpu:NAME"``
    the best whose name contains NAME; ``"cpu"`` none.
    """
    if choice == "cpu":
        return None
    found = adapters()
    if choice == "auto":
        return next((adapter for adapter in found if adapter.real), None)
    wanted = choice.removeprefix("gpu").removeprefix(":").strip().lower()
    for adapter in found:
        if wanted in adapter.title.lower():
            return adapter
    if found:
        raise UserError(f"there is no GPU {wanted!r}; there are "
                        f"{', '.join(adapter.title for adapter in found)}")
    raise UserError(f"there is no GPU here: {missing()}")


LIMITS = {
    "max-buffer-size": 256 << 20,
    "max-storage-buffer-binding-size": 128 << 20,
    "max-uniform-buffer-binding-size": 64 << 10,
    "max-storage-buffers-per-shader-stage": 8,
    "max-storage-textures-per-shader-stage": 4,
    "max-sampled-textures-per-shader-stage": 16,
    "max-samplers-per-shader-stage": 16,
    "max-texture-dimension-2d": 8192,
    "max-texture-dimension-3d": 2048,
    "max-texture-array-layers": 256,
    "max-compute-workgroup-storage-size": 16384,
    "max-compute-invocations-per-workgroup": 256,
    "max-compute-workgroup-size-x": 256,
    "max-compute-workgroup-size-y": 256,
    "max-compute-workgroup-size-z": 64,
    "max-compute-workgroups-per-dimension": 65535,
    "max-bind-groups": 4,
    "max-bindings-per-bind-group": 1000,
}
"""WebGPU's default limits, asked for by number: what is not asked for, wgpu fills with all that
the card has, and code then fails on a smaller one."""

BINDING = LIMITS["max-storage-buffer-binding-size"]
"""Bytes of a buffer that a shader can see at once."""
_STAGED = 32 << 20  # Bytes that are read back at once.
_DISPATCH = 0.05  # Seconds that one dispatch should take: some systems reset a driver after two.


@dataclass(frozen=True)
class Kernel:
    """A compiled entry point of a shader."""

    pipeline: Any
    layout: Any


class Device:
    """A device on an adapter, with WebGPU's default limits.

    ``kept`` holds whatever stages keep here from call to call, by names of their own.
    """

    def __init__(self, adapter: Adapter) -> None:
        with quiet_driver():
            import wgpu

            self._flags = wgpu
            self.adapter = adapter
            self._device = handle_of(adapter).request_device_sync(required_limits=dict(LIMITS))
        self._kernels: dict[tuple[Any, ...], Kernel] = {}
        self.kept: dict[str, Any] = {}

    @property
    def raw(self) -> Any:
        """The device of wgpu itself, for a window that shows what it computes."""
        return self._device

    # -- memory -----------------------------------------------------------------------------------

    def buffer(self, data: Array | int, *, uniform: bool = False) -> Any:
        """A buffer with an array's bytes, or an empty one (zeros) of so many bytes."""
        usage = self._flags.BufferUsage
        flags = usage.COPY_DST | usage.COPY_SRC | (usage.UNIFORM if uniform else usage.STORAGE)
        if isinstance(data, (int, np.integer)):
            return self._device.create_buffer(size=max(16, -(-int(data) // 4) * 4), usage=flags)
        raw = np.ascontiguousarray(data).reshape(-1).view(np.uint8)
        buffer = self._device.create_buffer(size=max(16, -(-raw.nbytes // 4) * 4), usage=flags)
        self.write(buffer, raw)
        return buffer

    def write(self, buffer: Any, data: Array, offset: int = 0) -> None:
        """Copy an array's bytes into a buffer, from a byte (a multiple of 4) on."""
        raw = np.ascontiguousarray(data).reshape(-1).view(np.uint8)
        whole = raw.nbytes // 4 * 4
        if whole:
            self._device.queue.write_buffer(buffer, offset, raw[:whole])
        if whole < raw.nbytes:
            rest = np.zeros(4, np.uint8)
            rest[:raw.nbytes - whole] = raw[whole:]
            self._device.queue.write_buffer(buffer, offset + whole, rest)

    def read(self, buffer: Any, dtype: Any, shape: int | Sequence[int], offset: int = 0) -> Array:
        """An array of what a buffer holds, from a byte on."""
        out = np.empty(shape, dtype)
        raw = out.reshape(-1).view(np.uint8)
        for start in range(0, raw.nbytes, _STAGED):
            part = raw[start:start + _STAGED]
            size = -(-part.nbytes // 4) * 4
            staged = self._staging(size)
            encoder = self._device.create_command_encoder()
            encoder.copy_buffer_to_buffer(buffer, offset + start, staged, 0, size)
            self._device.queue.submit([encoder.finish()])
            staged.map_sync("READ", 0, size)
            part[:] = np.frombuffer(staged.read_mapped(0, size, copy=False), np.uint8)[:part.nbytes]
            staged.unmap()
        return out

    def _staging(self, size: int) -> Any:
        """A buffer that this process reads, kept: a new one's memory has to be found first."""
        kept = self.kept.get("staging")
        if kept is None or kept.size < size:
            usage = self._flags.BufferUsage
            kept = self._device.create_buffer(size=min(_STAGED, 1 << (size - 1).bit_length()),
                                              usage=usage.COPY_DST | usage.MAP_READ)
            self.kept["staging"] = kept
        return kept

    def texture(self, size: tuple[int, ...], format: str, *, written: bool = False,
                layers: int = 1, drawn: bool = False) -> Any:
        """A texture of (width, height) or (width, height, depth) texels.

        ``written``: a shader writes it. ``layers``: so many of two dimensions, one upon the other.
        ``drawn``: it is drawn on, as windows are.
        """
        usage = self._flags.TextureUsage
        flags = usage.TEXTURE_BINDING | usage.COPY_DST | usage.COPY_SRC
        flat = len(size) == 2
        return self._device.create_texture(
            size=(*size, layers) if flat else size, dimension="2d" if flat else "3d", format=format,
            usage=flags | (usage.STORAGE_BINDING if written else 0)
            | (usage.RENDER_ATTACHMENT if drawn else 0))

    def fill_texture(self, texture: Any, data: Array) -> None:
        """Copy texels [H, W, ...] or [D, H, W, ...] into a texture of that size."""
        width, height, depth = texture.size
        raw = np.ascontiguousarray(data).reshape(-1).view(np.uint8)
        per_row = raw.nbytes // (height * depth)
        # One copy must fit the buffers that it goes through.
        rows = max(1, (64 << 20) // per_row)
        for layer in range(depth):
            for row in range(0, height, rows):
                some = min(rows, height - row)
                start = (layer * height + row) * per_row
                self._device.queue.write_texture(
                    {"texture": texture, "origin": (0, row, layer)},
                    raw[start:start + some * per_row],
                    {"bytes_per_row": per_row, "rows_per_image": some}, (width, some, 1))

    def sampler(self) -> Any:
        """A sampler that interpolates, and repeats the texels at the borders."""
        key = "linear sampler"
        if key not in self.kept:
            self.kept[key] = self._device.create_sampler(
                mag_filter="linear", min_filter="linear", address_mode_u="clamp-to-edge",
                address_mode_v="clamp-to-edge", address_mode_w="clamp-to-edge")
        return self.kept[key]

    # -- work -------------------------------------------------------------------------------------

    def kernel(self, source: str, entry: str, constants: Mapping[str, float] | None = None,
               ) -> Kernel:
        """Compile an entry point of a shader (WGSL); its ``override`` constants may be set."""
        values = dict(constants or {})
        key = (source, entry, *sorted(values.items()))
        if key not in self._kernels:
            module = self._device.create_shader_module(code=source)
            pipeline = self._device.create_compute_pipeline(
                layout="auto", compute={"module": module, "entry_point": entry,
                                        "constants": values})
            self._kernels[key] = Kernel(pipeline, pipeline.get_bind_group_layout(0))
        return self._kernels[key]

    def bind(self, kernel: Kernel, bindings: Mapping[int, Any]) -> Any:
        """Resources of a kernel by their numbers: buffers, textures, samplers, or buffers' parts.

        A part of a buffer is (buffer, first byte, bytes); the first byte is a multiple of 256.
        """
        entries = []
        for number, resource in bindings.items():
            if isinstance(resource, tuple):
                buffer, offset, size = resource
                resource = {"buffer": buffer, "offset": offset, "size": size}
            elif hasattr(resource, "create_view"):
                layered = resource.dimension == "2d" and resource.size[2] > 1
                resource = resource.create_view(dimension="2d-array" if layered else None)
            elif hasattr(resource, "map_state"):
                resource = {"buffer": resource, "offset": 0, "size": resource.size}
            entries.append({"binding": number, "resource": resource})
        return self._device.create_bind_group(layout=kernel.layout, entries=entries)

    def run(self, *steps: tuple[Kernel, Any, tuple[int, int, int]]) -> None:
        """Run kernels one after the other: (kernel, bound resources, workgroups)."""
        encoder = self._device.create_command_encoder()
        # In one pass: each dispatch sees what those before it wrote.
        work = encoder.begin_compute_pass()
        for kernel, group, count in steps:
            if min(count) < 1:
                continue
            work.set_pipeline(kernel.pipeline)
            work.set_bind_group(0, group)
            work.dispatch_workgroups(*count)
        work.end()
        self._device.queue.submit([encoder.finish()])

    def wait(self) -> None:
        """Wait until all work is done."""
        # A read comes after all that was submitted; wgpu-py's own way to wait fails in 0.32.
        if "wait" not in self.kept:
            self.kept["wait"] = self.buffer(16)
        self.read(self.kept["wait"], np.uint32, 1)


def bands(total: int, first: int, run: Callable[[int, int], None], wait: Callable[[], None],
          ) -> int:
    """Run work on ``total`` rows in bands, sized by what the first ones take.

    Returns the rows that a band may have, for more work of the same kind. ``first`` are the rows of
    the calibration dispatch, ``run(since, until)`` sends a band off.
    """
    bound = 0
    since, size = 0, max(1, min(first, total))
    wait()
    while since < total:
        until = min(total, since + size)
        start = time.perf_counter()
        run(since, until)
        bound += 1
        if until < total and bound <= 3:
            wait()
            spent = max(time.perf_counter() - start, 1e-5)
            # A first dispatch may include compiling: grow step by step.
            size = int(min(math.ceil((until - since) * _DISPATCH / spent), 16 * (until - since)))
            size = max(1, size)
        since = until
    return size


class GpuLostError(RuntimeError):
    """The GPU can't do it: its device was lost twice, it hung, or its memory is too small."""


class GpuProcess:
    """A child that holds one device; a call that takes ``timeout`` seconds is taken to hang.

    ``starts`` is how many times a child was started.
    """

    def __init__(self, adapter: Adapter, timeout: float = _TIMEOUT) -> None:
        self.adapter, self.timeout, self.starts = adapter, timeout, 0
        self._child: Child | None = None
        self._held: dict[str, frozenset[str]] = {}
        self._lock = threading.RLock()
        self._lost = False

    def holds(self, kind: str, name: str) -> bool:
        """Whether the child that runs now keeps something under this name (`note`)."""
        return (self._child is not None and self._child.alive and name in self._held.get(kind, ()))

    def note(self, kind: str, names: Collection[str]) -> None:
        """Remember what of a kind the child keeps now."""
        self._held[kind] = frozenset(names)

    def call(self, name: str, *arguments: Any) -> Any:
        """Call ``"package.module:function"`` in the child, with the `Device` and the arguments.

        These, and what it returns, are arrays, numbers, text, and what can be pickled of them.
        Raises `GpuLostError` if the child was lost; a later call starts another one, unless that
        was lost, too.
        """
        with self._lock:
            if self._lost:
                raise GpuLostError(f"{self.adapter.title} was lost twice")
            child = self._running()
            timer = threading.Timer(self.timeout, child.kill)
            timer.daemon = True
            timer.start()
            try:
                child.send((name, arguments))
                good, result = child.receive()
            except (OSError, EOFError) as error:
                slow = timer.finished.is_set()
                self.close()
                self._lost = self.starts > 1
                why = f"did not answer within {self.timeout:g} s" if slow else "was lost"
                raise GpuLostError(f"{self.adapter.title} {why}") from error
            except BaseException:
                self.close()  # an answer is under way that nobody will read
                raise
            finally:
                timer.cancel()
        if good:
            return result
        if isinstance(result, GpuLostError):
            self.close()
        raise result

    def close(self) -> None:
        """End the child."""
        child, self._child = self._child, None
        self._held.clear()
        if child is not None:
            child.close()

    def _running(self) -> Child:
        if self._child is None or not self._child.alive:
            self.close()
            self.starts += 1
            self._child = Child("lfportrait.gpu:main")
            with contextlib.suppress(OSError):
                self._child.send(self.adapter)
        return self._child


_processes: dict[Adapter, GpuProcess] = {}

Result = TypeVar("Result")


def attempted(adapter: Adapter | None, work: Callable[[GpuProcess], Result]) -> Result | None:
    """What work on a GPU gives; None, and a warning, where it was lost, or without an adapter.

    The caller computes on the CPU then.
    """
    if adapter is None:
        return None
    try:
        return work(gpu_process(adapter))
    except GpuLostError as error:
        warnings.warn(f"{error}: the CPU computes instead", stacklevel=3)
        return None


def gpu_process(adapter: Adapter) -> GpuProcess:
    """The process of an adapter, started when it is first called and ended with this one."""
    if adapter not in _processes:
        _processes[adapter] = GpuProcess(adapter)
        atexit.register(_processes[adapter].close)
    return _processes[adapter]


def _answer(device: Device, name: str, arguments: tuple[Any, ...]) -> tuple[bool, Any]:
    """What a call returns, or the error that it raised."""
    module, function = name.split(":")
    try:
        return True, getattr(importlib.import_module(module), function)(device, *arguments)
    except MemoryError as error:
        return False, GpuLostError(f"{device.adapter.title} has too little memory: {error}")
    except Exception as error:
        text, kind = str(error), type(error)
        if kind.__name__ == "GPUOutOfMemoryError" or any(
                words in text.lower() for words in ("out of memory", "not enough memory")):
            return False, GpuLostError(f"{device.adapter.title} has too little memory")
        if "lost" in text.lower():
            return False, GpuLostError(f"{device.adapter.title} was lost")
        if kind.__module__.split(".")[0] in ("builtins", "lfportrait"):
            return False, error
        # The parent need not have the module that this error is from.
        return False, RuntimeError(f"{kind.__name__}: {text}")


def main() -> None:
    """Answer calls until the parent is gone."""
    pipe = Pipe()
    adapter = pipe.requests.get()
    try:
        device = Device(adapter)
    except Exception as error:
        pipe.requests.get()
        pipe.tell(False, GpuLostError(f"{adapter.title} can't be used: {error}"))
        return
    while True:
        pipe.tell(*_answer(device, *pipe.requests.get()))
