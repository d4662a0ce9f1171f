"""Our own kinds of export, a class each, and the one list of them and those of other packages.

What computes is imported when it is called.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from ..errors import UserError
from ..lightfield import quilt_part
from ..lightfield.prints import PrintConfig
from ..plugins import blamed, gathered
from .exporter import Export, ExportConfig, ExportContext, LoopConfig, Option, SweepConfig
from .frames.files import PICTURES, VIDEOS, FrameConfig
from .page.config import PageConfig

if TYPE_CHECKING:
    from ..field import VoxelField



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
    writer = "loop:write_loop"

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


EXPORTS = "lfportrait.exports"
"""Group of entry points with classes above `Export`."""


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
    UserError
        If nothing is written under such a name, or not of this kind.
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
    field, path
        The field and the file (`lfportrait formats` lists the names).
    parameters
        `ExportConfig`, whose ``kind`` may say what a 3D file is to hold; `FrameConfig`,
        `PageConfig`, or what another kind has.
    context
        Placement, display and progress.

    Returns
    -------
    figures
        ``kind``, ``bytes`` of the file with those beside it, ``out``, and what belongs to the kind:
        ``points``, ``faces``, ``splats`` and their ``psnr``, ``views``, ``parallax_percent``.

    Raises
    ------
    UserError
        If the name asks for nothing known, or the parameters do not go with it.
    """
    export = export_of(path, parameters.kind if isinstance(parameters, ExportConfig) else "auto")
    if parameters is not None and not isinstance(parameters, export.parameters):
        raise TypeError(f"{path.name} takes {export.parameters.__name__}, "
                        f"not {type(parameters).__name__}")
    return export.make(field, path, parameters, context)
