"""What is compared: sitters, methods, their views with their times, and the parameters of it all.

Methods color a field, or paint single views. All get the same field, the same views and the same
landmarks. What paints single views gets renders of the real field with the landmarks projected into
them, which no detector finds as exactly, and is cut out by the field's opacity: what is compared is
the paint, not the cutting.

A sitter is a capture, its field, and the views in which all methods are measured. The real field is
rendered once in two sets of views. The arc (a light-field display's cone) shows whether
neighbouring views agree; the close views, which the head fills from one profile's half to the
other's, show paint as large as an exemplar does.
"""

from __future__ import annotations

import functools
import os
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from lfportrait.arrays import Float64, UInt8
from lfportrait.cache import fingerprint_files
from lfportrait.capture import Camera, Capture
from lfportrait.color import to_uint8
from lfportrait.device import device_name, torch_device
from lfportrait.errors import UserError
from lfportrait.example import (
    Exemplar,
    MethodConfig,
    Skin,
    Transfer,
    TransferConfig,
    face_size,
    prepare,
)
from lfportrait.face import fit_to_surface
from lfportrait.field import ReconstructConfig, Rendering, VoxelField, reconstruct_with_figures
from lfportrait.files import atomic_write
from lfportrait.measure import cost_of
from lfportrait.media.folders import files_below
from lfportrait.plugins import offered
from lfportrait.progress import Progress
from lfportrait.stylize import StylizeConfig, kept_skin, stylize_with_figures

from ..baselines.config import FaceBlitConfig, FaceStyleConfig, NetworkConfig
from ..metrics.views import Arc, head_cameras


@dataclass(frozen=True)
class MethodEntry:
    """One method."""

    # ``field``: colors a field; ``views``: paints each view by itself.
    kind: Literal["field", "views"]
    what: str  # The method in a few words.


_FIELDS = {
    "skin": "ours: painted once on the head's surface",
    "paper": "Shen et al. 2023: views painted one by one, then the losses",
    "surface": "as paper, with guides that are anchored to the surface",
    "arf": "Zhang et al. 2022: nearest-neighbour features, no example",
    "stylized-nerf": "Huang et al. 2022: a painting network and the field teach each other",
    "ref-npr": "Zhang et al. 2023: one painted view carried over the field",
}
_VIEWS = {
    "views": "our transfer, each view by itself, no field",
    "faceblit": "Texler et al. 2021, each view by itself",
    "facestyle": "after Fiser et al. 2017, each view by itself",
    "network": "after Futschik et al. 2019, trained for one style, each view by itself",
}


def _field_methods() -> dict[str, MethodEntry]:
    """What `stylize` can do, methods of any package, and the paper's way with other guides."""
    names = (*_FIELDS, *(name for name in offered("lfportrait.field_methods")
                         if name not in _FIELDS))
    return {name: MethodEntry("field", _FIELDS.get(name, "see docs/methods.md")) for name in names}


METHODS: dict[str, MethodEntry] = {
    **_field_methods(), **{name: MethodEntry("views", what) for name, what in _VIEWS.items()}}
"""All methods by name."""


def field_config(name: str, base: StylizeConfig, sizes: Sizes, seed: int) -> StylizeConfig:
    """Parameters of a method that colors a field."""
    config = replace(base, method={"surface": "paper"}.get(name, name), seed=seed)
    # Parameters of other methods do not count.
    config = replace(config, parameters=(
        () if config.other is None else (config.parameters_of(config.other),)))
    if config.method == "skin":
        return replace(config, pixels=sizes.pixels)
    if config.method != "paper":
        # Published methods keep their own sizes.
        return config
    return replace(config, guide="surface" if name == "surface" else "view",
                   size=sizes.painted_size, views=sizes.painted_views, steps=sizes.painted_steps)


def view_config(name: str, sizes: Sizes, seed: int) -> MethodConfig:
    """Parameters of a method that paints single views."""
    if name == "faceblit":
        return FaceBlitConfig()
    if name == "facestyle":
        return FaceStyleConfig(seed=seed)
    if name == "network":
        return NetworkConfig(budget=sizes.network_seconds, size=sizes.render_size,
                             pairs=sizes.network_pairs, seed=seed)
    return TransferConfig(seed=seed)


def own_parameters(name: str, config: StylizeConfig) -> dict[str, Any]:
    """Parameters that a method's result depends on: those of the skin count for it alone."""
    return {one.name: getattr(config, one.name) for one in fields(config)
            if one.name != "skin" or name == "skin"}


@dataclass(frozen=True)
class Sizes:
    """Sizes that a run is made of."""

    pixels: float  # Of the skin per world unit.
    # render_size, close_size: Width and height in pixels of the views on the arc, and of those that
    # the head fills.
    render_size: int
    close_size: int
    # painted_size, painted_views, painted_steps: Of methods that paint views before they fit a
    # field: width and height in pixels, views on each of three arcs, refinement steps.
    painted_size: int
    painted_views: int
    painted_steps: int
    crops: int  # Of renders and of the exemplar, for the distances of features.
    # network_pairs, network_seconds: Training of the network that paints single views: its
    # examples, and seconds.
    network_pairs: int
    network_seconds: float


QUICK = Sizes(256.0, 256, 384, 384, 7, 20, 24, 6, 15.0)
"""About a minute a portrait and method."""
FULL = Sizes(384.0, 384, 768, 576, 15, 90, 48, 24, 240.0)
"""The methods' own sizes."""


@dataclass(frozen=True)
class TablesConfig:
    """Methods and sizes of the comparison."""

    methods: tuple[str, ...] = ()
    """Methods to compare; by default all (field and views, see docs/comparisons.md)."""
    size: Literal["quick", "full"] = "quick"
    """quick: about a minute a portrait and method; full: the methods' own sizes, many minutes."""
    sizes: tuple[str, ...] = ()
    """Sizes other than these, as NAME=NUMBER: pixels, render-size, close-size, painted-size,
    painted-views, painted-steps, crops, network-pairs, network-seconds (docs/comparisons.md)."""
    views: int = 16
    """Views on the arc."""
    cone: float = 40.0
    """Width of the arc in degrees."""
    speed: bool = True
    """Also measure Table 1 (the mask guide) and Fig. 6 (speed of the transfers)."""
    done_only: bool = False
    """Compute nothing: write the tables of the finished cells."""
    study: Path | None = None
    """Folder with the results of a user study (`lfportrait study results`), to be included."""
    stylize: StylizeConfig = field(default_factory=StylizeConfig)
    """Parameters of the methods that color a field; method, guide, pixels, size, views and steps
    are set by the options above."""

    def all_sizes(self) -> Sizes:
        """The sizes of this run: those that are given, else those of ``size``."""
        kinds = {"float": float, "int": int}
        known = {one.name: kinds[str(one.type)] for one in fields(Sizes)}
        given: dict[str, Any] = {}
        for word in self.sizes:
            name, _, value = word.partition("=")
            name = name.replace("-", "_")
            if name not in known:
                raise UserError(f"--sizes {word}: choose from "
                                f"{', '.join(known).replace('_', '-')}, and write NAME=NUMBER")
            try:
                given[name] = known[name](value)
            except ValueError:
                raise UserError(f"--sizes {word}: {value!r} is no number") from None
        return replace(QUICK if self.size == "quick" else FULL, **given)

    def chosen(self) -> tuple[str, ...]:
        """Names of the methods that are compared."""
        return self.methods or tuple(METHODS)

    def check(self) -> None:
        """Raise `UserError` where parameters are unknown or out of range."""
        unknown = [name for name in self.methods if name not in METHODS]
        if unknown:
            raise UserError(f"there is no method {unknown[0]!r}; choose from {', '.join(METHODS)}")
        if len(set(self.chosen())) < len(self.chosen()):
            raise UserError("a method is named twice in --methods")
        if self.views < 2:
            raise UserError(f"--views must be 2 or more, not {self.views}")
        if not 0.0 < self.cone <= 180.0:
            raise UserError(f"--cone must lie between 0 and 180 degrees, not at {self.cone:g}")
        sizes = self.all_sizes()
        for name in ("render_size", "close_size", "painted_size"):
            if getattr(sizes, name) < 32:
                raise UserError(f"--sizes {name.replace('_', '-')} must be 32 pixels or more, "
                                f"not {getattr(sizes, name)}")
        if self.study is not None and not (self.study / "results.json").is_file():
            raise UserError(f"there are no results of a study in {self.study}; write them with "
                            "`lfportrait study results`")
        if sizes.crops < 2:
            raise UserError(f"--sizes crops must be 2 or more, not {sizes.crops}")


CLOSE_DEGREES = (-45.0, -20.0, 0.0, 20.0, 45.0)
"""Yaws of the close views."""
SHOWN = (0, 2, 4)
"""Those that are shown as pictures."""

Opener = Callable[[Path], Capture]
"""Makes a capture of what a user named."""


def landmarks_in(cameras: Camera, view: int, landmarks: NDArray[np.floating],
                 ) -> Float64:
    """Landmarks [68, 3] in space as pixels [68, 2] of a view."""
    pixels, _ = cameras[view].project(np.asarray(landmarks, np.float64))
    return np.asarray(pixels[0], np.float64)


@dataclass(frozen=True)
class Source:
    """Source of a sitter, as the user named it."""

    name: str  # Of the sitter.
    capture: Path  # Photos, a data set or a capture.
    # A field that was reconstructed from it; None: it is reconstructed once and kept.
    field: Path | None = None

    def key(self) -> str:
        """Hash of the files."""
        files = [self.capture] if self.capture.is_file() else files_below(self.capture)
        return fingerprint_files(files + ([self.field] if self.field else []))


def sources_of(captures: tuple[str, ...], fields: tuple[str, ...] = ()) -> list[Source]:
    """Sitters from words of the command line: ``CAP``, ``NAME=CAP`` or ``NAME=CAP:FIELD`` each.

    ``fields`` are field files in the order of the captures, where they are not named there.
    """
    if not captures:
        raise UserError("name the sitters: --capture NAME=CAPTURE[:FIELD] ...")
    if len(fields) > len(captures):
        raise UserError(f"there are {len(fields)} fields for {len(captures)} captures")
    found = []
    for number, word in enumerate(captures):
        name, _, rest = word.rpartition("=") if not Path(word).exists() else ("", "", word)
        path, given = Path(rest), fields[number] if number < len(fields) else ""
        if not path.exists() and ":" in rest:
            text, _, given = rest.rpartition(":")
            path = Path(text)
        if not path.exists():
            raise UserError(f"there is no capture {path}; write --capture NAME=CAPTURE[:FIELD]")
        if given and not Path(given).is_file():
            raise UserError(f"there is no field {given}")
        found.append(Source(name or path.stem, path, Path(given) if given else None))
    names = [source.name for source in found]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise UserError(f"two sitters are called {twice!r}; name them: --capture NAME=CAPTURE")
    wrong = next((name for name in names if "/" in name or name.startswith(".")), None)
    if wrong is not None:
        raise UserError(f"{wrong!r} is not a valid sitter name; leave out slashes and leading dots")
    return found


class Sitter:
    """A sitter that is ready to be painted; what takes long is computed when first needed.

    Parameters
    ----------
    field, capture : The real field, and its capture with landmarks.
    file : The field's file, for the skin that is kept beside it.
    pixels : Of the skin per world unit.
    arc, close_size : Its width in degrees, its views, and their pixels a side; those of the close
        views.
    """

    def __init__(self, name: str, field: VoxelField, capture: Capture, file: Path, *,
                 pixels: float, arc: tuple[float, int, int], close_size: int,
                 device: str = "auto") -> None:
        if capture.landmarks is None:
            raise UserError(f"the sitter {name!r} has no facial landmarks; run `lfportrait "
                            "calibrate` on the photos")
        self.name, self.field, self.capture, self.file = name, field, capture, file
        self.device = device
        self.landmarks = np.asarray(capture.landmarks, np.float64)
        self._pixels, self._arc = pixels, arc
        self.close_cameras = head_cameras(self.landmarks, CLOSE_DEGREES, close_size, room=1.1,
                                          back=0.2)

    @functools.cached_property
    def skin(self) -> Skin:
        """The skin of the field."""
        return kept_skin(self.file, self.field, self.capture, self._pixels)

    @functools.cached_property
    def arc(self) -> Arc:
        """The real field along the arc."""
        return Arc.of(self.field, *self._arc)

    @functools.cached_property
    def close(self) -> list[Rendering]:
        """The real field in the close views."""
        return [self.field.render(self.close_cameras, view)
                for view in range(len(self.close_cameras))]

    @property
    def unit(self) -> float:
        """Size of the face in the close view from the front, in pixels."""
        return face_size(landmarks_in(self.close_cameras, len(CLOSE_DEGREES) // 2, self.landmarks))


def linked(source: Path, target: Path) -> None:
    """Let ``target`` be the file ``source``: a link where the system makes one, else a copy."""
    target.parent.mkdir(parents=True, exist_ok=True)
    target.unlink(missing_ok=True)
    try:
        os.symlink(source.absolute(), target)
    except OSError:
        shutil.copyfile(source, target)


def field_of(capture: Capture, target: Path, config: ReconstructConfig,
             progress: Progress | None) -> dict[str, Any]:
    """Reconstruct a capture's field into a file; figures."""
    field, figures = reconstruct_with_figures(capture, config, progress, fit_head=fit_to_surface)
    target.parent.mkdir(parents=True, exist_ok=True)
    field.save(target)
    return figures


Pictures = list[UInt8]


@dataclass(frozen=True)
class Views:
    """The pictures that a method is measured by, on white."""

    # arc, close: uint8 [H, W, 3] each: along the arc, and the close views.
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
    return Views([to_uint8(shot.color) for shot in sitter.arc.real],
                 [to_uint8(shot.color) for shot in sitter.close])


def paint_views(method: str, sitter: Sitter, exemplar: Exemplar, sizes: Sizes,
                stylize: StylizeConfig, seed: int, progress: Progress | None,
                ) -> tuple[Views, dict[str, Any]]:
    """Paint a sitter by a method of `METHODS`: its views, and figures.

    ``device`` of the networks; ``seconds``: ``once`` (what is done for all views), ``view`` (what
    each view takes on top of it); ``cpu_seconds`` and ``peak_memory_bytes`` of all of it;
    ``networks``, where there are some.
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
    return [to_uint8(styled.render(cameras, view).color) for view in range(len(cameras))]


def _by_views(method: str, sitter: Sitter, exemplar: Exemplar, sizes: Sizes, seed: int,
              progress: Progress | None) -> tuple[Views, dict[str, Any]]:
    config = view_config(method, sizes, seed)
    device = "cpu"
    if isinstance(config, NetworkConfig):
        config = replace(config, device=sitter.device)
        device = device_name(torch_device(sitter.device))
    middle = len(sitter.close) // 2
    front = (to_uint8(sitter.close[middle].color),
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


def _single(prepared: Any, shot: Rendering, landmarks: Float64) -> UInt8:
    """One view painted by itself and cut out by the field's opacity, on white."""
    photo = to_uint8(shot.color)
    if isinstance(prepared, Transfer):
        image = prepared.apply(photo, landmarks, mask=shot.alpha).image
    else:
        image = prepared.apply(photo, landmarks).image
    alpha = shot.alpha[..., None]
    return to_uint8(image * alpha + (1.0 - alpha))
