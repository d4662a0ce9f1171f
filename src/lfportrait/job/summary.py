"""The last stage of a job: page, sweep video and report.

The report shows the way from the photos to the coded picture: what was photographed and painted,
the field beside the truth, the guides and the transfer, the stylised views, the light field and
what the eyes see of it, and the figures of all stages.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import cv2
import numpy as np
from PIL import Image, ImageDraw

from ..arrays import Bool, Float32, Float64, UInt8
from ..capture import Camera, Capture
from ..color import to_uint8
from ..device import used_device
from ..example import Exemplar, Skin, SurfaceGuide, Transfer, TransferConfig
from ..field import Coverage, VoxelField
from ..files import write_image
from ..lightfield import Display, ViewMask, read_coded, render_views, simulate
from ..measure import give_back_memory, machine
from ..progress import Progress, note
from ..share import (
    Picture,
    Report,
    Section,
    Table,
    good_cone,
    sweep_cameras,
    sweep_frames,
    write_page,
    write_report,
    write_video,
)
from ..stylize import kept_skin, load_styled
from ..version import __version__
from .graph import MakeConfig, Task

_FRAMES = 90  # Of the sweep.
_ANGLES = (-45, 0, 45)
_COLUMN = 448  # The same in one of three columns.
_SHOWN = 640  # Width in pixels, about, at which the report shows a picture.
_FEW = np.array([(0.9, 0.2, 0.1), (1.0, 0.6, 0.1), (1.0, 0.75, 0.3), (0.3, 0.6, 1.0)])
"""Colors of places seen from none, one, two and more directions, which people with color
blindness can distinguish."""

_COLORS = {"skin": "beige", "hair": "brown", "neck": "pink", "ears": "orange", "clothes": "blue"}
_PALETTE = {"brows": (0.35, 0.2, 0.1), "eyes": (0.1, 0.6, 0.3), "nose": (0.95, 0.75, 0.5),
            "lips": (0.8, 0.15, 0.25), "skin": (0.96, 0.87, 0.72), "ears": (0.95, 0.6, 0.25),
            "hair": (0.5, 0.3, 0.15), "neck": (0.95, 0.72, 0.75), "clothes": (0.3, 0.5, 0.8)}
"""Colors of a surface's labels in the report."""


def share_job(task: Task, results: Path, exemplar: Exemplar, figures: dict[str, Any],
              progress: Progress | None = None, *,
              kept: Mapping[str, Any] = MappingProxyType({})) -> dict[str, Any]:
    """Write ``portrait.html``, ``sweep.mp4``, ``hero.png`` and ``report.html`` of a finished job.

    Parameters
    ----------
    task : What to write: its inputs are the capture, the field and the styled field, its folder
        holds ``lightfield.png``; its parameters are listed at the end of the report.
    results : Folder that the task's is relative to.
    figures : Figures of the stages so far.
    kept : What the stages before have read: `Tools.kept`.

    Returns
    -------
    figures : Size of the video and number of frames; the page's own; ``head_covered``, the share
        of the head that photos show well (`Coverage.share`).
    """
    folder, display, config = results / task.folder, task.display, task.config
    assert display is not None
    note(progress, "page, sweep and report")
    # Much of the work leaves a core idle: packing, coding the video, NumPy's loops.
    with ThreadPoolExecutor(2) as threads:
        loaded = threads.submit(load_styled, results / task.inputs["styled"], kept.get("styled"))
        taken = threads.submit(lambda: kept.get("capture") or Capture.load(
            results / task.inputs["capture"]))
        field = kept.get("field") or VoxelField.load(results / task.inputs["field"])
        styled, capture = loaded.result(), taken.result()
        # Worked out once, before several threads ask for it.
        styled.bricks, styled.stretches, styled.solid_extent  # noqa: B018
        give_back_memory()
        page = threads.submit(write_page, styled, folder / "portrait.html", config.page,
                              config.encode)
        film = threads.submit(
            write_video, folder / "sweep.mp4",
            sweep_frames(styled, good_cone(styled, display.cone), _FRAMES, config.sweep_size,
                         background=config.encode.background, ground=config.encode),
            preset="veryfast")
        report, share = _report(task, results, exemplar, figures, capture, field, styled,
                                kept.get("charts"))
        film.result()
        note(progress, "report")
        give_back_memory()
        write_report(folder / "report.html", report)
        return {"frames": _FRAMES, "size": config.sweep_size, "page": page.result(),
                "head_covered": round(share, 3)}


def _report(task: Task, results: Path, exemplar: Exemplar, figures: dict[str, Any],
            capture: Capture, field: VoxelField, styled: VoxelField, charts: list[Chart] | None,
            ) -> tuple[Report, float]:
    """Report of a field, and ``hero.png`` written; the share of the head that photos show well."""
    folder, display, config = results / task.folder, task.display, task.config
    assert display is not None
    cameras = sweep_cameras(90.0, 1, 480, styled)
    strip = _strip(styled, cameras, (-45, -22, 0, 22, 45), background=1.0)
    covered, share = _coverage_section(field, capture)
    give_back_memory()
    hero = np.concatenate(strip[1:4], axis=1)
    write_image(folder / "hero.png", hero)
    coded = read_coded(folder / "lightfield.png", display)
    return Report(
        title="A stylised portrait for a light-field display",
        subtitle=f"Exemplar {exemplar.name}, display {display.name}",
        hero=Picture(hero, "The stylised head from the left, the middle and the right"),
        key_figures=_key_figures(figures, display),
        sections=[
            _inputs(capture, exemplar),
            _field_section(field, capture),
            covered,
            _style_section(field, styled, capture, exemplar, results / task.inputs["field"], config,
                           charts),
            Section("Stylised views", "The optimised field; every view shows the same strokes.",
                    [Picture(image, f"{angle:+d} degrees", width=480)
                     for image, angle in zip(strip, (-45, -22, 0, 22, 45))], layout="strip"),
            Section("Sweep", "Over the display's view cone.", video=folder / "sweep.mp4"),
            _lightfield(coded, display),
            _figures(figures),
            Section("Parameters", "", tables=[Table(_parameters(config),
                                                    ("parameter", "value"))])]), share


def _strip(field: VoxelField, cameras: Camera, angles: tuple[int, ...], background: float,
           ) -> list[Float32]:
    """Renders from several yaw angles, framed like the first camera."""
    first = cameras[0]
    target = first.position[0] + first.pose[0, :3, 2] * float(
        np.linalg.norm(first.position[0][[0, 2]]))
    views = Camera.arc(np.array(angles, float), distance=float(
        np.linalg.norm(first.position[0] - target)), width=int(first.width[0]),
        height=int(first.height[0]), focal=float(first.focal[0, 0]), target=tuple(target))
    return [np.clip(seen.color, 0, 1) for seen in render_views(field, views, background=background)]


def _key_figures(figures: dict[str, Any], display: Display) -> list[tuple[str, str]]:
    rows = [("photos", str(figures.get("capture", {}).get("views", "")))]
    test = figures.get("reconstruct", {}).get("test")
    if test:
        rows.append(("held-out views", f"{test['psnr']:.1f} dB"))
    if "voxels" in figures.get("reconstruct", {}):
        rows.append(("voxels", f"{figures['reconstruct']['voxels'] / 1e6:.2f} M"))
    coded = figures.get("encode", {})
    if "subpixels" in coded:
        rows.append(("sub-pixels", f"{coded['subpixels'] / 1e6:.1f} M"))
        rows.append(("coded in", f"{coded['seconds']['cast']:.1f} s"))
    rows.append(("views", str(display.views)))
    return rows


def _with_points(image: UInt8, points: Float64) -> UInt8:
    """A picture with small marks at points [N, 2]."""
    picture = Image.fromarray(image.copy())
    draw = ImageDraw.Draw(picture)
    radius = max(1.5, max(image.shape[:2]) / 300)
    for x, y in points[np.isfinite(points).all(axis=1)]:
        draw.ellipse([x - radius, y - radius, x + radius, y + radius], fill=(0, 200, 80))
    return np.asarray(picture)


def _inputs(capture: Capture, exemplar: Exemplar) -> Section:
    chosen = np.unique(np.linspace(0, len(capture) - 1, 8).astype(int))
    pictures = [Picture(capture.image_float(int(view)), capture.names[view], width=300)
                for view in chosen]
    if capture.landmarks is not None:
        frontal = int(np.argmin(np.abs(np.arctan2(capture.cameras.position[:, 0],
                                                  capture.cameras.position[:, 2]))))
        pixels, _ = capture.cameras.project(capture.landmarks)
        image = to_uint8(capture.image_float(frontal))
        pictures.append(Picture(_with_points(image, pixels[frontal]), "landmarks, from 3D",
                                width=400))
    pictures.append(Picture(_with_points(exemplar.image, exemplar.landmarks),
                            f"exemplar {exemplar.name}", width=400))
    return Section("Photos and painting", f"{len(capture)} photos, "
                   f"{int(capture.held_out.sum())} of them held out for testing.", pictures,
                   layout="strip")


def _depth_picture(depth: Float32) -> Float32:
    """Depth as grey: near is light; nothing is black."""
    known = np.isfinite(depth)
    if not known.any():
        return np.zeros_like(depth)
    near, far = np.quantile(depth[known], [0.01, 0.99])
    shown = 1.0 - 0.85 * np.clip((depth - near) / max(far - near, 1e-6), 0, 1)
    return np.where(known, shown, 0.0).astype(np.float32)


def _field_section(field: VoxelField, capture: Capture) -> Section:
    tests = capture.testing() if len(capture.testing()) else capture.training()
    angle = np.abs(np.arctan2(capture.cameras.position[tests, 0],
                              capture.cameras.position[tests, 2]))
    view = int(tests[np.argmin(np.abs(angle - 0.4))])
    rendering = field.render(capture.cameras, view)
    truth = capture.image_float(view)
    error = np.abs(np.clip(rendering.color, 0, 1) - truth).mean(-1)
    return Section("Radiance field", "A view that was not trained on.", [
        Picture(truth, "photo"), Picture(np.clip(rendering.color, 0, 1), "field"),
        Picture(np.clip(5 * error, 0, 1), "error, five times"),
        Picture(_depth_picture(rendering.depth), "depth")])


def _coverage_section(field: VoxelField, capture: Capture) -> tuple[Section, float]:
    """Where the head is seen from how many directions, and the share that is seen well."""
    coverage = Coverage(field, capture)
    # Coverage changes slowly over a head: it is counted for every second pixel.
    views, few = _turned(field, 360), _turned(field, 180)
    pictures = []
    for view, angle in enumerate(_ANGLES):
        found = np.repeat(np.repeat(coverage.directions(few, view), 2, axis=0), 2, axis=1)
        color = _FEW[np.clip(found, 0, Coverage.ENOUGH)]
        shade = np.clip(field.render(views, view).color, 0, 1).mean(axis=-1, keepdims=True)
        picture = np.where(found[..., None] < 0, 1.0, color * (0.3 + 0.7 * shade))
        pictures.append(Picture(picture.astype(np.float32), f"{angle:+d} degrees"))
    share = coverage.share(float(np.linalg.norm(views.position[0])))
    return Section("What the photos show", f"Blue: seen from {Coverage.ENOUGH} directions or more, "
                   f"{100 * share:.0f} % of the head between the profiles; orange: from one or "
                   "two; red: from none, so its shape and colors are a guess. More photos from "
                   "further left and right, and from above and below, make it blue.",
                   pictures), share


def _turned(field: VoxelField, size: int = 448) -> Camera:
    """Views of a head from the left, the front and the right."""
    first = sweep_cameras(90.0, 1, size, field)[0]
    return Camera.arc(np.array(_ANGLES, float), distance=float(np.linalg.norm(first.position[0])),
                      width=size, height=size, focal=float(first.focal[0, 0]))


class Chart(NamedTuple):
    """What a report shows of one chart of a skin."""

    yaw: int  # From where the chart is seen, degrees.
    camera: Camera  # Its pixels, reduced to those that are shown.
    there: Bool  # bool [h, w], where it shows something.
    photo: Float32  # float32 [h, w, 3], photographed colors.
    regions: Float32  # float32 [h, w, 3], labels in their colors.


def charts_of(skin: Skin) -> list[Chart]:
    """The charts of a skin that a report shows."""
    labels, names = skin.labels
    palette = np.array([_PALETTE[name] for name in names], np.float32)
    atlas = skin.atlas
    yaw = np.degrees(np.arctan2(-atlas.cameras.pose[:, 0, 2], -atlas.cameras.pose[:, 2, 2]))
    level = np.abs(atlas.cameras.pose[:, 1, 2]) < 0.5
    charts = []
    for angle in _ANGLES:
        chart = int(np.argmin(np.where(level, np.abs(yaw - angle), np.inf)))
        x0, y0, x1, y1, dx, dy = (int(value) for value in atlas.boxes[chart])
        # Of a chart that is larger than it is shown, every so many pixels.
        step = -(-(x1 - x0) // _COLUMN)
        pixels = slice(y0 + dy, y1 + dy, step), slice(x0 + dx, x1 + dx, step)
        there = np.isfinite(atlas.depth[pixels])
        height, width = there.shape
        whole = atlas.cameras[chart]
        camera = Camera(whole.pose, whole.focal / step,
                        0.5 - (np.array([x0, y0]) + 0.5 - whole.center) / step,
                        np.array([width]), np.array([height]))
        photo = cv2.resize(atlas.color_of(np.s_[y0 + dy:y1 + dy, x0 + dx:x1 + dx]), (width, height),
                           interpolation=cv2.INTER_AREA)
        slots = skin.slots_of(atlas.owner[pixels])
        shown = labels[slots].astype(np.float32) / 255 @ palette
        regions = np.where((slots >= 0)[..., None], shown, photo.mean(axis=-1, keepdims=True))
        charts.append(Chart(round(float(yaw[chart])), camera, there, np.asarray(photo, np.float32),
                            np.asarray(regions, np.float32)))
    return charts


def _style_section(field: VoxelField, styled: VoxelField, capture: Capture, exemplar: Exemplar,
                   file: Path, config: MakeConfig, charts: list[Chart] | None) -> Section:
    """How the style came onto the head: on its surface, or by painted views."""
    if capture.landmarks is None or not config.stylize.on_skin:
        return _guides(field, capture, exemplar, config.stylize.transfer)
    if charts is None:
        charts = charts_of(kept_skin(file, field, capture, config.stylize.pixels))
    pictures = []
    for chart in charts:
        painted = np.clip(next(render_views(styled, chart.camera, background=1.0)).color, 0, 1)
        for picture, words in (
                (chart.photo, f"from {chart.yaw} degrees, photographed"),
                (chart.regions, "its regions"), (painted, "painted")):
            pictures.append(Picture(np.where(chart.there[..., None], picture, 1.0).astype(
                np.float32), words))
    return Section("Painted on the surface", "The head's surface is laid out in charts and painted "
                   "once for all views: the face by guides, look-up table and StyleBlit, the rest "
                   "by patches of like material ("
                   + ", ".join(f"{name} {color}" for name, color in _COLORS.items())
                   + "). Three of the charts.", pictures)


def _guides(field: VoxelField, capture: Capture, exemplar: Exemplar,
            config: TransferConfig) -> Section:
    if capture.landmarks is None:
        return Section("Example-based transfer")
    transfer = Transfer(exemplar, config)
    guide = SurfaceGuide(capture.landmarks, exemplar, transfer.regions)
    views = _turned(field)
    pictures = []
    for view, angle in enumerate(_ANGLES):
        rendering = field.render(views, view)
        position, anchor = guide(rendering.points(views, view))
        pixels, _ = views.project(capture.landmarks)
        result = transfer.apply(np.clip(rendering.color, 0, 1), pixels[view], position=position,
                                seeds_anchor=anchor, mask=rendering.alpha)
        shape = exemplar.image.shape
        coordinates = np.nan_to_num(np.dstack([
            position[..., 0] / shape[1], position[..., 1] / shape[0],
            np.zeros(position.shape[:2])]), nan=0.0)
        alpha = rendering.alpha[..., None]
        appearance = result.guides.appearance
        shown = np.clip(0.5 + 2.0 * (appearance - float(np.nanmedian(appearance))), 0, 1)
        pictures += [Picture(np.clip(coordinates, 0, 1), f"position guide, {angle:+d} degrees"),
                     Picture(shown, "appearance guide"),
                     Picture(result.image * alpha + (1 - alpha), "transfer by example")]
    return Section("Guides and transfer by example", "Position (red, green: the exemplar's x, y) "
                   "anchored to the surface, appearance, and the transferred view.", pictures)


def _lightfield(coded: UInt8, display: Display) -> Section:
    give_back_memory()  # The page is being packed beside.
    height, width = coded.shape[:2]
    y, x = int(height * 0.42), int(width * 0.5)
    crop = coded[y:y + 200, x - 150:x + 150]
    views = np.asarray(ViewMask.build(display).views[y:y + 200, x - 150:x + 150], np.float32)
    eyes = display.eyes()
    pictures = [Picture(crop, "coded picture, one to one", exact=True, width=0),
                Picture(views / max(1, display.views - 1), "mask guide: view of each sub-pixel",
                        exact=True, width=0)]
    for index, name in ((0, "left"), (display.views // 2, "middle"), (display.views - 1, "right")):
        seen = simulate(coded, display, (float(eyes[index]),), block=max(1, width // _SHOWN))
        pictures.append(Picture(seen, f"what the {name}most eye sees" if name != "middle"
                                else "what an eye in the middle sees"))
    return Section("Light field", f"{display.width} x {display.height} pixels, {display.views} "
                   "views, one ray per sub-pixel.", pictures)


def _parameters(config: Any, prefix: str = "") -> list[tuple[str, Any]]:
    """The fields of a configuration, nested ones by dotted names."""
    if not dataclasses.is_dataclass(config):
        return []
    rows: list[tuple[str, Any]] = []
    for entry in dataclasses.fields(config):
        value = getattr(config, entry.name)
        if dataclasses.is_dataclass(value):
            rows += _parameters(value, f"{prefix}{entry.name}.")
        else:
            rows.append((prefix + entry.name, value if isinstance(value, (int, float)) else
                         str(value)))
    return rows


def _figures(figures: dict[str, Any]) -> Section:
    stages = [(name, float(stage["stage_seconds"])) for name, stage in figures.items()
              if "stage_seconds" in stage]
    metrics: list[tuple[str, Any]] = []
    test = figures.get("reconstruct", {}).get("test", {})
    if test:
        metrics += [("held-out PSNR (dB)", test["psnr"]), ("held-out SSIM", test["ssim"])]
    style = figures.get("stylize", {})
    if style.get("fit", {}).get("rmse"):
        metrics.append(("fit to the example, RMSE", style["fit"]["rmse"][-1]))
    for moment in ("before", "after"):
        losses = style.get("refinement", {}).get(moment, {}).get("losses", {})
        metrics += [(f"{name} loss, {moment}", value) for name, value in sorted(losses.items())]
    networks = style.get("refinement", {}).get("networks", {})
    metrics += [(f"{term} network", name) for term, name in sorted(networks.items())]
    budget = figures.get("encode", {}).get("depth_budget", {})
    metrics += [(f"depth budget, {name.replace('_', ' ')}", value)
                for name, value in sorted(budget.items())]
    return Section("Figures", "", tables=[
        Table(stages, ("stage", "seconds"), bars=1, caption="Time"),
        Table(metrics, ("figure", "value"), caption="Quality"),
        Table([("lfportrait", __version__),
               ("device", used_device(figures)),
               *sorted(machine().items())], caption="Version and machine")])
