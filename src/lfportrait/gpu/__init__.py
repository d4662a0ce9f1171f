"""GPUs of any maker, by WebGPU: adapters, one device, its buffers and kernels, one process.

This folder knows no stage. A stage keeps its shaders and the functions that run them in a folder
``gpu/`` of its own; such a function takes a `Device` first, then arrays, and returns arrays. Stages
call it by its name through `GpuProcess.call`: the device lives in a process of its own, which is
started again when a driver resets or hangs (`lfportrait.gpu.process`).

All of it stays inside WebGPU's default limits, whatever a card could do, so that what runs in the
tests on a software adapter runs on every card. Only `device` imports wgpu, when it is first used.
"""

from .device import Adapter, adapters, chosen, missing
from .process import GpuLostError, GpuProcess, attempted, gpu_process

__all__ = ["Adapter", "GpuLostError", "GpuProcess", "adapters", "attempted", "chosen",
           "gpu_process", "missing"]
