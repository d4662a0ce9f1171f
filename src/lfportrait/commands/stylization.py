"""Commands of the style: ``transfer`` (2D), ``stylize`` (a field), ``styles``."""

from __future__ import annotations

from dataclasses import dataclass, replace
from dataclasses import field as option
from pathlib import Path
from typing import Annotated, Any

import tyro

from ..example import (
    Exemplar,
    FaceBlitConfig,
    FaceStyleConfig,
    Method,
    MethodConfig,
    NetworkConfig,
    TransferConfig,
)
from ..files import read_image, write_image
from ..stylize import StylizeConfig
from .common import Common

__all__ = ["Styles", "Stylize", "TransferPhoto"]


@dataclass
class TransferPhoto(Common):
    """Stylise one photo by example: guides, look-up table, StyleBlit; or one of its rivals."""

    photo: tyro.conf.Positional[Path]
    """Photo of a face."""
    style: str
    """Exemplar: a picture (landmarks beside it or detected) or a name from `lfportrait styles`."""
    out: Path = Path("out.png")
    """File for the stylised picture."""
    config: Annotated[TransferConfig, tyro.conf.arg(name="")] = option(
        default_factory=TransferConfig)
    """Transfer by StyleBlit."""
    method: Method = "styleblit"
    """styleblit: ours; faceblit: window-searched table and flood fill, as published; facestyle:
    guided patch synthesis, seconds a picture; network: trained on the paintings of one style."""
    faceblit: FaceBlitConfig = option(default_factory=FaceBlitConfig)
    """FaceBlit."""
    facestyle: FaceStyleConfig = option(default_factory=FaceStyleConfig)
    """FaceStyle."""
    network: NetworkConfig = option(default_factory=NetworkConfig)
    """Network."""
    dump: Path | None = None
    """Folder for pictures of every intermediate: guides, labels, table error, chunks, mask."""

    def run(self) -> dict[str, Any]:
        """Transfer and write."""
        from ..example import paint

        exemplar = Exemplar.load(self.style)
        photo = read_image(self.photo)[..., :3]
        result = paint(photo, exemplar, self._config())
        write_image(self.out, result.image)
        if self.dump is not None:
            result.dump(self.dump)
        return {"method": self.method, **result.seconds}

    def _config(self) -> MethodConfig:
        """The configuration of the chosen method."""
        if self.method == "faceblit":
            return self.faceblit
        if self.method == "facestyle":
            return replace(self.facestyle, seed=self.seed)
        if self.method == "network":
            return replace(self.network, seed=self.seed)
        return replace(self.config, seed=self.seed)


@dataclass
class Stylize(Common):
    """Optimise a field's colours to an exemplar."""

    field: tyro.conf.Positional[Path]
    """Field file (.npz)."""
    capture: Path
    """The capture that the field was reconstructed from."""
    style: str
    """Exemplar: a picture or a name from `lfportrait styles`."""
    out: Path = Path("styled.npz")
    """File for the stylised field."""
    config: Annotated[StylizeConfig, tyro.conf.arg(name="")] = option(default_factory=StylizeConfig)
    """Stylisation."""
    dump: Path | None = None
    """Folder for pictures of every intermediate."""

    def run(self) -> dict[str, Any]:
        """Stylise and save."""
        from ..capture import CalibrateConfig
        from ..field import VoxelField
        from ..pipeline import prepare_capture
        from ..stylize import stylize_with_figures

        exemplar = Exemplar.load(self.style)
        voxels = VoxelField.load(self.field)
        capture, _ = prepare_capture(self.capture, CalibrateConfig(), keep_background=True,
                                     need_face=True)
        with self.progress("stylize") as progress:
            styled, figures = stylize_with_figures(
                voxels, capture, exemplar, replace(self.config, seed=self.seed), progress,
                device=self.device, dump=self.dump)
        styled.save(self.out)
        return figures


@dataclass
class Styles(Common):
    """List the built-in exemplars; write one as a picture with its landmarks."""

    name: str = ""
    """Style to write with --out."""
    out: Path | None = None
    """Picture file; the landmarks go beside it."""

    def run(self) -> dict[str, Any]:
        """List or write."""
        from ..demo import demo_exemplar, demo_styles
        from ..errors import UserError
        from ..face import write_landmarks

        names = demo_styles()
        if self.out is not None:
            exemplar = demo_exemplar(self.name or names[0])
            write_image(self.out, exemplar.image)
            write_landmarks(self.out.with_suffix(".landmarks.txt"), exemplar.landmarks)
        elif self.name:
            raise UserError("say where to write the style with --out FILE.png")
        else:
            print("\n".join(names))
        return {"styles": names}
