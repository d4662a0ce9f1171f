"""Commands of displays: coded pictures of a field (``encode``), of views (``interlace``), and back.

``deinterlace`` takes coded pictures apart, ``simulate`` shows what an eye sees. ``cast`` and
``show`` are for attached displays; ``show --live`` codes a field on the GPU as it moves.
"""

from __future__ import annotations

import os
import re
import time
import warnings
from dataclasses import dataclass
from dataclasses import field as option
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
import tyro

from .. import lightfield, share
from ..errors import UserError
from ..files import write_image
from ..lightfield import Display, EncodeConfig, InterlaceConfig, QuiltHint, QuiltLayout
from ..lightfield.screens import URL, Bridge, DepthPicture, Device, Entry
from ..share import QUILTS, SECONDS, QuiltName, SequenceConfig
from .common import Common


@dataclass
class Encode(Common):
    """Code a field's light field for a display, one ray per sub-pixel; still or moving."""

    field: tyro.conf.Positional[Path]
    """Field file (.npz)."""
    display: str = "generic-4k"
    """Display preset (`lfportrait display list`) or a display or calibration file."""
    out: Path = Path("lightfield.png")
    """File for the coded picture; a name ending in .png keeps every sub-pixel. With --frames: a
    video (.mp4, .mov, .mkv), or a folder for pictures, which is resumed after an interruption.
    """
    quilt: Path | None = None
    """Also write a quilt; a name such as portrait_qs8x6a0.75.png sets columns, rows and aspect."""
    usual: ClassVar[tuple[str, ...]] = ("compose", "size", "focus", "ground", "background",
                                        "draft", "frames", "fps")
    config: Annotated[EncodeConfig, tyro.conf.arg(name="")] = option(default_factory=EncodeConfig)
    """Coding."""
    sequence: Annotated[SequenceConfig, tyro.conf.arg(name="")] = option(
        default_factory=SequenceConfig)
    """Motion."""

    def run(self) -> dict[str, Any]:
        from ..field import VoxelField
        from ..lightfield import composed, encode_with_figures

        if self.sequence.frames:
            return self._moving()
        lightfield.lossless(self.out)
        panel = Display.resolve(self.display)
        voxels = VoxelField.load(self.field)
        config = composed(voxels, panel, self.config)
        with self.progress("encode") as progress:
            progress.update(0, f"{panel.width} x {panel.height}, {panel.views} views")
            image, figures = encode_with_figures(voxels, panel, config, device=self.device)
        lightfield.write_coded(self.out, image, panel)
        if self.quilt is not None:
            picture, name = lightfield.quilt_of(voxels, panel, config,
                                                 name=self.quilt.name, device=self.device)
            layout = QuiltLayout.of_name(self.quilt.name, panel) or QuiltLayout.of_name(name)
            assert layout is not None
            share.write_quilt(self.quilt, picture, layout)
        return figures

    def _moving(self) -> dict[str, Any]:
        from ..field import VoxelField

        if self.quilt is not None:
            raise UserError("--quilt is for pictures that stand still; leave out --frames")
        panel = Display.resolve(self.display)
        voxels = VoxelField.load(self.field)
        start = time.perf_counter()
        with self.progress("encode", self.sequence.frames) as progress:
            figures = share.write_sequence(voxels, panel, self.config, self.sequence, self.out,
                                           progress.step)
        figures["seconds"] = {"sequence": round(time.perf_counter() - start, 3)}
        return figures | {"display": panel.name, "views": panel.views,
                          "subpixels": 3 * panel.width * panel.height}


@dataclass
class Simulate(Common):
    """Simulate the view of an eye in front of the display that shows a coded picture."""

    lightfield: tyro.conf.Positional[Path]
    """Coded picture."""
    display: str = "generic-4k"
    """The display that it was coded for."""
    eye: tuple[float, ...] = (0.0,)
    """Eye position X [Y] in half panel heights, at the viewing distance; x to the right."""
    crosstalk: float = 0.0
    """Cross-talk: sigma, in views, of the lobe that mixes in neighbouring views; 0 = none."""
    out: Path = Path("view.png")
    """File for the picture."""

    def run(self) -> dict[str, Any]:
        from ..lightfield import simulate

        if len(self.eye) not in (1, 2):
            raise UserError("--eye takes X or X Y")
        panel = Display.resolve(self.display)
        image = simulate(lightfield.read_coded(self.lightfield, panel), panel, self.eye,
                         crosstalk=self.crosstalk)
        write_image(self.out, image)
        return {}


_PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp")


@dataclass
class Interlace(Common):
    """Code a quilt, or a folder of views, for a display."""

    source: tyro.conf.Positional[Path]
    """Quilt, whose name gives columns, rows and aspect (portrait_qs8x6a0.75.png), or else its side
    file or EXIF; or a folder with one picture for each view, sorted by name from left to right."""
    display: str = "generic-4k"
    """Display preset (`lfportrait display list`) or a display or calibration file."""
    out: Path = Path("lightfield.png")
    """File for the coded picture; a name ending in .png keeps every sub-pixel."""
    columns: int = 0
    """Columns of the quilt; they come before what the quilt says."""
    rows: int = 0
    """Rows of the quilt."""
    aspect: float = 0.0
    """Aspect (width over height) of a view's content, if the quilt does not give it."""
    views: int = 0
    """Use only the first N views; 0 = all."""
    config: Annotated[InterlaceConfig, tyro.conf.arg(name="")] = option(
        default_factory=InterlaceConfig)
    """Sampling."""

    def run(self) -> dict[str, Any]:
        lightfield.lossless(self.out)
        panel = Display.resolve(self.display)
        asked = QuiltHint.of_options(self.columns, self.rows, self.aspect)
        layout = (QuiltLayout.of_name(self.source.name, panel) if self.source.is_dir()
                  else lightfield.layout_for(self.source, panel, asked=asked))
        start = time.perf_counter()
        views, aspect = lightfield.read_views(self.source, panel, layout=layout, views=self.views)
        loaded = time.perf_counter()
        image = lightfield.interlace(views, panel, self.config, aspect=self.aspect or aspect)
        coded = time.perf_counter()
        lightfield.write_coded(self.out, image, panel)
        return {"views": len(views), "view_size": [views.shape[2], views.shape[1]],
                "aspect": self.aspect or aspect, "display": panel.name,
                "subpixels": 3 * panel.width * panel.height,
                "seconds": {"load": round(loaded - start, 4),
                            "interlace": round(coded - loaded, 4)}}


@dataclass
class Deinterlace(Common):
    """Convert a coded picture into a quilt or a folder of views."""

    lightfield: tyro.conf.Positional[Path]
    """Coded picture."""
    display: str = "generic-4k"
    """The display that it was coded for."""
    out: Path = Path("views")
    """Folder for the views (0000.png is the leftmost), or, if the name ends in .png, a quilt; a
    name such as portrait_qs8x6a0.75.png sets its columns and rows."""
    views: int = 0
    """Number of views for a folder; by default that of the display."""
    size: tuple[int, int] = (0, 0)
    """Width and height of the views of a folder, or of the quilt; by default the panel's, or its
    customary quilt's."""

    def run(self) -> dict[str, Any]:
        panel = Display.resolve(self.display)
        if min(self.size) < 0 or max(self.size) > 65536 or (self.size[0] > 0) != (self.size[1] > 0):
            raise UserError("--size takes a width and a height of 1 to 65536 pixels")
        quilt = self.out.suffix.lower() in _PICTURES
        if quilt and self.views:
            raise UserError("the quilt's name sets its number of views; leave out --views")
        if not 0 <= self.views <= 1024:
            raise UserError(f"--views must be 1 to 1024, not {self.views}")
        start = time.perf_counter()
        image = lightfield.read_coded(self.lightfield, panel)
        if quilt:
            layout = QuiltLayout.of_name(self.out.name, panel)
            if layout is None:
                layout = QuiltLayout.of_display(panel)
            out = QuiltName.completed(self.out, layout)
            size = self.size if self.size[0] else panel.quilt_size
            width, height = size[0] // layout.columns, size[1] // layout.rows
            tiles = np.stack(list(lightfield.each_view(
                image, panel, count=layout.count, width=width, height=height)))
            picture = lightfield.assemble_quilt(tiles, layout, size)
            if out.suffix.lower() in QUILTS:
                share.write_quilt(out, picture, layout)
            else:
                write_image(out, picture)
            count = layout.count
        else:
            count, out = self.views or panel.views, self.out
            width, height = self.size if self.size[0] else (panel.width, panel.height)
            with self.progress("deinterlace", count) as progress:
                for index, view in enumerate(lightfield.each_view(
                        image, panel, count=count, width=width, height=height)):
                    write_image(out / f"{index:04d}.png", view)
                    progress.update(index + 1)
        if not self.quiet:
            print(f"{out}: {count} views of {width} x {height}")
        return {"views": count, "view_size": [width, height], "display": panel.name, "out": out,
                "seconds": {"deinterlace": round(time.perf_counter() - start, 4)}}


@dataclass
class Cast(Common):
    """Show quilts, or fields, on a Looking Glass, several in turn.

    Through a running Looking Glass Bridge, or, with --drive, by filling the drive of a frame that
    stands alone.
    """

    sources: tyro.conf.Positional[tuple[str, ...]] = ()
    """Quilts (pictures or videos; the name gives columns, rows and aspect, or else the side file or
    EXIF), or fields (.npz): their quilts are rendered for this display and written beside the
    fields."""
    drive: Path | None = None
    """Folder or letter of the drive as which a frame appears when it is plugged in: the quilts are
    written there, with a playlist that the frame plays without a computer."""
    display: str = ""
    """With --drive: the frame, a preset or a file; by default the calibration on the drive, else
    lookingglass-go."""
    picture: Literal["png", "jpg"] = "png"
    """With --drive: format of the fields' quilts; jpg takes less than half the room."""
    title: str = "lfportrait"
    """With --drive: title of the playlist."""
    seconds: float = SECONDS
    """How long each of several is shown."""
    screen: int = -1
    """Bridge's number of the display (see --list); by default the first Looking Glass."""
    list: bool = False
    """Only list the screens that Bridge reports."""
    save_display: Path | None = None
    """Write the display's calibration, as Bridge reports it, to this file (.toml)."""
    hide: bool = False
    """Stop playback and hide Bridge's window."""
    columns: int = 0
    """Columns of the quilts; they come before what the quilts say."""
    rows: int = 0
    """Rows of the quilts."""
    aspect: float = 0.0
    """Aspect (width over height) of a view's content, if the quilts do not give it."""
    views: int = 0
    """Number of views of the quilt; all tiles by default."""
    shift: float = 0.0
    """Bridge's focus: shift between the views, from -1 to 1."""
    rgbd: bool = False
    """The picture is RGB-D (color and depth side by side), not a quilt."""
    depth_side: int = 2
    """With --rgbd: Bridge's number, 0 to 3, of the side on which the depth lies."""
    depthiness: float = 1.0
    """With --rgbd: depth of the result, 0 to 3."""
    depth_inverted: bool = False
    """With --rgbd: dark is near."""
    url: str = URL
    """Address of Bridge."""
    timeout: float = 10.0
    """Timeout for Bridge's answers in seconds."""
    config: Annotated[EncodeConfig, tyro.conf.arg(name="")] = option(default_factory=EncodeConfig)
    """Placement of a field's head."""

    def run(self) -> dict[str, Any]:
        if not (self.sources or self.list or self.save_display or self.hide or self.drive):
            raise UserError("name the quilt or the field to cast: lfportrait cast "
                            "portrait_qs8x6a0.75.png")
        if not 0.1 <= self.seconds <= 86400:
            raise UserError(f"--seconds must be 0.1 to 86400, not {self.seconds:g}")
        QuiltHint.of_options(self.columns, self.rows, self.aspect)
        if self.drive is not None:
            return self._filled(self.drive)
        if not 0 < self.timeout <= 3600:
            raise UserError(f"--timeout must be 0 to 3600 seconds, not {self.timeout:g}")
        if not (0 <= self.depth_side <= 3 and 0 <= self.depthiness <= 3 and -1 <= self.shift <= 1):
            raise UserError("--depth-side must be 0 to 3, --depthiness 0 to 3, --shift -1 to 1")
        for source in self.sources:
            if "://" not in source and not Path(source).is_file():
                raise UserError(f"no such file: {source}")
        with Bridge(self.url, self.timeout) as bridge:
            figures: dict[str, Any] = {"bridge": bridge.version()}
            devices = bridge.devices()
            figures["screens"] = [{"index": device.index, "name": device.name,
                                   "hardware": device.hardware} for device in devices]
            if self.list:
                for device in devices:
                    kind = device.hardware if device.looking_glass else "an ordinary monitor"
                    print(f"{device.index:3}  {device.name}  ({kind})")
                if not devices:
                    print("Looking Glass Bridge reports no screens")
            if self.save_display is not None:
                panel = self._glass(bridge).display()
                panel.save(self.save_display)
                print(f"{self.save_display}: {panel.summary()}")
            if self.hide:
                bridge.hide(self.screen)
            if self.sources:
                figures |= self._cast(bridge)
        return figures

    def _filled(self, drive: Path) -> dict[str, Any]:
        if self.list or self.save_display or self.hide or self.rgbd or self.views:
            raise UserError("--drive needs no Bridge: leave out --list, --save-display, --hide, "
                            "--rgbd and --views")
        if os.name == "nt" and re.fullmatch("[A-Za-z]:", str(drive)):
            drive = Path(f"{drive}\\")  # E: alone is whatever folder was last open there
        plan = share.DrivePlan(drive, [Path(source) for source in self.sources], self.title,
                               self.display, self.picture, self.seconds, self.config,
                               QuiltHint.of_options(self.columns, self.rows, self.aspect))
        with self.progress("cast", len(plan.sources)) as progress:
            figures = share.fill_drive(plan, lambda number, _: progress.update(
                number, plan.sources[number].name))
        if not self.quiet:
            for quilt in figures["quilts"]:
                print(f"{drive / quilt['name']}: {quilt['views']} views")
            print(f"{drive}: {len(figures['quilts'])} quilts for {figures['display']}, "
                  f"{figures['bytes'] / 1e6:.1f} MB; eject the drive before you unplug it")
        return figures

    def _glass(self, bridge: Bridge) -> Device:
        device = bridge.device(self.screen)
        if not device.calibration:
            raise UserError(f"screen {device.index} ({device.name}) is not a Looking Glass")
        return device

    def _cast(self, bridge: Bridge) -> dict[str, Any]:
        device = bridge.device(self.screen)
        entries = [self._entry(source, device) for source in self.sources]
        playlist = bridge.cast_all(entries, screen=device.index)
        if not self.quiet:
            for entry in entries:
                print(f"{entry.picture}: {entry.layout.columns} x {entry.layout.rows} views on "
                      f"{device.name}")
        return {"playlist": playlist, "picture": entries[0].picture, "screen": device.index,
                "views": entries[0].views or entries[0].layout.count,
                "pictures": [entry.picture for entry in entries]}

    def _entry(self, source: str, device: Device) -> Entry:
        """What Bridge is to show of one source."""
        address = "://" in source
        picture = source if address else str(Path(source).resolve())
        if source.lower().endswith(".npz"):
            picture, layout = self._rendered(source, device)
        else:
            panel = device.display() if device.calibration else None
            layout = self._layout(source, panel)
        if not 0 <= self.views <= layout.count:
            raise UserError(f"the quilt has {layout.count} views, not {self.views}")
        depth = (DepthPicture(self.depth_side, self.depthiness, self.depth_inverted)
                 if self.rgbd else None)
        return Entry(picture, layout, self.views, self.shift, depth, self.seconds)

    def _layout(self, source: str, panel: Display | None) -> QuiltLayout:
        """The layout of a quilt, or of that which Bridge makes of a picture with depth."""
        asked = QuiltHint.of_options(self.columns, self.rows, self.aspect)
        if "://" not in source and not self.rgbd:
            return lightfield.layout_for(Path(source), panel, asked=asked)
        # Of a file behind an address only the name is known.
        hints = asked, QuiltHint.of_name(source.rpartition("/")[2])
        layout = next((QuiltLayout(hint.columns, hint.rows, aspect) for hint in hints
                       if hint and hint.columns
                       and (aspect := hint.aspect or (panel.aspect if panel else 0.0))), None)
        if layout is None and self.rgbd and panel is not None:
            return QuiltLayout.of_display(panel)
        if layout is None:
            raise UserError(f"nothing gives the layout of the quilt {source}: give --columns, "
                            "--rows and --aspect")
        return layout

    def _rendered(self, source: str, device: Device) -> tuple[str, QuiltLayout]:
        """A quilt of a field for this display, written beside the field."""
        from ..field import VoxelField

        if not device.calibration:
            raise UserError(f"screen {device.index} ({device.name}) is not a Looking Glass: make a "
                            "quilt with `lfportrait encode --quilt` and cast that")
        panel = device.display()
        field = VoxelField.load(Path(source))
        with self.progress("quilt"):
            quilt, name = lightfield.quilt_of(field, panel, self.config)
        layout = QuiltLayout.of_name(name)
        assert layout is not None
        out = Path(source).with_suffix("")
        out = out.with_name(f"{out.name}{layout.suffix()}.png").resolve()
        share.write_quilt(out, quilt, layout)
        return str(out), layout


@dataclass
class Show(Common):
    """Show coded pictures, or a field live, full screen on an attached panel; Esc closes."""

    lightfields: tyro.conf.Positional[tuple[Path, ...]] = ()
    """Coded pictures; the arrow keys switch between them. With --live: a field (.npz)."""
    display: str = "generic-4k"
    """The display that the pictures were coded for."""
    live: bool = False
    """Code a field on the GPU for each picture: the head moves, and the pointer turns it; h lists
    the keys."""
    simulate: bool = False
    """The same in an ordinary window: what an eye in the middle of the display sees."""
    photo: Path | None = None
    """With --live: the field that the shown one was stylised from, to mix both; by default
    field.npz beside it."""
    screen: int = -1
    """Number of the screen (see --list); by default the one that has the display's pixels."""
    seconds: float = 0.0
    """Time for each picture, or for --live; 0 = until a key is pressed."""
    list: bool = False
    """Only list the attached screens."""
    usual: ClassVar[tuple[str, ...]] = ("compose", "size", "focus", "ground")
    config: Annotated[EncodeConfig, tyro.conf.arg(name="")] = option(default_factory=EncodeConfig)
    """With --live: placement of the head at first."""

    def run(self) -> dict[str, Any]:
        from ..lightfield.screens import PygameDriver, show

        if self.list:
            if self.live:
                from ..lightfield.screens import screen_sizes

                screens = screen_sizes()
            else:
                driver = PygameDriver()
                screens = driver.screens()
                driver.close()
            for number, (width, height) in enumerate(screens):
                print(f"{number:3}  {width} x {height}")
            return {"screens": screens}
        if not 0 <= self.seconds < 1e6:
            raise UserError(f"--seconds must be 0 or more, not {self.seconds:g}")
        panel = Display.resolve(self.display)
        if not (panel.calibrated or self.simulate):
            warnings.warn(f"the display {panel.name} is not calibrated: expect blur and jumps; see "
                          "`lfportrait display import` and `lfportrait cast --save-display`",
                          UserWarning, stacklevel=1)
        if self.live or self.simulate:
            return self._live(panel)
        if not self.lightfields:
            raise UserError("name the coded picture to show: lfportrait show lightfield.png")
        if any(path.suffix.lower() == ".npz" for path in self.lightfields):
            raise UserError("a field is shown with --live; without, it is coded first: lfportrait "
                            "encode field.npz")
        images = [lightfield.read_coded(path, panel) for path in self.lightfields]
        screen = show(images, panel, screen=self.screen, seconds=self.seconds)
        return {"screen": screen, "display": panel.name, "pictures": len(images)}

    def _live(self, panel: Display) -> dict[str, Any]:
        """Show a field until the viewer closes the window, or the time is up; the figures."""
        from ..lightfield.screens import (
            LiveWindow,
            check_packages,
            fields_to_show,
            live_adapter,
            show_live,
        )

        if len(self.lightfields) != 1 or self.lightfields[0].suffix.lower() != ".npz":
            raise UserError("name one field to show live: lfportrait show styled.npz --live")
        if self.device != "cpu":
            check_packages()
        adapter = live_adapter(self.device)
        window = LiveWindow(panel, self.screen, self.simulate)
        with self.progress("live") as progress:
            progress.update(0, self.lightfields[0].name)
            field, real = fields_to_show(self.lightfields[0], self.photo)

            def say(line: str, stays: bool) -> None:
                if stays:
                    progress.say(line)
                else:
                    progress.update(0, line)

            return show_live(window, adapter, field, self.config, panel, real,
                             seconds=self.seconds, say=say)
