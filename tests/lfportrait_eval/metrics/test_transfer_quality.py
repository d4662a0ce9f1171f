"""Figures of quality with known answers, and the script that compares with published results."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from lfportrait.face import write_landmarks
from lfportrait.files import write_image
from lfportrait_eval.metrics.transfer_quality import (
    REFERENCES,
    Reference,
    compare_with_references,
    face_region,
    quality,
    quality_table,
    references,
)
from tests.portraits import drawn_face

ROOT = Path(__file__).parents[3]


@pytest.fixture
def scene():
    style, photo = drawn_face(120, 100, seed=2, skin=(120, 90, 200)), drawn_face(120, 100)
    return style, photo, lambda image: photo.landmarks


def test_the_exemplar_has_its_own_patches_and_the_photo_its_own_face(scene):
    style, photo, _ = scene
    moved = photo.landmarks + np.array([3, 4])

    def detect(image):
        return {True: moved, False: photo.landmarks}[bool((image == style.image).all())]

    copy = quality(style.image, photo.image, style, photo.landmarks, detect, samples=50)
    assert copy["face"] < 0.05 and copy["picture"] < 0.05
    eyes = np.linalg.norm(photo.landmarks[36] - photo.landmarks[45])
    assert copy["nme"] == pytest.approx(5 / eyes)
    itself = quality(photo.image, photo.image, style, photo.landmarks, detect, samples=50)
    assert itself["nme"] == 0 and itself["face"] > 10
    missed = quality(photo.image / 255, photo.image, style, photo.landmarks, lambda image: None,
                     whole=False, samples=5)
    assert np.isnan(missed["nme"]) and np.isnan(missed["picture"])
    with pytest.raises(ValueError, match="size"):
        quality(photo.image[:-1], photo.image, style, photo.landmarks, detect)


def test_the_region_of_the_face_lies_between_jaw_and_brows(scene):
    _, photo, _ = scene
    region = face_region(photo.image.shape, photo.landmarks)
    assert region[tuple(photo.landmarks[30].astype(int)[::-1])]
    assert not region[:int(photo.landmarks[17:27, 1].min()) - 2].any()
    assert not region[int(photo.landmarks[8, 1]) + 2:].any()


def test_methods_and_references_go_through_the_same_figures(scene):
    style, photo, detect = scene
    published = {"one": Reference(style, style.image, True),
                 "two": Reference(style, photo.image, False)}
    kept = []
    rows = compare_with_references(
        photo.image, published, {"copy": lambda image, exemplar, points: exemplar.image}, detect,
        samples=40, keep=lambda style, method, image: kept.append((style, method)))
    assert kept == [("one", "copy"), ("two", "copy")]
    assert rows["one"]["reference"] == rows["one"]["copy"]
    assert rows["two"]["reference"]["face"] == rows["two"]["photo"]["face"]
    table = quality_table(rows).splitlines()
    assert len(table) == 1 + 2 * 3 + 3
    assert "nan" not in quality_table(rows) and table[-1].startswith("mean")


def _script():
    spec = importlib.util.spec_from_file_location("compare", ROOT / "scripts/compare_transfer.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_without_the_data_the_script_says_why_it_does_nothing(tmp_path, capsys):
    assert _script().main([str(tmp_path)]) == 0
    assert capsys.readouterr().out.startswith("skipped: there is no ")


def test_the_script_prints_the_table(scene, tmp_path, capsys, monkeypatch):
    style, photo, detect = scene
    write_image(tmp_path / "faceblit_reference" / "target1.png", photo.image)
    for name, file in REFERENCES.items():
        write_image(tmp_path / "faceblit_reference" / file, style.image)
        write_image(tmp_path / "styles" / f"{name}.png", style.image)
        write_landmarks(tmp_path / "styles" / f"{name}.landmarks.txt", style.landmarks)
    _, found = references(tmp_path)
    assert not found["bronzestatue"].whole and found["het"].whole
    script = _script()
    monkeypatch.setattr(script, "detect_landmarks", detect)
    assert script.main([str(tmp_path), "--methods", "styleblit", "--styles", "het", "--samples",
                        "20", "--out", str(tmp_path / "out")]) == 0
    words = [line.split()[:2] for line in capsys.readouterr().out.splitlines()]
    assert ["het", "reference"] in words and ["het", "styleblit"] in words
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "het_styleblit.png", "figures.json"}
