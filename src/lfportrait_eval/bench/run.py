"""Run the speed benchmarks: warm, best of several, with quality figures.

A first call compiles the kernels or loads them from the cache; it is made before the clock starts.
Times depend on the machine and on what else runs on it: compare the ratios of one run.
"""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfportrait.capture import Camera, Capture
from lfportrait.device import gpu_adapter
from lfportrait.example import Exemplar
from lfportrait.field import ReconstructConfig, VoxelField, reconstruct_with_figures
from lfportrait.files import write_image
from lfportrait.gpu import gpu_process
from lfportrait.measure import machine, peak_memory_bytes
from lfportrait.progress import Progress

from .encode import bench_encode
from .floor import device_floor, machine_rates, training_floor
from .plot import line_plot
from .print import bench_print
from .transfer import SHORT_NETWORK, bench_transfer, say, timed

__all__ = ["BENCHES", "bench", "bench_encode", "bench_print", "bench_reconstruct",
           "bench_stylize", "bench_transfer"]

SHORT = ReconstructConfig(resolutions=(64, 128), rays=(0.5, 1.0), batch=(16384,))
"""A reconstruction that takes seconds, for a field to measure on."""


def _embedded_capture(size: int = 256, views: int = 36) -> Capture:
    from lfportrait.demo import demo_capture

    return demo_capture(size=size, views=views)


def _field(path: Path | None, progress: Progress | None) -> VoxelField:
    """The field to measure: a file, or the embedded head, reconstructed in seconds."""
    if path is not None:
        return VoxelField.load(path)
    say(progress, "reconstructing the embedded head")
    return reconstruct_with_figures(_embedded_capture(), SHORT)[0]


def bench_reconstruct(capture: Capture, config: ReconstructConfig | None = None, *,
                      render_size: int = 512, repeats: int = 3, plot: Path | None = None,
                      device: str = "cpu", progress: Progress | None = None) -> dict[str, Any]:
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
    device
        Where to train and to render, a choice of ``--device``.
    progress
        Progress line.

    Returns
    -------
    figures
        ``device``, by its name; ``seconds``, ``train_rays_per_second`` with everything,
        ``kernel_rays_per_second`` of casting forward and backward alone on the finest lattice,
        ``floor`` (`training_floor`, on a GPU `device_floor`) for the latter,
        ``render_rays_per_second``, ``test`` (PSNR, SSIM), ``voxels``, ``levels``, ``curve``
        (progress over time), ``peak_memory_bytes``.
    """
    config = config or SHORT
    # A miniature run compiles the kernels before the clock starts.
    reconstruct_with_figures(capture, replace(config, resolutions=(24,), rays=(0.02,),
                                              batch=(4096,)), device=device)
    say(progress, "reconstructing")
    field, run = reconstruct_with_figures(capture, config, progress, measure_every=1.0,
                                          device=device)
    peak = peak_memory_bytes()
    if plot is not None:
        write_image(plot, _curve_plot(run["curve"]))
    say(progress, "what the machine can do")
    casting = run["train"]["casting"]
    adapter = gpu_adapter(device)
    floor = (training_floor(machine_rates(), casting["samples_per_ray"], casting["rows_per_ray"],
                            casting["row_width"]) if adapter is None
             else device_floor(gpu_process(adapter), casting["batch"], casting["rows_per_ray"],
                               casting["row_width"]))
    front = Camera.arc(np.zeros(1), distance=4.0, width=render_size, height=render_size,
                       focal=1.7 * render_size)
    field.render(front, 0, device=device)
    shortest, _ = timed(lambda: field.render(front, 0, device=device), repeats)
    return {"device": run["device"], "seconds": run["seconds"]["train"],
            "train_rays": run["train"]["rays"],
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


def bench_stylize(field: VoxelField, capture: Capture, exemplar: Exemplar | None = None, *,
                  size: int = 320, views: int = 5, steps: int = 6,
                  pixels: float | None = None, progress: Progress | None = None,
                  device: str = "auto") -> dict[str, Any]:
    """Stylisation, its parts apart: on the skin, and by a few painted views beside it.

    Parameters
    ----------
    field, capture
        The real field and its capture with landmarks.
    exemplar
        The painting; the embedded one by default.
    size, views
        Size and number of the painted views.
    steps
        Refinement steps.
    pixels
        Of the skin per world unit; None: as by default.
    progress
        Progress line.
    device
        Where the networks compute, a choice of ``--device``.

    Returns
    -------
    figures
        ``device`` of the networks; ``skin_seconds``; ``preview_seconds`` (the second one, with
        another seed); ``exemplar_seconds`` (preparing a painting); ``paint_seconds``,
        ``fit_iteration_seconds``, ``step_seconds`` on the skin; the networks; and ``views`` by
        painted views: ``view_seconds`` (render, transfer, weights of a view),
        ``fit_iteration_seconds``, ``step_seconds``.
    """
    from lfportrait.example import Skin, SkinPainter
    from lfportrait.stylize import StylizeConfig, paint, stylize_with_figures

    if exemplar is None:
        from lfportrait.demo import demo_exemplar

        exemplar = demo_exemplar()
    assert capture.landmarks is not None
    config = StylizeConfig(steps=steps)
    if pixels is not None:
        config = replace(config, pixels=pixels)
    preview = replace(config, preview=True)
    by_views = StylizeConfig(method="paper", size=size, views=views, pitches=(8.0,), steps=steps)
    # Miniature runs compile the kernels and load the networks before the clock starts.
    stylize_with_figures(field, capture, exemplar, replace(config, pixels=96.0, steps=1),
                         device=device)
    stylize_with_figures(field, capture, exemplar, replace(by_views, size=96, views=1, steps=1),
                         device=device)
    say(progress, "skin")
    clock = [time.perf_counter()]
    skin = Skin.of(field, capture.landmarks, capture.cameras, config.pixels)
    clock.append(time.perf_counter())
    SkinPainter(exemplar)
    clock.append(time.perf_counter())
    paint(skin, exemplar, preview)
    clock.append(time.perf_counter())
    painter = SkinPainter(exemplar, preview.painting)
    painter.paint(skin, 2)
    clock.append(time.perf_counter())
    painter.seed = 1
    painter.paint(skin, 2)
    clock.append(time.perf_counter())
    say(progress, "stylising")
    _, run = stylize_with_figures(field, capture, exemplar, config, progress, device=device,
                                  skin=skin)
    seconds = run["seconds"]
    say(progress, "by views")
    _, viewed = stylize_with_figures(field, capture, exemplar, by_views, progress, device=device)
    others = viewed["seconds"]
    return {"device": run["device"],
            "skin_seconds": clock[1] - clock[0], "exemplar_seconds": clock[2] - clock[1],
            "preview_seconds": clock[3] - clock[2], "again_seconds": clock[5] - clock[4],
            "paint_seconds": seconds["paint"], "seconds": seconds, "steps": steps,
            "fit_iteration_seconds": seconds["fit"] / max(config.iterations, 1),
            "step_seconds": seconds["refine"] / max(steps, 1),
            "networks": run.get("refinement", {}).get("networks", {}),
            "views": {"size": size, "views": viewed["views"], "seconds": others,
                      "view_seconds": others["views"] / max(viewed["views"], 1),
                      "fit_iteration_seconds": others["fit"] / max(by_views.iterations, 1),
                      "step_seconds": others["refine"] / max(steps, 1)},
            "peak_memory_bytes": peak_memory_bytes()}


BENCHES = ("encode", "print", "reconstruct", "transfer", "stylize")


def bench(what: str, *, field: Path | None = None, capture: Path | None = None,
          plot: Path | None = None, full: bool = False, device: str = "auto",
          progress: Progress | None = None) -> dict[str, Any]:
    """Run one measurement, or all.

    Parameters
    ----------
    what
        ``"encode"``, ``"print"``, ``"reconstruct"``, ``"transfer"``, ``"stylize"`` or ``"all"``.
    field
        Field file; without it, the embedded head is reconstructed first.
    capture
        Capture to reconstruct and stylise; the embedded one by default.
    plot
        File for a picture of the reconstruction's PSNR over time.
    full
        Reconstruct by the default schedule instead of in seconds.
    device
        Where to compute, a choice of ``--device``.
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
            return bench_encode(_field(field, progress), device=device, progress=progress)
        if name == "print":
            return bench_print(_field(field, progress), progress=progress)
        if name == "transfer":
            return bench_transfer(progress=progress, network=replace(SHORT_NETWORK, device=device))
        photos = Capture.load(capture) if capture is not None else _embedded_capture()
        if name == "reconstruct":
            return bench_reconstruct(photos, ReconstructConfig() if full else SHORT, plot=plot,
                                     device=device, progress=progress)
        voxels = (VoxelField.load(field) if field is not None
                  else reconstruct_with_figures(photos, SHORT, progress)[0])
        return bench_stylize(voxels, photos, progress=progress, device=device)

    if what != "all" and what not in BENCHES:
        raise ValueError(f"there is no measurement {what!r}")
    figures = {name: run(name) for name in BENCHES} if what == "all" else run(what)
    return {**figures, "machine": machine(), "peak_memory_bytes": peak_memory_bytes()}
