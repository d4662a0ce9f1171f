"""Casting through Looking Glass Bridge, against a small server on the loopback address."""

import contextlib
import dataclasses
import http.server
import json
import socket
import threading

import numpy as np
import pytest

from lfportrait.cli import main
from lfportrait.errors import UserError
from lfportrait.files import write_image
from lfportrait.lightfield import Display, QuiltLayout, quilt_of
from lfportrait.lightfield.screens.bridge import Bridge, DepthPicture
from lfportrait.media.pictures import read_image
from tests.fields import shell_field

CALIBRATION = {"serial": "LKG-P01234", "configVersion": "3.0", "screenW": {"value": 96.0},
               "screenH": {"value": 128.0}, "DPI": {"value": 324.0}, "slope": {"value": -7.15},
               "center": {"value": 0.53}, "pitch": {"value": 52.59}, "viewCone": {"value": 40.0},
               "invView": {"value": 1.0}}


def text(value, kind="WSTRING"):
    return {"name": "x", "type": kind, "value": value}


def screen(index, name, hardware, calibration):
    return text({"index": text(index, "UNSIGNED_INT"), "hwid": text(name),
                 "hardwareVersion": text(hardware), "calibration": text(calibration),
                 "defaultQuilt": text(""), "state": text("ok")}, "VARIANT_MAP")


class FakeBridge(http.server.BaseHTTPRequestHandler):
    """Answers as Bridge does, also in what is strange: it never says 404, and PUT alone counts."""

    def log_message(self, *_):
        pass

    def do_POST(self):
        self.send_response(200)
        self.end_headers()

    def do_PUT(self):
        server = self.server
        arguments = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        name = self.path.strip("/")
        server.calls.append((name, arguments))
        answer = server.answer(name, arguments)
        body = b"" if answer is None else json.dumps(answer).encode()
        self.send_response(server.code)
        self.end_headers()
        self.wfile.write(body)


class Server(http.server.ThreadingHTTPServer):
    code = 200

    def __init__(self):
        super().__init__(("127.0.0.1", 0), FakeBridge)
        self.calls, self.playlists, self.showing, self.window = [], {}, None, False
        self.screens = {"0": screen(0, "DELL U2720Q", "thirdparty", ""),
                        "2": screen(2, "LKG-P01234", "portrait", json.dumps(CALIBRATION))}
        self.refuse = {}

    @property
    def url(self):
        return f"http://127.0.0.1:{self.server_port}"

    def answer(self, name, arguments):
        status = {"status": text(self.refuse.get(name, "Completion"))}
        if name in self.refuse and self.refuse[name] is None:
            return None
        if name == "bridge_version":
            return {**status, "payload": text("2.5.1")}
        if name == "enter_orchestration":
            return {**status, "payload": text("token-7")}
        if arguments.get("orchestration") != "token-7":
            return {"status": text("UnknownOrchestration")}
        if name == "available_output_devices":
            return {**status, "payload": text(self.screens, "VARIANT_MAP")}
        if name == "instance_playlist":
            self.playlists.setdefault(arguments["name"], [])
        elif name == "insert_playlist_entry":
            self.playlists[arguments["name"]].append(arguments)
        elif name == "play_playlist":
            self.showing = (arguments["name"], arguments["head_index"])
            if name in self.refuse:
                status["payload"] = text({"message": text("no such file")}, "VARIANT_MAP")
        elif name == "show_window":
            self.window = arguments["show_window"]
        elif not name.startswith("transport_control_"):
            return None
        return status

    def entry(self):
        return self.playlists[self.showing[0]][0]


@pytest.fixture
def server():
    with contextlib.closing(Server()) as fake:
        fake.close = lambda: (fake.shutdown(), fake.server_close())
        threading.Thread(target=fake.serve_forever, args=(0.01,), daemon=True).start()
        yield fake


def run(*words):
    return main([str(word) for word in words])


def error_of(capsys):
    lines = [line for line in capsys.readouterr().err.splitlines()
             if line.startswith("lfportrait:")]
    assert len(lines) == 1, lines
    return lines[0]


@pytest.fixture
def quilt(tmp_path):
    path = tmp_path / "head_qs3x2a0.75.png"
    write_image(path, np.zeros((16, 18, 3), np.uint8))
    return path


def test_a_quilt_is_cast_to_the_looking_glass(server, quilt, tmp_path, capsys):
    assert run("cast", quilt, "--url", server.url, "--json", tmp_path / "run.json") == 0
    entry = server.entry()
    assert server.showing[1] == 2
    assert server.window
    assert entry["uri"] == str(quilt.resolve())
    assert (entry["cols"], entry["rows"], entry["view_count"], entry["aspect"]) == (3, 2, 6, 0.75)
    assert entry["isRGBD"] == 0
    assert "3 x 2 views on LKG-P01234" in capsys.readouterr().out
    figures = json.loads((tmp_path / "run.json").read_text())
    assert (figures["bridge"], figures["screen"], figures["views"]) == ("2.5.1", 2, 6)
    names = [name for name, _ in server.calls]
    assert names.index("instance_playlist") < names.index("insert_playlist_entry")
    assert names[-1] == "play_playlist"


def test_every_cast_has_a_playlist_of_its_own(server, quilt):
    with Bridge(server.url) as bridge:
        first = bridge.cast(quilt, QuiltLayout(3, 2, 0.75))
        assert bridge.cast(quilt, QuiltLayout(3, 2, 0.75)) != first
    assert all(len(entries) == 1 for entries in server.playlists.values())


def test_a_renamed_quilt_is_cast_as_its_side_file_says(server, quilt, tmp_path, capsys):
    renamed = quilt.rename(tmp_path / "head.png")
    assert run("cast", renamed, "--url", server.url) == 2
    assert "nothing gives the layout" in error_of(capsys)
    assert server.showing is None
    (tmp_path / "head.png.json").write_text(json.dumps(
        {"quilt_settings": {"viewX": 3, "viewY": 2, "aspect": 0.75}}))
    assert run("cast", renamed, "--url", server.url, "--quiet") == 0
    entry = server.entry()
    assert (entry["cols"], entry["rows"], entry["aspect"]) == (3, 2, 0.75)


def test_a_layout_can_be_given(server, quilt, tmp_path, capsys):
    address = "https://example.org/quilts/anna.mp4?size=full"
    assert run("cast", address, "--url", server.url) == 2
    assert "give --columns" in error_of(capsys)
    assert run("cast", address, "--url", server.url, "--columns", 3, "--rows", 2, "--aspect", 1.5,
               "--quiet") == 0
    assert (server.entry()["cols"], server.entry()["rows"], server.entry()["aspect"]) == (3, 2, 1.5)
    assert run("cast", "https://example.org/a_QS4X2.png", "--url", server.url, "--quiet") == 0
    entry = server.entry()
    panel = Display.from_looking_glass(CALIBRATION)
    assert (entry["cols"], entry["rows"], entry["aspect"]) == (4, 2, panel.aspect)


def test_several_portraits_are_one_playlist(server, quilt, tmp_path):
    other = tmp_path / "other_qs2x2a1.5.png"
    write_image(other, np.zeros((16, 18, 3), np.uint8))
    assert run("cast", quilt, other, quilt, "--url", server.url, "--seconds", 4.5, "--quiet") == 0
    entries = server.playlists[server.showing[0]]
    assert [entry["uri"] for entry in entries] == [str(path) for path in (quilt, other, quilt)]
    assert [entry["index"] for entry in entries] == [0, 1, 2]
    assert [(entry["cols"], entry["aspect"]) for entry in entries] == [
        (3, 0.75), (2, 1.5), (3, 0.75)]
    assert {entry["durationMS"] for entry in entries} == {4500}
    assert len(server.playlists) == 1


def test_nothing_is_cast_if_one_of_several_is_missing(server, quilt, tmp_path, capsys):
    assert run("cast", quilt, tmp_path / "none_qs3x2a1.png", "--url", server.url) == 2
    assert "no such file" in error_of(capsys)
    assert server.showing is None


def test_views_focus_and_depth_reach_bridge(server, quilt):
    assert run("cast", quilt, "--url", server.url, "--views", 5, "--shift", 0.25, "--quiet") == 0
    assert (server.entry()["view_count"], server.entry()["focus"]) == (5, 0.25)
    assert "depth_loc" not in server.entry()
    assert run("cast", quilt, "--url", server.url, "--rgbd", "--depth-side", 3, "--depthiness", 0.7,
               "--depth-inverted", "--quiet") == 0
    entry = server.entry()
    assert (entry["isRGBD"], entry["depth_loc"], entry["depthiness"], entry["depth_inversion"]) == (
        1, 3, 0.7, 1)
    with Bridge(server.url) as bridge:
        bridge.cast("https://example.org/a.mp4", QuiltLayout(8, 6, 0.75), depth=DepthPicture())
    assert server.entry()["uri"] == "https://example.org/a.mp4"


def test_a_field_becomes_a_quilt_for_the_very_display(server, tmp_path, monkeypatch):
    monkeypatch.setattr("lfportrait.lightfield.quilt_of", lambda field, display, config:
                        quilt_of(field, dataclasses.replace(display, quilt_size=(96, 96)), config))
    field = shell_field(basis=1, size=12)
    field.save(tmp_path / "head.npz")
    small = {**CALIBRATION, "serial": "mine"}
    server.screens["2"] = screen(2, "mine", "portrait", json.dumps(small))
    layout = Display.from_looking_glass(small).quilt
    assert run("cast", tmp_path / "head.npz", "--url", server.url, "--quiet") == 0
    written = list(tmp_path.glob("head_qs*.png"))
    assert server.entry()["uri"] == str(written[0].resolve())
    assert (server.entry()["cols"], server.entry()["rows"]) == layout
    assert read_image(written[0]).max() > 0


def test_screens_are_listed_and_the_calibration_saved(server, tmp_path, capsys):
    assert run("cast", "--list", "--save-display", tmp_path / "mine.toml", "--url",
               server.url) == 0
    out = capsys.readouterr().out
    assert "0  DELL U2720Q  (an ordinary monitor)" in out
    assert "2  LKG-P01234  (portrait)" in out
    display = Display.load(tmp_path / "mine.toml")
    assert display == Display.from_looking_glass(CALIBRATION)
    assert display.calibrated
    assert server.showing is None


def test_what_plays_can_be_hidden(server):
    server.window = True
    assert run("cast", "--hide", "--url", server.url) == 0
    assert not server.window
    assert "transport_control_pause" in [name for name, _ in server.calls]


def test_without_bridge_one_line_says_so(quilt, capsys):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        free = taken.getsockname()[1]
    assert run("cast", quilt, "--url", f"http://127.0.0.1:{free}") == 2
    line = error_of(capsys)
    assert "no Looking Glass Bridge answers" in line
    assert "lfportrait show" in line


def test_a_bridge_that_hangs_is_given_up(quilt, capsys):
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        assert run("cast", quilt, "--url", f"http://127.0.0.1:{silent.getsockname()[1]}",
                   "--timeout", 0.3) == 2
    assert "no Looking Glass Bridge answers" in error_of(capsys)


@pytest.mark.parametrize(("refuse", "complaint"), [
    ({"enter_orchestration": None}, "no Looking Glass Bridge of version 2.2"),
    ({"instance_playlist": "Failure"}, "failed at instance_playlist: Failure"),
    ({"insert_playlist_entry": None}, "insert_playlist_entry gave nothing"),
    ({"play_playlist": "Failure"}, "no such file")])
def test_what_bridge_refuses_is_told(server, quilt, capsys, refuse, complaint):
    server.refuse = refuse
    assert run("cast", quilt, "--url", server.url) == 2
    assert complaint in error_of(capsys)


def test_other_servers_are_told(server, quilt, capsys):
    server.code = 404
    assert run("cast", quilt, "--url", server.url) == 2
    assert "404" in error_of(capsys)


def test_without_a_looking_glass_nothing_is_cast(server, quilt, capsys):
    del server.screens["2"]
    assert run("cast", quilt, "--url", server.url) == 2
    assert "reports no Looking Glass display" in error_of(capsys)
    assert server.showing is None
    server.screens = {}
    assert run("cast", "--list", "--url", server.url) == 0
    assert "no screens" in capsys.readouterr().out


@pytest.mark.parametrize(("words", "complaint"), [
    ([], "name the quilt"), (["none_qs3x2a1.png"], "no such file"),
    (["QUILT", "--screen", "7"], "no screen 7"), (["QUILT", "--views", "7"], "6 views"),
    (["QUILT", "--timeout", "0"], "--timeout"), (["QUILT", "--shift", "4"], "--shift"),
    (["--save-display", "x.toml", "--screen", "0"], "is not a Looking Glass"),
    (["QUILT", "--url", "ftp://host"], "http://")])
def test_mistakes_are_told_in_one_line(server, quilt, capsys, words, complaint):
    words = [quilt if word == "QUILT" else word for word in words]
    assert run("cast", "--url", server.url, *words) == 2
    assert complaint in error_of(capsys)
    assert server.showing is None


def test_a_session_that_bridge_has_forgotten_is_told(server):
    with Bridge(server.url) as bridge, pytest.raises(UserError, match="UnknownOrchestration"):
        bridge.token = "old"
        bridge.devices()
