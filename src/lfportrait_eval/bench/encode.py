"""Speed of the coding: sizes, views, cones, the benefit of the mask, and baselines."""

from __future__ import annotations

import functools
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from lfportrait.device import device_name, gpu_adapter
from lfportrait.field import VoxelField
from lfportrait.gpu import Adapter, gpu_process
from lfportrait.lightfield import (
    Display,
    EncodeConfig,
    ViewMask,
    code_on_device,
    composed,
    encode_with_figures,
    interlace,
    view_camera,
)
from lfportrait.measure import memory_of
from lfportrait.metrics import psnr
from lfportrait.progress import Progress
from lfportrait.temporary import temporary_folder

from .transfer import say, timed

__all__ = ["bench_encode", "bench_masks", "device_figures"]

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

    Panels have 96 views over 40 degrees, the head is 80 % as high as the panel.

    Parameters
    ----------
    field
        The field to code.
    sizes
        Of `PANELS`.
    masks
        Of `MASKS`: with and without the stored mask guide (Shen et al. 2023, Table 1).
    rivals
        Of ``sizes``: where the other ways are measured.
    repeats
        The shortest of so many runs counts.
    config
        Coding.
    device
        Where to code, a choice of ``--device``; on a GPU there is no mask, and ``masks`` is left
        out.
    progress
        Progress line.

    Returns
    -------
    figures
        ``device``, by its name. Per size ``seconds``, ``draft_seconds``, ``subpixels``,
        ``views``, ``method``, ``psnr`` and ``draft_psnr`` (dB, against direct casting in steps of
        half a voxel), ``memory_bytes`` (on top of field and mask); on a GPU also those of
        `device_figures`. ``direct``: casting in half-voxel steps; ``view_by_view``: all
        views rendered, then interlaced; both with ``times_slower``. ``views`` and ``cones``:
        seconds at the middle size by their number and by degrees. ``mask``: a list with
        ``build_seconds``,
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

    Parameters
    ----------
    field
        The field to code.
    sizes
        Of `MASKS`, at least one.
    repeats, config, progress
        As for `bench_encode`.

    Returns
    -------
    rows
        ``resolution``, and the figures of ``mask`` in `bench_encode`.
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
            "without_seconds": fresh, "bytes": mask.nbytes, "memory_bytes": memory}


_REPEATS = 20


def device_figures(field: VoxelField, display: Display, config: EncodeConfig,
                   adapter: Adapter) -> dict[str, Any]:
    """Times on the device, with nothing read back.

    Returns
    -------
    figures
        ``device_seconds`` of coding, the field being there; ``shade_seconds`` of evaluating its
        colors for the views; ``copy_seconds``: the floor, a copy of as many bytes as the field and
        the picture have, within the device's memory.
    """
    process = gpu_process(adapter)
    config = composed(field, display, config)
    run = code_on_device(process, field, display, config, repeats=1 if not adapter.real
                         else _REPEATS)
    size = run["field_bytes"] + 3 * display.width * display.height
    return {"device_seconds": run["repeated"], "shade_seconds": run["shade"],
            "copy_seconds": process.call("lfportrait.gpu.measuring:copy_seconds", size),
            "copy_bytes": size}
