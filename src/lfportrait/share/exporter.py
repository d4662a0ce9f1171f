"""What a kind of export is, and its parameters: each kind is a class above `Export`.

Our own are in `kinds`; other packages bring theirs by entry points.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass, is_dataclass
from dataclasses import field as option
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from ..errors import UserError
from ..lightfield import EncodeConfig
from ..plugins import blamed
from ..progress import Progress

if TYPE_CHECKING:
    from ..field import VoxelField


METRES = 0.1
"""Of a unit of the portrait frame: a head, which lies within -1 to 1, is 20 cm high."""


Up = Literal["auto", "y-up", "y-down"]


@dataclass(frozen=True)
class SplatConfig:
    """Parameters of Gaussian splats."""

    count: int = 400_000
    """Number of splats at most: one for each point of the visible surface."""
    steps: int = 120
    """Views of the field to which the splats are fitted, one after the other; 0 does not fit."""
    degree: Literal[0, 1, 2] | None = None
    """Degree of the spherical harmonics; by default the field's. Painted fields have degree 0."""
    up: Up = "auto"
    """Which way is up in the file. y-down: turned by 180 degrees about z, which SuperSplat undoes.
    auto: y-down in PLY and SOG files, y-up in SPZ and GLB files."""


@dataclass(frozen=True)
class ExportConfig:
    """Parameters of export."""

    kind: str = "auto"
    """Content of the file. auto: what its name asks for: splats in SPZ and SOG files, and in PLY
    and GLB files whose name contains "splat"; points in other PLY files; a mesh in GLB, USDZ and
    OBJ files; `lfportrait formats` lists all."""
    world: Literal["portrait", "source"] = "portrait"
    """Coordinates: the portrait frame (+y up, +z out of the face; points and meshes in metres,
    20 cm high; splats see ``--splats.up``), or those of the source capture as they are."""
    level: float | None = None
    """Opacity, 0 to 1. Points: the least along one voxel, by default 0.1. Mesh: at the surface; by
    default 0.5, accumulated from outside (0.15 with a
    texture), or 0.1 per voxel for a field with a background."""
    smooth: float | None = None
    """Mesh: sigma in voxels of the Gaussian that smooths the opacity first; by default 1.5, with a
    texture 0.8."""
    texture: Literal["auto", "yes", "no"] = "auto"
    """Mesh in a GLB or OBJ file: colors as a picture (yes) or at the vertices (no). auto: a picture
    if the field is painted. USDZ files always have a picture, PLY files never."""
    splats: SplatConfig = option(default_factory=SplatConfig)
    """Splats."""


@dataclass(frozen=True)
class SweepConfig:
    """Parameters of a video in which the head turns from side to side."""

    size: int = 512
    """Width and height in pixels."""
    frames: int = 90
    """Number of frames of one loop."""


@dataclass(frozen=True)
class LoopConfig:
    """Parameters of a short loop for messengers, in which the head turns a little."""

    size: int = 480
    """Width and height in pixels."""
    frames: int = 48
    """Number of frames of one loop."""
    fps: float = 20.0
    """Frames per second."""
    sway: float = 10.0
    """How far the head turns to each side, in degrees."""
    rise: float = 3.0
    """How far it is seen from above and from below, in degrees."""

    def __post_init__(self) -> None:
        for name, least, most in (("size", 16, 2160), ("frames", 2, 600), ("fps", 1, 50),
                                  ("sway", 0, 90), ("rise", 0, 60)):
            value = getattr(self, name)
            if not least <= value <= most:
                raise UserError(f"--loop.{name} must be {least} to {most}, not {value:g}")


_TYPES = {bool: "bool", int: "whole", float: "number", str: "text"}


@dataclass(frozen=True)
class NoParameters:
    """Of a kind without parameters."""


@dataclass(frozen=True)
class Option:
    """A parameter that the studio asks for: a field of `Export.parameters`, and a line beside it.

    ``min`` and ``max`` bound a number, ``choices`` a text; an empty text leaves the default.
    """

    name: str
    note: str
    default: bool | int | float | str
    min: float | None = None
    max: float | None = None
    choices: tuple[str, ...] | None = None

    @property
    def type(self) -> str:
        """``bool``, ``whole``, ``number``, ``text`` or ``choice``."""
        return "choice" if self.choices else _TYPES[type(self.default)]


@dataclass(frozen=True)
class ExportContext:
    """What an export has beside its own parameters.

    Placement and ground of the head; the panel (a preset's name or a display file, empty: none is
    named); and where it says how far it is.
    """

    encode: EncodeConfig = option(default_factory=EncodeConfig)
    display: str = ""
    progress: Progress = option(default_factory=lambda: Progress("export", enabled=False))

    def tell(self, share: float, text: str) -> None:
        """Say how much is done, 0 to 1, and what is being done."""
        self.progress.total = 100
        self.progress.update(int(100 * share), text)

    def step(self, number: int, count: int) -> None:
        """Say that a frame of a video begins."""
        self.progress.total = count
        self.progress.update(number, f"frame {number + 1} of {count}")


class Export(ABC):
    """One kind of file that a portrait is exported as.

    Attributes
    ----------
    name
        Short, one among all kinds.
    title, purpose
        For people, in English; one line each.
    ending, suffixes
        What the studio puts behind a name (``.glb``, ``_2x1.jpg``); suffixes that it can be written
        with, by default that of ``ending``.
    mark
        How a name's stem must end to ask for this kind; empty: its suffix is enough.
    contents
        What ``--kind`` calls it, by default its name; several kinds may be one in several formats.
    parameters, options
        A frozen data class, whose fields are ``--NAME.FIELD``; those that the studio asks for.
    megabytes
        A file of a head of 64 photos takes about; 0: nobody knows.
    group
        Where the studio's page shows it: ``panel``, ``screen``, ``solid``, ``splats`` or
        ``further``; empty: nowhere.
    needs_display
        Whether it is made for a panel.
    command
        What writes it on the command line; the name of a file asks only for kinds of ``export``.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    purpose: ClassVar[str]
    ending: ClassVar[str]
    suffixes: ClassVar[tuple[str, ...]] = ()
    mark: ClassVar[str] = ""
    contents: ClassVar[str] = ""
    parameters: ClassVar[type] = NoParameters
    options: ClassVar[tuple[Option, ...]] = ()
    megabytes: ClassVar[float] = 0
    group: ClassVar[str] = "further"
    needs_display: ClassVar[bool] = False
    command: ClassVar[str] = "export"

    @abstractmethod
    def write(self, field: VoxelField, path: Path, parameters: Any,
              context: ExportContext) -> dict[str, Any]:
        """Write the file, which appears under its name when it is whole.

        Parameters
        ----------
        field
            The field; a `StyledField` where the file holds one.
        path, parameters, context
            The file; an instance of ``parameters``; what else there is.

        Returns
        -------
        figures
            For ``--json``; whole numbers are also printed. ``out``, where the file has another name
            than ``path``, and ``bytes``, where there are files beside it.

        Raises
        ------
        UserError
            If the parameters make no sense or the file can't be written.
        """

    def check(self) -> None:
        """Complain of a class that can't be used; those of other packages are looked at."""
        for name in ("name", "title", "purpose", "ending"):
            if not isinstance(getattr(self, name, None), str):
                raise TypeError(f"it has no {name}")
        if not is_dataclass(self.parameters):
            raise TypeError("its parameters are no data class")
        self.parameters()
        {option.name: option.type for option in self.options}

    @property
    def kind(self) -> str:
        """What ``--kind`` calls it."""
        return self.contents or self.name

    @property
    def written(self) -> tuple[str, ...]:
        """All suffixes that it can be written with, the usual one first."""
        return self.suffixes or (Path(f"x{self.ending}").suffix,)

    def claim(self, path: Path) -> int:
        """How clearly a file's name asks for this kind.

        0: not at all, 1: by its suffix, 2: by a mark in its stem.
        """
        if path.suffix.lower() not in self.written:
            return 0
        if not self.mark:
            return 1
        return 2 if path.stem.lower().endswith(self.mark) else 0

    def make(self, field: VoxelField, path: Path, parameters: Any = None,
             context: ExportContext | None = None) -> dict[str, Any]:
        """Write the file; its figures with ``kind``, ``out`` and ``bytes``.

        Raises
        ------
        UserError
            As `write`, and where the code of another package fails.
        """
        with blamed(self):
            figures = self.write(field, path, self.parameters() if parameters is None
                                 else parameters, context or ExportContext())
            out = Path(figures.get("out", path))
            return {"kind": self.kind, "bytes": out.stat().st_size, **figures, "out": out}

    def chosen(self, options: Mapping[str, Any]) -> Any:
        """Parameters by the options that the studio asks for; an empty text leaves its default."""
        with blamed(self):
            return self.parameters(**{name: value for name, value in options.items()
                                      if value != ""})

    def facts(self, figures: Mapping[str, Any]) -> list[str]:
        """What the command line says of a file: the numbers of what is in it."""
        counts = [f"{value:,} {name}" for name, value in figures.items()
                  if isinstance(value, int) and name != "bytes"]
        return [*counts, *([f"{figures['psnr']:.1f} dB to the field"] if "psnr" in figures else [])]

    def entry(self) -> dict[str, Any]:
        """As the studio's page and ``--json`` have it."""
        return {"kind": self.name, "title": self.title, "purpose": self.purpose,
                "suffix": Path(f"x{self.ending}").suffix, "group": self.group,
                "about_bytes": round(1e6 * self.megabytes), "needs_display": self.needs_display,
                "options": [{**asdict(one), "type": one.type} for one in self.options]}
