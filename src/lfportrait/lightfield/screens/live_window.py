"""Windows for a light field that is shown live, by rendercanvas and glfw, and the show in them.

The only module that imports them. A panel's window is full screen; it must have exactly the panel's
pixels, and what is drawn into it first is read back and compared before the picture counts as
shown.

For a show a photo's field is found and the device started; what is lost is said.
"""

from __future__ import annotations

import importlib.util
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ...device import device_name, gpu_adapter
from ...errors import UserError
from ...field import VoxelField
from ...gpu import Adapter
from ...gpu.device import Device
from ..display import Display
from ..gpu.live import Blit, same_points
from ..placement import EncodeConfig
from .live import Live, OffscreenWindow, check_pixels, one_eyed
from .show import choose_screen

_FASTEST = 240.0
"""Pictures a second, at most, where the window system does not hold them back."""
_SLOWEST = 4.0
"""How often a second a picture that stands still is looked at again."""
_OPENING = 5.0
"""Seconds in which a window must have reached its size."""
_SHARE = 0.8
"""Height of an ordinary window over its screen's, at most."""
_EVENTS = ("pointer_down", "pointer_up", "pointer_move", "wheel", "key_down", "char", "close")
_FORMATS = ("bgra8unorm", "rgba8unorm")
_NO_SCREEN = ("there is no screen to show a light field on: run this in a desktop session on the "
              "machine that the display is plugged into")


class LiveWindow:
    """A window on an attached screen.

    Parameters
    ----------
    display
        The panel.
    screen
        Number of the screen; -1 = the one that has the panel's pixels.
    plain
        An ordinary window, as high as fits, on the desktop's screen, instead of a panel's.

    Attributes
    ----------
    size
        Width and height in pixels, once it is open.
    screen
        Number of the screen, -1 for an ordinary window.

    Raises
    ------
    UserError
        If a package is missing, there is no screen, or none of the panel's size.
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
        """Open the window; its width and height in pixels.

        Raises
        ------
        UserError
            If it does not fill a panel pixel for pixel.
        """
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
        height = min(display.height, int(_SHARE * screen[1]),
                     int(_SHARE * screen[0] / display.aspect))
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
    """The GPU for a choice of ``--device``.

    Raises
    ------
    UserError
        If there is none: nothing else is fast enough.
    """
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
    field
        What is shown.
    display
        The panel.
    config
        How the field is placed at first.
    photo
        A field of the same points whose colors the viewer can mix in.
    screen
        Number of the panel's screen; -1: the one that has its pixels.
    simulate
        An ordinary window instead, with what an eye in the middle sees.
    window
        Draw into this one in memory instead: for tests, and to keep the pictures.
    seconds
        How long; 0: until the window is closed.
    device
        Which graphics card: ``"gpu"``, ``"gpu:NAME"``, or ``"auto"`` (`lfportrait.device`).

    Returns
    -------
    figures
        Pictures a second and milliseconds for each.

    Raises
    ------
    UserError
        If a package, the graphics card or the panel's screen is missing.
    """
    if window is None:
        check_packages()
    adapter = live_adapter(device)
    shown: LiveWindow | OffscreenWindow = window or LiveWindow(display, screen, simulate)
    return show_live(shown, adapter, field, config or EncodeConfig(), display, photo,
                     seconds=seconds)


def fields_to_show(source: Path, photo: Path | None) -> tuple[VoxelField, VoxelField | None]:
    """A field's file, and the field whose colors can be mixed in.

    Parameters
    ----------
    source
        The (stylised) field's file.
    photo
        The field's that it was stylised from; by default ``field.npz`` beside it, where that has
        the same points.

    Raises
    ------
    UserError
        If the named one has other points.
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

    The device lives in this process, where its window is.

    Parameters
    ----------
    window
        The panel's, an ordinary one, or one in memory.
    adapter
        The GPU.
    field, config, panel, photo, seconds, say
        As for `Live`.

    Returns
    -------
    figures
        For ``--json``.

    Raises
    ------
    UserError
        If the window is not as the panel needs it, or the GPU was lost or is too small.
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
