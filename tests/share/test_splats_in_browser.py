"""Splats in programs that others wrote, Spark on three.js and PlayCanvas, in a real browser.

Files are placed as SuperSplat places them: PLY and SOG are turned by 180 degrees about z.
"""

import base64
import io
import os
import shutil
import threading
from dataclasses import replace
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from lfportrait.capture import Camera
from lfportrait.field import C0, VoxelField
from lfportrait.share import orbit_cameras
from lfportrait.share.kinds import SplatConfig
from lfportrait.share.splats.cloud import SPLAT_WRITERS, framed, render_splats
from lfportrait.share.splats.fitting import field_splats
from tests.fields import head_field, shell_field
from tests.share.page.browser import decibels

pytestmark = pytest.mark.slow  # in a browser; the files are read in test_splats.py

SIZE = 128
ENGINES = Path(os.environ.get(
    "LFPORTRAIT_ENGINES", Path(__file__).parents[2] / ".venv" / "engines"))
PACKAGES = {"spark": ("three", "@sparkjsdev/spark"), "playcanvas": ("playcanvas",)}
"""Of the engines, each with a page `engines/NAME.html`."""
NEAR = {"spark": (27, 45), "playcanvas": (22.5, 24)}
"""PSNR to the field, and to the same splats in lfportrait.

PlayCanvas' splats fade to nothing at their rims instead of being cut off there: they are smaller.
"""
FORMATS = [("spark", "ply"), ("spark", "spz"), ("spark", "sog"),
           ("playcanvas", "glb"), ("playcanvas", "sog")]


@pytest.fixture(scope="module")
def engines():
    """The folder of the packages that the pages load."""
    modules = ENGINES / "node_modules"
    missing = [name for names in PACKAGES.values() for name in names
               if not (modules / name).is_dir()]
    if missing and os.environ.get("LFPORTRAIT_REQUIRE_ENGINE") == "1":
        pytest.fail(f"{modules} lacks {', '.join(missing)}, and LFPORTRAIT_REQUIRE_ENGINE=1 asks "
                    f"for the engines")
    if missing:
        pytest.skip(f"{modules} lacks {', '.join(missing)} (.ci/run installs the engines)")
    return modules.resolve()


class Quiet(SimpleHTTPRequestHandler):
    """Files of a folder, without a line for each."""

    def log_message(self, *_):
        pass


def lopsided_head() -> VoxelField:
    """A head with a red patch on one side, which a mirrored picture shows on the other."""
    head = head_field(64)
    z, y, x = np.nonzero(head.links >= 0)
    patch = head.links[z, y, x][(x > 40) & (y > 28)]
    sh = head.sh.copy()
    sh[patch, :, 0] = (np.array([0.9, 0.15, 0.1]) - 0.5) / C0
    return VoxelField(head.links, head.density, sh)


@pytest.fixture(scope="module")
def head():
    """A field, and splats that show it."""
    field = lopsided_head()
    # As fine as the pictures' pixels. What an export finds out for its figures, nobody reads here.
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("lfportrait.share.splats.fitting.splat_psnr", lambda *_: 0.0)
        return field, field_splats(field, SplatConfig(count=20_000, steps=60))[0]


@pytest.fixture(scope="module")
def shimmering():
    """Splats whose colors change with the direction they are seen from."""
    splats, _ = field_splats(shell_field(size=20, basis=9), SplatConfig(count=2000, steps=12))
    return splats


@pytest.fixture(scope="module")
def folder(engines, tmp_path_factory):
    """What is served."""
    path = tmp_path_factory.mktemp("served")
    for name in PACKAGES:
        shutil.copy(Path(__file__).parent / "engines" / f"{name}.html", path)
    (path / "modules").symlink_to(engines)
    return path


@pytest.fixture(scope="module")
def address(folder):
    """Where it is served."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(folder)))
    threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    server.server_close()


@pytest.fixture(scope="module")
def shown(folder, address, browser):
    """Pictures of splats that an engine shows; its page is read once for those of one engine."""
    page = browser.new_page()
    page.set_default_timeout(120_000)
    complaints, numbers = [], []
    page.on("pageerror", lambda error: complaints.append(str(error)))

    def picture(engine, kind, splats, cameras, view=0) -> np.ndarray:
        """What the engine shows of a file: float [H, W, 3], on white."""
        numbers.append(len(numbers))
        file = folder / f"splats-{len(numbers)}.{kind}"  # no page knows the one before
        with file.open("wb") as stream:
            SPLAT_WRITERS[file.suffix](stream, framed(splats, file.suffix))
        if page.url != f"{address}/{engine}.html":
            page.goto(f"{address}/{engine}.html")
            page.wait_for_function("() => 'show' in window")
        # The engines' cameras have y up and look along -z; matrices are lists of columns.
        pose = cameras.pose[view] @ np.diag([1.0, -1.0, -1.0, 1.0])
        if kind == "glb":
            pose[:3, 3] *= 0.1  # in metres
        size = int(cameras.height[view])
        angle = float(np.degrees(2 * np.arctan(size / 2 / cameras.focal[view, 1])))
        code = page.evaluate("(all) => show(...all)",
                             [file.name, size, pose.T.ravel().tolist(), angle])
        with Image.open(io.BytesIO(base64.b64decode(code.split(",")[1]))) as read:
            assert complaints == []
            return np.asarray(read.convert("RGB")) / 255.0

    yield picture
    page.close()


@pytest.mark.parametrize(("engine", "kind"), FORMATS)
def test_an_engine_shows_the_field(shown, head, engine, kind):
    field, splats = head
    cameras, view = orbit_cameras(8, SIZE, field), 3
    expected = np.clip(field.render(cameras, view).color, 0, 1)
    seen = shown(engine, kind, splats, cameras, view)
    to_field, to_splats = NEAR[engine]
    assert decibels(seen, expected) > to_field
    # What a mistake in the axes or in the order of the colors would look like.
    for wrong in (seen[:, ::-1], seen[::-1], seen[..., ::-1]):
        assert decibels(wrong, expected) < 20
    assert decibels(seen, np.clip(render_splats(splats, cameras, view), 0, 1)) > to_splats


@pytest.mark.parametrize(("engine", "kind"), FORMATS)
def test_an_engine_shows_colors_that_depend_on_the_direction(shown, shimmering, engine, kind):
    cameras = Camera.arc(np.array([35.0]), distance=3.0, width=256, height=256,
                         focal=1.3 * 256, pitch=10.0)
    expected = np.clip(render_splats(shimmering, cameras), 0, 1)
    seen = shown(engine, kind, shimmering, cameras)
    # A plain color for each splat, and harmonics of the opposite direction.
    plain, opposite = (replace(shimmering, sh=shimmering.sh * np.array(factors, np.float32))
                       for factors in ([1] + 8 * [0], [1] + 3 * [-1] + 5 * [1]))
    assert decibels(seen, expected) > 38
    for wrong in (plain, opposite):
        assert decibels(seen, np.clip(render_splats(wrong, cameras), 0, 1)) < 36
