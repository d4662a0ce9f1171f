"""The child of `lfportrait.gpu.process`: one device, one call after the other."""

from __future__ import annotations

import importlib
from typing import Any

from ..runner import Pipe
from .device import Device
from .process import GpuLostError

__all__ = ["main"]


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
