"""Light fields shown live: what pointer and keys change, a script of events, and the command."""

import dataclasses
import importlib.util
import itertools
import json
import os
import shutil
import subprocess
import sys

import numpy as np
import pytest

from lfportrait.cli import main
from lfportrait.errors import UserError
from lfportrait.gpu import Adapter
from lfportrait.lightfield import Display, EncodeConfig, encode
from lfportrait.lightfield.screens import OffscreenWindow, fields_to_show, show_field, show_live
from lfportrait.lightfield.screens.live import Controls, one_eyed
from lfportrait.metrics import psnr
from tests.fields import shell_field
from tests.lightfield.gpu.test_live import EVEN, painted
from tests.lightfield.test_ground import checkered

PANEL = Display(160, 96, views=24, pitch=11.3, slant=0.2, cone=40, distance=4, name="panel")
CONFIG = EncodeConfig()


def typed(text):
    return {"event_type": "char", "data": text}


def key(name):
    return {"event_type": "key_down", "key": name}


def pointer(kind, x):
    return {"event_type": f"pointer_{kind}", "x": x, "y": 5, "button": 1 if kind != "move" else 0}


def after(*events, controls=None, width=100.0):
    controls = controls or Controls(sway=False, mixable=True)
    for event in events:
        controls.handle(event, width)
    return controls


def test_a_drag_turns_the_head_and_only_while_the_button_is_down():
    controls = after(pointer("move", 90), pointer("down", 10), pointer("move", 35))
    turned = controls.applied(CONFIG).turn
    assert turned == pytest.approx(30.0)
    after(pointer("move", 60), pointer("up", 60), pointer("move", 0), controls=controls)
    assert controls.applied(CONFIG).turn == pytest.approx(60.0)
    assert after(key("ArrowLeft")).applied(CONFIG).turn == -5.0
    # As far as one likes: from behind, and on to the front.
    far = after(*[event for _ in range(5) for event in (
        pointer("down", 0), pointer("move", 100), pointer("up", 100))])
    assert far.applied(CONFIG).turn == pytest.approx(-120.0)
    assert far.applied(EncodeConfig(turn=150)).turn == pytest.approx(30.0)


@pytest.mark.parametrize(("events", "name", "value"), [
    ([typed("+")], "focus", 0.02), ([typed("-")], "focus", -0.02),
    ([typed("+")] * 99, "focus", 0.5),
    ([{"event_type": "wheel", "dx": 0, "dy": -300.0}], "focus", 0.06),
    ([typed("]")], "depth_scale", 1.06), ([typed("[")] * 99, "depth_scale", 0.2),
    ([typed("]")] * 99, "depth_scale", 4.0), ([typed(".")], "size", 0.8 * 1.06),
    ([typed(",")] * 99, "size", 0.8 * 0.2), ([typed("]"), typed("["), typed("x")], "size", 0.8),
    ([typed("+"), typed("]"), typed("."), typed("r")], "focus", 0.0)])
def test_keys_change_focus_depth_and_size_within_bounds(events, name, value):
    config = after(*events).applied(CONFIG)
    assert getattr(config, name) == pytest.approx(value)
    untouched = {"focus", "depth_scale", "size", "turn"} - {name}
    if events[0] != typed("+") or len(events) == 1:
        for other in untouched:
            assert getattr(config, other) == getattr(CONFIG, other)


def test_near_eyes_bound_the_focus():
    close = after(*[typed("+")] * 99, controls=Controls(distance=0.5, sway=False))
    assert close.applied(CONFIG).focus == pytest.approx(0.2)


def test_painting_and_photo_fade_into_each_other():
    controls = after(typed("m"))
    assert controls.share == 0 and not controls.still
    controls.advance(0.25)
    assert controls.share == pytest.approx(0.25)
    controls.advance(5.0)
    assert controls.share == 1.0 and controls.still
    after(key("ArrowDown"), key("ArrowDown"), controls=controls).advance(5.0)
    assert controls.share == pytest.approx(0.8)
    after(typed("m"), controls=controls).advance(5.0)
    assert controls.share == 0.0
    alone = after(typed("m"), key("ArrowUp"), controls=Controls(mixable=False, sway=False))
    alone.advance(5.0)
    assert alone.share == 0.0 and "photo" not in alone.summary()


def test_the_head_sways_slowly_until_it_is_paused():
    controls = Controls()
    seen = []
    for _ in range(100):
        controls.advance(0.1)
        seen.append(controls.applied(CONFIG).turn)
    assert max(seen) == pytest.approx(8.0, abs=0.1) and min(seen) == pytest.approx(-8.0, abs=0.1)
    assert np.abs(np.diff(seen)).max() < 0.6
    after(typed(" "), controls=controls)
    before = controls.applied(CONFIG)
    controls.advance(3.0)
    assert controls.applied(CONFIG) == before and controls.still
    after(typed(" "), pointer("down", 1), controls=controls).advance(3.0)
    assert controls.applied(CONFIG) == before


def test_escape_q_and_the_windows_own_button_close():
    for event in (key("Escape"), typed("q"), {"event_type": "close"}):
        assert after(event).closed
    assert not after(typed("h"), key("Enter")).closed


@pytest.fixture
def play(gpu_child):
    """Plays a script beside a device (`live_runs.played`)."""
    return lambda *arguments: gpu_child.call("tests.lightfield.gpu.live_runs:quietly", "played",
                                             *arguments)


def alike(picture, wanted):
    return psnr(picture / 255.0, wanted / 255.0) >= EVEN


@pytest.mark.slow  # shaders; what events change is above
def test_events_change_the_pictures_that_follow(play):
    photo = shell_field(20, basis=9, seed=3)
    painting = checkered(painted(photo))
    panel = dataclasses.replace(PANEL, flip_x=True)
    script = {0: [typed(" ")], 1: [pointer("down", 10)], 2: [pointer("move", 50)], 3: [
        pointer("up", 50), typed("]")], 4: [key("ArrowUp")], 9: [typed("r")]}
    pictures, _, figures, over = play(painting, panel, CONFIG, script, 12, photo)
    assert len(pictures) == 12 and not over
    turned = EncodeConfig(turn=30)
    deeper = dataclasses.replace(turned, depth_scale=1.06)
    for number, config in ((0, CONFIG), (1, CONFIG), (2, turned), (3, deeper), (10, CONFIG)):
        wanted = panel.to_panel(encode(painting, panel, config, device="cpu"))
        assert alike(pictures[number], wanted), number
    wide = np.zeros_like(photo.sh)
    wide[..., :1] = painting.sh
    mixed = dataclasses.replace(photo.with_sh(0.9 * wide + 0.1 * photo.sh),
                                backdrop=painting.backdrop)
    assert alike(pictures[8], panel.to_panel(encode(mixed, panel, deeper, device="cpu")))
    # What stands still is not coded again.
    assert figures["frames"] < 12 and figures["coding_ms"]["slowest"] > 0


@pytest.mark.slow  # shaders
def test_a_composed_head_stays_composed(play):
    field = shell_field(20, basis=1)
    config = EncodeConfig(compose=True)
    script = {0: [typed(" ")], 1: [typed("."), typed("["), typed("+")]}
    pictures, *_ = play(field, PANEL, config, script, 2)
    changed = EncodeConfig(compose=True, size=0.8 * 1.06, depth_scale=1 / 1.06, focus=0.02)
    for picture, wanted in zip(pictures, (config, changed), strict=True):
        assert alike(picture, encode(field, PANEL, wanted, device="cpu"))


@pytest.mark.slow  # shaders; the sway is above
def test_a_sway_moves_the_head_and_its_time_ends(play):
    field = shell_field(16, basis=1)
    pictures, said, figures, over = play(field, PANEL.scaled(64, 40), CONFIG, {1: [typed("h")]},
                                         200, None, 1.5)
    assert over and 44 <= len(pictures) <= 46
    assert figures["frames"] >= len(pictures)
    assert all(not np.array_equal(a, b) for a, b in itertools.pairwise(pictures))
    assert said[0].startswith("drag") and "pictures a second" in said[1]


@pytest.mark.slow  # shaders; closing is above
def test_a_closed_window_shows_nothing_more(play):
    field = shell_field(16, basis=1)
    pictures, _, _, over = play(field, PANEL.scaled(64, 40), CONFIG, {3: [key("Escape")]}, 50)
    assert over and len(pictures) == 3


@pytest.mark.slow  # shaders
def test_a_picture_for_the_ground_is_read_once(play, tmp_path):
    field = shell_field(20, basis=1)
    config = EncodeConfig(ground="white")
    pictures, *_ = play(field, PANEL, config, {0: [typed(" ")]}, 1)
    assert alike(pictures[0], encode(field, PANEL, config, device="cpu"))


def test_one_eye_is_no_panel():
    panel = dataclasses.replace(PANEL, subpixels="BGR", flip_x=True, inverted=True)
    seen = one_eyed(panel, 80, 48)
    assert seen.eyes().tolist() == [0.0] and not seen.flip_x
    assert np.ptp(seen.places()[..., 0]) == 0


class FakeWindow:
    """A window that something goes wrong in."""

    screen, closed = 0, False

    def __init__(self, error):
        self.error = error

    def open(self):
        raise self.error

    def close(self):
        self.closed = True


@pytest.mark.parametrize(("error", "kind", "text"), [
    (RuntimeError("Device was lost"), UserError, "a card (Vulkan) was lost, or its memory is too"),
    (MemoryError(), UserError, "too small for this field: out of memory"),
    (UserError("as it is"), UserError, "^as it is$"), (ValueError("a bug"), ValueError, "a bug")])
def test_a_lost_device_is_said_in_one_line(error, kind, text):
    window = FakeWindow(error)
    with pytest.raises(kind, match=text.replace("(", r"\(").replace(")", r"\)")):
        show_live(window, Adapter("a card", "discrete", "Vulkan"), None, CONFIG, PANEL)
    assert window.closed


def test_a_photo_is_found_beside_the_painting_only_if_it_is_its_own(tmp_path):
    photo = shell_field(16, basis=4)
    painted(photo).save(tmp_path / "styled.npz")
    assert fields_to_show(tmp_path / "styled.npz", None)[1] is None
    photo.save(tmp_path / "field.npz")
    assert fields_to_show(tmp_path / "styled.npz", None)[1].basis == 4
    assert fields_to_show(tmp_path / "field.npz", None)[1] is None
    shell_field(18).save(tmp_path / "field.npz")
    assert fields_to_show(tmp_path / "styled.npz", None)[1] is None
    with pytest.raises(UserError, match="has other points"):
        fields_to_show(tmp_path / "styled.npz", tmp_path / "field.npz")


# -- the command ----------------------------------------------------------------------------------


@pytest.fixture
def saved(tmp_path):
    """A field's file and a panel's."""
    field = shell_field(16, basis=1)
    field.save(tmp_path / "styled.npz")
    dataclasses.replace(PANEL, calibrated=True).save(tmp_path / "panel.toml")
    return tmp_path


def complaint(capsys, *words):
    """The one line that a command fails with."""
    assert main([str(word) for word in words]) == 2
    lines = [line for line in capsys.readouterr().err.splitlines() if "warning" not in line]
    assert len(lines) == 1
    return lines[0]


@pytest.mark.parametrize(("words", "text"), [
    (["x.npz"], "a field is shown with --live"),
    (["x.png", "--live"], "name one field to show live"),
    (["a.npz", "b.npz", "--simulate"], "name one field to show live"),
    (["x.npz", "--live", "--device", "cpu"], "--device cpu has none here"),
    (["x.npz", "--live", "--seconds", "-1"], "--seconds must be 0 or more")])
def test_what_cant_be_shown_live_is_said_in_one_line(capsys, words, text):
    assert text in complaint(capsys, "show", *words)


def test_missing_packages_are_named(capsys, monkeypatch):
    real = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *rest: (
        None if name in ("rendercanvas", "glfw") else real(name, *rest)))
    line = complaint(capsys, "show", "x.npz", "--live")
    assert "rendercanvas, glfw: pip install 'lfportrait[gpu,live]'" in line


def command(saved, *words, **environment):
    """The command in a process of its own: windows are not for tests' processes."""
    kept = {name: value for name, value in os.environ.items()
            if name not in ("DISPLAY", "WAYLAND_DISPLAY", "XDG_SESSION_TYPE")}
    return subprocess.run(
        [sys.executable, "-m", "lfportrait", "show", "styled.npz", "--display", "panel.toml",
         "--device", "gpu", *words], cwd=saved, capture_output=True, text=True, timeout=300,
        check=False, env={**kept, "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
                          **environment})


@pytest.mark.slow  # a process of its own
@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there is a screen")
def test_no_screen_is_said_in_one_line(saved, adapter):
    pytest.importorskip("glfw", reason="glfw is not installed: pip install 'lfportrait[live]'")
    done = command(saved, "--live")
    assert done.returncode == 2
    assert "there is no screen to show a light field on" in done.stderr.splitlines()[-1]


@pytest.fixture
def x_server():
    """A screen in memory of the panel's pixels, by Xvfb; its name."""
    if shutil.which("Xvfb") is None:
        pytest.skip("Xvfb is not installed (Debian: apt install xvfb)")
    pytest.importorskip("glfw", reason="glfw is not installed: pip install 'lfportrait[live]'")
    read, write = os.pipe()
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", str(write), "-screen", "0", f"{PANEL.width}x{PANEL.height}x24"],
        pass_fds=[write], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    os.close(write)
    with os.fdopen(read) as stream:
        number = stream.readline().strip()
    yield f":{number}"
    server.kill()
    server.wait()


@pytest.mark.slow  # a window, its process and shaders
@pytest.mark.parametrize("word", ["--live", "--simulate"])
def test_a_real_window_shows_the_pictures_own_pixels(saved, adapter, x_server, word):
    done = command(saved, word, "--seconds", "0.5", "--json", "out.json", DISPLAY=x_server)
    assert done.returncode == 0, done.stderr
    figures = json.loads((saved / "out.json").read_text())
    # The first may take all the time where the machine is busy; one more follows it all the same.
    assert figures["frames"] >= 2 and figures["device"].startswith("gpu: ")
    if word == "--live":
        assert figures["size"] == [PANEL.width, PANEL.height] and figures["screen"] == 0


@pytest.mark.slow  # a window and its process
def test_a_screen_of_another_size_is_refused(saved, adapter, x_server):
    dataclasses.replace(PANEL, width=PANEL.width + 16).save(saved / "panel.toml")
    listed = command(saved, "--live", "--list", DISPLAY=x_server)
    assert listed.stdout.split() == ["0", "160", "x", "96"]
    done = command(saved, "--live", DISPLAY=x_server)
    assert done.returncode == 2
    assert "no screen has the 176 x 96 pixels" in done.stderr.splitlines()[-1]


def test_nothing_is_shown_live_without_a_gpu():
    window = OffscreenWindow((PANEL.width, PANEL.height))
    with pytest.raises(UserError, match="--device cpu has none here"):
        show_field(shell_field(), PANEL, window=window, device="cpu")
    assert window.pictures == []
