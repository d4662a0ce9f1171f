"""Speed of the coding: sizes, views, cones, the benefit of the mask, baselines, and of prints.

A lenticular print is coded by rays, and made the usual way, in one run. The usual way: as many
views as there are pixels under a lens, each a picture of 300 pixels per inch; columns of them
interlaced to a whole number of pixels a lens; the result resampled to the printer's resolution.
Here it gets the views from the fastest kernel there is for them, and the exact phase of each of its
columns; what is left is what the steps themselves cost and lose.
"""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from lfportrait.arrays import Int64, UInt8
from lfportrait.device import device_name, gpu_adapter
from lfportrait.field import VoxelField
from lfportrait.gpu import Adapter, gpu_process
from lfportrait.lightfield import (
    Display,
    EncodeConfig,
    ViewMask,
    code_on_device,
    composed,
    encode_rows,
    encode_with_figures,
    interlace,
    render_view,
    view_camera,
)
from lfportrait.lightfield.prints import (
    PrintConfig,
    PrintSheet,
    fitted,
    through_lenses,
    write_print,
)
from lfportrait.measure import cost_of, memory_of
from lfportrait.metrics import psnr
from lfportrait.progress import Progress
from lfportrait.temporary import temporary_folder

from .transfer import say, timed

PANELS = {"1080p": "generic-1080p", "4k": "generic-4k", "8k": "generic-8k"}
"""Sizes of ``bench encode`` and the presets that have them."""
MASKS = {"1k": "generic-1k", "2k": "generic-2k", "4k": "generic-4k", "8k": "generic-8k"}
"""Sizes of the paper's Table 1."""
VIEWS, CONE = 96, 40.0
"""Views and cone (degrees) of the panels, whatever the presets have, so that sizes compare."""
MANY_VIEWS = (32, 64, 96, 160)
WIDE_CONES = (20.0, 40.0, 60.0)


def _display(preset: str, views: int = VIEWS, cone: float = CONE) -> Display:
    return replace(Display.preset(preset), views=views, cone=cone)


def bench_encode(field: VoxelField, *, sizes: tuple[str, ...] = ("1080p", "4k", "8k"),
                 masks: tuple[str, ...] = ("1k", "2k", "4k", "8k"), rivals: str = "1080p",
                 repeats: int = 3, config: EncodeConfig | None = None, device: str = "cpu",
                 progress: Progress | None = None) -> dict[str, Any]:
    """Speed of the coding at several panel sizes, with quality, the mask's benefit and a baseline.

    Panels have 96 views over 40 degrees, the head is 80 % as high as the panel. The shortest of
    ``repeats`` runs counts. On a GPU there is no mask.

    Returns
    -------
    figures : ``device``, by its name. Per size ``seconds``, ``draft_seconds``, ``subpixels``,
        ``views``, ``method``, ``psnr`` and ``draft_psnr`` (dB, against direct casting in steps of
        half a voxel), ``memory_bytes`` (on top of field and mask); on a GPU also those of
        `device_figures`. ``direct``: casting in half-voxel steps; ``view_by_view``: all views
        rendered, then interlaced; both with ``times_slower``. ``views`` and ``cones``: seconds at
        the middle size by their number and by degrees. ``mask``: a list with ``build_seconds``,
        ``load_seconds``, ``with_seconds`` (load and code), ``without_seconds`` (build and code),
        ``bytes``.
    """
    config = config or EncodeConfig()
    adapter = gpu_adapter(device)
    figures: dict[str, Any] = {"device": device_name(adapter)}
    for size in sizes:
        say(progress, f"coding {size}")
        figures[size] = _coded(field, _display(PANELS[size]), config, repeats, device)
        if adapter is not None:
            figures[size] |= device_figures(field, _display(PANELS[size]), config, adapter)
    panel, ours = PANELS[rivals], figures[rivals]["seconds"]
    figures["direct"] = {key.removeprefix("direct_"): figures[rivals][key] for key in (
        "direct_seconds", "subpixels", "views")}
    figures["direct"] |= {"method": "direct", "step_size": 0.5, "resolution": rivals}
    say(progress, f"all {VIEWS} views, then interlacing")
    figures["view_by_view"] = {**_view_by_view(field, _display(panel), config),
                               "resolution": rivals}
    for way in ("direct", "view_by_view"):
        figures[way]["times_slower"] = figures[way]["seconds"] / ours
    say(progress, "numbers of views, cones")
    middle = PANELS[sizes[len(sizes) // 2]]
    displays = ({f"views {n}": _display(middle, views=n) for n in MANY_VIEWS}
                | {f"cone {c:g}": _display(middle, cone=c) for c in WIDE_CONES})
    seconds = _alternating(field, displays, config, repeats, device)
    figures["views"] = {str(n): seconds[f"views {n}"] for n in MANY_VIEWS}
    figures["cones"] = {f"{c:g}": seconds[f"cone {c:g}"] for c in WIDE_CONES}
    figures["mask"] = (bench_masks(field, masks, repeats=repeats, config=config, progress=progress)
                       if masks and adapter is None else [])
    return figures


def bench_masks(field: VoxelField, sizes: tuple[str, ...] = tuple(MASKS), *, repeats: int = 3,
                config: EncodeConfig | None = None,
                progress: Progress | None = None) -> list[dict[str, Any]]:
    """Table 1 of Shen et al. (2023): time and memory with and without the stored mask guide.

    For each of some `MASKS` the ``resolution``, and the figures of ``mask`` in `bench_encode`.
    """
    config = config or EncodeConfig()
    # A small picture compiles the kernels before the clock starts.
    encode_with_figures(field, replace(_display(MASKS[sizes[0]]), width=64, height=8), config,
                        device="cpu")
    rows = []
    for size in sizes:
        say(progress, f"mask guide, {size}")
        rows.append({"resolution": size, **_mask(field, _display(MASKS[size]), config, repeats)})
    return rows


def _alternating(field: VoxelField, displays: dict[str, Display], config: EncodeConfig,
                 repeats: int, device: str) -> dict[str, float]:
    """Shortest times, the panels one after the other in each round: noise hits all alike."""
    masks = {name: ViewMask.build(display, cache=False) for name, display in displays.items()}
    seconds = dict.fromkeys(displays, float("inf"))
    for _ in range(repeats):
        for name, display in displays.items():
            start = time.perf_counter()
            encode_with_figures(field, display, config, mask=masks[name], device=device)
            seconds[name] = min(seconds[name], time.perf_counter() - start)
    return seconds


def _coded(field: VoxelField, display: Display, config: EncodeConfig, repeats: int,
           device: str) -> dict[str, Any]:
    mask = ViewMask.build(display, cache=False)
    ways = {"": config, "draft_": replace(config, draft=True),
            "direct_": replace(config, method="direct", step_size=0.5, draft=False)}
    row: dict[str, Any] = {}
    pictures = {}
    for way, chosen in ways.items():
        encode_with_figures(field, replace(display, width=64, height=8), chosen, device=device)
        # Half-voxel steps take so long that one run suffices.
        row[f"{way}seconds"], (pictures[way], run) = timed(
            functools.partial(encode_with_figures, field, display, chosen, mask=mask,
                              device=device),
            1 if way == "direct_" else repeats)
        if not way:
            row |= {name: run[name] for name in ("subpixels", "views", "method")}
            row["subpixels_per_second"] = run["subpixels"] / row["seconds"]
            row["memory_bytes"], _ = memory_of(
                lambda: encode_with_figures(field, display, config, mask=mask, device=device))
    if gpu_adapter(device) is not None:  # held against the CPU's, not against its own
        pictures["direct_"] = encode_with_figures(field, display, ways["direct_"], mask=mask,
                                                  device="cpu")[0]
    reference = pictures["direct_"].astype(np.float32) / 255
    for way in ("", "draft_"):
        quality = psnr(pictures[way].astype(np.float32) / 255, reference)
        row[f"{way}psnr"] = min(quality, 99.0)
    return row


def _view_by_view(field: VoxelField, display: Display, config: EncodeConfig) -> dict[str, Any]:
    """The common way: every view as a whole picture, then the panel's sub-pixels picked."""
    start = time.perf_counter()
    views = np.empty((display.views, display.height, display.width, 3), np.uint8)
    for view, eye in enumerate(display.eyes()):
        camera = view_camera(display, config, float(eye), width=display.width,
                             height=display.height)
        color = field.render(camera, 0, background=config.background, step=config.step_size).color
        views[view] = np.clip(color, 0, 1) * 255 + 0.5
    rendered = time.perf_counter()
    interlace(views, display)
    end = time.perf_counter()
    return {"seconds": end - start, "render_seconds": rendered - start,
            "interlace_seconds": end - rendered, "views": display.views,
            "subpixels": 3 * display.width * display.height * display.views,
            "method": "view by view", "bytes": views.nbytes}


def _mask(field: VoxelField, display: Display, config: EncodeConfig, repeats: int,
          ) -> dict[str, Any]:
    """One row of Table 1: time and memory with and without the stored mask guide."""
    ViewMask.build(replace(display, width=32, height=8), cache=False)
    with temporary_folder() as folder:
        build, mask = timed(lambda: ViewMask.build(display, cache=False), repeats)
        ViewMask.build(display, cache=folder)
        load, _ = timed(lambda: ViewMask.build(display, cache=folder), repeats)

        def code(cache: bool | Path) -> None:
            encode_with_figures(field, display, config, device="cpu",
                                mask=ViewMask.build(display, cache=cache))

        stored, _ = timed(lambda: code(folder), repeats)
        fresh, _ = timed(lambda: code(False), repeats)
        memory, _ = memory_of(lambda: code(folder))
    return {"build_seconds": build, "load_seconds": load, "with_seconds": stored,
            "without_seconds": fresh, "bytes": int(mask.views.nbytes), "memory_bytes": memory}


_REPEATS = 20


def device_figures(field: VoxelField, display: Display, config: EncodeConfig,
                   adapter: Adapter) -> dict[str, Any]:
    """Times on the device, with nothing read back.

    ``device_seconds`` of coding, the field being there; ``shade_seconds`` of evaluating its colors
    for the views; ``copy_seconds``: the floor, a copy of as many bytes as the field and the picture
    have, within the device's memory.
    """
    process = gpu_process(adapter)
    config = composed(field, display, config)
    run = code_on_device(process, field, display, config, repeats=1 if not adapter.real
                         else _REPEATS)
    size = run["field_bytes"] + 3 * display.width * display.height
    return {"device_seconds": run["repeated"], "shade_seconds": run["shade"],
            "copy_seconds": process.call("lfportrait_eval.bench.run:copy_seconds", size),
            "copy_bytes": size}


USUAL_PPI = 300.0
"""Pixels per inch of the views that studios interlace."""
EYES = 9
"""Places that what an eye sees is compared from."""


def bench_print(field: VoxelField, config: PrintConfig | None = None, *, repeats: int = 3,
                progress: Progress | None = None) -> dict[str, Any]:
    """Time, memory and quality of a print and of the usual way to make one.

    The page is by default 8 x 10 inches at 720 dpi without border, 60.12 lpi. The shortest of
    ``repeats`` runs counts.

    Returns
    -------
    figures : ``rays`` and ``usual``: ``seconds`` with the file written, ``cpu_seconds`` of all
        cores together, ``memory_bytes`` beyond the field's, ``psnr`` (dB) of what an eye sees
        through the lenses at nine places, the mean and the ``worst``, against the field rendered
        from there; ``usual`` also by its parts and ``times_slower``. ``pixels``,
        ``pixels_per_lens``, ``depth_scale``.
    """
    config = config or PrintConfig(lpi=60.12, bleed=0.0, margin=0.0)
    sheet = PrintSheet.of(config)
    display = sheet.display
    coding, depth = fitted(field, sheet)
    # A few rows compile the kernels before the clock starts.
    encode_rows(field, display, coding, 0, 8)
    figures: dict[str, Any] = {
        "pixels": display.width * display.height, "pixels_per_lens": sheet.pixels_per_lens,
        "depth_scale": depth.depth_scale}
    say(progress, "print by rays")
    with temporary_folder() as folder:
        path = folder / "print.tiff"
        # The first run tells the memory: later ones find some of it taken already.
        memory, (cost, _) = memory_of(
            lambda: cost_of(lambda: write_print(field, sheet, path, coding=coding)))
        seconds, run = timed(lambda: write_print(field, sheet, path, coding=coding), repeats)
        figures["rays"] = {"seconds": seconds, "cpu_seconds": cost.cpu_seconds,
                           "coding_seconds": run["seconds"]["coding"], "memory_bytes": memory}
        say(progress, "views, interlaced and resampled")
        memory, (cost, (parts, usual)) = memory_of(lambda: cost_of(
            lambda: _usual_way(field, sheet, coding, folder / "usual.tiff")))
    figures["usual"] = {"seconds": sum(parts.values()), "cpu_seconds": cost.cpu_seconds, **parts,
                        "memory_bytes": memory}
    figures["usual"]["times_slower"] = figures["usual"]["seconds"] / seconds
    say(progress, "what an eye sees")
    # Rows stand for themselves: every fourth one tells as much.
    rows = np.arange(0, display.height, 4)
    pages = {"rays": encode_rows(field, display, coding, 0, len(rows), 4), "usual": usual[rows]}
    for name, scores in _seen(field, display, coding, rows, pages).items():
        figures[name] |= {"psnr": float(np.mean(scores)), "worst": float(np.min(scores))}
    return figures


def _usual_way(field: VoxelField, sheet: PrintSheet, coding: EncodeConfig, path: Path,
               ) -> tuple[dict[str, float], UInt8]:
    """Seconds of each step, and the page uint8 [H, W, 3]."""
    display = sheet.display
    count = round(sheet.pixels_per_lens)
    small = USUAL_PPI / sheet.config.dpi
    camera = replace(display, views=count, width=round(display.width * small),
                     height=round(display.height * small))
    parts: dict[str, float] = {}

    def step(name: str, work: Callable[[], Any]) -> Any:
        start = time.perf_counter()
        result = work()
        parts[f"{name}_seconds"] = time.perf_counter() - start
        return result

    views = step("views", lambda: [render_view(field, camera, view, coding)
                                   for view in range(count)])
    strips = step("interlace", lambda: _interlaced(views, display, count))
    page = step("resample", lambda: cv2.resize(strips, (display.width, display.height),
                                               interpolation=cv2.INTER_CUBIC))
    step("write", lambda: cv2.imwrite(str(path), page[..., ::-1],
                                      [cv2.IMWRITE_TIFF_COMPRESSION, 1]))
    return parts, np.asarray(page, np.uint8)


def _interlaced(views: list[UInt8], display: Display, count: int,
                ) -> UInt8:
    """A whole number of columns a lens, each of one view."""
    width = round(display.width / display.pitch * 3.0 * count)
    place = (np.arange(width) + 0.5) * display.width / width - 0.5
    share = np.mod((3.0 * place + display.offset) / display.pitch, 1.0)
    view = np.minimum(((1.0 - share) * count).astype(int), count - 1)
    out = np.empty((display.height, width, 3), np.uint8)
    for number, picture in enumerate(views):
        columns = view == number
        out[:, columns] = cv2.resize(picture, (width, display.height),
                                     interpolation=cv2.INTER_LINEAR)[:, columns]
    return out


def _seen(field: VoxelField, display: Display, coding: EncodeConfig, rows: Int64,
          pages: dict[str, UInt8]) -> dict[str, list[float]]:
    """PSNR of each page from each eye.

    A lens is as wide as its strip of ink; a view may be compared at the ink or at the lens's
    middle. A page counts by what it fits better.
    """
    scores: dict[str, list[float]] = {name: [] for name in pages}
    last = display.views - 1
    # An eye nearer to the edge of the viewing angle sees something of its other edge, too.
    for view in np.linspace(0.1 * last, 0.9 * last, EYES).round().astype(int):
        truth = render_view(field, display, int(view), coding)[rows]
        eye = float(display.eyes()[view])
        targets = [through_lenses(truth, display, x, rows) for x in (eye, 0.0)]
        for name, page in pages.items():
            seen = through_lenses(page, display, eye, rows)
            inside = slice(1, -1)  # of the outermost lenses a part lies beyond the page
            found = max(psnr(seen[:, inside], target[:, inside]) for target in targets)
            scores[name].append(found if math.isfinite(found) else 99.0)
    return scores
