"""A method's views of one sitter in one style, with their times."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfportrait.capture import Camera
from lfportrait.device import device_name, torch_device
from lfportrait.example import Exemplar, Transfer, prepare
from lfportrait.field import Rendering, VoxelField
from lfportrait.files import atomic_write
from lfportrait.measure import cost_of
from lfportrait.progress import Progress
from lfportrait.stylize import StylizeConfig, stylize_with_figures

from ..baselines.transfer import NetworkConfig
from .methods import METHODS, Sizes, field_config, view_config
from .sitters import Sitter, bytes_of, landmarks_in

__all__ = ["Views", "paint_views", "real_views"]

Pictures = list[NDArray[np.uint8]]


@dataclass(frozen=True)
class Views:
    """The pictures that a method is measured by, on white.

    Attributes
    ----------
    arc, close
        uint8 [H, W, 3] each: along the arc, and the close views.
    """

    arc: Pictures
    close: Pictures

    def save(self, path: Path) -> None:
        """Write both to a file, which appears when it is complete."""
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(path) as stream:
            np.savez_compressed(stream, arc=np.stack(self.arc), close=np.stack(self.close))

    @staticmethod
    def load(path: Path) -> Views:
        """Read what `save` wrote."""
        with np.load(path, allow_pickle=False) as arrays:
            return Views(list(arrays["arc"]), list(arrays["close"]))


def real_views(sitter: Sitter) -> Views:
    """The real field in the same views."""
    return Views([bytes_of(shot.color) for shot in sitter.arc.real],
                 [bytes_of(shot.color) for shot in sitter.close])


def paint_views(method: str, sitter: Sitter, exemplar: Exemplar, sizes: Sizes,
                stylize: StylizeConfig, seed: int, progress: Progress | None,
                ) -> tuple[Views, dict[str, Any]]:
    """Paint a sitter by a method.

    Parameters
    ----------
    method
        Of `METHODS`.
    sitter, exemplar
        Who, and in whose manner.
    sizes, stylize, seed
        Parameters.
    progress
        Updated with what is being done.

    Returns
    -------
    views, figures
        ``device`` of the networks; ``seconds``: ``once`` (what is done for all views), ``view``
        (what each view takes on top of it); ``cpu_seconds`` and ``peak_memory_bytes`` of all of
        it; ``networks``, where there are some.
    """
    if METHODS[method].kind == "field":
        return _by_field(method, sitter, exemplar, sizes, stylize, seed, progress)
    return _by_views(method, sitter, exemplar, sizes, seed, progress)


def _by_field(method: str, sitter: Sitter, exemplar: Exemplar, sizes: Sizes,
              stylize: StylizeConfig, seed: int, progress: Progress | None,
              ) -> tuple[Views, dict[str, Any]]:
    config = field_config(method, stylize, sizes, seed)
    skin = sitter.skin if config.on_skin else None
    cost, (styled, found) = cost_of(lambda: stylize_with_figures(
        sitter.field, sitter.capture, exemplar, config, progress, device=sitter.device,
        skin=skin))
    start = time.perf_counter()
    views = Views(_seen(styled, sitter.arc.cameras), _seen(styled, sitter.close_cameras))
    each = (time.perf_counter() - start) / (len(views.arc) + len(views.close))
    networks = found.get("networks", found.get("refinement", {}).get("networks"))
    return views, {"seconds": {"once": cost.seconds, "view": round(each, 4)},
                   "cpu_seconds": cost.cpu_seconds, "peak_memory_bytes": cost.peak_memory_bytes,
                   "device": found["device"],
                   **({"networks": networks} if networks else {})}


def _seen(styled: VoxelField, cameras: Camera) -> Pictures:
    return [bytes_of(styled.render(cameras, view).color) for view in range(len(cameras))]


def _by_views(method: str, sitter: Sitter, exemplar: Exemplar, sizes: Sizes, seed: int,
              progress: Progress | None) -> tuple[Views, dict[str, Any]]:
    config = view_config(method, sizes, seed)
    device = "cpu"
    if isinstance(config, NetworkConfig):
        config = replace(config, device=sitter.device)
        device = device_name(torch_device(sitter.device))
    middle = len(sitter.close) // 2
    front = (bytes_of(sitter.close[middle].color),
             landmarks_in(sitter.close_cameras, middle, sitter.landmarks))
    once, prepared = cost_of(lambda: prepare(exemplar, config, [front]))

    def painted(cameras: Camera, real: list[Rendering]) -> Pictures:
        pictures = []
        for view, shot in enumerate(real):
            if progress is not None:
                progress.update(progress.done, f"view {view + 1} of {len(real)}")
            pictures.append(_single(prepared, shot, landmarks_in(cameras, view, sitter.landmarks)))
        return pictures

    cost, views = cost_of(lambda: Views(painted(sitter.arc.cameras, sitter.arc.real),
                                        painted(sitter.close_cameras, sitter.close)))
    each = cost.seconds / (len(views.arc) + len(views.close))
    return views, {"device": device, "seconds": {"once": once.seconds, "view": round(each, 4)},
                   "cpu_seconds": round(once.cpu_seconds + cost.cpu_seconds, 3),
                   "peak_memory_bytes": max(once.peak_memory_bytes, cost.peak_memory_bytes)}


def _single(prepared: Any, shot: Rendering, landmarks: NDArray[np.float64]) -> NDArray[np.uint8]:
    """One view painted by itself and cut out by the field's opacity, on white."""
    photo = bytes_of(shot.color)
    if isinstance(prepared, Transfer):
        image = prepared.apply(photo, landmarks, mask=shot.alpha).image
    else:
        image = prepared.apply(photo, landmarks).image
    alpha = shot.alpha[..., None]
    return bytes_of(image * alpha + (1.0 - alpha))
