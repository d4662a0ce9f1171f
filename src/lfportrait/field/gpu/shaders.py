"""Shader sources: WGSL files of this package and others, put together."""

from __future__ import annotations

import functools
from importlib import resources

__all__ = ["shader"]


@functools.cache
def shader(*files: str) -> str:
    """Sources one after the other: WGSL has no include.

    Parameters
    ----------
    files
        ``"package/file.wgsl"`` below `lfportrait`.
    """
    texts = []
    for file in files:
        package, _, name = file.rpartition("/")
        folder = resources.files("lfportrait." + package.replace("/", "."))
        texts.append((folder / name).read_text(encoding="utf-8"))
    return "\n".join(texts)
