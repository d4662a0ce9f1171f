"""The page is served to this machine alone, and nothing else is."""

import threading
import urllib.error
import urllib.request
from queue import Queue

import pytest

from lfportrait.errors import UserError
from lfportrait.share import serve_page


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    """The address of a served file, whose port is free again afterwards (that takes a while)."""
    folder = tmp_path_factory.mktemp("served")
    (folder / "page.html").write_text("<p>here</p>")
    (folder / "secret.txt").write_text("secret")
    told = Queue()
    thread = threading.Thread(target=serve_page, args=(folder / "page.html",), kwargs={
        "browse": False, "ready": lambda address, end: told.put((address, end))})
    thread.start()
    address, end = told.get(timeout=60)
    yield address
    end()
    thread.join(60)
    assert not thread.is_alive()


def test_the_page_is_there_and_nothing_else(served):
    assert served.startswith("http://127.0.0.1:")
    with urllib.request.urlopen(served) as answer:
        assert answer.read() == b"<p>here</p>"
        assert answer.headers["Content-Type"].startswith("text/html")
    for name in ("secret.txt", "../secret.txt"):
        with pytest.raises(urllib.error.HTTPError, match="404"):
            urllib.request.urlopen(served + name)


def test_a_port_that_is_taken_is_told(served, tmp_path):
    with pytest.raises(UserError, match="choose another --port"):
        serve_page(tmp_path / "page.html", int(served.rstrip("/").rsplit(":", 1)[1]), browse=False)


@pytest.mark.parametrize(("host", "allowed"), [
    ("evil.example", False), ("127.0.0.1.evil.example:80", False), ("", False),
    ("localhost:8000", True), ("127.0.0.1", True)])
def test_another_sites_name_gets_nothing(served, host, allowed):
    asked = urllib.request.Request(served, headers={"Host": host})
    if allowed:
        with urllib.request.urlopen(asked) as answer:
            assert answer.status == 200
    else:
        with pytest.raises(urllib.error.HTTPError, match="403"):
            urllib.request.urlopen(asked)
