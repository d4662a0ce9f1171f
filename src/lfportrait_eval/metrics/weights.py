"""Read pretrained weights of the metrics' networks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

__all__ = ["read_weights"]


def read_weights(path: Path) -> dict[str, Any]:
    """Weights by name, float32."""
    import torch
    from safetensors.torch import load_file

    weights = (load_file(str(path)) if path.suffix == ".safetensors"
               else torch.load(path, map_location="cpu", weights_only=True))
    return {name: value.float() for name, value in weights.items()}
