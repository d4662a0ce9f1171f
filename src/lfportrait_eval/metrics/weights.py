"""Read pretrained weights of the metrics' networks, and compute with all their digits."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

__all__ = ["exact", "read_weights"]


@contextmanager
def exact(place: str) -> Iterator[None]:
    """Without gradients, and without the shorter numbers that NVIDIA's cards convolve with.

    What is measured should not depend on who measures. ``place`` is torch's name of the device.
    """
    import torch

    with torch.no_grad():
        if not place.startswith("cuda"):
            yield
            return
        with torch.backends.cudnn.flags(enabled=True, allow_tf32=False):
            yield


def read_weights(path: Path, place: str = "cpu") -> dict[str, Any]:
    """Weights by name, float32, on torch's device of that name."""
    import torch
    from safetensors.torch import load_file

    weights = (load_file(str(path)) if path.suffix == ".safetensors"
               else torch.load(path, map_location="cpu", weights_only=True))
    return {name: value.float().to(place) for name, value in weights.items()}
