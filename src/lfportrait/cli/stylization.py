"""Commands of the style: ``transfer`` (2D) and ``stylize`` (a field)."""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from dataclasses import field as option
from pathlib import Path
from typing import Annotated, Any, ClassVar

import tyro

from ..errors import UserError
from ..example import (
    Exemplar,
    Method,
    MethodConfig,
    TransferConfig,
    photo_method,
)
from ..labels import LABELS, RegionStyle, members, read_regions, read_value
from ..stylize import StylizeConfig
from .common import Common

__all__ = ["Stylize", "TransferPhoto"]


@dataclass
class TransferPhoto(Common):
    """Stylise photos or a video by example (StyleBlit or another method)."""

    photo: tyro.conf.Positional[Path]
    """Photo of a face, a folder of photos, or a video."""
    style: str
    """Exemplar: a picture (landmarks beside it or detected) or a name from `lfportrait styles`."""
    out: Path = Path("out.png")
    """File for the stylised picture; for a folder of photos a folder, for a video a .mp4."""
    region: Annotated[tuple[tuple[str, ...], ...], tyro.conf.UseAppendAction] = ()
    """Strength or style of one region: NAME=NUMBER multiplies its strength (0 keeps the photo,
    above 1 exaggerates, 4 at most), NAME=STYLE or NAME=STYLE:NUMBER paints it like another picture,
    e.g. hair=other.png:0.5 lips=0.3; where regions overlap, the last one wins. Regions are brows,
    eyes, nose, lips, skin, ears, hair, neck, clothes, background, and the groups features and
    body."""
    config: Annotated[TransferConfig, tyro.conf.arg(name="")] = option(
        default_factory=lambda: TransferConfig(quality="best"))
    """Transfer by StyleBlit; a video is always painted with --quality fast."""
    method: Method = "styleblit"
    """styleblit: the default; the others are published methods for comparison, with their own
    parameters (docs/methods.md)."""
    dump: Path | None = None
    """Folder for pictures of every intermediate: guides, labels, table error, chunks, mask."""

    groups: ClassVar[dict[str, str]] = {"": "lfportrait.transfer_methods"}
    usual: ClassVar[tuple[str, ...]] = ("quality", "extent", "strength")

    def run(self) -> dict[str, Any]:
        """Transfer and write."""
        from ..capture import is_video
        from .transfers import transfer_folder, transfer_photo, transfer_video

        exemplar = Exemplar.load(self.style)
        choices = self._choices()
        if is_video(self.photo):
            if self.method != "styleblit" or choices:
                raise UserError("a video is painted by --method styleblit, without --region")
            with self.progress("transfer") as progress:
                return transfer_video(self.photo, self.out, exemplar,
                                      replace(self.config, seed=self.seed, quality="fast"),
                                      progress)
        if self.photo.is_dir():
            with self.progress("transfer") as progress:
                return transfer_folder(self.photo, self.out, exemplar, self._config(), choices,
                                       progress)
        seconds = transfer_photo(self.photo, self.out, exemplar, self._config(), choices,
                                 self.dump)
        return {"method": self.method, **seconds}

    def _choices(self) -> list[RegionStyle]:
        """What regions get."""
        found = read_regions(self.region)
        for name in found:
            members(name, LABELS)
        return [read_value(name, value) for name, value in found.items()]

    def _config(self) -> MethodConfig:
        """The configuration of the chosen method."""
        if self.method == "styleblit":
            return replace(self.config, seed=self.seed)
        kind = photo_method(self.method).parameters
        config = next((one for one in self.given if isinstance(one, kind)), kind())
        common = {"seed": self.seed, "device": self.device}
        return replace(config, **{entry.name: common[entry.name] for entry in fields(kind)
                                  if entry.name in common})


@dataclass
class Stylize(Common):
    """Stylise a field by an exemplar."""

    field: tyro.conf.Positional[Path]
    """Field file (.npz)."""
    capture: Path
    """The capture that the field was reconstructed from."""
    style: Annotated[list[str], tyro.conf.UseAppendAction]
    """Exemplar: a picture or a name from `lfportrait styles`. Several are all kept in the file; the
    field shows the first, `lfportrait restyle` selects another."""
    out: Path = Path("styled.npz")
    """File for the stylised field."""
    config: Annotated[StylizeConfig, tyro.conf.arg(name="")] = option(default_factory=StylizeConfig)
    """Stylisation."""
    dump: Path | None = None
    """Folder for pictures of every intermediate."""

    groups: ClassVar[dict[str, str]] = {"": "lfportrait.field_methods"}
    usual: ClassVar[tuple[str, ...]] = ("method", "preview", "strength", "keep", "pixels",
                                        "texture")

    def run(self) -> dict[str, Any]:
        """Stylise and save."""
        from ..field import VoxelField, check_field_path
        from ..job import capture_of_face
        from ..stylize import kept_skin, stylize_with_figures

        if not self.style:
            raise UserError("no style is given; name a painting: --style PICTURE")
        if not self.field.exists():  # before the painting is looked for
            raise UserError(f"no such field file: {self.field}")
        with self.progress("stylize") as progress:
            check_field_path(self.out)
            with ThreadPoolExecutor(1) as aside:
                coming = aside.submit(VoxelField.load, self.field)
                exemplars = [Exemplar.load(style) for style in self.style]
                capture = capture_of_face(self.capture)
                skin = (kept_skin(self.field, coming.result, capture, self.config.pixels)
                        if self.config.on_skin and capture.landmarks is not None else None)
                field = coming.result()
            config = replace(self.config, seed=self.seed, parameters=self.given)
            styled, figures = stylize_with_figures(field, capture, exemplars, config, progress,
                                                   device=self.device, dump=self.dump, skin=skin)
            styled.save(self.out)
        for notice in figures["notices"]:
            print(f"note: {notice}", file=sys.stderr)
        return figures
