"""Downloads from a real server on this machine: good ones, and all the ways they go wrong."""

import contextlib
import hashlib
import threading
import time
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from itertools import count
from types import SimpleNamespace
from urllib.parse import urlsplit

import pytest

from lfportrait import models
from lfportrait.cli.doctor import Models, ModelsFetch
from lfportrait.errors import UserError
from lfportrait.models import ModelFile

CONTENT = bytes(range(256)) * 200
DIGEST = hashlib.sha256(CONTENT).hexdigest()


class Server:
    """A web server on a free port; ``files`` and ``faults`` say what it gives under a name."""

    def __init__(self):
        self.files: dict[str, bytes] = {}
        self.faults: dict[str, str] = {}
        self.asked: list[str] = []
        self.released = threading.Event()
        server = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self):
                name = urlsplit(self.path).path.lstrip("/")
                server.asked.append(name)
                faults = server.faults.get(name, "").split(" then ")
                fault = faults[min(server.asked.count(name), len(faults)) - 1]
                if fault == "error":
                    return self.send_error(503)
                if name not in server.files or fault == "gone":
                    return self.send_error(404)
                content = server.files[name]
                if fault == "silent":
                    return server.released.wait(5)
                self.send_response(200)
                if fault != "endless":
                    whole = len(content) // 2 if fault == "short" else len(content)
                    self.send_header("Content-Length", str(whole))
                self.end_headers()
                with contextlib.suppress(OSError):  # the client had enough
                    self._write(content, fault)

            def _write(self, content, fault):
                if fault in ("cut", "short", "stalled"):
                    self.wfile.write(content[:len(content) // 2])
                    if fault == "stalled":
                        server.released.wait(5)
                elif fault == "trickling":
                    for start in range(0, len(content), 5120):
                        self.wfile.write(content[start:start + 5120])
                        time.sleep(0.05)
                elif fault == "endless":
                    for _ in range(400):
                        self.wfile.write(content)
                else:
                    self.wfile.write(content)

            def log_message(self, *_):
                pass

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self._server.daemon_threads = True
        self._server.block_on_close = False
        self.address = f"http://127.0.0.1:{self._server.server_address[1]}"
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.02,))
        self._thread.start()

    def close(self):
        self.released.set()
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


@pytest.fixture
def server(monkeypatch):
    monkeypatch.setattr(models, "PAUSE", 0.01)
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    running = Server()
    running.files["net.bin"] = CONTENT
    yield running
    running.close()


@pytest.fixture
def shelf(server, tmp_path, monkeypatch):
    """An empty cache and a registry of two networks on the server and one by hand."""
    monkeypatch.setattr(models, "cache_folder", lambda: tmp_path / "cache")
    monkeypatch.delenv("LFPORTRAIT_MODELS", raising=False)
    monkeypatch.delenv("LFPORTRAIT_MIRROR", raising=False)
    server.files["other.bin"] = CONTENT[:1000]
    other = hashlib.sha256(CONTENT[:1000]).hexdigest()
    monkeypatch.setattr(models, "REGISTRY", {
        "net": (ModelFile("net.bin", DIGEST, "a test", "CC0", server.address + "/net.bin", 51200),),
        "other": (ModelFile("other.bin", other[:8], "a test", "CC0",
                            server.address + "/other.bin?generation=1", 1000),),
        "handmade": (ModelFile("handmade.bin", DIGEST, "a test", "CC0", size=51200),)})
    monkeypatch.setattr(models, "GROUPS", {"pair": ("net", "other")})
    return tmp_path / "cache"


def get(server, target, name="net.bin", **changes):
    wanted = {"sha256": DIGEST, "size": len(CONTENT), "quiet": True, **changes}
    return models.fetch_file(f"{server.address}/{name}", target, **wanted)


def test_a_file_comes_whole(server, tmp_path):
    target = tmp_path / "folder" / "net.bin"
    assert get(server, target) == target
    assert target.read_bytes() == CONTENT
    assert [path.name for path in target.parent.iterdir()] == ["net.bin"]
    # The publisher's first digits are enough.
    assert get(server, tmp_path / "b.bin", sha256=DIGEST[:8].upper()).read_bytes() == CONTENT


@pytest.mark.parametrize(("fault", "message", "asked"), [
    ("cut", "broke off|cut off, 25600 of 51200", 2),
    ("short", "cut off, 25600 of 51200 bytes came", 2),
    ("gone", "the server answers 404", 1),
    ("error", "the server answers 503", 2),
    ("silent", r"127\.0\.0\.1 is too slow, nothing came for 0\.3 s", 2),
    ("stalled", r"127\.0\.0\.1 is too slow, nothing came for 0\.3 s", 2),
    ("endless", "another file came, over .* bytes instead of 51200", 2),
])
def test_each_failure_is_one_line_and_leaves_nothing(server, tmp_path, monkeypatch, fault, message,
                                                     asked):
    if fault in ("silent", "stalled"):
        monkeypatch.setattr(models, "TIMEOUT", 0.3)
    server.faults["net.bin"] = fault
    begin = time.monotonic()
    with pytest.raises(UserError, match=message) as caught:
        get(server, tmp_path / "net.bin")
    text = str(caught.value)
    assert "\n" not in text and "net.bin" in text and "lfportrait models add" in text
    assert list(tmp_path.iterdir()) == []
    while len(server.asked) < asked and time.monotonic() - begin < 60:
        time.sleep(0.02)  # a request that was given up may be read later
    assert len(server.asked) == asked
    assert time.monotonic() - begin < 60


@pytest.mark.parametrize(("content", "message"), [
    (CONTENT[::-1], "damaged, its SHA-256 does not begin with"),
    (b"<html>log in first</html>", "cut off, 25 of 51200 bytes"),
    (CONTENT + b"!", "another file came, 51201 bytes instead of 51200")])
def test_another_content_is_refused(server, tmp_path, content, message):
    server.files["net.bin"] = content
    with pytest.raises(UserError, match=message):
        get(server, tmp_path / "net.bin")
    assert list(tmp_path.iterdir()) == []


def test_a_closed_port_is_told(server, tmp_path):
    server.close()
    with pytest.raises(UserError, match=r"127\.0\.0\.1 can't be reached; check the network"):
        get(server, tmp_path / "net.bin")
    assert list(tmp_path.iterdir()) == []


def test_what_is_no_address_is_told(tmp_path):
    for url in ("studio/models/net.bin", "ftp://127.0.0.1/net.bin"):
        with pytest.raises(UserError, match="not a web address"):
            models.fetch_file(url, tmp_path / "net.bin", DIGEST, quiet=True)


@pytest.mark.parametrize("fault", ["cut", "short", "error", "stalled"])
def test_a_second_try_may_succeed(server, tmp_path, monkeypatch, fault):
    if fault == "stalled":
        monkeypatch.setattr(models, "TIMEOUT", 1.0)
    server.faults["net.bin"] = f"{fault} then fine"
    assert get(server, tmp_path / "net.bin").read_bytes() == CONTENT
    assert len(server.asked) == 2


def test_a_server_that_trickles_is_left(server, tmp_path, monkeypatch):
    """It would never be silent for long enough."""
    server.faults["net.bin"] = "trickling"
    # Half a minute passes between two pieces, by a clock that this machine's pace does not change.
    clock = SimpleNamespace(monotonic=count(0.0, 0.9 * models.TIMEOUT).__next__,
                            sleep=time.sleep)
    monkeypatch.setattr(models, "time", clock)
    with pytest.raises(UserError, match=r"the server is too slow, \d{4,5} bytes in \d\d s; try "
                                        r"again"):
        get(server, tmp_path / "net.bin")
    assert list(tmp_path.iterdir()) == []


def test_an_interrupted_download_leaves_nothing(server, tmp_path, monkeypatch):
    (tmp_path / "net.bin").write_bytes(b"older")

    def interrupt(self, done, note=""):
        raise KeyboardInterrupt

    monkeypatch.setattr(models.Progress, "update", interrupt)
    with pytest.raises(KeyboardInterrupt):
        get(server, tmp_path / "net.bin")
    assert [path.name for path in tmp_path.iterdir()] == ["net.bin"]
    assert (tmp_path / "net.bin").read_bytes() == b"older"


def test_a_folder_that_can_not_be_made_is_told(server, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match="can't make the folder"):
        get(server, tmp_path / "file" / "net.bin")


def test_the_progress_line_names_file_and_size(server, tmp_path, capsys):
    get(server, tmp_path / "net.bin", quiet=False)
    assert "net.bin (0.1 MB): " in capsys.readouterr().err
    assert [models.megabytes(size) for size in (4_788_208, 249_024, 7_289, 553_433_881)] == [
        "5 MB", "0.2 MB", "0.1 MB", "553 MB"]


def test_a_network_is_fetched_once(server, shelf):
    assert models.fetch("net", quiet=True) == shelf / "net.bin"
    assert models.fetch("net", quiet=True).read_bytes() == CONTENT
    assert models.fetch("other", quiet=True).read_bytes() == CONTENT[:1000]
    assert server.asked == ["net.bin", "other.bin"]


def test_nothing_is_downloaded_where_that_is_not_wanted(server, shelf):
    with pytest.raises(UserError, match=r"'net' is missing: .*lfportrait models fetch net"):
        models.fetch("net", download=False)
    with pytest.raises(UserError, match="it can't be downloaded automatically"):
        models.fetch("handmade")
    assert server.asked == []


def test_all_that_a_job_needs_is_told_at_once(server, shelf):
    assert models.missing(["pair"]) == ["net", "other"]
    with pytest.raises(UserError, match=r"this job needs 2 networks \(0\.1 MB\).*: net, other; "
                                        r"get them with `lfportrait models fetch pair`"):
        models.require(["pair"], download=False)
    with pytest.raises(UserError, match=r"needs 1 network .*: net; get it with "
                                        r"`lfportrait models fetch net`"):
        models.require(["net"], download=False)  # the group would bring more
    models.fetch("net", quiet=True)
    with pytest.raises(UserError, match=r"the report needs 1 network \(.*: other; get it"):
        models.require(["net", "other"], download=False, purpose="the report")
    with pytest.raises(UserError, match="this job needs the network 'handmade', which is missing"):
        models.require(["other", "handmade"], download=True)
    assert server.asked == ["net.bin"]
    with pytest.raises(UserError, match="there is no network or group 'pears'"):
        models.missing(["pears"])


def test_all_that_a_job_needs_is_downloaded_before_it_begins(server, shelf, capsys):
    models.require(["net", "pair"], download=True)
    assert models.missing(["pair"]) == []
    assert server.asked == ["net.bin", "other.bin"]
    lines = capsys.readouterr().err.splitlines()
    assert [line.split(":")[0] for line in lines] == ["net.bin (0.1 MB)", "other.bin (0.1 MB)"]
    models.require(["pair"], download=False)
    assert server.asked == ["net.bin", "other.bin"]


def test_a_damaged_network_is_told_before_the_job_begins(server, shelf):
    models.require(["pair"], download=True, quiet=True)
    (shelf / "other.bin").write_bytes(CONTENT[:999])
    with pytest.raises(UserError, match=r"other\.bin is damaged or another file"):
        models.require(["pair"], download=False)


def test_a_stand_in_counts(server, shelf, monkeypatch):
    monkeypatch.setattr(models, "_STAND_INS", {"other": "net"})
    assert models.missing(["other"]) == ["other"]
    models.fetch("net", quiet=True)
    assert models.missing(["other"]) == []
    assert not models.available("other")
    models.require(["other"], download=False)


def test_a_mirror_is_asked_by_name(server, shelf, monkeypatch):
    """At its own addresses, also for what has no official one; the hash is checked all the same."""
    server.files.update({"studio/net.bin": CONTENT, "studio/handmade.bin": CONTENT,
                         "studio/other.bin": CONTENT[::-1]})
    monkeypatch.setenv("LFPORTRAIT_MIRROR", server.address + "/studio/")
    assert models.listing()[2].endswith("/studio/handmade.bin")
    models.require(["net", "handmade"], download=True, quiet=True)
    assert server.asked == ["studio/net.bin", "studio/handmade.bin"]
    with pytest.raises(UserError, match=r"other\.bin.*another file came"):
        models.fetch("other", quiet=True)
    assert not (shelf / "other.bin").exists()


def test_the_command_fetches_names_and_groups(server, shelf, capsys):
    ModelsFetch(names=("pair",), quiet=True).run()
    assert capsys.readouterr().out.splitlines() == [
        f"net: {shelf / 'net.bin'}", f"other: {shelf / 'other.bin'}"]
    Models().run()
    rows = capsys.readouterr().out.splitlines()
    assert "pair" in rows[0] and "here" in rows[0] and server.address in rows[0]
    assert "pair" not in rows[2] and rows[2].endswith("by hand, optional")


@pytest.mark.data
def test_the_real_networks_of_the_main_job_come_from_a_mirror(server, shared_weights, tmp_path,
                                                              monkeypatch):
    monkeypatch.setattr(models, "cache_folder", lambda: tmp_path / "cache")
    monkeypatch.delenv("LFPORTRAIT_MODELS", raising=False)
    monkeypatch.setenv("LFPORTRAIT_MIRROR", server.address)
    for name in models.GROUPS["portrait"]:
        file = models.REGISTRY[name][0].file
        server.files[file] = (shared_weights / file).read_bytes()
    models.require(["portrait"], download=True, quiet=True)
    assert models.missing(["portrait"]) == []
    assert len(list((tmp_path / "cache").iterdir())) == 3
    # One of them spoilt on its way.
    name = "hair-segmentation"
    entry = replace(models.REGISTRY[name][0])
    (tmp_path / "cache" / entry.file).unlink()
    server.files[entry.file] = server.files[entry.file][:-1] + b"?"
    with pytest.raises(UserError, match=r"hair_segmentation\.tflite.*SHA-256"):
        models.require(["portrait"], download=True, quiet=True)
    assert models.missing(["portrait"]) == [name]
