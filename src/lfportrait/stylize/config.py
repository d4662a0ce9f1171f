"""Parameters of the stylisation, and the interface of methods of other packages that color a field.

A package names a method under ``[project.entry-points."lfportrait.field_methods"]``. Behind the
name is a `FieldMethod`. The fields of its parameters are options of the command line:
``--NAME.FIELD``. The published methods that ours are compared with come in this way.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from dataclasses import field as option
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
import tyro

from ..arrays import Float32
from ..errors import UserError
from ..example import SKIN_PIXELS, SkinConfig, TransferConfig, Wear
from ..plugins import Choice, chosen, offered

if TYPE_CHECKING:
    from ..capture import Capture
    from ..example import Exemplar
    from ..field import VoxelField
    from ..progress import Progress

GROUP = "lfportrait.field_methods"  # Entry points of the methods of other packages.
OWN = ("skin", "paper")  # Methods of this stage.


@dataclass(frozen=True)
class FieldTask:
    """Inputs of another package's method."""

    field: VoxelField  # The real field; its density stays as it is.
    capture: Capture  # Its capture.
    exemplar: Exemplar  # The painting.
    background: float = 1.0  # Grey level behind the head.
    seed: int = 0  # Seed of the order of the views and of all other choices.
    progress: Progress | None = None  # Progress line.
    dump: Path | None = None  # Folder for pictures of intermediates; None writes none.
    # How a view is painted by example, where a method starts from one.
    transfer: TransferConfig = option(default_factory=TransferConfig)
    # Where networks compute, a choice of ``--device``; a method that has some calls
    # `lfportrait.device.torch_device` with it, and puts that device's name
    # (`lfportrait.device.device_name`) into its figures as ``device``.
    device: str = "auto"

    def tell(self, note: str, steps: int = 0) -> None:
        """Count ``steps`` finished steps on the progress line and show ``note``."""
        if self.progress is not None:
            self.progress.step(note, steps)

    def random(self, stream: int) -> np.random.Generator:
        """A random generator of its own for each ``stream``."""
        return np.random.Generator(np.random.Philox(key=[self.seed, stream]))


@dataclass(frozen=True)
class FieldMethod:
    """A method of another package."""

    # Class of its parameters, a frozen data class whose fields have defaults.
    parameters: type[Any]
    # Gives the colors of the field's rows, float32 [N, 3], and figures with ``seconds``. Its
    # module, and all that this imports, is part of a result's key.
    paint: Callable[[FieldTask, Any], tuple[Float32, dict[str, Any]]]
    needs_face: bool = True  # Whether it asks for the capture's landmarks.
    # Networks of the registry (`lfportrait.models`) that it can't do without.
    networks: tuple[str, ...] = ()


def field_method(name: str) -> FieldMethod:
    """A method of another package; `UserError` if no installed package has it."""
    found: FieldMethod = chosen(GROUP, name, OWN)
    return found


Network = Literal["auto", "vgg16", "resnet50", "vgg19-se", "embedded"]


@dataclass(frozen=True)
class StylizeConfig:
    """Parameters of the stylisation."""

    method: Annotated[str, Choice(GROUP, *OWN)] = "skin"
    """skin: painted once on the head's surface, then fitted and refined; paper: views painted one
    by one (Shen et al. 2023), then refined by the losses; the others are published methods for
    comparison, with their own parameters (docs/methods.md)."""
    preview: bool = False
    """On the skin: half the resolution, no fit and no refinement; seconds."""
    pixels: float = SKIN_PIXELS
    """On the skin: resolution in pixels per world unit (a head is about 1.5 high), 32 to 1024."""
    guide: Literal["surface", "view"] = "view"
    """Guide of painted views: from the landmarks in each view (paper), or anchored to the
    surface."""
    size: int = 576
    """Width and height of painted views in pixels."""
    arc: float = 75.0
    """Half angle of the painted views' arc in degrees."""
    views: int = 15
    """Views on each arc."""
    pitches: tuple[float, ...] = (-12.0, 8.0, 28.0)
    """Elevation of the arcs in degrees."""
    texture: bool = True
    """On the skin: add a texture with the details that the lattice is too coarse for."""
    fit_iterations: int | None = None
    """Iterations of the least-squares fit to the painting; by default 12 in views, on the skin 0
    with a texture, else 1 (more are sharper, but less consistent between views)."""
    steps: int | None = None
    """Refinement steps, one view each; 0: fit only; by default 3 on the skin, 90 in views."""
    content_network: Network = "auto"
    """Features of the content loss; auto: vgg16 if its weights are at hand, else embedded."""
    style_network: Network = "auto"
    """Features of the style loss; auto: resnet50 if its weights are at hand, else embedded."""
    alpha: float = 0.001
    """Weight of the content loss; at the paper's 0.001 its gradient is 0.1 of the fit's."""
    beta: float = 0.005
    """Weight of the style loss; at the paper's 0.005 its gradient is 0.5 of the fit's."""
    gamma: float = 10.0
    """Weight of the Laplacian loss; at the paper's 10 its gradient is 0.5 of the fit's."""
    lap_reference: Literal["example", "content"] = "example"
    """Reference of the Laplacian loss: the example (keeps brush work) or the photo (as in the
    paper)."""
    strength: float = 1.0
    """0 leaves the real colors, 1 gives the style; `lfportrait restyle` changes it afterwards."""
    keep: tuple[str, ...] = ()
    """Regions that keep the photo's colors: eyes, lips, hair, ears, clothes, ..."""
    eyes: Literal["auto", "painted"] = "auto"
    """On the skin: eyes that are closed on the head are painted closed (auto), or open as in the
    painting (painted)."""
    wear: tuple[Wear, ...] = ()
    """On the skin: put on the sitter what the painting's wears: hat, spectacles."""
    vignette: bool = True
    """Let a bust that the photos cut off, below or at a side, end in strokes that thin out instead
    of a straight cut."""
    background: float = 1.0
    """Grey level behind the head while stylising."""
    ground: bool = True
    """Paint a ground, too, from the painting's own background: panels show it behind the head
    (`--ground` of `lfportrait encode`). Previews have none."""
    skin: SkinConfig = field(default_factory=SkinConfig)
    """Painting on the skin."""
    transfer: TransferConfig = field(default_factory=TransferConfig)
    """Example-based transfer of faces and views."""
    parameters: tyro.conf.Suppress[tuple[Any, ...]] = ()
    """Parameters of methods of other packages, their data classes; without one its defaults."""
    seed: tyro.conf.Suppress[int] = 0
    """Seed of the order of the views and of the chunks."""

    def check(self) -> None:
        """Raise `UserError` if parameters are inconsistent or out of range."""
        if self.method not in OWN:
            field_method(self.method)
        if self.preview and not self.on_skin:
            raise UserError(f"--preview paints on the skin; leave out --method {self.method}")
        if self.on_skin:
            check_pixels(self.pixels)

    @property
    def on_skin(self) -> bool:
        """Whether the head is painted on its surface."""
        return self.method == "skin"

    @property
    def other(self) -> FieldMethod | None:
        """The method, where another package brings it."""
        return None if self.method in OWN else field_method(self.method)

    @property
    def needs_face(self) -> bool:
        """Whether the method asks for the capture's landmarks."""
        return self.other is None or self.other.needs_face

    @property
    def networks(self) -> tuple[str, ...]:
        """Networks of the registry that the method can't do without."""
        return self.other.networks if self.other is not None else ()

    @property
    def maker(self) -> str:
        """The module whose package makes the result (`lfportrait.cache.key_of`)."""
        return __name__ if self.other is None else self.other.paint.__module__

    def parameters_of(self, method: FieldMethod) -> Any:
        """Parameters of a method of another package."""
        given = (one for one in self.parameters if isinstance(one, method.parameters))
        return next(given, None) or method.parameters()

    def section(self, name: str) -> Any:
        """Parameters of another package's method by its name in a file of jobs, or None."""
        found = {method.replace("-", "_"): method for method in offered(GROUP)}
        return self.parameters_of(field_method(found[name])) if name in found else None

    def with_section(self, parameters: Any) -> StylizeConfig:
        """The same with other parameters of another package's method."""
        others = (one for one in self.parameters if type(one) is not type(parameters))
        return replace(self, parameters=(*others, parameters))

    @property
    def painting(self) -> SkinConfig:
        """Parameters of the painting on the skin, hasty ones for a preview."""
        return replace(self.skin, hasty=True) if self.preview else self.skin

    @property
    def iterations(self) -> int:
        """Iterations of the fit."""
        if self.fit_iterations is not None:
            return self.fit_iterations
        return (0 if self.texture else 1) if self.on_skin else 12

    @property
    def refinements(self) -> int:
        """Refinement steps."""
        return self.steps if self.steps is not None else (3 if self.on_skin else 90)

    @property
    def rate(self) -> float:
        """Adam's first step in color units; it falls to a tenth."""
        return 0.001 if self.on_skin else 0.02


def check_pixels(pixels: float) -> None:
    """Raise `UserError` for a skin of too few or too many ``pixels`` per world unit."""
    if not 32.0 <= pixels <= 1024.0:
        raise UserError(f"--pixels must lie between 32 and 1024, not at {pixels:g}")
