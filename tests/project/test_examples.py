"""The numbered examples run, in their order, on tiny data, and draw what they say."""

import functools
import importlib.util
from pathlib import Path

import numpy as np
import pytest

from lfportrait.demo import demo_exemplar
from lfportrait.field import VoxelField
from lfportrait.media.pictures import read_image
from lfportrait.share import orbit_cameras
from tests.share.page.browser import Opened, decibels

EXAMPLES = sorted((Path(__file__).parents[2] / "examples").glob("[0-9]*.py"))
SMALL = {
    "01_hello": {"size": 64, "views": 16, "rays": (0.05, 0.05)},
    "02_transfer": {"size": 128},
    "03_encode": {"width": 160, "height": 90},
    "04_simulate": {},
    "05_page": {},
}


def run(path: Path, out: Path) -> None:
    spec = importlib.util.spec_from_file_location(f"example_{path.stem}", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.main(out, **SMALL[path.stem])


@pytest.fixture(scope="module")
def results(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("examples")
    # A painting of the usual size takes longer.
    small = functools.partial(demo_exemplar, width=180, height=240)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("lfportrait.demo.demo_exemplar", small)
        for path in EXAMPLES:
            run(path, out)
    return out


def test_every_example_is_run():
    assert [path.stem for path in EXAMPLES] == list(SMALL)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_examples_are_short_and_say_what_they_show(path):
    text = path.read_text()
    assert len(text.splitlines()) < 60
    assert text.startswith('"""') and "Key concepts:" in text and "Run:" in text


@pytest.mark.parametrize(("name", "shape"), [
    ("hello.png", (64, 192)), ("transfer.png", (128, 288)), ("lightfield.png", (90, 160)),
    ("eyes.png", (270, 160))])
def test_pictures_are_drawn(results, name, shape):
    image = read_image(results / name)
    assert image.shape[:2] == shape
    assert image.std() > 10
    if name == "eyes.png":  # parallax: the outer eyes don't see the same
        assert np.abs(image[:90].astype(int) - image[180:]).max() > 30


def test_the_page_of_the_examples_opens(results, browser):
    field = VoxelField.load(results / "field.npz")
    field = field.with_sh(field.sh[:, :, :4])
    cameras = orbit_cameras(3, 96, field)
    with Opened(browser, results / "portrait.html") as page:
        assert page.complaints == []
        seen = np.clip(field.render(cameras, 1, background=0.0).color, 0, 1)
        assert decibels(page.view(cameras, 1)[..., :3], seen) > 35
