"""The modelled head as a field: it looks like its photographs."""

import numpy as np
import pytest
from scipy import ndimage

from modelled_head import SITTER, head_field, landmarks, photograph, studio_cameras

# Slow: tests and users have what was made of it.
pytestmark = [pytest.mark.usefixtures("coarse_heads"), pytest.mark.slow]


@pytest.fixture(scope="module")
def field():
    return head_field(step=2, cameras=studio_cameras(96, 12))


def test_views_of_the_field_are_the_photographs(field):
    cameras = studio_cameras(96, 12)
    for view in (0, 2, 5):
        picture = photograph(SITTER, cameras, view)
        photo = picture.image.astype(np.float64) / 255
        wanted = photo[..., :3] * photo[..., 3:] + 1 - photo[..., 3:]
        seen = field.render(cameras, view)
        within = ndimage.binary_erosion(photo[..., 3] == 1, iterations=3) & (seen.alpha > 0.99)
        assert within.mean() > 0.1
        assert -10 * np.log10(((seen.color - wanted)[within] ** 2).mean()) > 24
        assert np.abs(seen.alpha - photo[..., 3]).mean() < 0.03
        # The surface lies where it was photographed, to half a voxel of 0.033.
        distance = np.linalg.norm(seen.points(cameras, view) - cameras.pose[view, :3, 3], axis=-1)
        away = np.abs(distance - picture.depth)[within]
        assert np.median(away) < 0.017


def test_landmarks_lie_on_the_field(field):
    points = landmarks(SITTER)[17:]
    cells = np.round((points + 1.06) / (2.12 / 64)).astype(int)
    assert (field.links[cells[:, 2], cells[:, 1], cells[:, 0]] >= 0).all()


def test_what_no_photograph_sees_has_a_neighbours_color():
    few = head_field(step=4, cameras=studio_cameras(48, 12)[3:4])
    color = 0.5 + 0.28209479177387814 * few.sh[:, :, 0]
    assert np.isfinite(color).all() and color.min() >= 0 and color.max() <= 1
