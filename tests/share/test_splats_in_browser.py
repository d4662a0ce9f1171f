"""Splats in a program that others wrote: Spark, on three.js, in a real browser."""

import base64
import io
import os
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
from lfportrait.share.splats import SPLAT_WRITERS, SplatConfig, field_splats, render_splats
from tests.fields import head_field, shell_field
from tests.share.page.browser import decibels

SIZE = 256
FORMATS = ("ply", "spz", "sog")
ENGINES = Path(os.environ.get(
    "LFPORTRAIT_ENGINES", Path(__file__).parents[2] / ".venv" / "engines"))

PAGE = """<!DOCTYPE html><meta charset="utf-8"><link rel="icon" href="data:,">
<script type="importmap">{"imports": {
  "three": "./modules/three/build/three.module.js",
  "three/addons/": "./modules/three/examples/jsm/",
  "spark": "./modules/@sparkjsdev/spark/dist/spark.module.min.js"
}}</script>
<script type="module">
import * as THREE from "three";
import { SparkRenderer, SplatMesh } from "spark";

window.show = async (file, size, pose, fieldOfView) => {
  const renderer = new THREE.WebGLRenderer({ preserveDrawingBuffer: true });
  renderer.setPixelRatio(1);
  renderer.setSize(size, size);
  renderer.setClearColor(0xffffff, 1);
  const scene = new THREE.Scene();
  // Splats that were fitted without compensation for the widening by 0.3 pixels.
  const spark = new SparkRenderer({
    renderer, autoUpdate: false, preBlurAmount: 0.3, blurAmount: 0, sortRadial: false,
    accumExtSplats: true });
  const splats = new SplatMesh({ url: file, lod: false, extSplats: true });
  await splats.initialized;
  scene.add(spark, splats);
  const camera = new THREE.PerspectiveCamera(fieldOfView, 1, 0.1, 100);
  camera.matrixAutoUpdate = false;
  camera.matrix.set(...pose);
  camera.updateMatrixWorld(true);
  await spark.update({ scene, camera });
  renderer.render(scene, camera);
  const picture = renderer.domElement.toDataURL("image/png");
  const count = splats.splats.getNumSplats();
  renderer.dispose();
  renderer.forceContextLoss();
  return [count, picture.split(",")[1]];
};
</script>"""


@pytest.fixture(scope="module")
def engines():
    """The folder of the packages that the page loads."""
    modules = ENGINES / "node_modules"
    if not all((modules / name).is_dir() for name in ("three", "@sparkjsdev/spark")):
        if os.environ.get("LFPORTRAIT_REQUIRE_ENGINE") == "1":
            pytest.fail(f"{modules} has no three and @sparkjsdev/spark, and "
                        f"LFPORTRAIT_REQUIRE_ENGINE=1 asks for them")
        pytest.skip(f"{modules} has no three and @sparkjsdev/spark (.ci/run installs them)")
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
    return field, field_splats(field, SplatConfig(count=50_000, steps=60))[0]


@pytest.fixture(scope="module")
def shimmering():
    """Splats whose colors change with the direction they are seen from."""
    splats, _ = field_splats(shell_field(size=20, basis=9), SplatConfig(count=2000, steps=12))
    return splats


@pytest.fixture(scope="module")
def folder(engines, tmp_path_factory):
    """What is served."""
    path = tmp_path_factory.mktemp("served")
    (path / "index.html").write_text(PAGE, encoding="utf-8")
    (path / "modules").symlink_to(engines)
    return path


@pytest.fixture(scope="module")
def page(folder, browser):
    """An open page that shows files of the folder."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(folder)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    opened = browser.new_page()
    complaints = []
    opened.on("pageerror", lambda error: complaints.append(str(error)))
    try:
        opened.goto(f"http://127.0.0.1:{server.server_port}/index.html")
        opened.wait_for_function("() => 'show' in window", timeout=30_000)
        yield opened
    finally:
        opened.close()
        server.shutdown()
        server.server_close()
    assert complaints == []


def shown(page, folder, splats, kind, cameras, view) -> np.ndarray:
    """The engine's picture of a file of splats: float [H, W, 3], on white."""
    file = folder / f"splats.{kind}"
    with file.open("wb") as stream:
        SPLAT_WRITERS[file.suffix](stream, splats)
    # In three.js a camera's y points up and it looks along -z.
    pose = cameras.pose[view] @ np.diag([1.0, -1.0, -1.0, 1.0])
    angle = float(np.degrees(2 * np.arctan(SIZE / 2 / cameras.focal[view, 1])))
    count, picture = page.evaluate("(all) => show(...all)",
                                   [file.name, SIZE, pose.ravel().tolist(), angle])
    assert count == len(splats)
    with Image.open(io.BytesIO(base64.b64decode(picture))) as read:
        return np.asarray(read.convert("RGB")) / 255.0


@pytest.mark.parametrize("kind", FORMATS)
def test_an_engine_shows_the_field(page, folder, head, kind):
    field, splats = head
    cameras, view = orbit_cameras(8, SIZE, field), 3
    expected = np.clip(field.render(cameras, view).color, 0, 1)
    seen = shown(page, folder, splats, kind, cameras, view)
    assert decibels(seen, expected) > 27
    # What a mistake in the axes or in the order of the colors would look like.
    for wrong in (seen[:, ::-1], seen[::-1], seen[..., ::-1]):
        assert decibels(wrong, expected) < 20
    # The same splats give the same picture, but for the files' rounding and 8 bits.
    assert decibels(seen, np.clip(render_splats(splats, cameras, view), 0, 1)) > 45


@pytest.mark.parametrize("kind", FORMATS)
def test_an_engine_shows_colors_that_depend_on_the_direction(page, folder, shimmering, kind):
    cameras = Camera.arc(np.array([35.0]), distance=3.0, width=SIZE, height=SIZE,
                         focal=1.3 * SIZE, pitch=10.0)
    expected = np.clip(render_splats(shimmering, cameras), 0, 1)
    seen = shown(page, folder, shimmering, kind, cameras, 0)
    # A plain color for each splat, and harmonics of the opposite direction.
    plain, opposite = (replace(shimmering, sh=shimmering.sh * np.array(factors, np.float32))
                       for factors in ([1] + 8 * [0], [1] + 3 * [-1] + 5 * [1]))
    assert decibels(seen, expected) > 39
    for wrong in (plain, opposite):
        assert decibels(seen, np.clip(render_splats(wrong, cameras), 0, 1)) < 36
