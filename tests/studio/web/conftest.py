"""The studio's page in a real browser, and before it a real studio with two sitters."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

pytest.importorskip("starlette")
pytest.importorskip("uvicorn")

from lfportrait.face import write_landmarks
from lfportrait.face.landmarks import GENERIC_LANDMARKS
from lfportrait.field import save_field
from tests.conftest import DATA
from tests.share.page.browser import CONTEXTS
from tests.share.page.portraits import painted_head

ROOT = Path(__file__).resolve().parents[3]
SCREENS = ("sitters", "photos", "making", "style", "portrait", "show")


@pytest.fixture(scope="session")
def browser(plain_browser):
    """Pages here are text, forms and pictures."""
    return plain_browser


def picture(seed: int, size: int = 120) -> Image.Image:
    """Soft noise: no two have the same bytes."""
    small = np.random.default_rng(seed).integers(0, 255, (6, 6, 3), np.uint8)
    return Image.fromarray(small).resize((size, size), Image.Resampling.BICUBIC)


@pytest.fixture(scope="session")
def portraits(tmp_path_factory) -> Path:
    """A folder of projects: one whose portrait the commands made, one that has nothing yet."""
    folder = tmp_path_factory.mktemp("studio") / "portraits"
    job = folder / "anna" / "portrait"
    job.mkdir(parents=True)
    head = painted_head(32)
    save_field(head, job / "field.npz")
    head.save(job / "styled.npz")
    picture(1, 64).save(job / "lightfield.png")
    (folder / "ben" / "photos").mkdir(parents=True)
    paintings = folder / "ben" / "paintings"
    paintings.mkdir()
    picture(2, 400).save(paintings / "ken.png")
    write_landmarks(paintings / "ken.landmarks.txt", face())
    return folder


def face() -> np.ndarray:
    """Landmarks of the generic head in a picture of 400 pixels, float64 [68, 2]."""
    flat = GENERIC_LANDMARKS[:, :2] * [1, -1]
    flat = (flat - flat.min(0)) / np.ptp(flat, axis=0).max()
    return np.round(100 + 200 * flat, 1)


class Studio:
    """A running studio.

    Attributes
    ----------
    address : With the key of the run.
    folder : Of the projects.
    first : What lay there when it started (`files_in`).
    """

    def __init__(self, folder: Path) -> None:
        self.folder, self.first = folder, files_in(folder)
        self.process: subprocess.Popen[str] | None = None
        self.start()

    def start(self, port: int = 0) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tests.studio.web.quick_studio", "studio", "--folder",
             str(self.folder), "--port", str(port), "--no-browser"], stdout=subprocess.PIPE,
            text=True, cwd=ROOT, env=self.surroundings())
        self.address = self.process.stdout.readline().split(" ")[0]
        assert self.address.startswith("http://127.0.0.1:"), "the studio does not start"
        self.home = self.address.partition("#")[0]

    @staticmethod
    def surroundings() -> dict[str, str]:
        """With the networks that lie beside the checkout, where they do."""
        weights = DATA / "weights"
        return {**os.environ, **({"LFPORTRAIT_MODELS": str(weights)} if weights.is_dir() else {})}

    def stop(self) -> None:
        self.process.terminate()
        self.process.wait(60)
        self.process.stdout.close()


KEPT = ("styles", "pages")
"""What the studio keeps for itself of a sitter that depends on the files alone."""


def files_in(folder: Path) -> dict[Path, bytes]:
    """What lies in the sitters' folders, but for `KEPT`."""
    return {path: path.read_bytes() for sitter in folder.glob("[!.]*") for path in sitter.rglob("*")
            if path.is_file() and path.relative_to(sitter).parts[:2] not in {
                (".studio", name) for name in KEPT}}


@pytest.fixture(scope="session")
def running(portraits) -> Iterator[Studio]:
    """One studio for all files: it starts within a second, but finds a face after four."""
    started = Studio(portraits)
    yield started
    started.stop()


class Opened:
    """The page, let in.

    Attributes
    ----------
    page : Playwright's.
    complaints, requests : What the page wrote on the console or threw, and the addresses that it
        asked for.
    open : Addresses that have not been answered in full, by their requests.
    """

    def __init__(self, browser, studio: Studio, hash_: str = "", *, width=1280, height=800,
                 **context) -> None:
        self.studio = studio
        context.setdefault("reduced_motion", "reduce")
        context.setdefault("locale", "en")
        self.options = {"viewport": {"width": width, "height": height}, **context}
        self.context = CONTEXTS.take(browser, **self.options)
        self.page = self.context.new_page()
        self.complaints: list[str] = []
        self.requests: list[str] = []
        # The viewer's pictures are read back (`tests.share.page.browser.PLAIN`).
        self.page.on("console", lambda message: "GPU stall" in message.text or
                     self.complaints.append(
                         f"{message.text} {message.location.get('url', '')}".strip()))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.open: dict[Any, str] = {}
        self.page.on("request", lambda request: self.open.update({request: request.url}))
        for ended in ("requestfinished", "requestfailed"):
            self.page.on(ended, lambda request: self.open.pop(request, None))
        self.page.goto(studio.address)
        self.page.wait_for_selector("[data-screen][data-ready]")
        if hash_:
            self.go(hash_)

    def __enter__(self) -> Opened:
        return self

    def __exit__(self, *_: object) -> None:
        CONTEXTS.give(self.context, f"{self.studio.home}static/favicon.svg", **self.options)

    def go(self, hash_: str) -> None:
        """Another screen, by its address."""
        # The screen before may be one of the same name, and stays until the next one is drawn.
        self.page.evaluate("""(name) => {
          if ((location.hash.slice(1) || "sitters") === name) return;
          document.querySelector("[data-screen]").dataset.before = "";
          location.hash = name;
        }""", hash_)
        screen = hash_.partition("/")[0]
        self.wait(f"[data-screen={screen}][data-ready]:not([data-before])")

    def wait(self, selector: str, seconds: float = 120.0) -> None:
        """Until something is seen; where it does not come, what is there is said."""
        from playwright.sync_api import TimeoutError

        try:
            self.page.wait_for_selector(selector, timeout=1000 * seconds)
        except TimeoutError as error:
            around = self.run("""() => [location.hash, ...document.querySelectorAll(
              "[data-screen], .toast")].map((each) => each.outerHTML ?? each).join("\\n")""")
            raise AssertionError(f"{selector} does not come\n"
                                 f"unanswered: {sorted(self.open.values())}\n"
                                 f"complaints: {self.complaints}\n{around[:5000]}") from error

    def reload(self) -> None:
        self.open.clear()
        self.page.reload()
        self.page.wait_for_selector("[data-screen][data-ready]", timeout=60000)

    def answered(self) -> bool:
        """Whether all that the page asked for has come, but for the events, which never end."""
        return not any("/api/events" not in url for url in self.open.values())

    def again(self) -> None:
        """As if it had just been opened, in a fifth of the time.

        What a test did to the page, to its requests and to what the browser keeps is undone. Where
        it changed the language, the theme or the browser's own functions, the page is read again.
        """
        self.page.unroute_all()
        self.page.set_viewport_size(self.options["viewport"])
        self.page.emulate_media(color_scheme=self.options.get("color_scheme", "light"))
        clean = self.run("""async () => {
          const chosen = localStorage.length > 0;
          localStorage.clear();
          if (chosen || ![open, fetch, XMLHttpRequest.prototype.send].every(
            (each) => String(each).includes("[native code]"))) return false;
          for (const each of document.querySelectorAll("dialog")) each.remove();
          const { refresh } = await import("/static/state.js");
          await refresh();
          // An address that leads nowhere shows this screen, too.
          if (document.querySelector("[data-screen=sitters]"))
            history.replaceState(null, "", "#sitters");
          return true;
        }""")
        if clean:
            self.go("sitters")
            self.eventually(self.answered)
            # An answer to a test before may have been one more complaint.
            self.run("""() => {
              for (const each of document.querySelectorAll(".toast")) each.remove();
            }""")
        else:
            self.run("""() => history.replaceState(null, "", "/")""")
            self.reload()
        self.complaints.clear()
        self.requests.clear()

    def run(self, script: str, argument=None):
        return self.page.evaluate(script, argument)

    def ask(self, method: str, path: str, data=None):
        """A request as the page sends it; the answer's JSON."""
        return self.run("""async ([method, path, data]) => {
          const { get, send } = await import("/static/api.js");
          return method === "GET" ? get(path, null) : send(method, path, data ?? {});
        }""", [method, path, data])

    def sitter(self, name: str) -> str:
        """A new sitter's id, which the page has heard of."""
        made = self.ask("POST", "/api/projects", {"name": name, "demo": False})["id"]
        self.until("""async (id) => (await import("/static/state.js")).project(id)?.id""", made)
        return str(made)

    def until(self, script: str, argument=None, seconds: float = 180.0):
        """What a script returns, once it is true; the page's policy forbids Playwright's own."""
        begun = time.monotonic()
        while (waited := time.monotonic() - begun) < seconds:
            found = self.run(script, argument)
            if found:
                return found
            time.sleep(min(0.01 + 0.1 * waited, 0.3))  # to ask takes time of what is waited for
        raise AssertionError(f"{script} stays {found}; {self.complaints}")

    def eventually(self, condition: Callable[[], bool], seconds: float = 60.0) -> None:
        """Wait for what only the test can tell."""
        begun = time.monotonic()
        while not condition():
            assert time.monotonic() - begun < seconds, (self.complaints, self.open.values())
            self.page.wait_for_timeout(10)


@pytest.fixture(scope="session")
def opened_once(browser, running) -> Iterator[Opened]:
    """The page of all tests that take `opened`."""
    with Opened(browser, running) as each:
        yield each


@pytest.fixture(scope="module")
def studio(running, opened_once) -> Studio:
    """The studio with the sitters as they were at first; tests before may have made others."""
    for job in opened_once.ask("GET", "/api/jobs")["jobs"]:
        if job["state"] in ("waiting", "running"):
            opened_once.ask("POST", f"/api/jobs/{job['id']}/cancel")
        opened_once.ask("DELETE", f"/api/jobs/{job['id']}")
    folders = {path.relative_to(running.folder).parts[0] for path in running.first}
    for folder in running.folder.iterdir():
        if folder.name not in {*folders, ".studio"}:
            shutil.rmtree(folder)
    for path in files_in(running.folder):
        if path not in running.first:
            path.unlink()
    for path, data in running.first.items():
        if not path.is_file() or path.read_bytes() != data:
            path.write_bytes(data)
    return running


@pytest.fixture(scope="module")
def opened_here(opened_once, studio) -> Iterator[Opened]:
    """The page, for all tests of a file."""
    opened_once.again()
    yield opened_once
    # Where it is left on a portrait, or with a dialog, it draws on and on: that took half a core
    # from all tests that came after.
    opened_once.again()


@pytest.fixture
def opened(opened_here) -> Opened:
    """The page as it is when it is opened."""
    opened_here.again()
    return opened_here


@pytest.fixture
def portraits_of(tmp_path) -> Iterator[Studio]:
    """A studio of its own, to be ended."""
    (tmp_path / "mine" / "ben" / "photos").mkdir(parents=True)
    running = Studio(tmp_path / "mine")
    yield running
    running.stop()
