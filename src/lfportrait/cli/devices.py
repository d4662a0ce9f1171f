"""The commands ``cast`` and ``show`` for attached displays."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from dataclasses import field as option
from pathlib import Path
from typing import Annotated, Any

import tyro

from ..errors import UserError
from ..files import write_image
from ..lightfield import Display, EncodeConfig, QuiltLayout, quilt_of, read_coded
from ..lightfield.screens import URL, Bridge, DepthPicture, Device
from .common import Common

__all__ = ["Cast", "Show"]


@dataclass
class Cast(Common):
    """Show a quilt, or a field, on a Looking Glass through a running Looking Glass Bridge."""

    source: tyro.conf.Positional[str] = ""
    """Quilt (picture or video; its name gives columns, rows and aspect), or a field (.npz): its
    quilt is rendered for this display and written beside the field."""
    screen: int = -1
    """Bridge's number of the display (see --list); by default the first Looking Glass."""
    list: bool = False
    """Only list the screens that Bridge reports."""
    save_display: Path | None = None
    """Write the display's calibration, as Bridge reports it, to this file (.toml)."""
    hide: bool = False
    """Stop playback and hide Bridge's window."""
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
        """Connect and show."""
        if not (self.source or self.list or self.save_display or self.hide):
            raise UserError("name the quilt or the field to cast: lfportrait cast "
                            "portrait_qs8x6a0.75.png")
        if not 0 < self.timeout <= 3600:
            raise UserError(f"--timeout must be 0 to 3600 seconds, not {self.timeout:g}")
        if not (0 <= self.depth_side <= 3 and 0 <= self.depthiness <= 3 and -1 <= self.shift <= 1):
            raise UserError("--depth-side must be 0 to 3, --depthiness 0 to 3, --shift -1 to 1")
        address = "://" in self.source
        if self.source and not address and not Path(self.source).is_file():
            raise UserError(f"no such file: {self.source}")
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
            if self.source:
                figures |= self._cast(bridge, address)
        return figures

    def _glass(self, bridge: Bridge) -> Device:
        device = bridge.device(self.screen)
        if not device.calibration:
            raise UserError(f"screen {device.index} ({device.name}) is not a Looking Glass")
        return device

    def _cast(self, bridge: Bridge, address: bool) -> dict[str, Any]:
        device = bridge.device(self.screen)
        picture = self.source if address else str(Path(self.source).resolve())
        layout = QuiltLayout.of_name(Path(self.source).name)
        if self.source.lower().endswith(".npz"):
            picture, layout = self._rendered(device)
        if layout is None:
            if not device.calibration:
                raise UserError(f"the name of {self.source} must give the quilt's layout, as in "
                                "portrait_qs8x6a0.75.png")
            layout = QuiltLayout.of_display(device.display())
        if not 0 <= self.views <= layout.count:
            raise UserError(f"the quilt has {layout.count} views, not {self.views}")
        depth = (DepthPicture(self.depth_side, self.depthiness, self.depth_inverted)
                 if self.rgbd else None)
        playlist = bridge.cast(picture, layout, views=self.views, screen=device.index,
                               focus=self.shift, depth=depth)
        if not self.quiet:
            print(f"{picture}: {layout.columns} x {layout.rows} views on {device.name}")
        return {"playlist": playlist, "picture": picture, "screen": device.index,
                "views": self.views or layout.count}

    def _rendered(self, device: Device) -> tuple[str, QuiltLayout]:
        """A quilt of the field for this display, written beside the field."""
        from ..field import VoxelField

        if not device.calibration:
            raise UserError(f"screen {device.index} ({device.name}) is not a Looking Glass: make a "
                            "quilt with `lfportrait encode --quilt` and cast that")
        panel = device.display()
        field = VoxelField.load(Path(self.source))
        with self.progress("quilt"):
            quilt, name = quilt_of(field, panel, self.config)
        layout = QuiltLayout.of_name(name)
        assert layout is not None
        out = Path(self.source).with_suffix("")
        out = out.with_name(f"{out.name}{layout.suffix()}.png").resolve()
        write_image(out, quilt)
        return str(out), layout


@dataclass
class Show(Common):
    """Show coded pictures full screen on an attached panel, unscaled; Esc closes."""

    lightfields: tyro.conf.Positional[tuple[Path, ...]] = ()
    """Coded pictures; the arrow keys switch between them."""
    display: str = "generic-4k"
    """The display that the pictures were coded for."""
    screen: int = -1
    """Number of the screen (see --list); by default the one that has the display's pixels."""
    seconds: float = 0.0
    """Time for each picture; 0 = until a key is pressed."""
    list: bool = False
    """Only list the attached screens."""

    def run(self) -> dict[str, Any]:
        """Show until closed."""
        from ..lightfield.screens import PygameDriver, show

        if self.list:
            driver = PygameDriver()
            screens = driver.screens()
            driver.close()
            for number, (width, height) in enumerate(screens):
                print(f"{number:3}  {width} x {height}")
            return {"screens": screens}
        if not self.lightfields:
            raise UserError("name the coded picture to show: lfportrait show lightfield.png")
        if not 0 <= self.seconds < 1e6:
            raise UserError(f"--seconds must be 0 or more, not {self.seconds:g}")
        panel = Display.resolve(self.display)
        images = [read_coded(path, panel) for path in self.lightfields]
        if not panel.calibrated:
            warnings.warn(f"the display {panel.name} is not calibrated: expect blur and jumps; see "
                          "`lfportrait display import` and `lfportrait cast --save-display`",
                          UserWarning, stacklevel=1)
        screen = show(images, panel, screen=self.screen, seconds=self.seconds)
        return {"screen": screen, "display": panel.name, "pictures": len(images)}
