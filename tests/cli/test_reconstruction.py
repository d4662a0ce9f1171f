"""A head from one photo by the command that makes fields."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from lfportrait.cli import main
from lfportrait.face.landmarks import FIT
from lfportrait.field import VoxelField
from tests.capture.test_capture import make_capture
from tests.fields import shell_field


@pytest.fixture
def fitted(monkeypatch):
    """How captures were prepared, and at which resolution fields were made; nothing is fitted."""
    seen = []
    capture = replace(make_capture(), figures={FIT: {}, "mattes": "network"})

    def prepare(photos, config, **choices):
        seen.append((photos.name, choices["made_from"], choices["keep_background"]))
        return capture, {}

    def field(found, config, progress):
        seen.append(config.resolution)
        return replace(shell_field(8), cone=40.0), {"voxels": 1}
    monkeypatch.setattr("lfportrait.job.prepare_capture", prepare)
    monkeypatch.setattr("lfportrait.face.portrait_field", field)
    return capture, seen


def test_a_photo_becomes_a_field(tmp_path, fitted):
    Image.fromarray(np.zeros((8, 8, 3), np.uint8)).save(tmp_path / "her.png")
    out = tmp_path / "field.npz"
    assert main(["reconstruct", str(tmp_path / "her.png"), "--out", str(out), "--resolution", "64",
                 "--quiet", "--json", str(tmp_path / "figures.json")]) == 0
    assert fitted[1] == [("her.png", "auto", False), 64]
    assert VoxelField.load(out).cone == 40.0
    assert '"mattes": "network"' in (tmp_path / "figures.json").read_text()


def test_a_saved_capture_of_a_photo_is_no_data_set_to_train_on(tmp_path, fitted):
    capture, seen = fitted
    capture.save(tmp_path / "capture")
    assert main(["reconstruct", str(tmp_path / "capture"), "--out", str(tmp_path / "field.npz"),
                 "--quiet"]) == 0
    assert seen == [0] and VoxelField.load(tmp_path / "field.npz").cone == 40.0


def test_from_face_is_for_photos(tmp_path, fitted, capsys):
    main(["reconstruct", str(tmp_path), "--from", "face", "--out", str(tmp_path / "f.npz"),
          "--quiet"])
    assert fitted[1][0] == (tmp_path.name, "face", False)
