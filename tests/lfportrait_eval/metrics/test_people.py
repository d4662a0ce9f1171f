"""Each figure of how people are kept rises with its defect, on drawn faces."""

import importlib.util
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import ndimage
from skimage.draw import polygon2mask

from lfportrait import models
from lfportrait.example import Exemplar, FaceFrame
from lfportrait.example.guides import regions as regions_module
from lfportrait.face import write_landmarks
from lfportrait.files import write_image
from lfportrait_eval.metrics.people import (
    LIMITS,
    Eyes,
    PreparedPainting,
    Sitter,
    corners_found,
    counts,
    dark_gaze,
    face_seams,
    forehead_found,
    forehead_region,
    gaze_found,
    painters_corners,
    people_found,
    people_table,
    people_table_compared,
    seam_found,
    tones_of,
)
from lfportrait_eval.metrics.people import gaze as gaze_module
from tests.portraits import drawn_face
from tests.share.test_video import ball

ROOT = Path(__file__).parents[3]


@pytest.fixture(autouse=True)
def without_networks(monkeypatch):
    monkeypatch.setattr(models, "available", lambda name: False)
    monkeypatch.setattr(models, "missing", lambda names: list(names))


@pytest.fixture(scope="module")
def sitter():
    return drawn_face(320, 240, seed=1)


@pytest.fixture(scope="module")
def painter():
    return drawn_face(300, 230, seed=2, skin=(210, 160, 120), hair=(30, 30, 40),
                      ground=(235, 235, 225))


@pytest.fixture(scope="module")
def painted():
    """The sitter in the painter's colors."""
    return drawn_face(320, 240, seed=3, skin=(210, 160, 120), hair=(30, 30, 40),
                      ground=(235, 235, 225)).image


def _local(exemplar):
    return FaceFrame.of(exemplar.landmarks).local(exemplar.image.shape[:2])


def _with_irises(exemplar, left, right):
    """Dark irises, each so far to the right of the middle of its eye, over half its width."""
    image = exemplar.image.copy()
    rows, columns = np.indices(image.shape[:2]) + 0.5
    for part, aside in ((slice(36, 42), left), (slice(42, 48), right)):
        eye = exemplar.landmarks[part]
        half = 0.5 * np.ptp(eye[:, 0])
        x, y = eye.mean(axis=0) + np.array([aside * half, 0])
        iris = np.hypot(columns - x, rows - y) < 0.4 * half
        image[iris & polygon2mask(iris.shape, eye[:, ::-1])] = 30
    return image


def test_eyes_that_look_apart_are_told_from_eyes_that_look_aside(sitter):
    large = replace(sitter, image=ndimage.zoom(sitter.image, (3, 3, 1), order=1),
                    landmarks=3 * sitter.landmarks, mask=None)
    real = _with_irises(large, 0.0, 0.0)

    def apart(left, right):
        return gaze_found(_with_irises(large, left, right), real, large.landmarks)["gaze"]

    assert apart(0, 0) == 0
    assert apart(0.3, 0.3) < 3
    errors = [apart(-aside, aside) for aside in (0.1, 0.2, 0.4)]
    assert errors[0] < errors[1] < errors[2] and errors[1] > LIMITS["gaze"]
    right = dark_gaze(_with_irises(large, 0.3, 0.3), large.landmarks)
    assert np.allclose(right[:, 0], 0.3 * 45, atol=4) and np.abs(right[:, 1]).max() < 4


def test_closed_eyes_have_no_gaze_and_must_stay_closed(sitter, monkeypatch):
    def eyes(opening, aside=0.0):
        return Eyes(np.array([[-4.25 - aside, 0.0], [4.25 + aside, 0.0]]), np.full(2, opening))

    def found(there, own):
        seen = iter((there, own))
        monkeypatch.setattr(gaze_module, "eyes_seen", lambda *_: next(seen))
        return gaze_found(sitter.image, sitter.image, sitter.landmarks)

    kept = found(eyes(0.05), eyes(0.03, 9.0))
    assert np.isnan(kept["gaze"]) and kept["lids"] < 0.03
    opened = found(eyes(0.35), eyes(0.03, 9.0))
    assert opened["lids"] > LIMITS["lids"] and opened["gaze"] == 0
    assert found(eyes(0.35, 3.0), eyes(0.35))["gaze"] == pytest.approx(6)
    assert np.isnan(found(None, eyes(0.35))["iris"])


def test_cloth_on_the_forehead_counts_by_its_share(sitter, painter, painted):
    tones = tones_of(painter)
    regions = sitter.regions()
    mask = forehead_region(sitter.landmarks, painted.shape[:2], sitter.image, regions)
    assert mask.sum() > 300

    def share(image):
        return forehead_found(image, sitter.image, sitter.landmarks, tones, regions)["forehead"]

    assert share(painted) == 0
    rows = np.indices(mask.shape)[0]
    shares = []
    for part in (0.25, 0.5, 1.0):
        cloth = painted.copy()
        cloth[mask & (rows <= np.quantile(rows[mask], part))] = (230, 232, 224)
        shares.append(share(cloth))
    assert LIMITS["forehead"] < shares[0] < shares[1] < shares[2]
    assert shares[2] > 0.8
    # Light and shade on skin are none.
    for light in (0.75, 1.12):
        assert share(np.uint8(np.clip(painted * light, 0, 255))) < LIMITS["forehead"]


def test_what_covers_the_painters_forehead_is_no_skin(sitter, painter, painted):
    # A bonnet in the color of the background.
    right, down = _local(painter)
    covered = painter.image.copy()
    covered[(down < -0.05) & (np.abs(right) < 0.8)] = (235, 235, 225)
    tones = tones_of(replace(painter, image=covered))
    cloth = painted.copy()
    cloth[_local(sitter)[1] < -0.08] = (235, 235, 225)
    found = forehead_found(cloth, sitter.image, sitter.landmarks, tones, sitter.regions())
    assert found["forehead"] > 0.8


def test_halves_of_a_forehead_in_other_light(sitter, painter, painted):
    tones, regions = tones_of(painter), sitter.regions()
    right, down = _local(sitter)

    def found(image):
        return forehead_found(image, sitter.image, sitter.landmarks, tones, regions)

    half, high = painted.copy(), painted.copy()
    half[right > 0] = half[right > 0] * 0.8
    high[down < -0.05] = high[down < -0.05] * 0.8
    plain = found(painted)
    assert found(half)["side_step"] > plain["side_step"] + 0.05
    assert found(high)["brow_step"] > plain["brow_step"] + 0.05


def test_a_straight_step_is_a_seam_and_shading_is_not(sitter, painted):
    right, _ = _local(sitter)

    def seam(factor):
        image = np.uint8(np.clip(painted * factor[..., None], 0, 255))
        return seam_found(image, sitter.image, sitter.landmarks)

    plain = seam(np.ones_like(right))["seam"]
    steps = [seam(np.where(right > 0.2, 1 - step, 1.0)) for step in (0.1, 0.25, 0.5)]
    strengths = [one["seam"] for one in steps]
    assert plain < strengths[0] < strengths[1] < strengths[2]
    assert strengths[2] > LIMITS["seam"] > plain
    assert steps[2]["seam_right"] == pytest.approx(0.2, abs=0.05)
    shading = seam(np.clip(1 - 0.4 * (right + 0.5), 0.3, 1))["seam"]
    assert shading < 0.5 * strengths[1]
    # One that the sitter has is his.
    half = np.where(right > 0.2, 0.5, 1.0)[..., None]
    own = seam_found(np.uint8(painted * half), np.uint8(sitter.image * half), sitter.landmarks)
    assert own["seam"] < 0.3 * strengths[2]


def test_a_streak_from_one_corner_of_the_mouth(sitter, painter, painted):
    contrast, own = painters_corners(painter.image, painter.landmarks)

    def mouth(image):
        return corners_found(image, sitter.landmarks, contrast, own)["mouth"]

    corner = sitter.landmarks[54]
    width = sitter.landmarks[54, 0] - sitter.landmarks[48, 0]
    rows, columns = np.indices(painted.shape[:2]) + 0.5
    values = [mouth(painted)]
    for wide in (0.06, 0.12, 0.2):
        streak = painted.copy()
        along = rows - corner[1]
        streak[(np.abs(columns - corner[0]) < wide * width) & (along > 0)
               & (along < 0.45 * width)] = (240, 240, 230)
        values.append(mouth(streak))
    assert values[0] < 0.4 and values == sorted(values) and values[-1] > LIMITS["mouth"]
    # Light from one side is no streak.
    right, _ = _local(sitter)
    aside = np.uint8(np.clip(painted * (1 - 0.3 * right)[..., None], 0, 255))
    assert mouth(aside) < LIMITS["mouth"]


def test_all_figures_of_a_pair(sitter, painter, painted):
    moved = sitter.landmarks + np.array([3.0, 0.0])
    faces = {sitter.image.tobytes(): sitter.landmarks, painted.tobytes(): moved}

    def detect(image):
        return faces.get(image.tobytes())

    blank = np.full_like(painted, 128)
    assert Sitter.of([blank], detect) is None
    person = Sitter.of([sitter.image, sitter.image, blank], detect, [sitter.image])
    prepared = PreparedPainting.of(painter)
    found = people_found([painted, painted, painted], person, prepared, detect, [painted])
    eyes = np.linalg.norm(sitter.landmarks[36] - sitter.landmarks[45])
    assert found["landmarks"] == pytest.approx(3 / eyes) == pytest.approx(found["arc"])
    assert found["lost"] == 0 and np.isnan(found["by_view"][2])
    lost = people_found([painted, blank, painted], person, prepared, detect, [blank])
    assert lost["lost"] == pytest.approx(2 / 3) and np.isnan(lost["arc"])
    assert lost["landmarks"] == pytest.approx(3 / eyes)
    assert set(LIMITS) <= set(found)


def test_a_sitters_fringe_is_no_forehead(monkeypatch):
    face = drawn_face(240, 240, seed=3)
    assert face.mask is not None
    right, down = FaceFrame.of(face.landmarks).local(face.image.shape[:2])
    bare = face.mask * ((down < -0.6) | (np.abs(right) > 0.5) & (down < 0.3))
    sizes = []
    for hair in (bare, np.maximum(bare, face.mask * (down < -0.12))):
        monkeypatch.setattr(regions_module, "_networks",
                            lambda image, size, hair=hair: (face.mask, np.float32(hair)))
        person = Sitter.of([face.image], lambda image: face.landmarks)
        assert person is not None
        sizes.append(forehead_region(face.landmarks, face.image.shape[:2], face.image,
                                     person.regions).sum())
    assert sizes[0] > 200 and sizes[1] < 0.05 * sizes[0]


def test_tables_count_what_is_beyond_the_limit():
    good = dict.fromkeys(LIMITS, 0.0)
    before = {"one": {"a": good | {"seam": 20.0}, "b": good | {"gaze": None}},
              "two": {"a": good}}
    after = {"one": {"a": good | {"mouth": 2.0}}}
    assert counts(before)["seam"] == (1, 3) and counts(before)["gaze"] == (0, 2)
    own = {"one": {"a": good | {"seam": 20.0, "seam_painting": 25.0}}}
    assert counts(own)["seam"] == (0, 1)
    table = people_table(before)
    assert "20.0*" in table and "1 of 3" in table and "together: 1 of 23" in table
    compared = people_table_compared(before, after).splitlines()
    assert [line.split()[2:] for line in compared[1:3]] == [["seam", "20.0*", "0.0"],
                                                            ["mouth", "0.00", "2.00*"]]
    assert [line.split()[0] for line in compared[-2:]] == ["before", "after"]
    assert compared[-1].count("1 of 1") == 1


def _script():
    spec = importlib.util.spec_from_file_location("people", ROOT / "scripts/measure_people.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_script_measures_photos_and_heads(sitter, painter, tmp_path, capsys, monkeypatch):
    script = _script()
    monkeypatch.setattr(script, "detect_landmarks", lambda image: sitter.landmarks)
    monkeypatch.setattr(script, "Session", _Session)
    write_image(tmp_path / "me.png", sitter.image)
    write_image(tmp_path / "his.png", painter.image)
    write_landmarks(tmp_path / "his.landmarks.txt", painter.landmarks)
    (tmp_path / "job" / "capture").mkdir(parents=True)
    (tmp_path / "job" / "field.npz").touch()
    out = tmp_path / "out.json"
    assert script.main(["--photos", str(tmp_path / "me.png"), "--styles", str(tmp_path / "his.png"),
                        "--json", str(out), "--pictures", str(tmp_path / "painted")]) == 0
    assert list(json.loads(out.read_text())) == ["me, photo"]
    assert (tmp_path / "painted" / "me_photo_his.png").is_file()
    again = ["--heads", str(tmp_path / "job"), "--photos", str(tmp_path / "me.png"), "--size",
             "240", "--styles", str(tmp_path / "his.png"), "--compare", str(out)]
    capsys.readouterr()
    assert script.main(again) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["sitter", "style", *LIMITS]
    assert lines[1].startswith("job") and lines[2].startswith("me, photo")
    assert lines[-2].startswith("before") and lines[-1].startswith("after")
    assert lines[-2].split()[1:] == lines[-1].split()[1:]


class _Session:
    """A head that is not painted at all."""

    def __init__(self, field, capture):
        from tests.portraits import HEAD_LANDMARKS

        self.field, self.capture = ball(), type("C", (), {"landmarks": HEAD_LANDMARKS})

    def preview(self, exemplar: Exemplar):
        return self.field


def test_without_its_files_the_script_says_why_it_does_nothing(tmp_path, capsys):
    assert _script().main(["--heads", str(tmp_path / "none"), "--styles", "fauve"]) == 0
    assert capsys.readouterr().out.startswith("skipped: there is no ")


def test_a_drawn_face_has_no_seams(sitter):
    assert face_seams(sitter.image, sitter.landmarks).max() < LIMITS["seam"]
