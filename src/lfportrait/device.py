"""The option ``--device``: allowed values, and the devices that a choice comes to.

Two libraries compute on GPUs: WebGPU (`lfportrait.gpu`) codes, renders and reconstructs, torch runs
the networks. Each has its own list of devices; a choice is looked up in both. Neither is imported
before it is needed, and ``auto`` asks them only where the system shows signs of a GPU: on other
machines it costs a look at a few files.
"""

from __future__ import annotations

import functools
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from .errors import UserError
from .graphics import gpu_in_sight, lacking

if TYPE_CHECKING:
    from .gpu import Adapter


@dataclass(frozen=True)
class TorchDevice:
    """Where torch computes: the CPU, or a GPU."""

    place: str = "cpu"  # Torch's own name of it: ``"cpu"``, ``"cuda:0"``, ``"mps"``, ``"xpu:1"``.
    name: str = "cpu"  # Its maker's name.
    backend: str = ""  # ``"CUDA"``, ``"ROCm"``, ``"Metal"`` or ``"XPU"``; empty for the CPU.
    memory: int = 0  # In bytes; 0 where torch does not report it.

    @property
    def title(self) -> str:
        """Name and backend, as figures give them."""
        return f"{self.name} ({self.backend})" if self.backend else self.name


def checked_choice(choice: str) -> str:
    """The user's choice of ``--device``, as it is."""
    if choice in ("auto", "cpu", "gpu") or (choice.startswith("gpu:") and choice != "gpu:"):
        return choice
    raise UserError(f"--device takes auto, cpu, gpu or gpu:NAME, not {choice!r}")


def check_device(choice: str) -> None:
    """Raise `UserError` if a choice makes no sense, or names a GPU that is not here.

    ``auto`` and ``cpu`` are never looked up.
    """
    if checked_choice(choice) in ("auto", "cpu"):
        return
    if not _named(gpu_adapters(), choice) and not _named(torch_devices(), choice):
        raise _no_gpu(choice)


@functools.lru_cache(maxsize=16)
def gpu_adapter(choice: str = "auto") -> Adapter | None:
    """The WebGPU adapter for a choice of ``--device``; None: compute on the CPU.

    ``"auto"``: the best real GPU, if there is one. ``"cpu"``: none. ``"gpu"``: the best one, if
    need be a program that stands in for it; a warning says so. ``"gpu:NAME"``: the best one with
    this in its name, upper or lower case.
    """
    if checked_choice(choice) == "cpu" or (
            choice == "auto" and not (gpu_in_sight() and find_spec("wgpu"))):
        return None
    from .gpu import chosen

    found = chosen(choice)
    if found is None or (choice == "auto" and too_small(found)):
        return None
    if not found.real:
        warnings.warn(f"{found.title} is no GPU: the CPU computes in its place", stacklevel=2)
    return found


def too_small(adapter: Adapter) -> bool:
    """Whether an adapter has less than WebGPU's default limits: then it is of no use here."""
    from .gpu import LIMITS

    return any(adapter.limits.get(name, least) < least for name, least in LIMITS.items())


def device_name(used: Adapter | TorchDevice | None) -> str:
    """How figures name where something was computed: ``"cpu"``, ``"gpu: NAME (Vulkan)"``."""
    return "cpu" if used is None or used.title == "cpu" else f"gpu: {used.title}"


def used_device(figures: Mapping[str, Mapping[str, Any]]) -> str:
    """Where a job computed, by its stages' figures: the GPU that one of them used, if any did."""
    devices = [str(stage.get("device", "cpu")) for stage in figures.values()]
    return next((device for device in devices if device != "cpu"), "cpu")


@functools.lru_cache(maxsize=1)
def torch_devices() -> tuple[TorchDevice, ...]:
    """The GPUs that torch can use here, in its order; torch is imported only if there may be one.

    Computers that NVIDIA's, AMD's, Apple's and Intel's libraries don't support have none, whatever
    WebGPU finds.
    """
    if not gpu_in_sight() or find_spec("torch") is None:
        return ()
    import torch

    found: list[TorchDevice] = []
    kinds: tuple[tuple[str, str, Any], ...] = (
        ("cuda", "ROCm" if getattr(torch.version, "hip", None) else "CUDA", torch.cuda),
        ("xpu", "XPU", getattr(torch, "xpu", None)))
    for place, backend, module in kinds:
        if module is not None and module.is_available():
            found += [TorchDevice(f"{place}:{number}", module.get_device_name(number), backend,
                                  int(module.get_device_properties(number).total_memory))
                      for number in range(module.device_count())]
    if torch.backends.mps.is_available():
        found.append(TorchDevice("mps", _apple_name(), "Metal"))
    return tuple(found)


@functools.lru_cache(maxsize=16)
def torch_device(choice: str = "auto") -> TorchDevice:
    """Where torch computes for a choice of ``--device``.

    ``"auto"`` and ``"gpu"``: on its first GPU, if it has any. ``"cpu"``: on the CPU.
    ``"gpu:NAME"``: on the first with this in its name, upper or lower case. On the CPU, with a
    warning, also where the chosen GPU is one that WebGPU can use and torch, as installed, can't.
    """
    if checked_choice(choice) == "cpu":
        return TorchDevice()
    found = _named(torch_devices(), choice)
    if found or choice == "auto":
        return found[0] if found else TorchDevice()
    adapters = _named(gpu_adapters(), choice)
    if not adapters:
        raise _no_gpu(choice)
    if adapters[0].real:
        warnings.warn(f"torch, as installed here, can't use {adapters[0].name}: networks compute "
                      "on the CPU", stacklevel=2)
    return TorchDevice()


def gpu_adapters() -> list[Adapter]:
    """The WebGPU adapters of this machine; none where wgpu or a system library is missing."""
    from .gpu import adapters

    return adapters()


def _named(devices: Sequence[Any], choice: str) -> list[Any]:
    """Those that a choice may mean, by their titles."""
    part = choice.partition(":")[2].strip().casefold()
    return [one for one in devices if part in one.title.casefold()]


def _no_gpu(choice: str) -> UserError:
    """The error for a choice that nothing here answers to: what there is, or what is missing."""
    titles = dict.fromkeys([one.title for one in gpu_adapters()]
                           + [one.title for one in torch_devices()])
    if titles:
        return UserError(f"there is no GPU {choice.partition(':')[2].strip()!r}; there are "
                         f"{', '.join(titles)}")
    lacks = lacking()
    why = f"{lacks[0].what}: {lacks[0].remedy}" if lacks else "leave --device at auto or cpu"
    return UserError(f"there is no GPU here; {why}")


def _apple_name() -> str:
    """The name of Apple's processor, whose GPU has no name of its own."""
    import platform
    import subprocess

    try:
        found = subprocess.run(["sysctl", "-n", "machdep.cpu.brand_string"], capture_output=True,
                               text=True, check=True, timeout=5).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        found = ""
    return found or f"Apple {platform.machine()}"
