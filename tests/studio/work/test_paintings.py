"""A face that no detector finds is laid where somebody points, to be corrected by hand."""

import numpy as np
import pytest

pytest.importorskip("starlette")

from lfportrait.face import read_landmarks
from lfportrait.files import write_image
from lfportrait.studio.work.resident import _Resident, usual_face


@pytest.mark.parametrize("place", [(150, 200), (60, 90), (240, 300), (3, 3), (299, 399)])
def test_a_usual_face_has_its_nose_where_it_was_pointed_at(place):
    points = usual_face(place, 300, 400)
    assert np.allclose(points[30], place) and points.shape == (68, 2)
    # Upright and not mirrored: the chin is below, the sitter's right eye on the picture's left.
    assert points[8, 1] > points[30, 1] > points[27, 1] and points[36, 0] < points[45, 0]
    assert 0.08 * 300 < np.ptp(points[:, 1]) <= 0.4 * 300 + 1e-9
    if 50 < place[0] < 250 and 80 < place[1] < 320:
        assert points.min() >= 0 and (points <= [299, 399]).all(), "inside the picture"


def test_where_nothing_is_found_the_landmarks_are_written_all_the_same(tmp_path):
    write_image(tmp_path / "flat.png", np.full((200, 150, 3), 120, np.uint8))
    found = _Resident().choose({"style": str(tmp_path / "flat.png"), "at": [75.0, 90.0]})
    written = read_landmarks(tmp_path / "flat.landmarks.txt")
    assert np.allclose(written, found["points"], atol=0.01)
    assert np.allclose(written[30], [75, 90], atol=0.01)
