"""A light field shown live: what the viewer changes, the pictures that follow, and the windows.

`Live` is driven by a screen: a window, or `OffscreenWindow`, which draws into memory for tests and
measurements. The window of a panel shows the picture pixel for pixel; an ordinary one shows what an
eye in the middle sees, by the same shaders without a lens. What pointer and keys change,
`Controls`, knows no window and no GPU.

Windows are rendercanvas's and glfw's; nothing else imports them. A panel's window is full screen;
it must have exactly the panel's pixels, and what is drawn into it first is read back and compared
before the picture counts as shown.
"""

import importlib.util
import math
import sys
import time
import warnings
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ...arrays import UInt8
from ...device import device_name, gpu_adapter
from ...errors import UserError
from ...field import Backdrop, VoxelField, head_points
from ...gpu import Adapter, Device
from ..coding import composed
from ..display import Display
from ..gpu.live import Blit, LiveCoder, LivePicture, pixels_of, same_points
from ..ground import backdrop_of
from ..placement import EncodeConfig
from .show import choose_screen

HELP = """drag, left, right  turn the head        wheel, + -  focus: towards the viewer, away
[ ]                less, more depth     , .         smaller, larger
m, down, up        painting and photo   space       pause, go on with the sway
r                  as it was            h           this help         Esc, q  close"""

_ACROSS = 120.0  # Degrees that a drag over all of the window turns the head.
_SWAY, _PERIOD = 8.0, 10.0  # Degrees to each side, and seconds of a sway to both.
_LONGEST = 0.25  # Seconds that the sway moves on by at most: after a slow picture it would jump.
_TURN, _FOCUS, _FACTOR, _SHARE = 5.0, 0.02, 1.06, 0.1
"""What one key press changes: degrees, half panel heights, factor of depth and size, share."""
_FADE = 1.0  # Seconds from the painting to the photo and back.
_REACH = 0.4
"""How far the focus moves a head, over the distance of the eyes, at most; half a panel height."""


def _between(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)


class Controls:
    """Turn, focus, depth, size and mixture, as the viewer has set them.

    Parameters
    ----------
    distance : Of the eyes, in half panel heights.
    mixable : Whether there is a photo's field to mix in.
    sway : Whether the head sways until the viewer pauses it.

    Attributes
    ----------
    share : Share of the photo, 0 to 1.
    closed, help : Whether the viewer closed the window; whether the help is to be seen.
    """

    def __init__(self, distance: float = 4.0, mixable: bool = False, sway: bool = True) -> None:
        self._reach, self._mixable, self.swaying = min(0.5, _REACH * distance), mixable, sway
        self.closed = self.help = False
        self._dragged: float | None = None
        self._reset()

    def _reset(self) -> None:
        self.turn, self.focus, self.depth, self.size = 0.0, 0.0, 1.0, 1.0
        self.share = self._fades_to = 0.0
        self._phase = 0.0

    def handle(self, event: Mapping[str, Any], width: float) -> None:
        """Take up an event of rendercanvas; ``width`` of the window, in the unit of its ``"x"``."""
        kind = event["event_type"]
        if kind == "pointer_down" and event.get("button") == 1:
            self._dragged = float(event["x"])
        elif kind == "pointer_up" and event.get("button") == 1:
            self._dragged = None
        elif kind == "pointer_move" and self._dragged is not None:
            moved = float(event["x"]) - self._dragged
            self._dragged = float(event["x"])
            self._turn(_ACROSS * moved / max(width, 1.0))
        elif kind == "wheel":
            self._focus(-float(event["dy"]) / 100.0)
        elif kind == "close":
            self.closed = True
        elif kind == "key_down":
            self._special(str(event["key"]))
        elif kind == "char":
            # What the key means on the viewer's keyboard, repeated while it is held.
            self._typed(str(event["data"]))

    @property
    def still(self) -> bool:
        """Whether nothing changes while the viewer does nothing."""
        return self.share == self._fades_to and (not self.swaying or self._dragged is not None)

    def advance(self, seconds: float) -> None:
        """Let time pass: the sway, and the way from the painting to the photo."""
        if self.swaying and self._dragged is None:
            self._phase = (self._phase + min(seconds, _LONGEST) / _PERIOD) % 1.0
        step = seconds / _FADE
        self.share += _between(self._fades_to - self.share, -step, step)

    def applied(self, config: EncodeConfig) -> EncodeConfig:
        """A configuration with what the viewer has set."""
        sway = _SWAY * math.sin(2 * math.pi * self._phase)
        turn = (config.turn + self.turn + sway + 180.0) % 360.0 - 180.0
        return replace(config, turn=turn, focus=config.focus + self.focus,
                       depth_scale=_between(config.depth_scale * self.depth, 0.05, 4.0),
                       size=_between(config.size * self.size, 0.05, 4.0))

    def summary(self) -> str:
        """The settings in one line."""
        parts = [f"turn {self.turn:+.0f} degrees", f"focus {self.focus:+.2f}",
                 f"depth {self.depth:.2f}", f"size {self.size:.2f}"]
        if self._mixable:
            parts.append(f"photo {100 * self.share:.0f} %")
        return ", ".join(parts + ([] if self.swaying else ["paused"]))

    # -- single changes ---------------------------------------------------------------------------

    def _special(self, key: str) -> None:
        if key == "Escape":
            self.closed = True
        elif key in ("ArrowLeft", "ArrowRight"):
            self._turn(_TURN if key == "ArrowRight" else -_TURN)
        elif key in ("ArrowUp", "ArrowDown"):
            self._mix(self._fades_to + (_SHARE if key == "ArrowUp" else -_SHARE))

    def _typed(self, text: str) -> None:
        if text in "+=-_":
            self._focus(1.0 if text in "+=" else -1.0)
        elif text in "[]":
            self.depth = _between(self.depth * _FACTOR ** (1 if text == "]" else -1), 0.2, 4.0)
        elif text in ",.":
            self.size = _between(self.size * _FACTOR ** (1 if text == "." else -1), 0.2, 4.0)
        elif text == " ":
            self.swaying = not self.swaying
        elif text.lower() == "m":
            self._mix(0.0 if self._fades_to > 0.5 else 1.0)
        elif text.lower() == "r":
            self._reset()
        elif text.lower() == "h":
            self.help = not self.help
        elif text.lower() == "q":
            self.closed = True

    def _turn(self, degrees: float) -> None:
        self.turn = (self.turn + degrees + 180.0) % 360.0 - 180.0

    def _focus(self, steps: float) -> None:
        self.focus = _between(self.focus + _FOCUS * steps, -self._reach, self._reach)

    def _mix(self, share: float) -> None:
        if self._mixable:
            self._fades_to = _between(share, 0.0, 1.0)

_KEPT = 10000  # Pictures, the latest ones, whose times the figures are about.


class Live:
    """A field on a device, and what the viewer makes of it.

    Parameters
    ----------
    field, config : What is shown, and how it is placed at first.
    panel : The display that it is composed for.
    display : The one that it is coded for: the panel, or `one_eyed` of it.
    photo : A field of the same points whose colors can be mixed in; or None.
    seconds : When it is over; 0: when the viewer closes it.
    say : Is given a line a second, and the help when the viewer asks for it.

    Attributes
    ----------
    controls : What the viewer has set.
    coder : Codes the pictures.
    frames : How many pictures were coded.
    """

    def __init__(self, device: Device, field: VoxelField, config: EncodeConfig, panel: Display,
                 display: Display, photo: VoxelField | None = None, *, seconds: float = 0.0,
                 say: Callable[[str, bool], None] = lambda line, stays: None) -> None:
        if config.ground not in ("painted", "black"):
            # It is read once, not for every picture.
            field = replace(field, backdrop=backdrop_of(field, config))
            config = replace(config, ground="painted", background=0.0)
        self._config, self._field, self._panel = config, field, panel
        self._known: tuple[EncodeConfig, EncodeConfig] | None = None
        self.coder = LiveCoder(device, field, display, photo)
        self.controls = Controls(panel.distance, photo is not None)
        self._seconds, self._say, self._helped = seconds, say, False
        self._begun, self._last, self._told = -1.0, 0.0, 0.0
        self._marks: list[float] = []
        self._coding: deque[float] = deque(maxlen=_KEPT)
        self.frames = 0

    @property
    def picture(self) -> LivePicture:
        """The picture that is to be shown now."""
        return self.coder.picture

    @property
    def over(self) -> bool:
        """Whether the viewer closed it, or its time is up."""
        late = self._seconds > 0 and self._begun >= 0 and self._last - self._begun >= self._seconds
        return self.controls.closed or late

    @property
    def still(self) -> bool:
        """Whether the next picture would be the same, unless the viewer changes something."""
        return self.coder.exact and self.controls.still

    def wanted(self) -> tuple[EncodeConfig, float]:
        """The configuration, composed, and the photo's share, that the viewer asks for."""
        return self._composed(self.controls.applied(self._config)), self.controls.share

    def _composed(self, config: EncodeConfig) -> EncodeConfig:
        """The composition of the field on the panel; turning the head leaves it as it is."""
        if not config.compose:
            return config
        plain = replace(config, turn=0.0)
        if self._known is None:
            if self._field.backdrop is None:
                # The head's places are looked for once; this ground is not shown.
                self._field = replace(self._field, backdrop=Backdrop(
                    np.zeros((2, 2, 3), np.uint8), 1.0, np.array([0.0, 0.0, 1.0]),
                    head_points(self._field)))
            self._known = plain, composed(self._field, self._panel, plain)
        elif self._known[0] != plain:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # it was said at the beginning
                self._known = plain, composed(self._field, self._panel, plain)
        return replace(self._known[1], turn=config.turn)

    def tick(self, now: float) -> bool:
        """Move on to a time in seconds; whether there is another picture."""
        if self._begun < 0:
            self._begun = self._last = self._told = now
        self.controls.advance(max(now - self._last, 0.0))
        self._last = now
        new = self.coder.step(*self.wanted())
        if new:
            self.frames += 1
            self._coding.append(self.coder.seconds)
            self._marks.append(now)
        if self.controls.help != self._helped:
            self._helped = self.controls.help
            if self._helped:
                self._say(HELP, True)
        return new

    def line(self) -> str | None:
        """A line for the viewer, once a second."""
        if self._last - self._told < 1.0:
            return None
        self._marks = [mark for mark in self._marks if mark > self._told]
        rate = len(self._marks) / (self._last - self._told)
        self._told = self._last
        line = f"{rate:.1f} pictures a second, {self.controls.summary()}"
        self._say(line, False)
        return line

    def figures(self) -> dict[str, Any]:
        """Pictures, their rate over the whole time, and what coding took, for ``--json``."""
        spent = self._last - self._begun
        out: dict[str, Any] = {"frames": self.frames, "frames_per_second": round(
            self.frames / spent, 2) if spent > 0 else 0.0}
        if self._coding:
            out["coding_ms"] = {
                name: round(1000.0 * float(np.quantile(self._coding, share)), 3)
                for name, share in (("median", 0.5), ("slowest", 1.0))}
        return out

    def close(self) -> None:
        """End what runs beside it."""
        self.coder.close()


class OffscreenWindow:
    """A panel's window in memory: runs a script of events, one picture after the other.

    Parameters
    ----------
    size : Width and height in pixels.
    script : Events and the pictures before which they happen, ``{3: [{"event_type": ...}]}``.
    frames : How many pictures are shown, unless it is over before.
    rate : Pictures a second, of the time that passes for what moves.
    keep : Whether `pictures` keeps them.
    exact : Whether each picture is gone on with until it is exact, however long that takes.

    Attributes
    ----------
    pictures : What was shown, uint8 [H, W, 3] each.
    screen : 0: it stands for a panel's, not for an ordinary window.
    """

    screen = 0

    def __init__(self, size: tuple[int, int],
                 script: Mapping[int, Sequence[Mapping[str, Any]]] | None = None, frames: int = 1,
                 rate: float = 30.0, keep: bool = True, exact: bool = False) -> None:
        self.size = size
        self._script, self._frames, self._rate, self._keep = script or {}, frames, rate, keep
        self._exact = exact
        self.pictures: list[UInt8] = []

    def open(self) -> tuple[int, int]:
        """Its width and height in pixels."""
        return self.size

    def close(self) -> None:
        """Nothing is left open."""

    def run(self, device: Device, display: Display, live: Live) -> None:
        """Show pictures until it is over."""
        format = "rgba8unorm"
        blit = Blit(device, display, format)
        target = device.texture(self.size, format, drawn=True)
        for frame in range(self._frames):
            for event in self._script.get(frame, ()):
                live.controls.handle(event, self.size[0])
            live.tick(frame / self._rate)
            if live.over:
                break
            if self._exact:
                live.coder.settle(*live.wanted())
            blit.draw(live.picture, target.create_view())
            if frame == 0:
                check_pixels(device, target, display, live.picture)
            if self._keep:
                self.pictures.append(pixels_of(device, target))
            live.line()


def one_eyed(panel: Display, width: int, height: int) -> Display:
    """What stands in for a panel where one eye, in the middle, is shown what it would see.

    All views are its own, a pixel's colors lie in one place, and nothing is mirrored.
    """
    return replace(panel, width=width, height=height, views=1, subpixels="RGB", flip_x=False,
                   flip_y=False, cells=((0.0,) * 6,), cell_pattern="single")


def check_pixels(device: Device, texture: Any, display: Display, picture: LivePicture) -> None:
    """Raise `UserError` unless a texture holds a picture's own pixels, as a panel is sent them."""
    want = display.to_panel(picture.read(device, display))
    if not np.array_equal(pixels_of(device, texture), want):
        raise UserError("the window does not show the picture's own pixels (fewer colors than 8 "
                        "bits each, or a filter): switch that off")


_FASTEST = 240.0  # Pictures a second, at most, where the window system does not hold them back.
_SLOWEST = 4.0  # How often a second a picture that stands still is looked at again.
_OPENING = 5.0  # Seconds in which a window must have reached its size.
_OF_SCREEN = 0.8  # Height of an ordinary window over its screen's, at most.
_EVENTS = ("pointer_down", "pointer_up", "pointer_move", "wheel", "key_down", "char", "close")
_FORMATS = ("bgra8unorm", "rgba8unorm")
_NO_SCREEN = ("there is no screen to show a light field on: run this in a desktop session on the "
              "machine that the display is plugged into")


class LiveWindow:
    """A window on an attached screen.

    ``screen`` is its number, -1 = that of the one that has the panel's pixels. ``plain`` gives an
    ordinary window, as high as fits, on the desktop's screen, instead of a panel's, whose
    ``screen`` then is -1. ``size``: width and height in pixels, once it is open.
    """

    def __init__(self, display: Display, screen: int = -1, plain: bool = False) -> None:
        self._glfw, self._display = _glfw(), display
        self._error: Exception | None = None
        self._sizes = screen_sizes()
        if not self._sizes:
            raise UserError(_NO_SCREEN)
        self.screen = -1 if plain else choose_screen(self._sizes, display, screen)
        self.size = (0, 0)
        self._canvas: Any = None
        self._title = f"lfportrait, {display.name}"

    def open(self) -> tuple[int, int]:
        """Open the window; its width and height in pixels."""
        from rendercanvas.glfw import RenderCanvas, loop

        self._loop: Any = loop
        self._canvas = RenderCanvas(size=(640, 360), title=self._title, max_fps=_FASTEST,
                                         update_mode="ondemand", min_fps=_SLOWEST, vsync=True)
        if self.screen < 0:
            self.size = self._shaped(self._sizes[0])
        else:
            self.size = self._filled(self._glfw.get_monitors()[self.screen])
        return self.size

    def run(self, device: Device, display: Display, live: Live) -> None:
        """Show pictures until it is over."""
        canvas = self._canvas
        context = canvas.get_wgpu_context()
        format = self._configured(context, device)
        blit, checked = Blit(device, display, format), [False]

        def handle(event: dict[str, Any]) -> None:
            live.controls.handle(event, canvas.get_logical_size()[0])
            canvas.request_draw()

        def draw() -> None:
            live.tick(time.perf_counter())
            if live.over:
                self._loop.call_soon(canvas.close)
                return
            texture = context.get_current_texture()
            if tuple(texture.size[:2]) != self.size:
                raise UserError(f"the window has {texture.size[0]} x {texture.size[1]} pixels "
                                f"instead of {self.size[0]} x {self.size[1]}: leave the screen's "
                                "resolution as it is")
            blit.draw(live.picture, texture.create_view())
            if not checked[0]:
                check_pixels(device, texture, display, live.picture)
                checked[0] = True
            line = live.line()
            if line is not None:
                canvas.set_title(f"{self._title}: {line}")
            if not live.still:
                canvas.request_draw()

        canvas.add_event_handler(handle, *_EVENTS)
        canvas.request_draw(lambda: self._guarded(draw))
        self._loop.run()
        if self._error is not None:
            raise self._error

    def close(self) -> None:
        """Close the window, if it is open."""
        if self._canvas is not None:
            self._canvas.close()

    def _guarded(self, draw: Any) -> None:
        """Draw; an error ends the loop and is raised after it, where it would only be logged."""
        if self._error is not None:
            return
        try:
            draw()
        except Exception as error:
            if type(error).__name__ == "DrawCancelled":
                raise  # the window is hidden at the moment
            self._error = error
            self._loop.call_soon(self._canvas.close)

    def _filled(self, monitor: Any) -> tuple[int, int]:
        """Fill a screen; the window's width and height in pixels."""
        glfw, window = self._glfw, self._canvas._window
        mode = glfw.get_video_mode(monitor)
        # Else it would vanish as soon as the viewer clicks on another screen.
        glfw.set_window_attrib(window, glfw.AUTO_ICONIFY, False)
        glfw.set_window_monitor(window, monitor, 0, 0, mode.size.width, mode.size.height,
                                mode.refresh_rate)
        glfw.set_input_mode(window, glfw.CURSOR, glfw.CURSOR_HIDDEN)
        want = self._display.width, self._display.height
        size = self._awaited(want)
        if size != want:
            self.close()
            raise UserError(f"the window has {size[0]} x {size[1]} pixels instead of the panel's "
                            f"{want[0]} x {want[1]}: set the screen's scaling to 100 %")
        return size

    def _shaped(self, screen: tuple[int, int]) -> tuple[int, int]:
        """Give an ordinary window the panel's shape; its width and height in pixels."""
        glfw, canvas, display = self._glfw, self._canvas, self._display
        height = min(display.height, int(_OF_SCREEN * screen[1]),
                     int(_OF_SCREEN * screen[0] / display.aspect))
        width = max(1, round(height * display.aspect))
        pixels, points = canvas.get_physical_size(), canvas.get_logical_size()
        ratio = pixels[0] / max(points[0], 1.0)
        canvas.set_logical_size(width / ratio, height / ratio)
        size = self._awaited((width, height))
        glfw.set_window_attrib(canvas._window, glfw.RESIZABLE, False)
        return size

    def _awaited(self, want: tuple[int, int]) -> tuple[int, int]:
        """The window's pixels, once they are these or the time for it is up."""
        end = time.perf_counter() + _OPENING
        while True:
            self._glfw.wait_events_timeout(0.02)
            width, height = self._glfw.get_framebuffer_size(self._canvas._window)
            if (width, height) == want or time.perf_counter() > end:
                return int(width), int(height)

    def _configured(self, context: Any, device: Device) -> str:
        """Set up the surface for drawing and reading back; the format of its pixels."""
        # A format that converts colors (-srgb) would be the usual one: the picture's bytes are it.
        wanted = context.get_preferred_format(device.raw.adapter).removesuffix("-srgb")
        for format in dict.fromkeys([wanted, *_FORMATS]):
            if format not in _FORMATS:
                continue
            try:
                context.configure(device=device.raw, format=format,
                                  usage="RENDER_ATTACHMENT | COPY_SRC")
            except ValueError:
                continue
            return str(format)
        raise UserError(f"{device.adapter.title} offers no window of 8 bits a color here: try "
                        "another --device")


def screen_sizes() -> list[tuple[int, int]]:
    """Width and height in pixels of every attached screen."""
    glfw = _glfw()
    return [_pixels(glfw, monitor) for monitor in glfw.get_monitors()]


def check_packages() -> None:
    """Raise `UserError` if one of the packages that windows need is missing."""
    missing = [name for name in ("wgpu", "rendercanvas", "glfw")
               if importlib.util.find_spec(name) is None]
    if missing:
        raise UserError(f"showing a light field live needs {', '.join(missing)}: "
                        "pip install 'lfportrait[gpu,live]'")


def _glfw() -> Any:
    """The window library, set up; `UserError` where there is no window system."""
    check_packages()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it warns of what is said here
        try:
            import glfw
        except ImportError as error:  # the library itself
            raise UserError(f"{_NO_SCREEN} ({error})") from error
        if not glfw.init():
            raise UserError(_NO_SCREEN)
    return glfw


def _pixels(glfw: Any, monitor: Any) -> tuple[int, int]:
    """Width and height of a screen in pixels."""
    size = glfw.get_video_mode(monitor).size
    # macOS counts in points.
    scale = glfw.get_monitor_content_scale(monitor) if sys.platform == "darwin" else (1.0, 1.0)
    return round(size.width * scale[0]), round(size.height * scale[1])


def live_adapter(choice: str) -> Adapter:
    """The GPU for a choice of ``--device``."""
    adapter = gpu_adapter(choice)
    if adapter is None:
        raise UserError(f"a light field is shown live by a GPU, and --device {choice} has none "
                        "here: see `lfportrait devices`; --device gpu takes software, slowly, "
                        "where there is no other")
    return adapter


def show_field(field: VoxelField, display: Display, config: EncodeConfig | None = None, *,
               photo: VoxelField | None = None, screen: int = -1, simulate: bool = False,
               window: OffscreenWindow | None = None, seconds: float = 0.0, device: str = "gpu",
               ) -> dict[str, Any]:
    """Show a field live on an attached panel, as ``lfportrait show --live`` does.

    A graphics card codes each picture. The pointer turns the head, keys move, flatten and mix it;
    the key ``h`` prints which.

    Parameters
    ----------
    field : What is shown.
    display : The panel.
    config : How the field is placed at first.
    photo : A field of the same points whose colors the viewer can mix in.
    screen : Number of the panel's screen; -1: the one that has its pixels.
    simulate : An ordinary window instead, with what an eye in the middle sees.
    window : Draw into this one in memory instead: for tests, and to keep the pictures.
    seconds : How long; 0: until the window is closed.
    device : Which graphics card: ``"gpu"``, ``"gpu:NAME"``, or ``"auto"`` (`lfportrait.device`).

    Returns
    -------
    figures : Pictures a second and milliseconds for each.

    Raises
    ------
    UserError : If a package, the graphics card or the panel's screen is missing.
    """
    if window is None:
        check_packages()
    adapter = live_adapter(device)
    shown: LiveWindow | OffscreenWindow = window or LiveWindow(display, screen, simulate)
    return show_live(shown, adapter, field, config or EncodeConfig(), display, photo,
                     seconds=seconds)


def fields_to_show(source: Path, photo: Path | None) -> tuple[VoxelField, VoxelField | None]:
    """A (stylised) field, and the one whose colors can be mixed in.

    That is ``photo``, which must have the same points; by default ``field.npz`` beside it, if it
    has.
    """
    field = VoxelField.load(source)
    beside = source.with_name("field.npz")
    if photo is None and (not beside.is_file() or beside.resolve() == source.resolve()):
        return field, None
    found = VoxelField.load(photo or beside)
    if same_points(field, found):
        return field, found
    if photo is not None:
        raise UserError(f"{photo} has other points than {source}: give the field that it was "
                        "stylised from")
    return field, None


def show_live(window: LiveWindow | OffscreenWindow, adapter: Adapter, field: VoxelField,
              config: EncodeConfig, panel: Display, photo: VoxelField | None = None, *,
              seconds: float = 0.0,
              say: Callable[[str, bool], None] = lambda line, stays: None) -> dict[str, Any]:
    """Show a field until the viewer closes the window, or the time is up.

    The device lives in this process, where its window is. ``field`` to ``say`` are as for `Live`;
    returns figures for ``--json``.
    """
    try:
        size = window.open()
        display = panel if window.screen >= 0 else one_eyed(panel, *size)
        device = Device(adapter)
        live = Live(device, field, config, panel, display, photo, seconds=seconds, say=say)
        try:
            window.run(device, display, live)
        finally:
            live.close()
    except UserError:
        raise
    except Exception as error:
        if not _of_device(error):
            raise
        raise UserError(f"{adapter.title} was lost, or its memory is too small for this field: "
                        f"{(str(error).strip().splitlines() or ['out of memory'])[0]}") from error
    finally:
        window.close()
    return {"display": panel.name, "screen": window.screen, "simulated": window.screen < 0,
            "size": list(size), "photo": photo is not None, "device": device_name(adapter),
            **live.figures()}


def _of_device(error: Exception) -> bool:
    """Whether an error is the device's: lost, or out of memory."""
    text = str(error).lower()
    return (isinstance(error, MemoryError) or type(error).__module__.startswith("wgpu")
            or "lost" in text or "memory" in text)
