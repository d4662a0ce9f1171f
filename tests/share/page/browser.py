"""A browser for tests of the page, and what they ask of it."""

import base64
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lfportrait import studio

ARGUMENTS = ["--headless=new", "--no-sandbox", "--use-angle=swiftshader",
             "--enable-unsafe-swiftshader"]
"""WebGL2 in software: slow, the same everywhere."""
BROWSERS = "chromium-headless-shell", "chromium", "chromium-browser", "google-chrome"
"""Names of its program. The first one is the same without windows, and opens pages sooner."""
PLAIN = ("--disable-gpu-compositing", "--renderer-process-limit=1")
"""Pages are put together without WebGL, and one process shows all of them, which takes less time.
What they draw by WebGL themselves is read back, and the browser complains of that."""

SMALL = Path(studio.__file__).parent / "web" / "favicon.svg"

VIEW = """([camera, size, how]) => {
  const { renderer, viewer } = lfportrait;
  viewer.stopped = true;
  renderer.gl.bindFramebuffer(renderer.gl.FRAMEBUFFER, renderer.target("test", size));
  renderer.view(camera, size, how);
  return text(renderer.pixels(size));
}"""

CODED = """([name, description, place]) => {
  const { renderer, viewer, Panel, readDisplay, panels } = lfportrait;
  viewer.stopped = true;
  const display = readDisplay(name, description), size = [display.width, display.height];
  const coder = new Panel(renderer, display);
  renderer.gl.bindFramebuffer(renderer.gl.FRAMEBUFFER, renderer.target("test", size));
  coder.draw({ ...panels.place, ...place });
  const pixels = text(renderer.pixels(size));
  coder.close();
  return pixels;
}"""

TEXT = """const text = (bytes) => {
  let all = "";
  for (let i = 0; i < bytes.length; i += 8192) {
    all += String.fromCharCode(...bytes.subarray(i, i + 8192));
  }
  return btoa(all);
};"""


def program() -> str | None:
    """The browser's program, or None."""
    named = os.environ.get("LFPORTRAIT_BROWSER")
    return named or next(filter(None, map(shutil.which, BROWSERS)), None)


@contextmanager
def chromium(playwright, *more: str) -> Iterator:
    """A running browser; tests are skipped where there is none, unless one is required."""
    path = program()
    if path is None:
        if os.environ.get("LFPORTRAIT_REQUIRE_BROWSER") == "1":
            pytest.fail("no Chromium is installed, and LFPORTRAIT_REQUIRE_BROWSER=1 asks for one")
        pytest.skip("no Chromium is installed (or name one with LFPORTRAIT_BROWSER)")
    running = playwright.chromium.launch(executable_path=path, args=[*ARGUMENTS, *more])
    yield running
    running.close()


class Contexts:
    """A browser's contexts, each used by one test after the other.

    Between two tests a context keeps a page of next to nothing, from where their pages come from:
    so the process that shows them lives on, with their scripts as it has compiled them, and the
    next page is there in half of the time.
    """

    def __init__(self) -> None:
        self._idle: dict[str, list] = {}
        self._small: dict[Any, Any] = {}

    def take(self, browser, **options):
        """A context that nobody uses, and in which no page has left anything."""
        idle = self._idle.setdefault(repr(sorted(options.items())), [])
        idle[:] = [each for each in idle if each.browser.is_connected()]
        found = next((each for each in idle if each.browser is browser), None)
        if found is None:
            found = browser.new_context(**options)
            found.set_default_timeout(60_000)  # a busy machine takes its time
            return found
        idle.remove(found)
        return found

    def give(self, context, small: str, **options) -> None:
        """Close what is open in it, for the next one who takes it with the same options.

        ``small`` is the address of a small file, at the place where the pages come from.
        """
        from playwright.sync_api import Error

        kept = self._small.get(context)
        if kept is None:
            kept = self._small[context] = context.new_page()
            with suppress(Error):  # a server may be gone
                kept.goto(small)
        for page in context.pages:
            if page is not kept:
                with suppress(Error):
                    page.evaluate("() => localStorage.clear()")
                page.close()
        context.clear_cookies()
        self._idle[repr(sorted(options.items()))].append(context)


CONTEXTS = Contexts()


class Opened:
    """A page in the browser.

    Attributes
    ----------
    page : Playwright's.
    complaints, requests : What the page told on the console or threw, and what it asked any
        network for.
    """

    def __init__(self, browser, path: Path, *, width=240, height=160, live=True, **context):
        # A head that sways is drawn all the while, by the processor.
        context.setdefault("reduced_motion", "reduce")
        self.options = {"viewport": {"width": width, "height": height}, **context}
        self.context = CONTEXTS.take(browser, **self.options)
        self.page = self.context.new_page()
        self.complaints: list[str] = []
        self.requests: list[str] = []
        # Pictures are read back by the tests, of which a browser without windows complains.
        self.page.on("console", lambda message: "GPU stall" in message.text or
                     self.complaints.append(message.text))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.goto(path.resolve().as_uri())
        wanted = "html[data-ready], body.standing" if live else "body.standing"
        self.page.wait_for_selector(wanted, state="attached", timeout=60000)
        if live and self.page.query_selector("body.standing"):
            pytest.fail(f"the page shows its poster alone: {self.told()} {self.complaints}")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        CONTEXTS.give(self.context, SMALL.as_uri(), **self.options)

    def run(self, script: str, argument=None):
        return self.page.evaluate(f"(argument) => {{ {TEXT} return ({script})(argument); }}",
                                  argument)

    def press(self, selector: str) -> None:
        """Click a button, which hides from a pointer that rests and comes back as it moves."""
        self.page.click(selector, force=True)

    def told(self) -> str:
        return self.page.inner_text("#message")

    def show(self, first: int, second: int, blend: float) -> None:
        self.loaded()
        self.run("([a, b, c]) => lfportrait.renderer.show(a, b, c)", [first, second, blend])

    def loaded(self) -> None:
        """Wait for the slider's other end, which the page reads by itself a little later."""
        self.run("""async () => {
          const { renderer, mix } = lfportrait;
          while (renderer.header.sets.length > 1 && renderer.slots.includes(null)) {
            await new Promise((done) => setTimeout(done, 20));
          }
          await mix.busy;
        }""")

    def view(self, cameras, number, **how) -> np.ndarray:
        """What the page draws for a camera: float [H, W, 4], colors premultiplied."""
        width, height = int(cameras.width[number]), int(cameras.height[number])
        pose = cameras.pose[number]
        camera = {"turn": pose[:3, :3].T.ravel().tolist(), "eye": pose[:3, 3].tolist(),
                  "lens": [*cameras.focal[number].tolist(), *cameras.center[number].tolist()]}
        return _pixels(self.run(VIEW, [camera, [width, height], how]), width, height) / 255.0

    def canvas(self) -> np.ndarray:
        """What is on the canvas, uint8 [H, W, 3]."""
        width, height, pixels = self.run("""() => {
          const { renderer } = lfportrait, { canvas, gl } = renderer;
          gl.bindFramebuffer(gl.FRAMEBUFFER, null);
          const size = [canvas.width, canvas.height];
          return [...size, text(renderer.pixels(size))];
        }""")
        return _pixels(pixels, width, height)[..., :3]

    def coded(self, display, name="panel.toml", text=None, **place) -> np.ndarray:
        """What the page codes for a panel, uint8 [H, W, 3], as it is sent to the panel."""
        pixels = self.run(CODED, [name, text or display.to_toml(), place])
        return _pixels(pixels, display.width, display.height)[..., :3]


def _pixels(text: str, width: int, height: int) -> np.ndarray:
    """Rows come from the bottom up."""
    return np.frombuffer(base64.b64decode(text), np.uint8).reshape(height, width, 4)[::-1]


def decibels(one, other) -> float:
    """PSNR of two pictures in [0, 1]."""
    return float(-10 * np.log10(np.mean((np.asarray(one) - np.asarray(other)) ** 2) + 1e-12))
