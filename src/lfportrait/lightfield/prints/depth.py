"""The depth of a print: what is sharp, a head placed within it, and what an eye sees of it.

N pixels under a lens are N directions. From one to the next, a point at depth z moves by the width
of a lens where z = N t / n (t thickness, n refractive index of the sheet): the depth budget is
D = 2 N t / n, half of it in front of the paper. Heads are deeper: `fitted` flattens them by just so
much that all that is seen of them is sharp. Nothing before the paper may be cut by its edge.

Through each lens an eye sees one point of the strip of ink below it, and the whole lens in that
color: a view has as many columns as there are lenses. Some of the rows are enough for a small
picture.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import cv2
import numpy as np

from ...arrays import Float32, Float64, Int64, UInt8
from ...errors import UserError
from ...field import VoxelField
from ..coding import encode_rows, view_camera
from ..display import Display
from ..placement import DepthReport, EncodeConfig, Placement
from .sheet import PrintSheet, paper_size

_ROWS = 320  # Rows of the pictures in which visible depths are looked for.
_SOLID = 0.5  # Opacity from which on a pixel shows a surface.
_RIM = 0.012  # What is nearer to an edge than this share of the print's height touches it.
_STRAYS = 0.25  # Per cent of the visible pixels that may lie further in front or behind.
_TOLERATED = 0.05
"""Share of the depth in front of the paper that what touches an edge may come forward."""
_EDGES = ("top", "bottom", "left", "right")


@dataclass(frozen=True)
class PrintDepth:
    """Depths of a print and its head in millimetres, positive in front of the paper."""

    budget: float  # D = 2 N t / n.
    # front, back: Limits of what is sharp from the viewing distance.
    front: float
    back: float
    # head_front, head_back: The foremost and the hindmost of what is seen of the head.
    head_front: float
    head_back: float
    depth_scale: float  # The head's depth over its true depth.
    focus: float  # Where the head's middle lies.
    # Movement from one direction to the next, in lenses, of what moves most; up to 1 is sharp.
    parallax: float
    # Edges at which the head is cut in front of the paper, and how far it lies in front there.
    touching: dict[str, float]
    behind: float  # ``focus`` with which it is not.

    def figures(self) -> dict[str, Any]:
        """For ``--json``."""
        return {key: value for key, value in asdict(self).items()
                if not isinstance(value, float) or math.isfinite(value)}

    def lines(self) -> list[str]:
        """The report for people."""
        back = "any depth" if math.isinf(self.back) else f"{-self.back:.1f} mm"
        lines = [f"sharp: {self.front:.1f} mm in front of the paper to {back} behind it "
                 f"(2 N t / n = {self.budget:.1f} mm)",
                 f"head: {_place(self.head_front)} to {_place(self.head_back)}, "
                 f"{100 * self.depth_scale:.1f} % of its true depth; from one direction to the "
                 f"next it moves by up to {self.parallax:.2f} lenses"]
        if self.parallax > 1.01:
            lines.append("more than one lens: its nearest or furthest parts blur (--relief 1 keeps "
                         "all of it sharp)")
        return lines

    def warning(self) -> str:
        """What is wrong at the edges; empty if nothing is."""
        if not self.touching:
            return ""
        edges = " and ".join(f"the {edge} edge {depth:.1f} mm" for edge, depth in
                             self.touching.items())
        return (f"the head is cut at {edges} in front of the paper, which eyes do not believe: "
                f"move it back with --focus {self.behind:.1f}, or make it smaller (--head)")


def _place(z: float) -> str:
    return f"{abs(z):.1f} mm {'in front' if z >= 0 else 'behind'}"


@dataclass(frozen=True)
class _Visible:
    """Depths of what is seen, in world units before the head's middle.

    ``rims`` holds the foremost of what touches each edge, minus infinity where nothing does.
    """

    low: float
    high: float
    rims: dict[str, float]


def _config(sheet: PrintSheet, depth_scale: float, focus: float) -> EncodeConfig:
    """How the page is coded; its unit is half the page's height, not the finished print's."""
    config, display = sheet.config, sheet.display
    wide, high = paper_size(config.size)
    part = 0.5 * high / sheet.half_height
    # Narrow panels get a smaller head (`Placement.of`): by the finished print, not by the page.
    narrow = min(1.0, 1.15 * wide / high) / min(1.0, 1.15 * display.aspect)
    return EncodeConfig(
        size=config.head * part * narrow, shift_x=config.shift_x * part,
        shift_y=config.shift_y * part, focus=focus / sheet.half_height, turn=config.turn,
        depth_scale=depth_scale, blend=config.blend, background=config.background)


def _visible(field: VoxelField, sheet: PrintSheet) -> _Visible:
    """Depths that the middle and the outermost eyes see within the finished print."""
    # Flat, for rays nearly as the print's own.
    coding = _config(sheet, 0.1, 0.0)
    placement = Placement.of(sheet.display, coding)
    outwards = placement.to_world[:, 2]
    trim, across = sheet.trim, _ROWS / sheet.display.height
    rows = slice(round(trim.top * across), round(trim.bottom * across))
    columns = slice(round(trim.left * across), round(trim.right * across))
    rim = max(1, round(_RIM * (rows.stop - rows.start)))
    depths, rims = [], dict.fromkeys(_EDGES, -math.inf)
    for eye in (-0.9 * sheet.display.eye_reach, 0.0, 0.9 * sheet.display.eye_reach):
        camera = view_camera(sheet.display, coding, eye, height=_ROWS,
                             width=max(1, round(_ROWS * sheet.display.aspect)))
        rendering = field.render(camera, 0)
        points = rendering.points(camera, 0)[rows, columns]
        z = np.where(rendering.alpha[rows, columns] > _SOLID, points @ outwards, np.nan)
        depths.append(z[np.isfinite(z)])
        for edge, strip in zip(_EDGES, (z[:rim], z[-rim:], z[:, :rim], z[:, -rim:]), strict=True):
            if np.isfinite(strip).any():
                rims[edge] = max(rims[edge], float(np.nanmax(strip)))
    seen = np.concatenate(depths)
    if not len(seen):
        raise UserError("nothing of the head is seen on the print: check --head, --shift-x and "
                        "--shift-y")
    low, high = np.percentile(seen, (_STRAYS, 100 - _STRAYS))
    # What touches an edge is no stray: it must not come forward.
    high = max(float(high), float(low) + 1e-3, *rims.values())
    return _Visible(float(low), high, rims)


def fitted(field: VoxelField, sheet: PrintSheet) -> tuple[EncodeConfig, PrintDepth]:
    """Place a head on a print, within the depth that its sheet shows sharply.

    Returns how to code the page (`sheet.display`), and the depth that comes of it.
    """
    config, unit = sheet.config, sheet.half_height
    seen = _visible(field, sheet)
    scale = Placement.of(sheet.display, _config(sheet, 1.0, 0.0)).scale * unit
    report = DepthReport.of(sheet.display, views=sheet.pixels_per_lens)
    half = 0.5 * sheet.depth_budget
    front, back = min(report.front * unit, half), max(report.back * unit, -half)
    # The paper's place in the head: so that front and back use up their budgets alike, but not
    # behind what touches an edge.
    plane = (front * seen.low - back * seen.high) / (front - back)
    plane = max(plane, *seen.rims.values())
    if config.depth_scale is not None:
        depth_scale = config.depth_scale
    else:
        room = min(front / max(seen.high - plane, 1e-6), -back / max(plane - seen.low, 1e-6))
        depth_scale = min(config.relief * room / scale, 1.0)
        if depth_scale < 0.01:
            raise UserError(f"this sheet shows a depth of {sheet.depth_budget:.1f} mm, in which "
                            "so large a head would be flat: print it smaller, with a higher "
                            "--dpi or fewer --lpi, or give --depth-scale")
    depth = scale * depth_scale
    focus = -depth * plane if config.focus is None else config.focus
    ends = depth * seen.high + focus, depth * seen.low + focus
    step = 2.0 * sheet.display.eye_reach * unit / sheet.pixels_per_lens
    lens = sheet.display.pitch / 3.0 / config.dpi * 25.4
    parallax = max(step * abs(z) / max(sheet.distance - z, 1e-3) / lens for z in ends)
    forward = {edge: depth * z + focus for edge, z in seen.rims.items()}
    touching = {edge: z for edge, z in forward.items() if z > _TOLERATED * front}
    behind = focus - max(0.0, *forward.values())
    return _config(sheet, depth_scale, focus), PrintDepth(
        sheet.depth_budget, front, back, *ends, depth_scale, focus, parallax, touching, behind)


def through_lenses(coded: UInt8, display: Display, eye: float, rows: Int64 | None = None, *,
                   distance: float | None = None) -> Float32:
    """The color of each lens to an eye, float32 [h, lenses, 3] in [0, 1], lenses from the left.

    Parameters
    ----------
    coded : Rows of a coded page, uint8 [h, W, 3].
    display : The lens sheet on the page. Where a page was coded for another pitch, as on test
        pages, that of the sheet that lies on it.
    eye, distance : x of the eye in half heights of the page; the viewing distance by default.
    rows : Which rows of the page they are, int64 [h]; by default the first ones.
    """
    lines = np.arange(len(coded)) if rows is None else np.asarray(rows)
    far = display.distance if distance is None else distance
    middle = _lens_middles(display, lines)
    x = display.aspect * (2.0 * (middle + 0.5) / display.width - 1.0)
    received = x + (eye - x) * display.distance / far
    share = np.mod(0.5 * (received / display.eye_reach + 1.0), 1.0)
    if display.inverted:
        share = 1.0 - share
    place = np.clip(middle + (share - 0.5) * display.pitch / 3.0, 0, display.width - 1)
    column = np.minimum(place.astype(np.int64), max(display.width - 2, 0))
    part = (place - column)[..., None].astype(np.float32)
    light = ((np.arange(256) / 255.0) ** display.gamma).astype(np.float32)
    across = np.arange(len(coded))[:, None]
    after = np.minimum(column + 1, display.width - 1)
    mixed = (1 - part) * light[coded[across, column]] + part * light[coded[across, after]]
    return np.asarray(mixed ** np.float32(1.0 / display.gamma), np.float32)


def _lens_middles(display: Display, rows: Int64) -> Float64:
    """Column of the middle of each lens, float64 [rows, lenses], from lens to lens a pitch on."""
    lens = display.pitch / 3.0
    # Of the lens in the page's middle; phase is half a pitch there.
    centre = 0.5 * (display.width - 1)
    phase = 3.0 * centre + rows * display.shift + display.offset
    first = centre + (0.5 * display.pitch - np.mod(phase, display.pitch)) / 3.0
    count = int(0.5 * display.width / lens)
    return np.asarray(first[:, None] + lens * np.arange(-count, count + 1))


@dataclass(frozen=True)
class SheetView:
    """A small copy of a print under its lenses: every n-th row, in full width.

    Attributes
    ----------
    sheet : The page.
    rows : Which rows, int64 [h].
    coded : uint8 [h, W, 3].
    """

    sheet: PrintSheet
    rows: Int64
    coded: UInt8

    @staticmethod
    def of(field: VoxelField, sheet: PrintSheet, config: EncodeConfig | None = None,
           height: int = 960) -> SheetView:
        """Code about ``height`` rows of the finished print.

        Parameters
        ----------
        field, sheet : As for `write_print`.
        config : How to place and code the head; by default as `write_print` does.
        height : About as many rows are coded.
        """
        config = config or fitted(field, sheet)[0]
        trim = sheet.trim
        apart = max(1, trim.height // height)
        rows = np.arange(trim.top, trim.bottom, apart)
        coded = encode_rows(field, sheet.display, config, int(rows[0]), len(rows), apart)
        return SheetView(sheet, rows, coded)

    def picture(self, eye: float) -> Float32:
        """The finished print to an eye at a share of the viewing angle, -0.5 (left) to 0.5.

        Returns
        -------
        picture : float32 [h, w, 3] in [0, 1].
        """
        display, trim = self.sheet.display, self.sheet.trim
        x = display.distance * math.tan(math.radians(display.cone) * eye)
        seen = through_lenses(self.coded, display, x, self.rows)
        middle = _lens_middles(display, self.rows)
        width = max(1, round(len(self.rows) * trim.width / trim.height))
        wanted = trim.left + (np.arange(width) + 0.5) * trim.width / width - 0.5
        lens = ((wanted[None] - middle[:, :1]) / (display.pitch / 3.0)).astype(np.float32)
        line = np.broadcast_to(np.arange(len(self.rows), dtype=np.float32)[:, None], lens.shape)
        return np.asarray(cv2.remap(seen, lens, np.ascontiguousarray(line), cv2.INTER_LINEAR,
                                    borderMode=cv2.BORDER_REPLICATE), np.float32)

    def sweep(self, frames: int = 90) -> Iterator[Float32]:
        """Pictures [H, W, 3] of an eye that moves through 0.9 of the viewing angle and back."""
        for turn in np.arange(frames) * 2 * math.pi / frames:
            yield self.picture(0.45 * math.sin(turn))
