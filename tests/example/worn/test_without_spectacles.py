"""A painting without its spectacles: no rims, no shade of theirs, and eyes as they were."""

from dataclasses import replace

import cv2
import numpy as np

from lfportrait.demo import demo_exemplar
from lfportrait.example.worn.inpainting import without_spectacles
from tests.example.worn.drawn_spectacles import KINDS, put_on


def test_rims_go_with_their_shade_and_eyes_leave_no_smear():
    bare = demo_exemplar("impression", width=360, height=480)
    kind = replace(KINDS["small round"], shadow=0.6)
    worn, lines = put_on(bare.image, bare.landmarks, kind)
    out = without_spectacles(replace(bare, image=worn)).image
    beside = (cv2.dilate(lines, np.ones((9, 9))) > 0.1) & (lines < 0.05)
    # Strokes are others.
    true, before, after = (cv2.GaussianBlur(picture.astype(np.float64), (0, 0), 5)
                           for picture in (bare.image, worn, out))
    for part, most in ((lines > 0.5, 0.2), (beside, 0.42)):
        assert np.abs(after - true)[part].mean() < most * np.abs(before - true)[part].mean()
    # Right below the eyes there is skin, nearly as light as it was; the eyes stay.
    light = []
    for eye in (bare.landmarks[36:42], bare.landmarks[42:48]):
        x, y = eye.mean(axis=0)
        width = eye[3, 0] - eye[0, 0]
        below = np.s_[int(y + 0.3 * width):int(y + 0.6 * width),
                      int(x - 0.3 * width):int(x + 0.3 * width)]
        light.append(after[below].mean() / true[below].mean())
        iris = np.s_[int(y), int(x) - 3:int(x) + 4]
        np.testing.assert_array_equal(out[iris], bare.image[iris])
    assert np.mean(light) > 0.85
