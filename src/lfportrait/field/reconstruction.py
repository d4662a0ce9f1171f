"""Reconstruction: Plenoxels' optimisation on the CPU, coarse to fine.

Each level of resolution trains density (by RMSProp) and color (by SART's steps, see
`lfportrait.field.kernels.descent`) on the squared color error (Shen et al. 2023, Eq. 2) with total
variation (Eq. 3) and a distortion loss that makes surfaces thin;
between levels, lattice points that no training ray sees are pruned and the rest are upsampled.
Where the photos have mattes, the field starts from their visual hull, the opacity of each ray is
fitted, too, and every batch is composited on random backgrounds, so that empty space ends clean;
rays that the hull and the mattes make idle are not drawn. Mattes that were made from the photos are
recomputed along the photos' edges before and within the last level
(`lfportrait.field.geometry.mattes`). Photos without mattes get spheres behind the lattice that
learn the room. Steps are counted in rays, not in seconds, unless a time budget is given.
"""

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Bool, Float64, Floats, Int32, Int64
from ..capture import Capture
from ..device import gpu_adapter
from ..gpu import GpuProcess, gpu_process
from ..measure import peak_memory_bytes
from ..progress import Progress, note, say
from .closing.colors import as_photographed, with_steady_colors
from .closing.fins import mouth_of, without_beaks, without_fins
from .closing.fitted_head import FitHead
from .closing.grazed import Grazed, with_even_colors
from .closing.sides import close_back, close_sides
from .config import ReconstructConfig, Settings
from .geometry.head_surface import HeadSurface, is_narrow
from .grid import Cut, VoxelField
from .kernels.descent import descend
from .training.gpu_stepping import GpuSteps
from .training.meter import CurveFile, Curves, Meter, held_out_quality
from .training.pixels import Batches
from .training.stepping import Caster, Plan, StepData
from .training.trainer import Trainer, settled
from .trimming import above_wall, find_cut, kept_pixels, trim


def reconstruct(capture: Capture, config: ReconstructConfig | None = None,
                progress: Progress | None = None, checkpoint: Path | None = None,
                device: str = "auto") -> VoxelField:
    """Reconstruct a radiance field from a capture: the field of `reconstruct_with_figures`.

    Parameters
    ----------
    capture : Views with their cameras in the portrait frame; held-out views are left out.
    config : Parameters.
    progress : Progress line.
    checkpoint : File that the state is written to; a run that finds one there goes on from it to
        the same field.
    device : Where to train: ``auto`` takes a real GPU, ``cpu``, ``gpu``, or ``gpu:NAME``.

    Raises
    ------
    UserError : If the capture or a parameter can't be used.
    """
    return reconstruct_with_figures(capture, config, progress, checkpoint, device=device)[0]


def reconstruct_with_figures(capture: Capture, config: ReconstructConfig | None = None,
                             progress: Progress | None = None, checkpoint: Path | None = None,
                             curves: Curves | None = None, device: str = "auto",
                             look: Callable[[Callable[[], VoxelField]], None] | None = None,
                             fit_head: FitHead | None = None) -> tuple[VoxelField, dict[str, Any]]:
    """Reconstruct a radiance field from a capture.

    Raises `UserError` if nothing is left to train on.

    Parameters
    ----------
    capture : Views with their cameras in the portrait frame; held-out views are only tested on.
    checkpoint : File that the state is written to once a minute; a run that finds one there goes
        on from it to the same field.
    curves : What is kept of the training's course; None keeps nothing.
    device : Where to train: ``auto`` takes a real GPU, ``cpu``, ``gpu``, or ``gpu:NAME``.
    look : Called when a coarse level is good enough to be looked at, and many times after that,
        each time with what gives the field as if the training ended there; the training is the
        same whether it is called for or not. It may raise an exception to end the
        reconstruction, which goes on from the checkpoint the next time.
    fit_head : What a narrow arc of photos does not show follows the head that this fits to them
        (`lfportrait.face.fit_to_surface`); None: a generic bust.

    Returns
    -------
    field, figures : The field and the figures for ``--json``: ``test.psnr`` (dB) and
        ``test.ssim`` over the held-out views, ``train.rays``, ``train.rays_per_second``,
        ``voxels``, ``seconds``; ``closed`` (share of the surface, rows added) where the head
        was open behind, ``trimmed`` (rows dropped and the plane's height) where a frayed end
        was cut off, both after the test, ``test.psnr_finished`` (dB) after them;
        ``test.psnr_kept`` and ``test.psnr_kept_finished`` (dB), the same over what the cut left
        of the held-out views; with ``curves.measure_every`` also ``curve``, a list of `CurvePoint`;
        with ``refine_poses`` also ``cameras`` (`PoseRefiner.figures`) and
        ``test.psnr_at_given_cameras`` (dB); where mattes were recomputed, also
        ``test.psnr_at_given_mattes``.
    """
    distance = float(np.linalg.norm(capture.cameras.position, axis=1).min())
    config = (config or ReconstructConfig()).resolved(capture.alphas is None, distance,
                                                      capture.cameras.pixel,
                                                      is_narrow(capture))
    file = CurveFile(curves.log) if curves is not None and curves.log is not None else None
    meter = None if curves is None else Meter(file, measure_every=curves.measure_every)
    adapter = gpu_adapter(device)
    process = gpu_process(adapter) if adapter is not None else None
    try:
        return _reconstruct(capture, config, progress, checkpoint, meter, process, look,
                            fit_head)
    finally:
        if file is not None:
            file.close()


def _reconstruct(capture: Capture, config: Settings, progress: Progress | None,
                 checkpoint: Path | None, meter: Meter | None, process: GpuProcess | None,
                 look: Callable[[Callable[[], VoxelField]], None] | None,
                 fit_head: FitHead | None) -> tuple[VoxelField, dict[str, Any]]:
    """The same with parameters put in; the field and the figures."""
    trainer = Trainer(capture, config, progress, checkpoint, meter, process,
                      None if look is None
                      else lambda trainer: look(lambda: _so_far(trainer, fit_head)))
    trainer.restore()
    first_rays = trainer.rays_done
    start = time.perf_counter()
    if meter is not None:
        meter.start(first_rays)
    trainer.offer()  # what an earlier run has trained
    while trainer.level < len(config.resolutions):
        trainer.run_level()
        trainer.offer()
    if meter is not None and (not meter.points or meter.points[-1]["rays"] < trainer.rays_done):
        trainer.record()
    trainer.finish()
    trained = (meter.seconds if meter is not None
               else time.perf_counter() - start - trainer.looked)
    field = trainer.field()
    begun = time.perf_counter()
    figures: dict[str, Any] = {
        "train": {"rays": trainer.rays_done, "views": len(trainer.views),
                  "rays_per_second": (trainer.rays_done - first_rays) / max(trained, 1e-9)},
        "voxels": len(field.density), "resolution": config.resolutions[-1],
        "levels": trainer.log, "device": trainer.device,
        "peak_memory_bytes": peak_memory_bytes()}
    if trainer.poses is not None:
        figures["cameras"] = trainer.poses.figures()
    cut = _cut(field, trainer)
    # Closing a head keeps one core busy: the views are tested beside it.
    with ThreadPoolExecutor(1) as beside:
        testing = beside.submit(_tested, field, trainer, capture, cut)
        finished = field
        if capture.alphas is not None and capture.landmarks is not None:
            finished = _finished(field, trainer, capture.landmarks, cut, figures, progress,
                                 fit_head)
        test, kept = testing.result()
    if test:
        figures["test"] = test
        if meter is not None:
            meter.finish(trainer.rays_done, trained, test["psnr"])
        if finished is not field:
            after = held_out_quality(finished, trainer.capture, config.background,
                                     trainer.test_gains, kept=kept)
            test |= {f"{name}_finished": after[name] for name in ("psnr", "psnr_kept")
                     if name in after}
    if meter is not None and meter.measure_every > 0:
        figures["curve"] = meter.points
        figures["train"]["casting"] = _casting_figures(trainer)
    figures["seconds"] = {"train": round(trained, 3),
                          "test": round(time.perf_counter() - begun, 3)}
    field = finished
    if progress is not None and "test" in figures:
        progress.update(progress.total, f"held-out views {figures['test']['psnr']:.2f} dB")
    return field, figures


def _tested(field: VoxelField, trainer: Trainer, capture: Capture, cut: Cut | None,
            ) -> tuple[dict[str, float], list[Bool] | None]:
    """How the held-out views look, if there are any, and their pixels that a cut leaves."""
    if not len(capture.testing()):
        return {}, None
    background, gains, tested = trainer.config.background, trainer.test_gains, trainer.capture
    if trainer.poses is not None:
        tested = trainer.poses.tested(field, trainer.capture, gains)
    others: dict[str, tuple[Capture, Float64 | None]] = {}
    if not np.allclose(gains, 1.0):
        others["psnr_without_exposure"] = tested, None
    if trainer.laid is not None:
        others["psnr_at_given_mattes"] = replace(tested, alphas=capture.alphas), gains
    kept = None
    if cut is not None:
        trimmed = trim(field, cut)
        kept = [kept_pixels(field, tested.cameras, int(view), cut, trimmed)
                for view in tested.testing()]
        if not all(one.any() for one in kept):
            kept = None
    figures = held_out_quality(field, tested, background, gains, others=others, kept=kept)
    if trainer.poses is not None:
        plain = held_out_quality(field, replace(tested, cameras=capture.cameras), background, gains)
        figures["psnr_at_given_cameras"] = plain["psnr"]
    return figures, kept


def _cut(field: VoxelField, trainer: Trainer) -> Cut | None:
    """Where a bust is to be cut; None: nowhere."""
    capture = trainer.capture
    if not trainer.config.cut_base or capture.alphas is None or capture.landmarks is None:
        return None
    cut = find_cut(field, capture.landmarks, capture.cameras[capture.training()],
                   surely="mattes" not in capture.figures)
    if trainer.surface is None or "mattes" not in capture.figures:
        return cut
    return above_wall(field, capture, cut)


def _so_far(trainer: Trainer, fit_head: FitHead | None) -> VoxelField:
    """The field as it would be if the training ended now."""
    field, capture = trainer.field(trainer.cleaned()), trainer.capture
    if capture.alphas is None or capture.landmarks is None:
        return field
    return _finished(field, trainer, capture.landmarks, _cut(field, trainer), {}, None, fit_head,
                     roughly=True)


def _finished(field: VoxelField, trainer: Trainer, landmarks: Floats,
              cut: Cut | None, figures: dict[str, Any], progress: Progress | None,
              fit_head: FitHead | None, roughly: bool = False) -> VoxelField:
    """The head with a back and a clean lower end (untrained: ``roughly``); fills the figures."""
    capture = trainer.capture
    surface = trainer.surface
    cameras, middle = capture.cameras[capture.training()], np.nanmean(landmarks[[0, 16]], axis=0)
    bare: list[Float64] = []
    if surface is not None:
        figures["geometry"] = _geometry(surface, progress)
        # What is closed goes on in these colors.
        field = without_fins(with_steady_colors(field, cameras, middle), landmarks)
        field, *bare = without_beaks(field, surface)
    if trainer.config.fill_back:
        if surface is not None:
            field, closed = close_sides(field, surface, capture, cut, fit_head)
        else:
            field, closed = close_back(field, landmarks, capture, cut)
        if closed is not None:
            figures["closed"] = {"share": round(closed.share, 4), "voxels": closed.points}
            if not roughly:
                note(progress, "training the closed head")
                whole = field
                field = settled(trainer, field, new=None if closed.grazed is None
                                else _new(closed.grazed, landmarks, bare))
                if closed.grazed is not None:
                    even = with_even_colors(with_steady_colors(field, cameras, middle),
                                            closed.grazed, whole)
                    field = as_photographed(even, field.sh, cameras, middle)
    if cut is not None:
        count = len(field.density)
        field = trim(field, cut)
        figures["trimmed"] = {"voxels": count - len(field.density),
                              "height": round(cut.height, 4)}
    figures["voxels"] = len(field.density)
    return field


def _new(grazed: Grazed, landmarks: Floats, bare: Sequence[Float64]) -> tuple[Float64, Float64]:
    """Where a narrow arc's head was changed, for `settled`; ``bare``: where matter was taken."""
    places, normals = grazed.new()
    mouth = mouth_of(landmarks)
    return np.concatenate([places, mouth, bare[0]]), np.concatenate([
        normals, np.broadcast_to([0.0, 0.0, 1.0], mouth.shape), bare[1]])


def _geometry(surface: HeadSurface, progress: Progress | None) -> dict[str, float]:
    """Share of the head that the photos of a narrow arc show, as figures and a one-line note."""
    head = surface.shown_of_head()
    figures = {"span_degrees": round(surface.span, 1), "head_shown": round(head, 3)}
    say(progress, f"the photos cover {surface.span:.0f} degrees around the head and show "
                  f"{100 * head:.0f} % of it well; the rest follows a generic head; for more, "
                  "take photos from further left, right, above and below")
    return figures


_CASTS = 8  # Batches that are cast for these figures.
_Cast = Callable[[Int32, Int64], dict[str, float]]
"""From a batch's tiles and blocks: ``seconds``, ``samples`` and ``records``."""


def _casting_figures(trainer: Trainer) -> dict[str, float]:
    """Time of casting rays forward and backward, and of applying their gradients.

    Of a reconstruction that is finished: ``rays_per_second`` of the fastest batch, for the two
    kernels alone; ``samples_per_ray``; ``rows_per_ray``, records of lattice points that a batch
    leaves by its number of rays; ``row_width``, values a point; ``batch``, rays of a step. On a GPU
    all kernels of a step count.
    """
    cast = (_cast_on_cpu(trainer) if trainer.process is None
            else _cast_on_gpu(trainer, trainer.process))
    data, config = trainer.data, trainer.config
    last = len(config.resolutions) - 1
    order = Batches(data, config.batch[last] // 16, config.seed, last)
    fastest, samples, records, rays = np.inf, 0.0, 0, 0
    for number in range(_CASTS):
        tiles = order.step(number)
        found = cast(tiles, order.blocks)
        fastest = min(fastest, found["seconds"] / (16 * len(tiles)))
        samples += found["samples"]
        records += int(found["records"])
        rays += 16 * len(tiles)
    return {"rays_per_second": 1.0 / fastest, "samples_per_ray": samples / rays,
            "rows_per_ray": records / rays, "row_width": trainer.width,
            "batch": rays // _CASTS}


def _cast_on_cpu(trainer: Trainer) -> _Cast:
    zero, lattice = np.float32(0.0), trainer.lattice
    assert lattice is not None
    caster = Caster(lattice, trainer.data, trainer.basis, trainer.workers)
    caster.skip_clear(trainer.options()[1])

    def cast(tiles: Int32, blocks: Int64) -> dict[str, float]:
        ground = np.ones((16 * len(tiles), 3), np.float32)
        start = time.perf_counter()
        caster.cast(tiles, ground, trainer.scale, trainer.options())
        # Steps of no length: the field stays as it is.
        descend(lattice.density, lattice.rows.ravel(), trainer.width, caster.records.arrays,
                caster.bases, zero, zero, zero, np.zeros(trainer.width, np.float32),
                np.float32(1.0))
        return {"seconds": time.perf_counter() - start,
                "samples": float(caster.losses[:, 2].sum()),
                "records": int(caster.records.counts.sum())}
    return cast


def _cast_on_gpu(trainer: Trainer, process: GpuProcess) -> _Cast:
    lattice, data, config = trainer.lattice, trainer.data, trainer.config
    assert lattice is not None
    last = len(config.resolutions) - 1

    def cast(tiles: Int32, blocks: Int64) -> dict[str, float]:
        level = StepData(lattice, data, config, last, trainer.basis, trainer.workers,
                         trainer.options(), np.float32(0.0), lambda: trainer.scale, lambda *_: None)
        steps = GpuSteps(process, level, len(tiles), trainer.background_trainer())
        steps.look_again(float(trainer.options()[1]))
        found = steps.measure(Plan(tiles, blocks, np.ones(len(tiles), np.float32),
                                   np.float32(0.0), np.float32(1.0), 0.0, (0.0, 0.0), False),
                              100 if process.adapter.real else 1)
        steps.close()
        return found
    return cast
