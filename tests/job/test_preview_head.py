"""The head on which paintings are tried is made once."""

import numpy as np
import pytest

from lfportrait import cache
from lfportrait.demo import demo_cameras, head_field
from lfportrait.job import preview_head as module
from lfportrait.job.preview_head import preview_head


@pytest.fixture
def made(monkeypatch):
    """How often the head is made; a coarse one."""
    calls = []

    def coarse(model):
        calls.append(model)
        return head_field(model, step=8, cameras=demo_cameras(32, 4))
    monkeypatch.setattr(module, "head_field", coarse)
    return calls


def test_it_is_made_once_and_read_then(made, tmp_path):
    field, capture, skin = preview_head(48.0, tmp_path / "heads")
    again, _, skin_again = preview_head(48.0, tmp_path / "heads")
    assert len(made) == 1
    assert len(list((tmp_path / "heads").iterdir())) == 2
    assert np.array_equal(field.density, again.density) and np.array_equal(field.sh, again.sh)
    assert np.array_equal(skin.atlas.points, skin_again.atlas.points, equal_nan=True)
    shot = again.render(capture.cameras, 0)
    assert shot.alpha.max() > 0.99 and 0.05 < shot.alpha.mean() < 0.7


def test_another_model_of_the_head_is_another_file(monkeypatch):
    before = module._key()
    monkeypatch.setattr(cache, "code_of", lambda package: f"changed {package}")
    assert module._key() != before


def test_a_damaged_file_is_made_anew_and_a_missing_folder_is_no_hindrance(made, tmp_path):
    preview_head(48.0, tmp_path)
    file = next(path for path in tmp_path.iterdir() if ".skin" not in path.name)
    file.write_bytes(b"not a field")
    field, _, _ = preview_head(48.0, tmp_path)
    assert len(made) == 2 and len(field.density) > 1000
    (tmp_path / "file").write_text("")
    field, _, skin = preview_head(48.0, tmp_path / "file" / "heads")
    assert len(made) == 3 and len(field.density) > 1000 and skin.atlas.points.size
