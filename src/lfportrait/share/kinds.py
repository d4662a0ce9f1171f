"""Kinds of export: what a kind is, the parameters of each, our own, and the one list of all.

Each kind is a subclass of `Export`; other packages bring theirs by entry points. What computes is
imported when it is called.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass, is_dataclass
from dataclasses import field as option
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from ..errors import UserError
from ..lightfield import EncodeConfig, quilt_part
from ..lightfield.prints import PrintConfig
from ..plugins import blamed, gathered
from ..progress import Progress
from .frames.files import PICTURES, VIDEOS, FrameConfig

if TYPE_CHECKING:
    from ..field import VoxelField

METRES = 0.1  # Of a unit of the portrait frame: a head, which lies within -1 to 1, is 20 cm high.


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
    name : Short, one among all kinds.
    title, purpose : For people, in English; one line each.
    ending, suffixes : What the studio puts behind a name (``.glb``, ``_2x1.jpg``); suffixes that
        it can be written with, by default that of ``ending``.
    mark : How a name's stem must end to ask for this kind; empty: its suffix is enough.
    contents : What ``--kind`` calls it, by default its name; several kinds may be one in several
        formats.
    parameters, options : A frozen data class, whose fields are ``--NAME.FIELD``; those that the
        studio asks for.
    megabytes : A file of a head of 64 photos takes about; 0: nobody knows.
    group : Where the studio's page shows it: ``panel``, ``screen``, ``solid``, ``splats`` or
        ``further``; empty: nowhere.
    needs_display : Whether it is made for a panel.
    command : What writes it on the command line; the name of a file asks only for kinds of
        ``export``.
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
        field : The field; a `StyledField` where the file holds one.
        path, parameters, context : The file; an instance of ``parameters``; what else there is.

        Returns
        -------
        figures : For ``--json``; whole numbers are also printed. ``out``, where the file has
            another name than ``path``, and ``bytes``, where there are files beside it.

        Raises
        ------
        UserError : If the parameters make no sense or the file can't be written.
        """

    def check(self) -> None:
        """Complain of a class that can't be used; those of other packages are looked at."""
        for name in ("name", "title", "purpose", "ending"):
            if not isinstance(getattr(self, name, None), str):
                raise TypeError(f"it has no {name}")
        if not is_dataclass(self.parameters):
            raise TypeError("its parameters are no data class")
        self.parameters()
        for one in self.options:
            if not one.choices and type(one.default) not in _TYPES:
                raise TypeError(f"its option {one.name} is no number, text or choice")

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
        UserError : As `write`, and where the code of another package fails.
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


@dataclass(frozen=True)
class PageConfig:
    """Parameters of a page (`write_page`)."""

    title: str = ""
    """Title of the portrait, in its caption; by default Portrait."""
    artist: str = ""
    """Artist, or title of the painting, in the caption."""
    date: str = ""
    """Date, in the caption, as given."""
    sh: int = 0
    """Degree of the spherical harmonics kept in the page, for a photographed field, 0 to 2. Degrees
    above 0 keep view-dependent colors; the file is 4 or 9 times larger."""
    max_size: float = 6.0
    """Largest size of the file in MB (of 1,000,000 bytes). Colors and densities are quantised as
    finely as this allows; if that is not enough, the lattice is made coarser."""
    cone: float = 0.0
    """Degrees in all over which the portrait turns; 0: all around, but 40 for a head that was made
    from one photo, which a button on the page unlocks; 360: all around."""


class _Own(Export):
    """A kind whose writer stands in another module."""

    writer: ClassVar[str]
    """Module in this package, and function: ``module:function``."""

    def write(self, field: VoxelField, path: Path, parameters: Any,
              context: ExportContext) -> dict[str, Any]:
        module, _, name = self.writer.partition(":")
        figures: dict[str, Any] = getattr(import_module(f".{module}", __package__), name)(
            field, path, parameters, context)
        return figures


class _Frame(_Own):
    """A picture or a video for a frame, a stereo viewer or a flat panel."""

    parameters = FrameConfig

    def facts(self, figures: Mapping[str, Any]) -> list[str]:
        far, near = figures.get("parallax_percent", (0, 0))
        return [f"{figures['size'][0]} x {figures['size'][1]}",
                *([f"{figures['views']} views for {figures['display']}"]
                  if "views" in figures else []),
                *([f"{figures['frames']} frames, {figures['codec']}"]
                  if "frames" in figures else []),
                *([f"parallax {near:g} % of the width in front, {-far:g} % behind"]
                  if "parallax_percent" in figures else [])]


class Coded(_Own):
    name, group, command = "coded", "panel", "encode"
    title, purpose = "Coded picture", "Shown on your panel, pixel for pixel"
    ending, megabytes, needs_display = ".png", 16, True
    writer = "writers:write_coded_picture"


class Quilt(_Frame):
    name, group, mark = "quilt", "panel", "_qs8x6a0.75"
    title, purpose = "Quilt", "All views in one picture, for Looking Glass and its programs"
    ending, suffixes, megabytes, needs_display = "_qs.png", PICTURES + VIDEOS, 12, True
    writer = "frames.export:write_quilt_of"

    def claim(self, path: Path) -> int:
        return 2 if path.suffix.lower() in self.written and quilt_part(path.stem.lower()) else 0


class Hop(_Frame):
    name, group = "hop", "panel"
    title, purpose = "Hologram for Looking Glass Studio", "Opens there with depth and focus set"
    ending, megabytes, needs_display = ".hop", 12, True
    writer = "frames.export:write_package"


class Rgbd(_Frame):
    name, group, mark = "rgbd", "panel", "_rgbd"
    title, purpose = ("Picture with depth",
                      "Colors and depth side by side, for Looking Glass Go and others")
    ending, suffixes, megabytes = "_rgbd.png", PICTURES + VIDEOS, 5
    writer = "frames.export:write_with_depth"


class Page(_Own):
    name, group, parameters = "page", "screen", PageConfig
    title, purpose = "Page", "One file that any browser turns by hand; to send to people"
    ending, suffixes, megabytes = ".html", (".html", ".htm"), 5
    options = (Option("title", "In the caption; Portrait if it is empty", ""),
               Option("artist", "Artist, or title of the painting, in the caption", ""),
               Option("date", "In the caption, as you write it", ""),
               Option("max_size", "Most MB that the file may have", 6.0, 0.1, 1000))
    writer = "writers:write_html"

    def facts(self, figures: Mapping[str, Any]) -> list[str]:
        return [f"{figures['rows']:,} voxels", *figures["sets"]]


class Sweep(_Own):
    name, group, command, parameters = "sweep", "screen", "render", SweepConfig
    title, purpose = "Film", "The head turns from side to side"
    ending, megabytes, needs_display = ".mp4", 1, True
    options = (Option("size", "Width and height in pixels", 512, 64, 2160),
               Option("frames", "Pictures for one turn to both sides and back", 90, 2, 3600))
    writer = "writers:write_sweep"


class Loop(_Own):
    name, group, parameters, mark = "loop", "screen", LoopConfig, "_loop"
    title, purpose = "Loop", "A short moving picture for messengers: the head turns a little"
    ending, suffixes, megabytes = "_loop.mp4", (".mp4", ".webp", ".gif"), 1
    options = (Option("size", "Width and height in pixels", 480, 16, 2160),
               Option("frames", "Pictures of one loop", 48, 2, 600),
               Option("sway", "How far the head turns to each side, in degrees", 10.0, 0, 90))
    writer = "video:write_loop"

    def claim(self, path: Path) -> int:
        return max(super().claim(path), int(path.suffix.lower() == ".gif"))


class Flat(_Frame):
    name, group = "flat", "screen"
    title, purpose = "Flat film", "Upright film for screens without lenses"
    ending, suffixes, megabytes = ".mp4", VIDEOS, 5
    options = (Option("frames", "Pictures for one turn to both sides and back", 120, 2, 3600),
               Option("fps", "Pictures per second", 30.0, 1, 120),
               Option("sway", "How far the head turns to each side, in degrees", 12.0, 0, 90))
    writer = "frames.export:write_flat"


class Stereo(_Frame):
    name, group, contents, mark = "stereo", "screen", "pair", "_2x1"
    title, purpose = "Stereo pair", "Two pictures, for headsets and 3D televisions"
    ending, suffixes, megabytes = "_2x1.jpg", PICTURES + VIDEOS, 3
    options: ClassVar[tuple[Option, ...]] = (
        Option("eye_distance", "Distance between the eyes in mm; less is flatter", 63.0, 0, 1000),)
    writer = "frames.export:write_pair"


class Anaglyph(_Frame):
    name, group, mark = "anaglyph", "screen", "_anaglyph"
    title, purpose = "Anaglyph", "For red and cyan glasses, on any screen or paper"
    ending, suffixes, megabytes = "_anaglyph.png", PICTURES + VIDEOS, 4
    options = Stereo.options
    writer = "frames.export:write_anaglyph"


class Print(_Own):
    name, group, command, parameters = "print", "screen", "print", PrintConfig
    title, purpose = "Lenticular print", "A sheet to be printed behind lenses"
    ending, suffixes, megabytes = ".tiff", (".tiff", ".tif", ".png"), 160
    options = (Option("lpi", "Lenses per inch, as the lens sheet says", 60.0, 10, 200),
               Option("dpi", "Dots per inch of the printer", 720.0, 100, 4800),
               Option("size", "Of the paper: 8x10in, 200x250mm, a4 or a4-landscape; 8x10in if it "
                      "is empty", ""))
    writer = "writers:write_lenticular"


class _Mesh(_Own):
    """The surface."""

    group, contents, parameters, writer = "solid", "mesh", ExportConfig, "writers:write_mesh"


class Glb(_Mesh):
    name, title, purpose = "glb", "GLB model", "For the web, Blender, and viewers of glTF"
    ending, megabytes = ".glb", 17


class Usdz(_Mesh):
    name, title, purpose = "usdz", "USDZ model", "Opens on iPhones and iPads, in the room"
    ending, megabytes = ".usdz", 33


class Obj(_Mesh):
    name, title = "obj", "OBJ model"
    purpose = "For older 3D programs: the model, its material and its picture in one .zip"
    ending, suffixes, megabytes = "-obj.zip", (".obj", ".zip"), 14
    writer = "writers:write_obj"


class Points(_Own):
    name, group, contents, parameters = "ply", "solid", "points", ExportConfig
    title, purpose = "PLY model", "Points and colors, for MeshLab and others"
    ending, megabytes = ".ply", 20
    writer = "writers:write_points"


class PlyMesh(_Mesh):
    name, group = "mesh_ply", ""
    title, purpose = "PLY mesh", "The surface with colors at its vertices, for MeshLab and others"
    ending, megabytes = ".ply", 20

    def claim(self, path: Path) -> int:
        return 0  # points are the usual


class _Splats(_Own):
    """Gaussian splats."""

    group, contents, parameters, writer = "splats", "splats", ExportConfig, "writers:write_splats"


class SplatsPly(_Splats):
    name, title, purpose = "splats_ply", "Splats, PLY", "For all viewers of Gaussian splats"
    ending, megabytes, mark = "-splats.ply", 27, "splat"

    def claim(self, path: Path) -> int:
        return 2 * (path.suffix.lower() in self.written and self.mark in path.stem.lower())


class Spz(_Splats):
    name, title, purpose = "spz", "Splats, SPZ", "Small, for phones and the web"
    ending, megabytes = ".spz", 6


class Sog(_Splats):
    name, title, purpose = "sog", "Splats, SOG", "The smallest, for PlayCanvas and SuperSplat"
    ending, megabytes = ".sog", 4


class SplatsGlb(SplatsPly):
    name, group = "splats_glb", ""
    title, purpose = "Splats, GLB", "For viewers of glTF that know its extension for splats"
    ending, megabytes = "-splats.glb", 27


class Field(_Own):
    name, command = "field", "stylize"
    title, purpose = "Field", "All of it, for lfportrait on another machine"
    ending, megabytes = "-styled.npz", 25
    writer = "writers:write_field"


class Checkpoint(_Own):
    name, parameters = "checkpoint", ExportConfig
    title, purpose = "Checkpoint", "For programs that read svox2 fields"
    ending, megabytes = ".npz", 11
    writer = "writers:write_checkpoint"


KINDS: tuple[type[Export], ...] = (
    Coded, Quilt, Hop, Rgbd, Page, Sweep, Loop, Flat, Stereo, Anaglyph, Print, Glb, Usdz, Obj,
    Points, PlyMesh, SplatsPly, Spz, Sog, SplatsGlb, Field, Checkpoint)
"""In the order in which the studio shows them."""


EXPORTS = "lfportrait.exports"  # Group of entry points with subclasses of `Export`.


def exports() -> dict[str, Export]:
    """All kinds of export by their names, in the order in which they are shown.

    Those of other packages are the last; a broken one is left out with a warning.
    """
    return gathered(EXPORTS, Export, KINDS)  # type: ignore[type-abstract]


def own_exports() -> list[Export]:
    """Our own kinds alone: entry points take a while to read."""
    return [kind() for kind in KINDS]


def export_of(path: Path, kind: str = "auto") -> Export:
    """The kind of export that a file's name asks for, or of ``kind`` (`Export.contents`).

    Raises
    ------
    UserError : If nothing is written under such a name, or not of this kind.
    """
    known = [one for one in exports().values() if one.command == "export"]
    suffix, name = path.suffix.lower(), path.name
    if kind != "auto":
        alike = [one for one in known if kind in (one.kind, one.name)]
        if not alike:
            raise UserError(f"there is no kind {kind!r}; the kinds are "
                            f"{', '.join(dict.fromkeys(one.kind for one in known))}")
        fitting = [one for one in alike if suffix in one.written]
        if not fitting:
            all_of = " or ".join(dict.fromkeys(end for one in alike for end in one.written))
            raise UserError(f"{kind} {'are' if kind.endswith('s') else 'is'} written as {all_of}, "
                            f"not {suffix or name}")
        return fitting[0]
    claims = {}
    for one in known:
        with blamed(one):
            claims[one] = one.claim(path)
    best = max(known, key=claims.__getitem__)
    if claims[best]:
        return best
    marks = [f"{one.mark} ({one.title})" for one in known if one.mark and suffix in one.written]
    if marks:
        raise UserError(f"can't tell what {name} is to hold: end the name in {', '.join(marks)}")
    ends = list(dict.fromkeys(end for one in known for end in one.written))
    raise UserError(f"can't export to {name}: its name must end in {', '.join(ends[:-1])} or "
                    f"{ends[-1]}; lfportrait formats lists what they hold")


def export_field(field: VoxelField, path: Path, parameters: Any = None,
                 context: ExportContext | None = None) -> dict[str, Any]:
    """Write a field as the kind of file that its name asks for.

    Parameters
    ----------
    field, path : The field and the file (`lfportrait formats` lists the names).
    parameters : `ExportConfig`, whose ``kind`` may say what a 3D file is to hold; `FrameConfig`,
        `PageConfig`, or what another kind has.
    context : Placement, display and progress.

    Returns
    -------
    figures : ``kind``, ``bytes`` of the file with those beside it, ``out``, and what belongs to
        the kind: ``points``, ``faces``, ``splats`` and their ``psnr``, ``views``,
        ``parallax_percent``.

    Raises
    ------
    UserError : If the name asks for nothing known, or the parameters do not go with it.
    """
    export = export_of(path, parameters.kind if isinstance(parameters, ExportConfig) else "auto")
    if parameters is not None and not isinstance(parameters, export.parameters):
        raise TypeError(f"{path.name} takes {export.parameters.__name__}, "
                        f"not {type(parameters).__name__}")
    return export.make(field, path, parameters, context)
