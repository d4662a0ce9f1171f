"""Speed, measured side by side in one run: warm, best of several, with the quality beside it.

A first call compiles the kernels or loads them from the cache; it is made before the clock starts.
Times depend on the machine and on what else runs on it: compare the ratios of one run.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..capture import Camera, Capture
from ..example import Exemplar, Transfer
from ..field import ReconstructConfig, VoxelField, reconstruct_with_figures
from ..files import write_image
from ..lightfield import (
    Display,
    EncodeConfig,
    ViewMask,
    encode_with_figures,
    interlace,
    view_camera,
)
from ..measure import machine, peak_memory_bytes
from ..metrics import psnr
from ..progress import Progress
from .floor import machine_rates, training_floor
from .plot import line_plot

__all__ = ["BENCHES", "bench", "bench_encode", "bench_reconstruct", "bench_stylize",
           "bench_transfer"]

PANELS = {"1080p": "generic-1080p", "4k": "generic-4k", "8k": "generic-8k"}
"""Sizes of ``bench encode`` and the presets that have them."""
MASKS = {"1k": "generic-1k", "2k": "generic-2k", "4k": "generic-4k", "8k": "generic-8k"}
"""Sizes of the paper's Table 1."""
SHORT = ReconstructConfig(resolutions=(64, 128), rays=(0.5, 1.0), batch=(16384,))
"""A reconstruction that takes seconds, for a field to measure on."""


def _timed(function: Callable[[], Any], repeats: int) -> tuple[float, Any]:
    """Shortest of several runs in seconds, and the last result."""
    best, result = float("inf"), None
    for _ in range(repeats):
        start = time.perf_counter()
        result = function()
        best = min(best, time.perf_counter() - start)
    return best, result


def _say(progress: Progress | None, text: str) -> None:
    if progress is not None:
        progress.update(progress.done, text)


def _embedded_capture(size: int = 256, views: int = 36) -> Capture:
    from ..demo import demo_capture

    return demo_capture(size=size, views=views)


def _field(path: Path | None, progress: Progress | None) -> VoxelField:
    """The field to measure: a file, or the embedded head, reconstructed in seconds."""
    if path is not None:
        return VoxelField.load(path)
    _say(progress, "reconstructing the embedded head")
    return reconstruct_with_figures(_embedded_capture(), SHORT)[0]


def bench_encode(field: VoxelField, *, sizes: tuple[str, ...] = ("1080p", "4k", "8k"),
                 masks: tuple[str, ...] = ("1k", "2k", "4k", "8k"), repeats: int = 2,
                 config: EncodeConfig | None = None, progress: Progress | None = None,
                 ) -> dict[str, Any]:
    """Coding at several panel sizes, beside its quality, the mask's worth and the common way.

    Parameters
    ----------
    field
        The field to code.
    sizes
        Of `PANELS`.
    masks
        Of `MASKS`: with and without the stored mask guide (Shen et al. 2023, Table 1).
    repeats
        The shortest of so many runs counts.
    config
        Coding.
    progress
        Progress line.

    Returns
    -------
    figures
        Per size ``seconds``, ``subpixels``, ``views``, ``method``, ``psnr`` (dB, against casting
        in steps of a quarter of a voxel); ``direct``: casting in half-voxel steps at the first
        size; ``view_by_view``: all views rendered at that size, then interlaced; ``mask``: a list
        with ``build_seconds``, ``load_seconds``, ``with_seconds`` (load and code),
        ``without_seconds`` (build and code), ``bytes``.
    """
    config = config or EncodeConfig()
    figures: dict[str, Any] = {}
    for size in sizes:
        _say(progress, f"coding {size}")
        # An 8K picture takes long enough for one run to tell.
        figures[size] = _coded(field, Display.preset(PANELS[size]), config,
                               1 if size == "8k" else repeats)
    first = Display.preset(PANELS[sizes[0]])
    _say(progress, "direct casting")
    direct = replace(config, step_size=0.5, draft=False)
    figures["direct"] = {**_coded(field, first, direct, repeats), "step_size": 0.5,
                         "resolution": sizes[0]}
    _say(progress, f"all {first.views} views, then interlacing")
    figures["view_by_view"] = {**_view_by_view(field, first, config), "resolution": sizes[0]}
    figures["view_by_view"]["times_slower"] = (
        figures["view_by_view"]["seconds"] / figures[sizes[0]]["seconds"])
    figures["mask"] = []
    for size in masks:
        _say(progress, f"mask guide, {size}")
        figures["mask"].append({"resolution": size, **_mask(
            field, Display.preset(MASKS[size]), config, repeats)})
    return figures


def _coded(field: VoxelField, display: Display, config: EncodeConfig, repeats: int,
           ) -> dict[str, Any]:
    mask = ViewMask.build(display, cache=False)
    encode_with_figures(field, replace(display, width=64, height=8), config)
    seconds, (image, run) = _timed(
        lambda: encode_with_figures(field, display, config, mask=mask), repeats)
    fine = replace(config, step_size=0.25, draft=False)
    reference, _ = encode_with_figures(field, display, fine, mask=mask)
    quality = psnr(image.astype(np.float32) / 255, reference.astype(np.float32) / 255)
    return {"seconds": seconds, "subpixels": run["subpixels"], "views": run["views"],
            "method": run["method"], "subpixels_per_second": run["subpixels"] / seconds,
            "psnr": min(quality, 99.0)}


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
    with tempfile.TemporaryDirectory() as name:
        build, mask = _timed(lambda: ViewMask.build(display, cache=False), repeats)
        ViewMask.build(display, cache=Path(name))
        load, _ = _timed(lambda: ViewMask.build(display, cache=Path(name)), repeats)

        def code(cache: bool | Path) -> None:
            encode_with_figures(field, display, config,
                                mask=ViewMask.build(display, cache=cache))

        stored, _ = _timed(lambda: code(Path(name)), 1)
        fresh, _ = _timed(lambda: code(False), 1)
    return {"build_seconds": build, "load_seconds": load, "with_seconds": stored,
            "without_seconds": fresh, "bytes": mask.nbytes}


def bench_reconstruct(capture: Capture, config: ReconstructConfig | None = None, *,
                      render_size: int = 512, repeats: int = 3, plot: Path | None = None,
                      progress: Progress | None = None) -> dict[str, Any]:
    """Reconstruction and rendering of a capture.

    Parameters
    ----------
    capture
        What to reconstruct.
    config
        Parameters; by default a schedule of a million and a half rays that takes seconds.
    render_size
        Width and height of the view that the rendering speed is measured on.
    repeats
        The fastest of so many renders counts.
    plot
        File for a picture of the PSNR over time.
    progress
        Progress line.

    Returns
    -------
    figures
        ``seconds``, ``train_rays_per_second`` with everything, ``kernel_rays_per_second`` of
        casting forward and backward alone on the finest lattice, ``floor`` (`training_floor`) for
        the latter, ``render_rays_per_second``, ``test`` (PSNR, SSIM), ``voxels``, ``levels``,
        ``curve`` (progress over time), ``peak_memory_bytes``.
    """
    config = config or SHORT
    # A miniature run compiles the kernels before the clock starts.
    reconstruct_with_figures(capture, replace(config, resolutions=(24,), rays=(0.02,),
                                              batch=(4096,)))
    _say(progress, "reconstructing")
    field, run = reconstruct_with_figures(capture, config, progress, measure_every=1.0)
    peak = peak_memory_bytes()
    if plot is not None:
        write_image(plot, _curve_plot(run["curve"]))
    _say(progress, "what the machine can do")
    casting = run["train"]["casting"]
    floor = training_floor(machine_rates(), casting["samples_per_ray"], casting["rows_per_ray"],
                           casting["row_width"])
    front = Camera.arc(np.zeros(1), distance=4.0, width=render_size, height=render_size,
                       focal=1.7 * render_size)
    field.render(front, 0)
    shortest, _ = _timed(lambda: field.render(front, 0), repeats)
    return {"seconds": run["seconds"]["train"], "train_rays": run["train"]["rays"],
            "train_rays_per_second": run["train"]["rays_per_second"],
            "kernel_rays_per_second": casting["rays_per_second"], "floor": floor,
            "times_above_floor": floor["rays_per_second"] / casting["rays_per_second"],
            "render_rays_per_second": render_size ** 2 / shortest, "test": run.get("test", {}),
            "voxels": run["voxels"], "levels": run.get("levels", []), "curve": run["curve"],
            "peak_memory_bytes": peak}


def _curve_plot(curve: list[dict[str, Any]]) -> NDArray[np.uint8]:
    """PSNR of training rays and of held-out views over time, uint8 [H, W, 3]."""
    trained = [(point["seconds"], point["psnr"]) for point in curve]
    held_out = [(point["seconds"], point["held_out_psnr"]) for point in curve
                if point["held_out_psnr"] is not None]
    return line_plot({name: ([x for x, _ in points], [y for _, y in points])
                      for name, points in (("training rays", trained),
                                           ("held-out views", held_out)) if points},
                     across="seconds", up="PSNR in dB",
                     title=f"{curve[-1]['rays'] / 1e6:.1f} million rays")


def bench_transfer(image: NDArray[np.uint8] | None = None,
                   landmarks: NDArray[np.floating] | None = None,
                   exemplar: Exemplar | None = None, *, repeats: int = 3,
                   progress: Progress | None = None) -> dict[str, Any]:
    """Example-based transfer, pre-calculation and synthesis apart (Shen et al. 2023, Fig. 6).

    Parameters
    ----------
    image, landmarks
        uint8 [H, W, 3] and its [68, 2] landmarks; by default the embedded head, 768 x 1024.
    exemplar
        The painting; the embedded one by default.
    repeats
        The fastest of so many runs counts.
    progress
        Progress line.

    Returns
    -------
    figures
        ``styleblit``: ``table_seconds`` (once per style), ``guides_seconds``,
        ``synthesis_seconds``, ``frame_seconds``, ``frames_per_second``, ``patch_fidelity``;
        ``size``: width and height.
    """
    from .likeness import patch_fidelity

    if image is None:
        image, landmarks = _embedded_photo()
    if exemplar is None:
        from ..demo import demo_exemplar

        exemplar = demo_exemplar()
    assert landmarks is not None
    points = np.asarray(landmarks, np.float64)
    picture = image
    _say(progress, "transfer by example")
    Transfer(exemplar).apply(picture, points)
    prepared, transfer = _timed(lambda: Transfer(exemplar), repeats)
    frame, result = _timed(lambda: transfer.apply(picture, points), repeats)
    return {"styleblit": {
        "table_seconds": result.seconds["table_seconds"], "prepare_seconds": prepared,
        "guides_seconds": result.seconds["guides_seconds"],
        "synthesis_seconds": result.seconds["synthesis_seconds"], "frame_seconds": frame,
        "frames_per_second": 1.0 / frame,
        "patch_fidelity": patch_fidelity(result.image, exemplar.image, samples=200)},
        "size": [image.shape[1], image.shape[0]]}


def _embedded_photo() -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    """A frontal photo of the embedded head, 768 x 1024, and its landmarks."""
    from ..demo import SITTER, landmarks, photograph

    camera = Camera.arc(np.array([8.0]), distance=4.4, width=768, height=1024, focal=1500.0)
    shot = photograph(SITTER, camera, 0).image
    alpha = shot[..., 3:].astype(np.float32) / 255.0
    image = (shot[..., :3] * alpha + 225.0 * (1.0 - alpha) + 0.5).astype(np.uint8)
    return image, camera.project(landmarks(SITTER))[0][0]


def bench_stylize(field: VoxelField, capture: Capture, exemplar: Exemplar | None = None, *,
                  size: int = 320, views: int = 5, steps: int = 6,
                  progress: Progress | None = None) -> dict[str, Any]:
    """Stylisation, its parts apart, on few small views.

    Parameters
    ----------
    field, capture
        The real field and its capture with landmarks.
    exemplar
        The painting; the embedded one by default.
    size, views, steps
        Size and number of views, refinement steps.
    progress
        Progress line.

    Returns
    -------
    figures
        ``seconds`` of the parts, ``view_seconds`` (render, transfer, weights of a view),
        ``fit_iteration_seconds``, ``step_seconds`` (one refinement step), the networks.
    """
    from ..stylize import StylizeConfig, stylize_with_figures

    if exemplar is None:
        from ..demo import demo_exemplar

        exemplar = demo_exemplar()
    config = StylizeConfig(size=size, views=views, pitches=(8.0,), steps=steps)
    # A miniature run compiles the kernels and loads the networks before the clock starts.
    stylize_with_figures(field, capture, exemplar, replace(config, size=96, views=1, steps=1))
    _say(progress, "stylising")
    _, run = stylize_with_figures(field, capture, exemplar, config, progress)
    seconds = run["seconds"]
    return {"seconds": seconds, "size": size, "views": run["views"], "steps": steps,
            "view_seconds": seconds["views"] / max(run["views"], 1),
            "fit_iteration_seconds": seconds["fit"] / max(config.fit_iterations, 1),
            "step_seconds": seconds["refine"] / max(steps, 1),
            "networks": run.get("refinement", {}).get("networks", {}),
            "peak_memory_bytes": peak_memory_bytes()}


BENCHES = ("encode", "reconstruct", "transfer", "stylize")


def bench(what: str, *, field: Path | None = None, capture: Path | None = None,
          plot: Path | None = None, full: bool = False,
          progress: Progress | None = None) -> dict[str, Any]:
    """Run one measurement, or all.

    Parameters
    ----------
    what
        ``"encode"``, ``"reconstruct"``, ``"transfer"``, ``"stylize"`` or ``"all"``.
    field
        Field file; without it, the embedded head is reconstructed first.
    capture
        Capture to reconstruct and stylise; the embedded one by default.
    plot
        File for a picture of the reconstruction's PSNR over time.
    full
        Reconstruct by the default schedule instead of in seconds.
    progress
        Progress line.

    Returns
    -------
    figures
        Those of the measurement, with ``machine`` and ``peak_memory_bytes``; for ``"all"`` one
        entry each.
    """
    def run(name: str) -> dict[str, Any]:
        if name == "encode":
            return bench_encode(_field(field, progress), progress=progress)
        if name == "transfer":
            return bench_transfer(progress=progress)
        photos = Capture.load(capture) if capture is not None else _embedded_capture()
        if name == "reconstruct":
            return bench_reconstruct(photos, ReconstructConfig() if full else SHORT, plot=plot,
                                     progress=progress)
        voxels = (VoxelField.load(field) if field is not None
                  else reconstruct_with_figures(photos, SHORT, progress)[0])
        return bench_stylize(voxels, photos, progress=progress)

    if what != "all" and what not in BENCHES:
        raise ValueError(f"there is no measurement {what!r}")
    figures = {name: run(name) for name in BENCHES} if what == "all" else run(what)
    return {**figures, "machine": machine(), "peak_memory_bytes": peak_memory_bytes()}
