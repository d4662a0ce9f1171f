"""Hashes of what a file is made from: the same key, the same bytes, nothing to be done again."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np

from .version import __version__

__all__ = ["key_of"]


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: _plain(getattr(value, field.name))
                for field in dataclasses.fields(value)}
    if isinstance(value, dict):
        return {str(name): _plain(item) for name, item in sorted(value.items())}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, np.ndarray):
        return hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Path):
        return str(value)
    return value


def key_of(*parts: Any) -> str:
    """Hash of parameters (data classes, dictionaries, arrays, numbers, strings), 32 hex digits."""
    text = json.dumps([__version__, *(_plain(part) for part in parts)], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:32]
