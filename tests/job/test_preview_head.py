"""The head on which paintings are tried: its skin is drawn once."""

import numpy as np
import pytest

from lfportrait.example import Skin
from lfportrait.job.session import preview_head


@pytest.fixture(scope="module")
def known():
    """The head's skin, which is always the same: it is drawn in earnest once."""
    return []


@pytest.fixture
def drawn(monkeypatch, known):
    """How often a skin is drawn."""
    calls, draw = [], Skin.of

    def of(*words, **options):
        calls.append(words)
        known[:] = known or [draw(*words, **options)]
        return known[0]

    monkeypatch.setattr(Skin, "of", of)
    return calls


def test_its_skin_is_drawn_once_and_read_then(drawn, tmp_path):
    field, capture, skin = preview_head(48.0, tmp_path / "heads")
    _, _, again = preview_head(48.0, tmp_path / "heads")
    assert len(drawn) == 1 and len(list((tmp_path / "heads").iterdir())) == 1
    assert np.array_equal(skin.atlas.points, again.atlas.points, equal_nan=True)
    shot = field.render(capture.cameras, 0)
    assert shot.alpha.max() > 0.99 and 0.05 < shot.alpha.mean() < 0.7


@pytest.mark.slow  # drawn once: above
def test_a_damaged_file_is_replaced_and_a_missing_folder_is_no_hindrance(drawn, tmp_path):
    preview_head(48.0, tmp_path)
    file, = tmp_path.iterdir()
    file.write_bytes(b"not a skin")
    preview_head(48.0, tmp_path)
    assert len(drawn) == 2
    (tmp_path / "file").write_text("")
    _, _, skin = preview_head(48.0, tmp_path / "file" / "heads")
    assert len(drawn) == 3 and skin.atlas.points.size
