"""Full-screen pictures: with a fake window system, and with pygame drawing into memory."""

import dataclasses
import os
import subprocess
import sys

import numpy as np
import pytest

from lfportrait.cli import main
from lfportrait.errors import UserError
from lfportrait.files import write_image
from lfportrait.lightfield import Display
from lfportrait.lightfield.screens.show import choose_screen, show

PANEL = Display(64, 48, 12, 7.3, 0.1, name="mine")
RANDOM = np.random.default_rng(0)


def picture():
    return RANDOM.integers(0, 256, (48, 64, 3), dtype=np.uint8)


class FakeScreens:
    """A window system of given screens that may scale, or change colors."""

    def __init__(self, sizes=((1920, 1080), (64, 48)), answers=("close",), scale=1.0, bits=8):
        self.sizes, self.answers, self.scale, self.bits = list(sizes), list(answers), scale, bits
        self.shown, self.closed, self.opened = [], False, None

    def screens(self):
        return self.sizes

    def open(self, screen, size):
        self.opened = screen
        return round(size[0] * self.scale), round(size[1] * self.scale)

    def put(self, image):
        self.window = image >> (8 - self.bits) << (8 - self.bits)
        self.shown.append(image.copy())

    def pixels(self):
        return self.window

    def wait(self, seconds):
        self.seconds = seconds
        return self.answers.pop(0)

    def close(self):
        self.closed = True


def test_the_picture_goes_to_the_screen_of_the_panels_size():
    screens, image = FakeScreens(), picture()
    assert show([image], PANEL, driver=screens) == 1
    assert screens.opened == 1
    assert np.array_equal(screens.shown[0], image)
    assert screens.closed


def test_a_mirroring_panel_is_sent_the_mirrored_picture():
    screens, image = FakeScreens(), picture()
    show([image], dataclasses.replace(PANEL, flip_x=True, flip_y=True), driver=screens)
    assert np.array_equal(screens.shown[0], image[::-1, ::-1])


def test_the_viewer_leafs_through_several_pictures():
    images = [picture() for _ in range(3)]
    screens = FakeScreens(answers=["next", "previous", "previous", "next", "next", "next", "close"])
    show(images, PANEL, driver=screens)
    order = [next(i for i, image in enumerate(images) if np.array_equal(image, shown))
             for shown in screens.shown]
    assert order == [0, 1, 0, 0, 1, 2, 0]
    timed = FakeScreens(answers=["time", "time", "time"])
    show(images, PANEL, seconds=2.5, driver=timed)
    assert (len(timed.shown), timed.seconds) == (3, 2.5)


@pytest.mark.parametrize(("screens", "screen", "complaint"), [
    (FakeScreens(sizes=[]), -1, "there is no screen"),
    (FakeScreens(sizes=[(1920, 1080)]), -1, r"no screen has the 64 x 48 .*0: 1920 x 1080"),
    (FakeScreens(), 0, "screen 0 has 1920 x 1080"), (FakeScreens(), 5, "there is no screen 5"),
    (FakeScreens(scale=1.5), -1, "96 x 72 pixels instead of"),
    (FakeScreens(bits=6), -1, "own pixels")])
def test_a_picture_that_would_be_changed_is_refused(screens, screen, complaint):
    with pytest.raises(UserError, match=complaint):
        show([picture()], PANEL, screen=screen, driver=screens)
    assert screens.closed


def test_a_picture_of_another_size_is_refused_before_any_window():
    screens = FakeScreens()
    with pytest.raises(UserError, match="must not be scaled"):
        show([picture()[:40]], PANEL, driver=screens)
    assert screens.opened is None


def test_of_several_screens_the_last_that_fits_is_taken():
    assert choose_screen([(64, 48), (64, 48), (3, 3)], PANEL) == 1
    assert choose_screen([(64, 48), (64, 48), (3, 3)], PANEL, 0) == 0


# -- the command, with pygame drawing into memory -------------------------------------------------


def program(*words, driver="dummy"):
    environment = {key: value for key, value in os.environ.items()
                   if key not in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER")}
    if driver:
        environment["SDL_VIDEODRIVER"] = driver
    return subprocess.run([sys.executable, "-m", "lfportrait", "show", *map(str, words)],
                          capture_output=True, text=True, env=environment, check=False, timeout=120)


def test_pygame_shows_every_pixel_of_the_panel(tmp_path):
    pytest.importorskip("pygame")
    panel = Display(1024, 768, 12, 7.3, 0.1, name="dummy", calibrated=True)
    panel.save(tmp_path / "panel.toml")
    write_image(tmp_path / "coded.png",
                RANDOM.integers(0, 256, (768, 1024, 3), dtype=np.uint8))
    done = program(tmp_path / "coded.png", "--display", tmp_path / "panel.toml", "--seconds", 0.05)
    assert (done.returncode, done.stderr) == (0, "")
    wrong = program(tmp_path / "coded.png", "--display", tmp_path / "panel.toml", "--screen", 3)
    assert wrong.returncode == 2
    assert "there is no screen 3" in wrong.stderr
    listed = program("--list")
    assert "0  1024 x 768" in listed.stdout


def test_without_a_screen_one_line_says_so(tmp_path):
    pytest.importorskip("pygame")
    if sys.platform in ("win32", "darwin"):
        pytest.skip("there is always a window system")
    PANEL.save(tmp_path / "panel.toml")
    write_image(tmp_path / "coded.png", picture())
    done = program(tmp_path / "coded.png", "--display", tmp_path / "panel.toml", driver="")
    assert done.returncode == 2
    lines = [line for line in done.stderr.splitlines() if line.startswith("lfportrait:")]
    assert len(lines) == 1
    assert "there is no screen" in lines[0]
    assert "not calibrated" in done.stderr


def test_without_pygame_one_line_tells_what_to_install(tmp_path, capsys, monkeypatch):
    PANEL.save(tmp_path / "panel.toml")
    write_image(tmp_path / "coded.png", picture())
    monkeypatch.setitem(sys.modules, "pygame", None)
    assert main(["show", str(tmp_path / "coded.png"), "--display",
                 str(tmp_path / "panel.toml")]) == 2
    assert "lfportrait[show]" in capsys.readouterr().err


@pytest.mark.parametrize(("words", "complaint"), [
    ([], "name the coded picture"), (["none.png"], "no such file"),
    (["none.png", "--seconds", "-1"], "--seconds")])
def test_mistakes_are_told(capsys, words, complaint):
    assert main(["show", *words]) == 2
    assert complaint in capsys.readouterr().err
