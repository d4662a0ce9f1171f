"""Looking Glass Studio's packages (.hop): a zip with the quilt and its settings."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

from ...files import atomic_write
from ...lightfield import QuiltLayout
from .metadata import quilt_settings

__all__ = ["write_hop"]


def write_hop(path: Path, media: str, contents: bytes | Path, layout: QuiltLayout, *,
              movie: bool = False) -> dict[str, Any]:
    """Write a package.

    Parameters
    ----------
    path
        The package.
    media
        Name of the quilt in it; its settings lie beside it as ``MEDIA.json``.
    contents
        The quilt, as a file's contents or a file.
    layout
        The quilt's layout.
    movie
        Whether it is a video.

    Returns
    -------
    figures
        ``bytes`` of the package.
    """
    settings = json.dumps(quilt_settings(layout, movie=movie), indent=1) + "\n"
    with atomic_write(path) as stream, zipfile.ZipFile(stream, "w") as package:
        # Entries without a time of writing: the same quilt gives the same bytes. Pictures and
        # videos are small already, and are only stored.
        entry = zipfile.ZipInfo(media)
        entry.external_attr = 0o644 << 16
        if isinstance(contents, Path):
            with package.open(entry, "w", force_zip64=True) as target, open(contents, "rb") as file:
                while block := file.read(1 << 20):
                    target.write(block)
        else:
            package.writestr(entry, contents)
        side = zipfile.ZipInfo(f"{media}.json")
        side.external_attr = 0o644 << 16
        package.writestr(side, settings, zipfile.ZIP_DEFLATED)
    return {"bytes": path.stat().st_size}
