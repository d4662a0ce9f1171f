"""Sheet and table of stylised fields are made from files, and say so where there are none."""

import json
from dataclasses import replace

import numpy as np
import pytest

import make_style_sheet
import stylize_figures
from lfportrait import models
from lfportrait.face import write_landmarks
from lfportrait.field import VoxelField
from lfportrait.files import write_image
from lfportrait.media.pictures import read_image
from lfportrait_eval.metrics import RowLabels
from tests.lfportrait_eval.bench.test_bench import ball_capture
from tests.portraits import HEAD_LANDMARKS, drawn_face
from tests.share.test_video import ball

pytestmark = pytest.mark.slow  # of a script that no user runs


@pytest.fixture
def files(tmp_path, monkeypatch):
    """A field, its capture, two stylised fields, one of them with labels, and an exemplar."""
    monkeypatch.setattr(models, "available", lambda name: False)
    monkeypatch.setattr(models, "missing", lambda names: list(names))
    field = ball()
    field.save(tmp_path / "field.npz")
    replace(ball_capture(), landmarks=HEAD_LANDMARKS).save(tmp_path / "capture")
    for name, tint in (("red", (1.5, -1.7, -1.7)), ("green", (-1.7, 1.5, -1.7))):
        field.with_sh(np.broadcast_to(np.float32(tint)[:, None], field.sh.shape)).save(
            tmp_path / f"{name}.npz")
    style = drawn_face(120, 90)
    write_image(tmp_path / "styles" / "drawn.png", style.image)
    write_landmarks(tmp_path / "styles" / "drawn.landmarks.txt", style.landmarks)
    with np.load(tmp_path / "green.npz") as arrays:
        kept = dict(arrays)
    np.savez(tmp_path / "green.npz", **kept, region_names=np.array(["hair"]),
             labels=np.full((len(field.density), 1), 255, np.uint8))
    return tmp_path


def test_a_row_for_every_field(files, capsys):
    arguments = [str(files), "--field", str(files / "field.npz"), "--size", "40",
                 "--rows", f"by red={files / 'red.npz'}", f"by green={files / 'green.npz'}"]
    assert make_style_sheet.main([*arguments, "--out", str(files / "sheet.png")]) == 0
    sheet = read_image(files / "sheet.png")
    row = 40 + 22 + 4
    assert sheet.shape == (3 * row, 5 * 44, 3)
    for line, channel in ((1, 0), (2, 1)):
        for column in range(5):
            middle = sheet[line * row + 42, column * 44 + 20]
            assert middle[channel] > 150 > 2 * np.delete(middle, channel).max()
    assert make_style_sheet.main([*arguments, "--out", str(files / "sheet.png"), "--style", "drawn",
                                  "--capture", str(files / "capture")]) == 0
    wider = read_image(files / "sheet.png")
    assert wider.shape == (3 * row, 5 * 44 + 34, 3)
    assert (wider[22:62, :30] == 255).all() and wider[row + 22:row + 62, :30].std() > 20
    assert make_style_sheet.main([str(files), "--field", str(files / "none.npz")]) == 0
    assert "skipped: there is no" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        make_style_sheet.main([str(files), "--field", "f.npz", "--rows", "no file"])


def test_one_table_for_all_fields(files, capsys, monkeypatch):
    monkeypatch.setattr(stylize_figures, "landmarks_kept",
                        lambda *_: {"nme": 0.25, "detected": 1.0, "views": 7})
    monkeypatch.setattr(stylize_figures, "views_fidelity", lambda *_: 3.5)
    monkeypatch.setattr(stylize_figures.models, "available", lambda name: name == "face-landmarker")
    sizes = []

    def repeats(styled: VoxelField, exemplar, labels: RowLabels, *, landmarks):
        sizes.append((labels.names, len(labels.weights) == len(styled.density), landmarks.shape))
        return {"hair": {"ratio": 1.5}}

    monkeypatch.setattr(stylize_figures, "region_repeats", repeats)
    assert stylize_figures.main([
        str(files), "--field", str(files / "field.npz"), "--capture", str(files / "capture"),
        "--styled", f"one={files / 'red.npz'}:drawn", f"two={files / 'green.npz'}", "--views", "9",
        "--out", str(files / "figures.json")]) == 0
    lines = [[cell.strip() for cell in line.strip("| ").split("|")]
             for line in capsys.readouterr().out.splitlines()]
    assert lines[0] == ["figure", "one", "two", "photo"] and len(lines) == 2 + 9
    rows = {title: cells for title, *cells in lines[2:]}
    assert rows["patches to the exemplar's, 0 and 45 degrees (delta E)"] == ["3.50", "-", "-"]
    assert rows["landmarks moved, -45 to 45 degrees, over the eyes"] == ["0.2500", "0.2500", "-"]
    assert rows["repeats in the hair, over the exemplar's"] == ["1.50", "-", "-"]
    assert rows["repeats in neck and body, over the exemplar's"] == ["-", "-", "-"]
    assert float(rows["error of views 35 degrees apart, over contrast"][2]) > 0
    # A file without labels takes those of another of the same rows.
    assert sizes == [(("hair",), True, (68, 3))]
    found = json.loads((files / "figures.json").read_text())
    assert list(found) == ["one", "two", "photo"] and found["two"]["megabytes"] > 0


def test_what_can_not_be_measured_is_said(files, capsys):
    field = ["--field", str(files / "field.npz")]
    assert stylize_figures.main([str(files), *field, "--styled", "a=none.npz"]) == 0
    assert "skipped: there is no none.npz" in capsys.readouterr().out
    for wrong in (["a"], ["=x.npz"], ["a=x.npz", "a=y.npz"], ["photo=x.npz"]):
        with pytest.raises(SystemExit):
            stylize_figures.main([str(files), *field, "--styled", *wrong])
