"""Show coded pictures full screen on an attached panel, and check that they are unscaled.

Under the lenses every sub-pixel has its own view, so a picture that anything on its way scales,
even by a pixel, is noise. The screen must have exactly the panel's pixels, the window too, and the
window's pixels are read back and compared before the picture counts as shown.

The window comes from a driver: pygame (SDL), which is an extra of the package.
"""

import os
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from ...arrays import UInt8
from ...errors import UserError
from ..display import Display, check_size


class PygameDriver:
    """Windows by pygame; `show` takes any object with these methods."""

    def __init__(self) -> None:
        # Without these the system would report points instead of pixels, or hide the window as soon
        # as the viewer clicks on another screen.
        os.environ.setdefault("SDL_WINDOWS_DPI_AWARENESS", "permonitorv2")
        os.environ.setdefault("SDL_VIDEO_MINIMIZE_ON_FOCUS_LOSS", "0")
        os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
        try:
            import pygame
        except ImportError as error:
            raise UserError("showing a picture full screen needs pygame: "
                            "pip install 'lfportrait[show]'") from error
        self.pygame: Any = pygame
        self.surface: Any = None
        try:
            pygame.display.init()
        except pygame.error as error:
            raise UserError(f"there is no screen to show the picture on ({error})") from error
        # Where there is no window system, SDL draws into memory without a word.
        unseen = pygame.display.get_driver() in ("offscreen", "dummy", "evdev")
        if unseen and not os.environ.get("SDL_VIDEODRIVER"):
            pygame.display.quit()
            raise UserError("there is no screen to show the picture on: run this in a desktop "
                            "session on the machine that the display is plugged into")

    def screens(self) -> list[tuple[int, int]]:
        """Width and height in pixels of every attached screen."""
        return [(int(width), int(height))
                for width, height in self.pygame.display.get_desktop_sizes()]

    def open(self, screen: int, size: tuple[int, int]) -> tuple[int, int]:
        """Open a full-screen window; the width and height in pixels that it really has."""
        try:
            self.surface = self.pygame.display.set_mode(size, self.pygame.FULLSCREEN,
                                                        display=screen)
        except self.pygame.error as error:
            raise UserError(f"can't open a window on screen {screen}: {error}") from error
        self.pygame.mouse.set_visible(False)
        window = self.pygame.display.get_window_size()
        if tuple(window) != tuple(self.surface.get_size()):
            return int(window[0]), int(window[1])
        return int(self.surface.get_width()), int(self.surface.get_height())

    def put(self, image: UInt8) -> None:
        """Show a picture of the window's size."""
        height, width = image.shape[:2]
        picture = self.pygame.image.frombuffer(np.ascontiguousarray(image).tobytes(),
                                               (width, height), "RGB")
        self.surface.blit(picture, (0, 0))
        self.pygame.display.flip()

    def pixels(self) -> UInt8:
        """The window's pixels as they are, uint8 [H, W, 3]."""
        width, height = self.surface.get_size()
        data = self.pygame.image.tobytes(self.surface, "RGB")
        return np.frombuffer(data, np.uint8).reshape(height, width, 3)

    def wait(self, seconds: float) -> str:
        """Wait for the viewer: ``"next"``, ``"previous"``, ``"close"``, or ``"time"`` when over."""
        pygame = self.pygame
        end = time.monotonic() + seconds if seconds > 0 else None
        while True:
            left = 0.1 if end is None else min(0.1, max(0.001, end - time.monotonic()))
            event = pygame.event.wait(int(1000 * left))
            if event.type == pygame.QUIT:
                return "close"
            if event.type == pygame.KEYDOWN:
                if event.key in (pygame.K_ESCAPE, pygame.K_q):
                    return "close"
                if event.key in (pygame.K_RIGHT, pygame.K_SPACE, pygame.K_PAGEDOWN):
                    return "next"
                if event.key in (pygame.K_LEFT, pygame.K_BACKSPACE, pygame.K_PAGEUP):
                    return "previous"
            if end is not None and time.monotonic() >= end:
                return "time"

    def close(self) -> None:
        """Close the window."""
        self.pygame.display.quit()


def choose_screen(screens: Sequence[tuple[int, int]], display: Display, screen: int = -1) -> int:
    """The number of the attached screen that is the panel, by the width and height of every one.

    -1 = the one that has the panel's pixels: the last of several, because the first is the
    desktop's.
    """
    size = (display.width, display.height)
    known = ", ".join(f"{number}: {width} x {height}"
                      for number, (width, height) in enumerate(screens))
    if not screens:
        raise UserError("there is no screen to show the picture on")
    advice = "set it to its own resolution and its scaling to 100 %"
    if screen >= 0:
        if screen >= len(screens):
            raise UserError(f"there is no screen {screen}; attached are {known}")
        if screens[screen] != size:
            raise UserError(f"screen {screen} has {screens[screen][0]} x {screens[screen][1]} "
                            f"pixels, the display {display.name} {size[0]} x {size[1]}: {advice}")
        return screen
    fitting = [number for number, found in enumerate(screens) if found == size]
    if not fitting:
        raise UserError(f"no screen has the {size[0]} x {size[1]} pixels of the display "
                        f"{display.name} (attached are {known}): plug it in, {advice}")
    return fitting[-1]


def show(images: Sequence[UInt8], display: Display, *, screen: int = -1,
         seconds: float = 0.0, driver: PygameDriver | None = None) -> int:
    """Show coded pictures full screen, unscaled, until the viewer closes the window.

    Returns the number of the screen that showed them.

    Parameters
    ----------
    images : uint8 [H, W, 3], coded for ``display``, as seen; the viewer leafs through several.
    screen : Number of the screen; -1 = the one that has the panel's pixels.
    seconds : Time for each picture; 0 = until the viewer goes on.
    driver : Window system; pygame by default.
    """
    for image in images:
        check_size(image, display)
    driver = driver or PygameDriver()
    try:
        screen = choose_screen(driver.screens(), display, screen)
        size = (display.width, display.height)
        opened = driver.open(screen, size)
        if opened != size:
            raise UserError(f"the window has {opened[0]} x {opened[1]} pixels instead of the "
                            f"panel's {size[0]} x {size[1]}: set the screen's scaling to 100 %")
        number = 0
        while 0 <= number < len(images):
            picture = display.to_panel(images[number])
            driver.put(picture)
            if not np.array_equal(driver.pixels(), picture):
                raise UserError("the window does not show the picture's own pixels (fewer colors "
                                "than 8 bits each, or a filter): switch that off")
            answer = driver.wait(seconds)
            if answer == "close":
                break
            number = max(0, number - 1) if answer == "previous" else number + 1
            if answer == "next" and number == len(images):
                number = 0
        return screen
    finally:
        driver.close()
