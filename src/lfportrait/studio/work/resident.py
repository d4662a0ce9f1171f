"""The process that answers at once: previews, viewers, faces, regions, what an eye sees.

It gets ``(number, name, facts)`` and answers ``(number, "ok", result)`` or, of an error, ``(number,
code, text)``, one after the other. It imports what takes long when it starts, before anybody asks.
"""

from __future__ import annotations

import io
import time
import traceback
import warnings
from collections.abc import Callable, Mapping
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from ...arrays import UInt8
from ...errors import UserError
from ...files import atomic_path, write_json
from ...lightfield import (
    DepthReport,
    Display,
    EncodeConfig,
    ViewMask,
    composed,
    encode,
    layout_of_file,
    pattern,
    simulate,
    write_coded,
)
from ...lightfield.screens import Bridge
from ...runner import Pipe
from ...share import OpenPage, PageConfig, recolored, write_page
from ...stylize import StyledField
from ..answers import failed
from ..styles import write_picture
from .paintings import PAINTING_ANSWERS
from .sitting import Look, Sitting

__all__ = ["serve"]

Facts = Mapping[str, Any]
_BRIDGE = 3.0
"""Seconds that Bridge has to answer."""


def jpeg(image: UInt8, quality: int = 88) -> bytes:
    """A picture as JPEG."""
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, "JPEG", quality=quality)
    return buffer.getvalue()


class _Resident:
    """What the process knows."""

    def __init__(self) -> None:
        self.sitting = Sitting()
        self._coded: tuple[str, UInt8] | None = None

    def preview(self, facts: Facts) -> dict[str, Any]:
        """A picture of a look, JPEG."""
        begun, look = time.perf_counter(), Look(facts["look"])
        image = self.sitting.picture(look, facts["cameras"], int(facts["size"]))
        data = jpeg(image)
        if facts.get("keep"):
            with atomic_path(facts["keep"]) as temporary:
                temporary.write_bytes(data)
        return {"picture": data, "key": look.key(), "seconds": time.perf_counter() - begun}

    def warm(self, facts: Facts) -> dict[str, Any]:
        """Read a head before it is asked for."""
        session = self.sitting.session(Path(facts["job"]))
        session.skin(float(facts.get("pixels") or session.config.pixels))
        return {}

    def viewer(self, facts: Facts) -> dict[str, Any]:
        """Write the page of a look, for an iframe; what is in it."""
        look = Look(facts["look"])
        target = Path(facts["folder"]) / f"{look.key()}.html"
        beside = target.with_suffix(".json")
        if not (target.is_file() and beside.is_file()):
            field = self.sitting.field(look)
            figures = write_page(field, target, PageConfig(title=facts.get("title", "")))
            about: dict[str, Any] = {"sets": figures["sets"], "styles": [], "regions": []}
            if isinstance(field, StyledField):
                about |= {"styles": list(field.styles), "regions": list(field.regions)}
            write_json(beside, about)
        return {"key": look.key()}

    def colors(self, facts: Facts) -> dict[str, Any]:
        """Further color sets for a page that is open."""
        page = OpenPage.of(Path(facts["page"]).read_bytes())
        sets = [recolored(page, self.sitting.field(Look(look))) for look in facts["looks"]]
        return {"sets": None if None in sets else sets}

    def _placed(self, facts: Facts) -> tuple[Any, Display, EncodeConfig]:
        field = self.sitting.on_panel(Look(facts["look"]))
        panel = Display.resolve(facts["display"])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the report says it
            return field, panel, composed(field, panel, EncodeConfig(**facts["placement"]))

    def budget(self, facts: Facts) -> dict[str, Any]:
        """The panel's depth budget for a head as it is placed."""
        _, panel, config = self._placed(facts)
        report = DepthReport.of(panel, config)
        return {"lines": report.lines(), "figures": report.figures(),
                "sharp": [report.back if np.isfinite(report.back) else None, report.front],
                "head": [report.head_back, report.head_front],
                "placement": {name: getattr(config, name) for name in (
                    "size", "shift_x", "shift_y", "focus", "depth_scale")}}

    def coded(self, facts: Facts) -> UInt8:
        """A look, coded for a panel; the last one is kept."""
        look = Look(facts["look"])
        field, panel, config = self._placed(facts)
        key = repr((look.key(), panel, config))
        if self._coded is None or self._coded[0] != key:
            self._coded = key, encode(field, panel, config, mask=ViewMask.build(panel))
        return self._coded[1]

    def eye(self, facts: Facts) -> dict[str, Any]:
        """What an eye in front of the panel sees, JPEG."""
        image, panel = self.coded(facts), Display.resolve(facts["display"])
        block = max(1, round(panel.width / int(facts["width"])))
        seen = simulate(image, panel, facts["eye"], crosstalk=facts["crosstalk"], block=block)
        return {"picture": jpeg(np.asarray(np.clip(seen, 0, 1) * 255 + 0.5, np.uint8))}

    def full(self, facts: Facts) -> dict[str, Any]:
        """Write the coded picture for the panel's own window."""
        panel = Display.resolve(facts["display"])
        write_coded(Path(facts["file"]), self.coded(facts), panel)
        return {}

    def pattern(self, facts: Facts) -> dict[str, Any]:
        """Write a test pattern."""
        panel = Display.resolve(facts["display"])
        write_coded(Path(facts["file"]), pattern(panel, facts["kind"]), panel)
        return {}

    def bridge(self, facts: Facts) -> dict[str, Any]:
        """The displays that Looking Glass Bridge on this machine reports."""
        try:
            with Bridge(timeout=_BRIDGE) as bridge:
                version = bridge.version()
                devices = [one for one in bridge.devices() if one.looking_glass]
        except UserError as error:
            return {"running": False, "version": "", "displays": [], "message": str(error)}
        return {"running": True, "version": version, "message": "", "displays": [
            {"index": one.index, "name": one.name, "display": asdict(one.display())}
            for one in devices]}

    def cast(self, facts: Facts) -> dict[str, Any]:
        """Show a quilt by Bridge."""
        path = Path(facts["file"])
        layout = layout_of_file(path)
        if layout is None:
            raise UserError(f"{path.name} is no quilt; export the version as a quilt first")
        with Bridge(timeout=_BRIDGE) as bridge:
            device = bridge.device(int(facts["screen"]))
            bridge.cast(path, layout, screen=device.index)
        return {"ok": True, "screen": device.index}

    def style_picture(self, facts: Facts) -> dict[str, Any]:
        """Write the picture of a built-in style."""
        image = self.sitting.exemplar(str(facts["style"])).image
        write_picture(image, int(facts["size"]), Path(facts["file"]))
        return {}


def serve() -> None:
    """Answer until the pipe ends."""
    pipe = Pipe()
    resident = _Resident()
    own: dict[str, Callable[[Facts], dict[str, Any]]] = {
        name: getattr(resident, name) for name in (
            "preview", "warm", "viewer", "colors", "budget", "eye", "full", "pattern", "bridge",
            "cast", "style_picture")}
    for name, function in PAINTING_ANSWERS.items():
        own[name] = partial(function, resident.sitting)
    while True:
        number, name, facts = pipe.requests.get()
        try:
            pipe.tell(number, "ok", own[name](facts))
        except Exception as error:
            refusal = failed(error)
            if refusal.code == "internal":
                traceback.print_exc()
            pipe.tell(number, refusal.code, refusal.message)
