"""The embedded painter's exemplars from the side give what his frontal ones give."""

import cv2
import numpy as np
import pytest

from lfportrait.capture import Capture
from lfportrait.demo import demo_capture, demo_exemplar, demo_head, demo_landmarks
from lfportrait.example import Skin
from lfportrait.face import face_pose
from lfportrait.stylize import StylizeConfig, stylize
from lfportrait_eval.metrics import PatchIndex, arc_cameras, views_fidelity
from tests.recordings import painting

STYLE, SIZE, PIXELS = "impression", 144, 120.0


@pytest.fixture(scope="module")
def head():
    cameras, points, field = demo_capture(96, 12).cameras, demo_landmarks(), demo_head()
    images = [np.zeros((96, 96, 3), np.uint8)] * 12
    capture = Capture(cameras, images, None, [str(n) for n in range(12)], np.zeros(12, bool),
                      np.eye(4), points)
    return field, capture, Skin.of(field, points, cameras, PIXELS)


def painted(head, turn):
    field, capture, skin = head
    exemplar = (painting(STYLE, 180, 240, turn) if turn
                else demo_exemplar(STYLE, 180, 240))
    config = StylizeConfig(preview=True, pixels=PIXELS)
    return exemplar, stylize(field, capture, exemplar, config, skin=skin)


@pytest.fixture(scope="module")
def frontal(head):
    exemplar, styled = painted(head, 0.0)
    patches = PatchIndex(exemplar.image)
    return styled, patches, views_fidelity(styled, patches, (0.0,), SIZE)


@pytest.mark.slow  # paints a head twice; turned: test_turned.py
def test_the_visible_side_is_painted_as_from_the_front(head, frontal):
    turn = 40.0
    straight, patches, fidelity = frontal
    exemplar, styled = painted(head, turn)
    assert abs(face_pose(exemplar.landmarks).yaw - turn) < 6
    cameras = arc_cameras(styled, (0.0,), SIZE)
    seen, wanted = (one.render(cameras, 0) for one in (styled, straight))
    points, marks = wanted.points(cameras, 0).reshape(SIZE, SIZE, 3), demo_landmarks()
    face = (np.abs(points[..., 0]) < 0.3) & (points[..., 1] > marks[8, 1])
    face &= (points[..., 1] < marks[19, 1]) & (points[..., 2] > 0)
    visible = face & (points[..., 0] < 0)
    error = ((seen.color - wanted.color)[visible] ** 2).mean()
    assert -10 * np.log10(error) > 25
    assert views_fidelity(styled, patches, (0.0,), SIZE) < 1.1 * fidelity


def test_a_painting_seen_from_the_side_is_seen_from_there():
    exemplars = [painting("charcoal", 120, 160, turn) for turn in (-30.0, 30.0)]
    yaws = [face_pose(one.landmarks).yaw for one in exemplars]
    assert yaws[0] < -24 and yaws[1] > 24 and abs(yaws[0] + yaws[1]) < 1
    masks = [cv2.flip(one.mask, 1) if n else one.mask for n, one in enumerate(exemplars)]
    assert np.abs(masks[0] - masks[1]).mean() < 0.05
