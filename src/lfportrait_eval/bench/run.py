"""Run the speed benchmarks: warm, best of several, with quality figures.

A first call compiles the kernels or loads them from the cache; it is made before the clock starts.
Times depend on the machine and on what else runs on it: compare the ratios of one run.

A file of measured figures says what was measured, on which machine, from which commit, and when.
``docs/measured.json`` of the repository is such a file; the page of benchmarks, and the tables of
other documents, are written from it (``scripts/make_benchmarks.py``). It has two parts:

- ``runs``: by name, the conditions of one measurement: ``command``, ``machine`` (`measure.machine`:
  ``processor``, ``cores``, ...), ``vectors`` (the instructions that kernels were compiled for),
  ``commit`` and ``date``.
- ``figures``: by name, such as ``encode.4k.seconds``, ``[value, run]``. The name's last part is the
  quantity, from which its unit follows: ``seconds``, ``psnr`` (dB), ``ssim``, ``peak_memory_bytes``
  and other numbers.

`record` adds a run's figures to a file, and drops runs that no figure comes from any more.
"""

from __future__ import annotations

import datetime
import json
import subprocess
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numba
import numpy as np

from lfportrait import __version__
from lfportrait.arrays import UInt8
from lfportrait.capture import Camera, Capture
from lfportrait.device import gpu_adapter
from lfportrait.errors import UserError
from lfportrait.example import Exemplar
from lfportrait.field import Curves, ReconstructConfig, VoxelField, reconstruct_with_figures
from lfportrait.files import atomic_write, read_json, write_image
from lfportrait.gpu import BINDING, Device, GpuProcess, gpu_process
from lfportrait.measure import machine, peak_memory_bytes
from lfportrait.progress import Progress
from lfportrait.simd.host import vector_unit
from lfportrait.stylize import StylizeConfig

from .encode import bench_encode, bench_print
from .kernels import multiply_adds, random_lines
from .transfer import SHORT_NETWORK, bench_transfer, say, timed

SHORT = ReconstructConfig(resolutions=(64, 128), rays=(0.5, 1.0), batch=(16384,))
"""A reconstruction that takes seconds, for a field to measure on."""


def _embedded_capture() -> Capture:
    from lfportrait.demo import demo_capture

    return demo_capture(size=256, views=36)


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
    capture : What to reconstruct.
    config : Parameters; by default a schedule of a million and a half rays that takes seconds.
    render_size : Width and height of the view that the rendering speed is measured on.
    repeats : The fastest of so many renders counts.
    plot : File for a picture of the PSNR over time.
    device : Where to train and to render, a choice of ``--device``.

    Returns
    -------
    figures : ``device``, by its name; ``seconds``, ``train_rays_per_second`` with everything,
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
    field, run = reconstruct_with_figures(capture, config, progress,
                                          curves=Curves(measure_every=1.0), device=device)
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


def _curve_plot(curve: list[dict[str, Any]]) -> UInt8:
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
                  by_views: StylizeConfig | None = None, pixels: float | None = None,
                  progress: Progress | None = None, device: str = "auto") -> dict[str, Any]:
    """Stylisation, its parts apart: on the skin, and by a few painted views beside it.

    Parameters
    ----------
    by_views : How it is stylised by painted views; its steps of refinement are also those on the
        skin. By default five views of 320 pixels, and six steps.
    pixels : Of the skin per world unit; None: as by default.

    Returns
    -------
    figures : ``device`` of the networks; ``skin_seconds``; ``preview_seconds`` (the second one,
        with another seed); ``exemplar_seconds`` (preparing a painting); ``paint_seconds``,
        ``fit_iteration_seconds``, ``step_seconds`` on the skin; the networks; and ``views`` by
        painted views: ``view_seconds`` (render, transfer, weights of a view),
        ``fit_iteration_seconds``, ``step_seconds``.
    """
    from lfportrait.example import Skin, SkinPainter
    from lfportrait.stylize import paint, stylize_with_figures

    if exemplar is None:
        from lfportrait.demo import demo_exemplar

        exemplar = demo_exemplar()
    assert capture.landmarks is not None
    by_views = by_views or StylizeConfig(method="paper", size=320, views=5, pitches=(8.0,), steps=6)
    steps = by_views.refinements
    config = StylizeConfig(steps=steps)
    if pixels is not None:
        config = replace(config, pixels=pixels)
    preview = replace(config, preview=True)
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
            "views": {"size": by_views.size, "views": viewed["views"], "seconds": others,
                      "view_seconds": others["views"] / max(viewed["views"], 1),
                      "fit_iteration_seconds": others["fit"] / max(by_views.iterations, 1),
                      "step_seconds": others["refine"] / max(steps, 1)},
            "peak_memory_bytes": peak_memory_bytes()}


BENCHES = ("encode", "print", "reconstruct", "transfer", "stylize")


def bench(what: str, *, field: Path | None = None, capture: Path | None = None,
          plot: Path | None = None, full: bool = False, device: str = "auto",
          progress: Progress | None = None) -> dict[str, Any]:
    """Run one measurement, or all; figures with ``machine`` and ``peak_memory_bytes``.

    Parameters
    ----------
    what : ``"encode"``, ``"print"``, ``"reconstruct"``, ``"transfer"``, ``"stylize"`` or ``"all"``:
        one entry each.
    field : Field file; without it, the embedded head is reconstructed first.
    capture : Capture to reconstruct and stylise; the embedded one by default.
    plot : File for a picture of the reconstruction's PSNR over time.
    full : Reconstruct by the default schedule instead of in seconds.
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


_COLORS = ("#1f62b4", "#c85214", "#28824a", "#823c96")


def line_plot(curves: dict[str, tuple[Sequence[float], Sequence[float]]], *, across: str, up: str,
              title: str = "") -> UInt8:
    """Draw curves, names and points (x, y), over a common axis: uint8 [600, 960, 3].

    ``across`` and ``up`` say what the axes show, with units.
    """
    # Here: a third of a second, for one option of one command.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    if not any(len(x) for x, _ in curves.values()):
        raise ValueError("a plot needs points")
    figure = Figure(figsize=(9.6, 6.0), dpi=100, layout="constrained")
    canvas, axes = FigureCanvasAgg(figure), figure.add_subplot()
    for index, (name, curve) in enumerate(curves.items()):
        x, y = np.array(sorted(zip(*curve))).reshape(-1, 2).T
        axes.plot(x, y, color=_COLORS[index % len(_COLORS)], linewidth=2.5, label=name,
                  marker="o" if len(x) < 60 else None, clip_on=False)
    if axes.dataLim.x0 >= 0:
        axes.set_xlim(left=0)
    axes.set(xlabel=across, ylabel=up, title=title)
    axes.grid(color="#e2e2e6")
    axes.legend(loc="lower right", frameon=False)
    canvas.draw()
    return np.array(canvas.buffer_rgba())[..., :3]


def machine_rates(megabytes: int = 512) -> dict[str, float]:
    """Random lines of 64 bytes and multiply-adds a second, all processors together.

    Lines are read from a table of some megabytes, a power of two far above the caches.
    """
    workers = numba.get_num_threads()
    table = np.ones(megabytes * 2 ** 18, np.float32)
    out = np.zeros((workers, 16), np.float32)
    lines, rounds = 8_000_000, 40_000_000
    random_lines(table, 1000, out)
    multiply_adds(1000, np.float32(0.5), out)
    best = [np.inf, np.inf]
    for _ in range(3):
        start = time.perf_counter()
        random_lines(table, lines, out)
        between = time.perf_counter()
        multiply_adds(rounds, np.float32(0.5), out)
        end = time.perf_counter()
        best = [min(best[0], between - start), min(best[1], end - between)]
    return {"random_lines_per_second": workers * lines / best[0],
            "multiply_adds_per_second": workers * rounds * 8 * 16 / best[1]}


def training_floor(rates: dict[str, float], samples: float, rows: float, width: int,
                   ) -> dict[str, float]:
    """Most rays a second that can be cast forward and backward.

    Parameters
    ----------
    rates : Of `machine_rates`.
    samples : Samples of a ray that take light.
    rows : Records of lattice points that a ray leaves (its packet's, by sixteen): each point's row
        must come from memory to be seen, and come and go when its record is taken up.
    width : Values of a lattice point's row, 4 bytes each.

    Returns
    -------
    figures : ``lines_per_ray`` of 64 bytes, ``multiply_adds_per_ray``, ``memory_rays_per_second``,
        ``compute_rays_per_second`` and the smaller of the two, ``rays_per_second``.
    """
    lines = rows * 3.0 * width * 4.0 / 64.0
    # A sample: density, three colors and back five slopes of eight corners, and an exponential.
    # A point: three dot products, and its step.
    adds = samples * (8.0 * (1.0 + 3.0 + 5.0) + 60.0) + rows * (3.0 * 16.0 + 3.0 * width)
    memory = rates["random_lines_per_second"] / max(lines, 1e-9)
    compute = rates["multiply_adds_per_second"] / max(adds, 1e-9)
    return {"samples_per_ray": samples, "rows_per_ray": rows, "lines_per_ray": lines,
            "multiply_adds_per_ray": adds, "memory_rays_per_second": memory,
            "compute_rays_per_second": compute, "rays_per_second": min(memory, compute)}


def device_floor(process: GpuProcess, rays: int, rows: float, width: int) -> dict[str, float]:
    """Most rays a second that a GPU's memory lets be trained, ``rays`` a step.

    ``rows_per_ray``, ``bytes_per_ray``, and ``rays_per_second``: a step's bytes copied within the
    device's memory, each read or written once. ``rows`` and ``width`` are as for `training_floor`.
    """
    moved = rows * 3.0 * width * 4.0
    seconds = process.call(f"{__name__}:copy_seconds", int(rays * moved / 2.0))
    return {"rows_per_ray": rows, "bytes_per_ray": moved, "rays_per_second": rays / seconds}


_COPIES = 20


def copy_seconds(device: Device, size: int) -> float:
    """Seconds that a device needs to copy ``size`` bytes within its own memory, the mean of 20.

    What is more than a binding holds is copied in parts.
    """
    part = min(max(size // 4 * 4, 4), BINDING)
    source, target = device.buffer(part), device.buffer(part)

    def copy() -> None:
        encoder = device.raw.create_command_encoder()
        for _ in range(_COPIES):
            left = size
            while left > 0:
                some = max(min(left, part) // 4 * 4, 4)
                encoder.copy_buffer_to_buffer(source, 0, target, 0, some)
                left -= part
        device.raw.queue.submit([encoder.finish()])
        device.wait()

    copy()
    start = time.perf_counter()
    copy()
    return (time.perf_counter() - start) / _COPIES


_CONDITIONS = ("machine", "vectors", "device", "failed", "repeats", "files", "stages", "totals")
"""Entries of a run's figures that are no figures of what was measured."""


def flat_figures(figures: Mapping[str, Any], prefix: str = "") -> dict[str, int | float]:
    """Numbers of nested figures by dotted names; lists and texts are left out."""
    rows: dict[str, int | float] = {}
    for name, value in figures.items():
        if name in _CONDITIONS:
            continue
        if isinstance(value, Mapping):
            rows.update(flat_figures(value, f"{prefix}{name}."))
        elif isinstance(value, (int, float)) and not isinstance(value, bool):
            rows[prefix + name] = value
    return rows


def commit_of_checkout() -> str:
    """The commit of the checkout that this package runs from; a package's version elsewhere."""
    try:
        done = subprocess.run(["git", "-C", str(Path(__file__).parent), "rev-parse", "--short=7",
                               "HEAD"], capture_output=True, text=True, check=True, timeout=20)
    except (OSError, subprocess.SubprocessError):
        return __version__
    return done.stdout.strip()


def read_measured(path: Path) -> dict[str, Any]:
    """The file's content, or an empty one where there is none."""
    if not path.exists():
        return {"runs": {}, "figures": {}}
    found = read_json(path)
    if not isinstance(found, dict) or not {"runs", "figures"} <= found.keys():
        raise UserError(f"{path} is no file of measured figures: it has no runs and figures")
    return found


def record(path: Path, what: str, figures: Mapping[str, Any], command: str, *,
           date: datetime.date | None = None, commit: str | None = None) -> None:
    """Add a run's figures, as ``--json`` has them, to a file; those of the same names are replaced.

    ``what`` was measured, a choice of ``lfportrait bench``, stands before the figures' names, but
    for ``all`` and ``job``, whose names begin with what they are. Date and commit are by default
    today's, and that of the checkout.
    """
    known = read_measured(path)
    commit = commit or commit_of_checkout()
    date = date or datetime.date.today()
    run = f"{date:%Y-%m-%d} {what} {commit}"
    unit = figures["vectors"]["unit"] if "vectors" in figures else vector_unit()[0]
    known["runs"][run] = {"command": command, "machine": figures["machine"],
                          "vectors": unit, "commit": commit, "date": f"{date:%Y-%m-%d}"}
    prefix = "" if what in ("all", "job") else f"{what}."
    known["figures"].update({name: [value, run]
                             for name, value in flat_figures(figures, prefix).items()})
    used = {source for _, source in known["figures"].values()}
    known["runs"] = {name: one for name, one in known["runs"].items() if name in used}
    with atomic_write(path) as stream:
        stream.write(_text(known).encode())


def _text(known: Mapping[str, Any]) -> str:
    """JSON with a line for each figure, so that a change shows what changed."""
    figures = ",\n".join(f'    {json.dumps(name)}: {json.dumps(value)}'
                         for name, value in sorted(known["figures"].items()))
    rest = {name: value for name, value in known.items() if name != "figures"}
    head = json.dumps(rest, indent=2, ensure_ascii=False).removesuffix("\n}")
    return f'{head},\n  "figures": {{\n{figures}\n  }}\n}}\n'
