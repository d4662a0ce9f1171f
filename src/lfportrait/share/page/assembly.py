"""The page's file: poster, caption, script and data in one HTML text."""

from __future__ import annotations

import base64
import html
import json
import re
import time
import warnings
from dataclasses import fields, replace
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import UserError
from ...field import C0, VoxelField
from ...files import atomic_write
from ...lightfield import Display, EncodeConfig, customary_views
from ...version import __version__
from .budget import fit
from .colors import ColorSet, color_sets
from .config import PageConfig
from .ground import PageGround, ground_style
from .packing import Lattice
from .poster import poster, start_view
from .texels import PageTexture

__all__ = ["page_script", "write_page"]

_SCRIPTS = ("unpack", "bricks", "texels", "renderer", "camera", "displays", "panel", "ends",
            "viewer", "input", "interface", "panelmode", "main")
_ROUNDED = 1 / 255 / C0
"""Coefficients of degree 0 that are so near to each other are a level of an 8-bit picture apart, as
those of a file may be."""
_SHADERS = ("march", "texture", "ground", "view", "mixed", "panel")
_DISPLAY = ("name", "width", "height", "views", "pitch", "slant", "offset", "subpixels", "cone",
            "distance", "eye_height", "inverted", "flip_x", "flip_y", "cells", "cell_pattern",
            "gamma", "calibrated")


def _text(name: str) -> str:
    return (resources.files(__package__) / "web" / name).read_text(encoding="utf-8")


def page_script() -> str:
    """The page's script: its files and shaders, joined into one function."""
    shaders = {name: _text(f"{name}.glsl") for name in _SHADERS}
    parts = [f"const SHADERS = {json.dumps(shaders, indent=1)};\n",
             *(_text(f"{name}.js") for name in _SCRIPTS)]
    return '(() => {\n"use strict";\n' + "\n".join(parts) + "})();\n"


def _presets() -> list[dict[str, Any]]:
    """The displays that ship with us, without what is as usual."""
    usual = {entry.name: entry.default for entry in fields(Display)}
    found = []
    for name in Display.names():
        panel = Display.preset(name)
        values = {key: getattr(panel, key) for key in _DISPLAY}
        found.append({key: value for key, value in values.items() if value != usual[key]})
    return found


def _json(data: Any) -> str:
    """JSON that can stand in a script element: no ``</script>`` ends it early."""
    return json.dumps(data, separators=(",", ":"), ensure_ascii=False).replace("<", "\\u003c")


def _caption(config: PageConfig, styles: list[str]) -> str:
    lines = [config.artist or ", ".join(styles), config.date]
    return "".join(f"<p>{html.escape(line)}</p>" for line in lines if line)


def _at_first(voxels: VoxelField, sets: list[ColorSet]) -> VoxelField:
    """The field as a page begins with it: in its first colors, without a room."""
    shown = next((each for each in sets if each.kind != "photo"), sets[0])
    texture = None
    if voxels.texture is not None and shown.texels is not None:
        texture = voxels.texture.with_texels(shown.texels)
    same = texture is None or (voxels.texture is not None and np.array_equal(
        texture.texels, voxels.texture.texels))
    if same and shown.sh.shape == voxels.sh.shape and (
            np.abs(shown.sh - voxels.sh).max(initial=0) < _ROUNDED):
        # What is shown already may be laid out already.
        first = replace(voxels.with_sh(voxels.sh), texture=texture, background=None)
        first.take_layouts(voxels)
        return first
    return replace(voxels.with_sh(shown.sh), texture=texture, background=None)


def write_page(voxels: VoxelField, path: str | Path, config: PageConfig | None = None,
               ground: EncodeConfig | None = None) -> dict[str, Any]:
    """Write a page that shows a field.

    Parameters
    ----------
    voxels
        The field. A `StyledField` brings a slider from photo to painting, and buttons for its
        styles.
    path
        File, ending in ``.html``.
    config
        Caption and size.
    ground
        What is behind the head; by default the painted ground, if the field has one.

    Returns
    -------
    figures
        ``bytes`` of the file, and those of its parts; ``rows`` and ``shape`` of what it holds,
        ``texture``: rows and columns of its atlas, or None; ``sets`` of colors, ``seconds``.

    Raises
    ------
    UserError
        If the field is empty, does not fit into the size, or a parameter is out of range.
    """
    config = config or PageConfig()
    if not 0.1 <= config.max_size <= 1000:
        raise UserError(f"--max-size must be 0.1 to 1000 MB, not {config.max_size:g}")
    if not 0 <= config.cone <= 360:
        raise UserError(f"--cone must be 0 to 360 degrees, not {config.cone:g}")
    start = time.perf_counter()
    if voxels.background is not None:
        warnings.warn("a page shows only the head, on a plain background: the room that this field "
                      "contains is left out", stacklevel=2)
    sets = color_sets(voxels, config.sh)
    surface = voxels.texture if any(each.texels is not None for each in sets) else None
    lattice = Lattice.of(voxels.links, voxels.density, sets, voxels.center, voxels.radius,
                         None if surface is None else surface.charts)
    texture = None if surface is None else PageTexture.of(
        surface, sets, voxels.lattice_points(), 1.8 * lattice.voxel)
    view = start_view(voxels)
    picture = poster(_at_first(voxels, sets), view)
    script, style = page_script(), _text("page.css")
    plane = PageGround.of(voxels, ground or EncodeConfig())
    tint, light = ground_style(plane.drop if plane else None)
    fixed = len(script) + len(style) + len(picture) * 4 // 3 + 20_000 + (plane.size if plane else 0)
    packed = fit(lattice, config.max_size * 1e6 - fixed, texture)
    header = {**packed.header, "start": view, "displays": _presets(),
              "quilts": customary_views(), "version": __version__,
              **({"ground": plane.header} if plane else {})}
    cone = config.cone or voxels.cone
    if 0 < cone < 360:
        header["start"] = {**view, "limit": np.radians(cone) / 2}
    title = config.title or "Portrait"
    styles = [each.name for each in sets if each.kind in ("style", "mix")]
    after = config.artist or ", ".join(styles)
    about = f"{title}, a portrait in three dimensions." + (f" {after}." if after else "")
    parts = {
        "title": html.escape(title), "caption": _caption(config, styles),
        "style": style + tint,
        "description": html.escape(about), "script": script, "header": _json(header),
        "poster": "data:image/webp;base64," + base64.b64encode(picture).decode(),
        "streams": "\n".join(
            f'<script type="application/octet-stream" data-stream="{name}">'
            f"{base64.b64encode(data).decode()}</script>"
            for name, data in packed.streams.items())}
    # One pass: what is put in may itself hold such a mark.
    text = _text("page.html")
    if light:
        text = text.replace('data-ground="dark"', 'data-ground="light"').replace(
            'aria-label="Light ground" aria-pressed="false"',
            'aria-label="Light ground" aria-pressed="true"')
    page = re.sub("@([a-z]+)@", lambda mark: parts[mark[1]], text).encode()
    with atomic_write(path) as stream:
        stream.write(page)
    return {"bytes": len(page), "script_bytes": len(script), "poster_bytes": len(picture),
            "ground_bytes": plane.size if plane else 0,
            "stream_bytes": {name: len(data) for name, data in packed.streams.items()},
            "rows": packed.header["rows"], "shape": packed.header["shape"],
            "texture": packed.header["texture"]["shape"][::2] if texture else None,
            "sets": [each.name or each.kind for each in sets],
            "seconds": round(time.perf_counter() - start, 3)}
