"""Which GPUs there are: names, kinds, drivers and limits of the adapters that WebGPU reports."""

from __future__ import annotations

import contextlib
import functools
import importlib.util
import os
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..errors import UserError
from ..graphics import lacking

_KINDS = {"DiscreteGPU": "discrete", "IntegratedGPU": "integrated", "CPU": "software"}
_ORDER = ("discrete", "integrated", "other", "software")
_BACKENDS = ("Vulkan", "Metal", "D3D12")
"""OpenGL's compute shaders differ from driver to driver: it is left out."""


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
