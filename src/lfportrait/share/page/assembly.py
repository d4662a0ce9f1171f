"""The page's file: poster, caption, script and data in one HTML text; shown, and colored again.

The poster is what a page shows at first: the front view, framed like the live one. The page draws
the picture as a plane behind the head (`web/ground.glsl`); the color is that of the page where
nothing is drawn.

A page keeps the rows of the lattice, and the texels of the surface, that its own colors need. What
is painted of the same field, in another mix, has a color at each of them. So only colors are sent:
no mask, no densities, no charts.

`serve_page` shows a page in the browser: on the loopback address, to this machine alone.
"""

from __future__ import annotations

import base64
import html
import json
import re
import time
import warnings
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from ... import lightfield
from ...arrays import Bool, UInt8
from ...browsing import open_browser
from ...capture import Camera
from ...color import to_uint8
from ...errors import UserError
from ...field import C0, Backdrop, VoxelField
from ...files import image_bytes, script_json, script_streams, write_bytes
from ...lightfield import Display, EncodeConfig
from ...version import __version__
from ..kinds import PageConfig
from ..video import DISTANCE, head_extent
from .packing import ColorSet, Lattice, PageTexture, code_values, color_sets, fit, texel_values

_HEIGHT = 1000
_MARGIN = 1.04


def start_view(voxels: VoxelField) -> dict[str, Any]:
    """Where the page's camera stands at first.

    ``target`` [3]; ``distance`` from it, in world units; ``reach`` and ``half``: half width and
    half height of what must fit into the window.
    """
    reach, low, high = head_extent(voxels)
    return {"target": [0.0, (low + high) / 2, 0.0], "distance": DISTANCE,
            "reach": _MARGIN * reach, "half": _MARGIN * (high - low) / 2}


def poster(voxels: VoxelField, start: dict[str, Any]) -> bytes:
    """The front view on a clear ground, as WebP."""
    near = np.sqrt(start["distance"] ** 2 - start["reach"] ** 2)
    focal = 0.5 * _HEIGHT * near / start["half"]
    width = max(2, round(_HEIGHT * start["reach"] / start["half"]))
    size = max(_HEIGHT, width)
    camera = Camera.arc(np.zeros(1), distance=start["distance"], width=size, height=size,
                        focal=focal, target=tuple(start["target"]))
    seen = next(lightfield.render_views(voxels, camera, background=0.0))
    alpha = np.clip(seen.alpha, 0.0, 1.0)[..., None]
    color = np.clip(seen.color / np.maximum(alpha, 1e-6), 0.0, 1.0)
    picture = to_uint8(np.concatenate([color, alpha], axis=2))
    top, left = (size - _HEIGHT) // 2, (size - width) // 2
    return _webp(picture[top:top + _HEIGHT, left:left + width], 82)


def _webp(picture: UInt8, quality: int) -> bytes:
    return image_bytes(picture, "WEBP", quality=quality, method=2)


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode()


_LONGEST = 720  # Pixels of the picture's longer side: a ground is soft, and lies behind.
_QUALITY = 78

_DARK, _LIGHT = 0.16, 0.88
"""Luma of a page's ground, at most and at least: its text must stay legible."""


@dataclass(frozen=True)
class PageGround:
    """A page's ground."""

    # For the page's script: ``picture``, a WebP as an address; ``left``, ``top``, ``width`` and
    # ``height`` in world units; ``depth``, how far it lies behind the head's middle; and for panels
    # ``back``, where the head's back is in the world, ``behind``, how far behind that the ground
    # lies in half panel heights, and ``blur`` (`EncodeConfig`).
    header: dict[str, Any]
    drop: Backdrop  # What it was made from.

    @property
    def size(self) -> int:
        """Bytes in the page."""
        return len(self.header["picture"])

    @staticmethod
    def of(voxels: VoxelField, config: EncodeConfig) -> PageGround | None:
        """What panels show behind a field; None where that is a grey level."""
        drop = lightfield.backdrop_of(voxels, config)
        if drop is None:
            return None
        longest = max(drop.picture.shape[:2])
        plane = lightfield.world_ground(voxels, config, max(longest / _LONGEST, 1.0) / drop.pixels)
        assert plane is not None
        picture = np.clip(plane.planes.transpose(1, 2, 0) + 0.5, 0, 255).astype(np.uint8)
        across, down = plane.texel
        return PageGround({
            "picture": "data:image/webp;base64," + _base64(_webp(picture, _QUALITY)),
            "left": round(plane.left - across / 2, 5), "top": round(plane.top + down / 2, 5),
            "width": round(across * picture.shape[1], 5),
            "height": round(down * picture.shape[0], 5), "depth": round(plane.depth, 5),
            "back": round(config.ground_depth / EncodeConfig.size - plane.depth, 5),
            "behind": config.ground_depth, "blur": config.ground_blur}, drop)


def ground_style(backdrop: Backdrop | None) -> tuple[str, bool]:
    """Style sheet of a page's ground, and whether the page begins with a light one.

    A painted ground that is dark takes the place of the page's dark one, a light one that of its
    light one: the other can be chosen as before. Without a painted ground the style is empty.
    """
    if backdrop is None:
        return "", False
    color = backdrop.color
    luma = float(color @ [0.299, 0.587, 0.114])
    light = luma > 0.5
    if light:
        ground = 1 - (1 - color) * min(1.0, (1 - _LIGHT) / max(1 - luma, 1e-3))
        glow = 1 - (1 - ground) * 0.4
    else:
        ground = color * min(1.0, _DARK / max(luma, 1e-3))
        glow = np.clip(1.6 * ground + 0.02, 0, 1)
    chosen = '[data-ground="light"]' if light else ':not([data-ground="light"])'
    return f"\n:root{chosen} {{ --ground: {_hex(ground)}; --glow: {_hex(glow)}; }}\n", light


def _hex(color: np.ndarray) -> str:
    """A color in [0, 1] for a style sheet."""
    return "#" + "".join(f"{round(255 * float(value)):02x}" for value in color)


_HEADER = re.compile(rb'<script type="application/json" id="portrait">(.*?)</script>', re.DOTALL)
_STREAM = re.compile(rb'<script type="application/octet-stream" data-stream="(mask|texels)">'
                     rb"([A-Za-z0-9+/=]*)</script>")


@dataclass(frozen=True)
class OpenPage:
    """What of a page other colors must fit to."""

    filled: Bool  # bool [Z, Y, X], the lattice points that it keeps.
    # bool [H, W], the texels that it keeps, or None where it has no texture.
    kept: Bool | None = field(default=None, repr=False)
    pixels: float = 0.0  # Texels per world unit; 0 without a texture.

    @staticmethod
    def of(page: bytes) -> OpenPage:
        """Read a page that `write_page` wrote."""
        found = _HEADER.search(page)
        streams = dict(_STREAM.findall(page))
        if found is None or b"mask" not in streams:
            raise UserError("this file is no page of a portrait; write it again")
        header = json.loads(found[1])
        texture = header.get("texture")
        if not texture:
            return OpenPage(_bits(streams[b"mask"], header["shape"]))
        height, _, width = texture["shape"]
        return OpenPage(_bits(streams[b"mask"], header["shape"]),
                        _bits(streams[b"texels"], (height, width)), float(texture["pixels"]))


def _bits(text: bytes, shape: Any) -> Bool:
    bits = np.unpackbits(np.frombuffer(zlib.decompress(base64.b64decode(text)), np.uint8))
    return bits[:int(np.prod(shape))].astype(np.bool_).reshape(shape)


def recolored(page: OpenPage, voxels: VoxelField) -> dict[str, Any] | None:
    """The colors of a page's field, as ``voxels`` has them, as a further color set of the page.

    Those seen from the front, of degree 0. ``bands`` as in the page's header; ``streams``: the
    band's residuals by its number; ``texels``: those of the texture, or None. Streams are deflated,
    in base64. None where the page does not hold the field row by row, as its size did not allow it.
    """
    if page.filled.shape != voxels.links.shape:
        return None
    rows = voxels.links[page.filled]
    if (rows < 0).any():
        return None
    levels = to_uint8(voxels.sh[rows][:, (1, 0, 2), 0] * np.float32(C0) + np.float32(0.5))
    stream, _ = code_values(page.filled, levels, np.zeros(len(levels), np.uint8))
    return {"bands": [{"low": 0.0, "high": 1.0}], "streams": {"0": _base64(stream)},
            "texels": _texels(page, voxels)}


def _texels(page: OpenPage, voxels: VoxelField) -> str | None:
    """The texture's stream, in the page's atlas and at its resolution."""
    if page.kept is None or voxels.texture is None:
        return None
    voxel = float((2.0 * voxels.radius / voxels.links.shape[::-1]).mean())
    colors = ColorSet("", "mix", voxels.sh, voxels.texture.texels)
    texture = PageTexture.of(voxels.texture, [colors], voxels.lattice_points(), 1.8 * voxel)
    for _ in range(round(np.log2(texture.pixels / page.pixels))):
        texture = texture.halved()
    [texels] = texture.texels
    if texels is None or texels.shape[:2] != page.kept.shape:
        return None
    values = texel_values(texels, page.kept)
    stream, _ = code_values(page.kept[:, None], values, np.zeros(len(values), np.uint8))
    return _base64(stream)


class _Handler(BaseHTTPRequestHandler):
    """Answers every request with one file, without logging."""

    def __init__(self, page: Path, *arguments: object) -> None:
        self.page = page
        super().__init__(*arguments)  # type: ignore[arg-type]

    def do_GET(self) -> None:
        """Send the page, or that there is nothing else."""
        # A page of another site that has its name point here must not read the portrait.
        name = self.headers.get("Host", "").rsplit(":", 1)[0].lower()
        if name not in ("127.0.0.1", "localhost"):
            self.send_error(403)
            return
        if self.path.split("?")[0] not in ("/", "/portrait.html"):
            self.send_error(404)
            return
        data = self.page.read_bytes()
        self.send_response(200)
        self.send_header("Content-Type", "text/html; charset=utf-8")
        self.send_header("Content-Length", str(len(data)))
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        self.wfile.write(data)

    def log_message(self, *_: object) -> None:
        """Keep still."""


def serve_page(page: str | Path, port: int = 0, *, browse: bool = True,
               ready: Callable[[str, Callable[[], None]], None] | None = None) -> None:
    """Serve a page's file until interrupted, on the loopback address; port 0 takes a free one.

    ``ready`` is called with the address, and with what ends the serving, once it can be reached.
    """
    try:
        server = ThreadingHTTPServer(("127.0.0.1", port), partial(_Handler, Path(page)))
    except (OSError, OverflowError) as error:
        raise UserError(f"can't serve on port {port}: {error}; choose another --port") from error
    address = f"http://127.0.0.1:{server.server_address[1]}/"
    with server:
        if ready is not None:
            ready(address, server.shutdown)
        if browse:
            open_browser(address)
        server.serve_forever()


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
    voxels : The field. A `StyledField` brings a slider from photo to painting, and buttons for
        its styles.
    path : File, ending in ``.html``.
    config : Caption and size.
    ground : What is behind the head; by default the painted ground, if the field has one.

    Returns
    -------
    figures : ``bytes`` of the file, and those of its parts; ``rows`` and ``shape`` of what it
        holds, ``texture``: rows and columns of its atlas, or None; ``sets`` of colors,
        ``seconds``.

    Raises
    ------
    UserError : If the field is empty, does not fit into the size, or a parameter is out of
        range.
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
    names = [each.name or each.kind for each in sets]
    styles = [each.name for each in sets if each.kind in ("style", "mix")]
    del sets, surface  # all of the colors, which lattice and texture hold as bytes now
    script, style = page_script(), _text("page.css")
    plane = PageGround.of(voxels, ground or EncodeConfig())
    tint, light = ground_style(plane.drop if plane else None)
    fixed = len(script) + len(style) + len(picture) * 4 // 3 + 20_000 + (plane.size if plane else 0)
    packed = fit(lattice, config.max_size * 1e6 - fixed, texture)
    header = {**packed.header, "start": view, "displays": _presets(),
              "quilts": lightfield.customary_views(), "version": __version__,
              **({"ground": plane.header} if plane else {})}
    cone = config.cone or voxels.cone
    if 0 < cone < 360:
        header["start"] = {**view, "limit": np.radians(cone) / 2}
    title = config.title or "Portrait"
    after = config.artist or ", ".join(styles)
    about = f"{title}, a portrait in three dimensions." + (f" {after}." if after else "")
    parts = {
        "title": html.escape(title), "caption": "".join(
            f"<p>{html.escape(line)}</p>" for line in (after, config.date) if line),
        "style": style + tint,
        "description": html.escape(about), "script": script, "header": script_json(header),
        "poster": "data:image/webp;base64," + _base64(picture),
        "streams": script_streams(packed.streams)}
    # One pass: what is put in may itself hold such a mark.
    text = _text("page.html")
    if light:
        text = text.replace('data-ground="dark"', 'data-ground="light"').replace(
            'aria-label="Light ground" aria-pressed="false"',
            'aria-label="Light ground" aria-pressed="true"')
    page = re.sub("@([a-z]+)@", lambda mark: parts[mark[1]], text).encode()
    write_bytes(path, page)
    return {"bytes": len(page), "script_bytes": len(script), "poster_bytes": len(picture),
            "ground_bytes": plane.size if plane else 0,
            "stream_bytes": {name: len(data) for name, data in packed.streams.items()},
            "rows": packed.header["rows"], "shape": packed.header["shape"],
            "texture": packed.header["texture"]["shape"][::2] if texture else None,
            "sets": names,
            "seconds": round(time.perf_counter() - start, 3)}
