"""FaceStyle, guided patch synthesis: whole transfers. Its engine: `example/test_patches.py`."""

from dataclasses import replace

import numpy as np

from lfportrait.example import photo_method, prepare
from lfportrait_eval.baselines.config import FaceStyleConfig
from lfportrait_eval.baselines.transfer import FaceStyle
from lfportrait_eval.metrics import patch_fidelity
from tests.portraits import drawn_face

QUICK = FaceStyleConfig(steps=2, passes=1)


def test_the_exemplar_s_own_photo_comes_back():
    face = drawn_face(128, 96)
    made = FaceStyle(face, QUICK).apply(face.image, face.landmarks)
    assert np.abs(made.image * 255 - face.image).mean() < 4


def test_a_photo_is_painted_with_the_exemplar_s_patches(tmp_path):
    style = drawn_face(160, 120, skin=(120, 90, 200), hair=(20, 90, 40), ground=(230, 220, 120))
    photo = drawn_face(120, 100, seed=1)
    made = prepare(style, QUICK).apply(photo.image, photo.landmarks)
    assert made.image.shape == photo.image.shape
    assert patch_fidelity(made.image, style.image, samples=200) < 0.5 * patch_fidelity(
        photo.image, style.image, samples=200)
    nose = tuple(photo.landmarks[30].astype(int)[::-1])
    assert np.abs(made.image[nose] * 255 - (120, 90, 200)).max() < 50
    made.dump(tmp_path)
    assert {path.stem for path in tmp_path.glob("*.png")} >= {
        "appearance", "segmentation", "position", "occupancy", "result"}
    assert photo_method("facestyle").parameters is FaceStyleConfig
    again = prepare(style, QUICK).apply(photo.image, photo.landmarks)
    other = prepare(style, replace(QUICK, seed=5)).apply(photo.image, photo.landmarks)
    assert again.image.tobytes() == made.image.tobytes() != other.image.tobytes()


def test_a_small_photo_is_painted_with_the_exemplar_made_small():
    style = drawn_face(320, 240, skin=(120, 90, 200))
    photo = drawn_face(96, 80, seed=1)
    made = FaceStyle(style, QUICK).apply(photo.image, photo.landmarks)
    jaw = photo.landmarks[8]
    below_lips = (int(0.5 * (jaw[1] + photo.landmarks[57, 1])), int(jaw[0]))
    assert np.abs(made.image[below_lips] * 255 - (120, 90, 200)).max() < 50
