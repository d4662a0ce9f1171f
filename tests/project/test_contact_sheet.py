"""The contact sheet is drawn from a folder of data, and says so where there is none."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from lfportrait.demo import demo_capture
from lfportrait.face import write_landmarks
from lfportrait.field import ReconstructConfig, reconstruct_with_figures
from lfportrait.files import write_image
from lfportrait.media.pictures import read_image
from tests.portraits import drawn_face

pytestmark = pytest.mark.slow  # a script that no user runs


def _script():
    path = Path(__file__).parents[2] / "scripts" / "make_contact_sheet.py"
    spec = importlib.util.spec_from_file_location("contact_sheet", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_views_nearest_to_the_angles_are_taken():
    capture = demo_capture(size=16, views=60)
    views = _script().nearest_views(capture, (0, 80))
    position = capture.cameras.position[views]
    yaw = np.degrees(np.arctan2(position[:, 0], position[:, 2]))
    assert abs(yaw[0]) < 15 and abs(yaw[1] - 80) < 15


def test_a_row_for_every_exemplar(tmp_path, monkeypatch, capsys):
    script = _script()
    assert script.main([str(tmp_path)]) == 0
    assert capsys.readouterr().out.startswith("skipped: ")
    photo = drawn_face(120, 90, seed=1)
    write_image(tmp_path / "faceblit_reference" / "target1.png", photo.image)
    for name, skin in (("blue", (90, 90, 220)), ("green", (80, 200, 90))):
        style = drawn_face(128, 96, skin=skin)
        write_image(tmp_path / "styles" / f"{name}.png", style.image)
        write_landmarks(tmp_path / "styles" / f"{name}.landmarks.txt", style.landmarks)
    capture = demo_capture(size=64, views=24)
    capture.save(tmp_path / "lee")
    field, _ = reconstruct_with_figures(
        capture, ReconstructConfig(resolutions=(32,), rays=(0.05,), batch=(2048,)))
    field.save(tmp_path / "field.npz")
    monkeypatch.setattr(script, "detect_landmarks", lambda image: photo.landmarks)
    assert script.main([str(tmp_path), "--field", str(tmp_path / "field.npz"), "--height", "64",
                        "--out", str(tmp_path / "sheet.png")]) == 0
    sheet = read_image(tmp_path / "sheet.png")
    row = 64 + 22 + script.GAP
    assert sheet.shape == (3 * row, 48 + 48 + 4 * 64 + 6 * script.GAP, 3)
    for line, channel in ((1, 2), (2, 1)):  # the skin of the exemplar, on the photo and the head
        for x in (48 + 4 + 24, 2 * (48 + 4) + 32):
            patch = sheet[line * row + 22 + 26:line * row + 22 + 36, x - 4:x + 5]
            assert patch.reshape(-1, 3).mean(axis=0).argmax() == channel
