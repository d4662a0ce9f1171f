"""The command ``devices``: which GPUs there are, which are used, and what is missing."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from importlib import metadata
from typing import TYPE_CHECKING, Any

from ..device import (
    device_name,
    gpu_adapter,
    gpu_adapters,
    too_small,
    torch_device,
    torch_devices,
)
from ..graphics import lacking
from .common import Common

if TYPE_CHECKING:
    from ..gpu import Adapter

__all__ = ["Devices"]

_LIMITS = {"max-storage-buffer-binding-size": "largest binding",
           "max-buffer-size": "largest buffer",
           "max-compute-workgroup-storage-size": "memory of a workgroup",
           "max-storage-buffers-per-shader-stage": "storage buffers of a stage"}
"""Limits of an adapter that matter here, in words."""


@dataclass
class Devices(Common):
    """List the GPUs that --device can name, what auto takes, and what is missing.

    Light fields are computed through WebGPU (any maker's GPU), networks by torch.
    """

    def run(self) -> dict[str, Any]:
        """Look and print."""
        adapters, gpus, lacks = gpu_adapters(), torch_devices(), lacking()
        used = {"light fields": device_name(gpu_adapter("auto")),
                "networks": device_name(torch_device("auto"))}
        try:
            torch = metadata.version("torch")
        except metadata.PackageNotFoundError:
            torch = ""
        print("WebGPU")
        for one in adapters:
            print(f"  {one.name}  ({_words(one)})")
            print(f"    {', '.join(_limit_words(one))}")
        if not adapters:
            print("  none")
        print(f"torch {torch}")
        for gpu in gpus:
            memory = f", {_size(gpu.memory)}" if gpu.memory else ""
            print(f"  {gpu.name}  ({gpu.backend}, {gpu.place}{memory})")
        if not gpus:
            print("  none")
        print("--device auto")
        for what, name in used.items():
            print(f"  {what}: {name}")
        if lacks:
            print("missing")
        for lack in lacks:
            print(f"  {lack.what}: {lack.remedy}")
        return {"adapters": [_figures(one) for one in adapters],
                "torch": {"version": torch, "devices": [asdict(gpu) for gpu in gpus]},
                "auto": used, "missing": [lack._asdict() for lack in lacks]}


def _limits(adapter: Adapter) -> dict[str, int]:
    return {name: adapter.limits[name] for name in _LIMITS if name in adapter.limits}


def _words(adapter: Adapter) -> str:
    """Kind, interface, driver and memory."""
    parts = [adapter.kind, adapter.backend, adapter.driver,
             _size(adapter.memory) if adapter.memory else "",
             "too small: less than WebGPU's default limits" if too_small(adapter) else ""]
    return ", ".join(part for part in parts if part)


def _limit_words(adapter: Adapter) -> list[str]:
    return [f"{_LIMITS[name]} {value if 'buffers' in name else _size(value)}"
            for name, value in _limits(adapter).items()]


def _size(size: int) -> str:
    """A number of bytes in the units that limits are given in."""
    for unit, words in ((1 << 30, "GiB"), (1 << 20, "MiB"), (1 << 10, "KiB")):
        if size >= unit:
            return f"{size / unit:.4g} {words}"
    return f"{size} bytes"


def _figures(adapter: Adapter) -> dict[str, Any]:
    return {"name": adapter.name, "kind": adapter.kind, "backend": adapter.backend,
            "vendor": adapter.vendor, "driver": adapter.driver, "memory": adapter.memory,
            "too_small": too_small(adapter), "limits": _limits(adapter)}
