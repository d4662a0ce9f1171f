"""One photo of the modelled head becomes a head."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import gaussian_filter

from lfportrait import models
from lfportrait.capture import Camera, Capture, read_photos
from lfportrait.errors import UserError
from lfportrait.face import is_portrait, portrait_capture, portrait_field
from lfportrait.face.one_photo import portrait
from lfportrait.field import ReconstructConfig
from lfportrait.progress import Progress
from tests.recordings import photographs

pytestmark = pytest.mark.skipif(models.missing(["face-landmarker"]) != [],
                                reason="the network for landmarks is not here")


@pytest.fixture(scope="module")
def photo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The modelled head from the front, cut out."""
    camera = Camera.arc(np.zeros(1), distance=4.4, width=440, height=440, focal=860.0)
    path = tmp_path_factory.mktemp("photo") / "her.png"
    Image.fromarray(photographs("front", camera)[0].image).save(path)
    return path


def test_one_photo_becomes_a_field_that_looks_like_it(photo, tmp_path):
    capture, figures = portrait_capture(read_photos(photo))
    assert is_portrait(capture) and len(capture) == 1 and capture.landmarks is not None
    assert figures["landmarks_px"][0] < 6 and abs(figures["angles"][0]["yaw"]) < 6
    capture.save(tmp_path / "capture")
    again = Capture.load(tmp_path / "capture")
    field, made = portrait_field(again, ReconstructConfig(resolution=96))
    assert made["voxels"] == len(field.density) > 10_000
    shown = field.render(again.cameras, 0)
    matte = again.alphas[0] > 127
    low = int(again.cameras.project(again.landmarks)[0][0, 8, 1])
    both = (shown.alpha > 0.5)[:low] & matte[:low]
    assert both.sum() / ((shown.alpha > 0.5)[:low] | matte[:low]).sum() > 0.93
    error = (shown.color - again.image_float(0))[:low][both]
    assert -10 * np.log10((error ** 2).mean()) > 19
    # It is closed behind.
    behind = Camera.arc(np.array([180.0]), distance=4.4, width=160, height=160, focal=320.0)
    assert field.render(behind, 0).alpha[60:90, 70:90].min() > 0.95


def test_a_hat_is_kept_by_its_outline(photo, tmp_path, monkeypatch):
    picture = np.array(Image.open(photo))
    row, column = np.mgrid[:440, :440]
    hat = (np.hypot(column - 220, (row - 150) * 0.9) < 110) & (row < 130)
    picture[hat] = 60, 90, 60, 255
    Image.fromarray(picture).save(tmp_path / "hat.png")
    monkeypatch.setattr(portrait, "_hair_of",
                        lambda image, matte, landmarks: np.zeros(matte.shape, np.float32))
    captured, usable = [], portrait._usable
    monkeypatch.setattr(portrait, "_usable", lambda photos: captured.extend(usable(photos))
                        or captured)
    capture, _ = portrait_capture(read_photos(tmp_path / "hat.png"))
    capture.save(tmp_path / "capture")
    again = Capture.load(tmp_path / "capture")
    kept = portrait._looked_at(again, 0)[0].hair > 0.5
    made = captured[-1].picture.hair > 0.5
    assert (kept == made).mean() > 0.9999, "the field is made of what was fitted"
    assert kept[hat].mean() > 0.98
    # Her hair below it is found with it, and no more.
    hair = (row >= 132) & (row < 200) & (np.abs(column - 220) > 80) & (picture[..., 3] > 250)
    assert kept[hair].mean() > 0.8
    assert not kept[210:].any() and not kept[165:, 175:265].any()
    # What is made of it reaches as far.
    field = portrait_field(again, ReconstructConfig(resolution=64))[0]
    assert (field.render(again.cameras, 0).alpha > 0.5)[hat].mean() > 0.9


class Enough(Exception):
    """Ends the work."""


def test_the_head_is_shown_before_its_fine_lattice_is_filled(photo, monkeypatch):
    monkeypatch.setattr(portrait, "ROUGH", 40)
    monkeypatch.setattr(Progress, "show", lambda self, make, *, at_once: shown.append(make()))
    shown, capture = [], portrait_capture(read_photos(photo))[0]

    def look(make):
        shown.append(make())
        raise Enough

    with Progress("", enabled=False) as progress, pytest.raises(Enough):
        portrait_field(capture, ReconstructConfig(resolution=96), progress, look=look)
    progress_saw, looked = shown
    assert progress_saw is looked, "it is made once"
    assert max(looked.links.shape) < 60 and looked.cone == 40
    assert looked.render(capture.cameras, 0).alpha[200:240, 200:240].min() > 0.9
    # One that is no finer has no look of its own.
    portrait_field(capture, ReconstructConfig(resolution=40), look=look)
    assert len(shown) == 2


@pytest.mark.parametrize(("kept", "mattes", "cut"), [
    ({"cut_out": True}, "network", True), ({"cut_out": False}, "given", False),
    ({}, "given", True), ({}, "network", False)])
def test_of_each_photo_is_known_whether_it_came_cut_out(kept, mattes, cut):
    figures = {portrait.FIT: {"views": [{"cut_out": not cut}, kept]}, "mattes": mattes}
    assert portrait._cut_out(SimpleNamespace(figures=figures), 1) == cut


def test_a_photo_of_another_day_shapes_the_head_and_is_not_seen(photo, tmp_path):
    picture = np.array(Image.open(photo))
    Image.fromarray(picture).save(tmp_path / "one.png")
    grain = gaussian_filter(np.random.default_rng(0).normal(size=(440, 440, 1)), (3, 3, 0))
    made_up = np.clip(picture[..., :3] + 35 * grain / grain.std(), 0, 255)
    Image.fromarray(np.dstack([made_up.astype(np.uint8), picture[..., 3]])).save(
        tmp_path / "two.png")
    alone, _ = portrait_capture(read_photos(photo))
    with pytest.warns(UserWarning, match=r"(one|two).png: of another day") as said:
        capture, figures = portrait_capture(read_photos(tmp_path))
    assert len(said) == 1 and len(capture) == len(figures["landmarks_px"]) == 1
    assert {*capture.names, *figures["other_moments"]} == {"one.png", "two.png"}
    known = [one.figures[portrait.FIT]["identity"] for one in (alone, capture)]
    assert known[0] != known[1], "the other one has its part in the shape"


def test_of_photos_turned_alike_the_largest_is_first(photo, tmp_path):
    picture = Image.open(photo)
    picture.resize((410, 410)).save(tmp_path / "a.png")
    picture.save(tmp_path / "b.png")
    seen = portrait._usable(read_photos(tmp_path))
    assert [one.photo.name for one in seen] == ["b.png", "a.png"]


@pytest.mark.parametrize("turned, chosen", [
    (((0.05, 200), (0.1, 300), (0.2, 400)), 1), (((0.35, 200), (0.4, 300)), 0),
    (((0.25, 200), (-0.28, 300), (0.34, 400)), 1)])
def test_a_larger_photo_decides_only_if_it_is_about_frontal(monkeypatch, turned, chosen):
    def seen(one):
        return SimpleNamespace(picture=SimpleNamespace(landmarks=one))

    monkeypatch.setattr(portrait, "_Seen", seen)
    monkeypatch.setattr(portrait, "face_yaw", lambda one: one[0])
    monkeypatch.setattr(portrait, "ear_to_ear", lambda one: one[1])
    order = [one.picture.landmarks for one in portrait._usable(list(turned))]
    assert order[0] == turned[chosen] and sorted(order) == sorted(turned)


def test_a_photo_without_a_face_is_refused(tmp_path):
    Image.fromarray(np.full((200, 200, 3), 128, np.uint8)).save(tmp_path / "wall.png")
    if models.missing(["person-segmentation"]):
        pytest.skip("the network for mattes is not here")
    with pytest.raises(UserError, match="no face was found in wall"):
        portrait_capture(read_photos(tmp_path / "wall.png"))


def test_of_several_photos_those_without_a_face_are_left_out(photo, tmp_path):
    if models.missing(["person-segmentation"]):
        pytest.skip("the network for mattes is not here")
    Image.open(photo).save(tmp_path / "a.png")
    Image.fromarray(np.full((200, 200, 4), 128, np.uint8)).save(tmp_path / "wall.png")
    with pytest.warns(UserWarning, match="wall.png is left out: no face"):
        capture, _ = portrait_capture(read_photos(tmp_path))
    assert capture.names == ["a.png"]
