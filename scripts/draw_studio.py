"""Draw the pictures of the studio's tutorial (docs/studio.md): its screens, with the built-in head.

    python scripts/draw_studio.py docs/images

A studio is started in a temporary folder, a browser goes through its screens as a person does, and
what it shows is written as ``studio-*.jpg``. Needs Playwright and Chromium (its path in
`LFPORTRAIT_BROWSER`) and the extra ``studio``; takes some minutes.
"""

from __future__ import annotations

import io
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Browser, Page, sync_playwright

from lfportrait.files import write_image

DESK, PHONE = (1280, 800), (390, 844)
GAP = 20
LONG = 600.0
"""Seconds that a head may take."""
SHOWN = """() => [...document.querySelectorAll("#main img")].filter((image) => {
  const { top, bottom } = image.getBoundingClientRect();
  return top < innerHeight && bottom > 0;
}).every((image) => image.complete && image.naturalWidth > 0)
  && !document.querySelector("#main .on-sitter.blank, #top span.face")
  && ![...document.querySelectorAll("#main *")].some((each) => each.checkVisibility()
    && [...each.childNodes].some((one) => one.nodeType === 3 && one.data.trim().endsWith("…")))"""
"""Whether all pictures that can be seen are there."""


@contextmanager
def studio(folder: Path) -> Iterator[str]:
    """A studio; its address with the key."""
    process = subprocess.Popen(
        [sys.executable, "-m", "lfportrait", "studio", "--folder", str(folder), "--no-browser"],
        stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    try:
        yield process.stdout.readline().split(" ")[0]
    finally:
        process.terminate()
        process.wait(30)


class Screens:
    """The studio's page in a browser.

    Parameters
    ----------
    browser : Playwright's.
    address : Of the studio, with its key.
    size : Width and height of the window.
    context : Further choices of Playwright's context.
    """

    def __init__(self, browser: Browser, address: str, size: tuple[int, int],
                 **context: Any) -> None:
        self.page: Page = browser.new_context(
            viewport={"width": size[0], "height": size[1]}, reduced_motion="reduce",
            **{"locale": "en", **context}).new_page()
        self.page.set_default_timeout(120_000)
        self.page.goto(address)
        self.page.wait_for_selector("[data-screen][data-ready]")

    def ask(self, method: str, path: str, data: dict[str, Any] | None = None) -> Any:
        """A request as the page sends it; the answer's JSON."""
        return self.page.evaluate("""async ([method, path, data]) => {
          const { get, send } = await import("/static/api.js");
          return method === "GET" ? get(path, null) : send(method, path, data ?? {});
        }""", [method, path, data])

    def go(self, place: str) -> None:
        """Another screen, by its address."""
        self.page.evaluate("(place) => { location.hash = place; }", place)
        self.page.wait_for_selector(f"[data-screen={place.partition('/')[0]}][data-ready]")

    def until(self, script: str, seconds: float = LONG) -> None:
        """Wait until a script says so: the page's policy forbids Playwright's own way."""
        end = time.monotonic() + seconds
        while not self.page.evaluate(script):
            if time.monotonic() > end:
                raise TimeoutError(script)
            time.sleep(0.2)

    def seen(self) -> NDArray[np.uint8]:
        """The window once all its pictures are there, uint8 [H, W, 3]."""
        self.until(SHOWN)
        self.page.wait_for_timeout(700)
        return self.shot()

    def shot(self) -> NDArray[np.uint8]:
        """The window as it is, uint8 [H, W, 3]."""
        self.page.mouse.move(0, 0)
        with Image.open(io.BytesIO(self.page.screenshot())) as picture:
            return np.asarray(picture.convert("RGB"))

    def wait_for(self, job: str) -> None:
        """Wait for the end of a job."""
        end = time.monotonic() + LONG
        while (state := self.ask("GET", f"/api/jobs/{job}")["state"]) != "done":
            if state in ("failed", "cancelled") or time.monotonic() > end:
                raise RuntimeError(f"{job} is {state}")
            time.sleep(0.5)


def making(desk: Screens, sitter: str) -> NDArray[np.uint8]:
    """The head while it is made; waits for its end."""
    job = desk.ask("POST", "/api/jobs", {"kind": "head", "project": sitter})["id"]
    desk.go(f"making/{sitter}")
    desk.until("""() => [...document.querySelectorAll(".phase")].some((each) =>
      each.querySelector("progress") && each.querySelector("img")?.naturalWidth)""")
    found = desk.shot()
    desk.wait_for(job)
    return found


def style_of(desk: Screens, sitter: str, name: str) -> str:
    """Id of a style by its name."""
    found = desk.ask("GET", f"/api/styles?project={sitter}")["styles"]
    return str(next(one["id"] for one in found if one["name"] == name))


def paint(desk: Screens, sitter: str, name: str) -> None:
    """A version of a sitter in a style, which is shown then."""
    style = style_of(desk, sitter, name)
    made = desk.ask("POST", f"/api/projects/{sitter}/versions", {
        "name": name, "style": style, "mix": {}})
    desk.ask("PATCH", f"/api/projects/{sitter}", {"version": made["id"], "style": style})


def landmarks(desk: Screens, sitter: str) -> NDArray[np.uint8]:
    """A point of a painting that is moved, and the preview beside it."""
    fauve = style_of(desk, sitter, "fauve")
    style = desk.ask("POST", f"/api/styles/{fauve}/copy?project={sitter}")["id"]
    desk.go(f"style/{sitter}/{style}/landmarks")
    point = desk.page.locator(".mark[data-number='45']")
    point.wait_for(timeout=1000 * LONG)
    point.focus()
    for _ in range(3):  # the first preview prepares the painting, which those after it need not
        desk.page.evaluate("() => delete document.querySelector('.preview').dataset.seconds")
        desk.page.keyboard.press("ArrowRight")
        desk.until("() => document.querySelector('.preview').dataset.seconds")
    return desk.seen()


def other_sitters(desk: Screens, folder: Path, anna: str) -> None:
    """One who is painted in another style, and one who has no photos yet."""
    desk.ask("POST", "/api/projects", {"name": "Ben", "demo": False})
    clara = desk.ask("POST", "/api/projects", {"name": "Clara", "demo": True})["id"]
    shutil.copytree(folder / "Anna" / "portrait", folder / "Clara" / "portrait",
                    dirs_exist_ok=True)
    paint(desk, clara, "charcoal")
    desk.go(f"portrait/{clara}")
    desk.seen()
    desk.go(f"portrait/{anna}")


def phone(browser: Browser, address: str, sitter: str) -> NDArray[np.uint8]:
    """Three screens beside each other, in German and dark."""
    small = Screens(browser, address, PHONE, locale="de", color_scheme="dark", has_touch=True)
    shots = []
    for screen in ("style", "photos", "portrait"):
        small.go(f"{screen}/{sitter}")
        small.page.wait_for_timeout(1500)
        shots += [small.seen(), np.full((PHONE[1], GAP, 3), 255, np.uint8)]
    return np.concatenate(shots[:-1], 1)


def draw(browser: Browser, folder: Path, address: str) -> Iterator[tuple[str, NDArray[np.uint8]]]:
    """Names and pictures, as they come."""
    desk = Screens(browser, address, DESK)
    anna = desk.ask("POST", "/api/projects", {"name": "Anna", "demo": True})["id"]
    yield "making", making(desk, anna)
    desk.wait_for(desk.ask("POST", f"/api/projects/{anna}/check")["id"])
    paint(desk, anna, "fauve")
    desk.go(f"portrait/{anna}")
    desk.page.wait_for_timeout(5000)
    desk.page.reload()  # now the sitter has a picture
    desk.page.wait_for_selector("[data-screen][data-ready]")
    yield "portrait", desk.seen()
    desk.go(f"style/{anna}")
    yield "style", desk.seen()
    desk.go(f"show/{anna}")
    desk.page.wait_for_timeout(1500)
    yield "show", desk.seen()
    desk.go(f"photos/{anna}")
    desk.seen()
    desk.page.evaluate("() => scrollTo(0, document.querySelector('.judged').offsetTop - 20)")
    yield "photos", desk.seen()
    yield "phone", phone(browser, address, anna)
    yield "landmarks", landmarks(desk, anna)
    other_sitters(desk, folder, anna)
    desk.go("sitters")
    desk.page.set_viewport_size({"width": DESK[0], "height": 565})  # above the folder's name
    yield "sitters", desk.seen()


def main(out: str) -> None:
    """Write the pictures."""
    program = os.environ.get("LFPORTRAIT_BROWSER") or shutil.which("chromium")
    with (tempfile.TemporaryDirectory(prefix="lfportrait-") as name, studio(Path(name)) as address,
          sync_playwright() as playwright):
        browser = playwright.chromium.launch(executable_path=program, args=[
            "--use-angle=swiftshader", "--enable-unsafe-swiftshader"])
        for each, picture in draw(browser, Path(name), address):
            write_image(Path(out) / f"studio-{each}.jpg", picture, quality=82)
            print(f"studio-{each}.jpg")
        browser.close()


if __name__ == "__main__":
    main(*sys.argv[1:])
