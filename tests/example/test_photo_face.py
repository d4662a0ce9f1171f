"""Where StyleBlit's face ends on a photo, and in what light patches go on from there."""

from dataclasses import replace

import numpy as np
import pytest

from lfportrait.example import Transfer, TransferConfig
from lfportrait.example.guides.regions import find_regions
from lfportrait.example.painter import photo as module
from tests.portraits import CANONICAL, drawn_face

HEIGHT, WIDTH = 240, 200
HAIR, SKIN = np.array([200, 60, 20]), np.array([90, 150, 200])


@pytest.fixture(scope="module")
def style():
    """A painting with a lock of hair over the cheek."""
    face = drawn_face(HEIGHT, WIDTH, seed=3, skin=tuple(SKIN), hair=tuple(HAIR))
    (x, y), (left, right) = face.landmarks[27], face.landmarks[[0, 16], 0]
    scale = (right - left) / np.ptp(CANONICAL[[0, 16], 0])
    rows, columns = np.indices((HEIGHT, WIDTH)) + 0.5
    lock = np.hypot(columns - x + 0.35 * scale, rows - (y + 0.4 * scale)) < 0.13 * scale
    image = face.image.copy()
    image[lock] = HAIR
    regions = find_regions(image, face.landmarks, face.mask, networks=False)
    hair = regions.hair if regions.hair is not None else np.zeros(lock.shape, np.float32)
    regions = replace(regions, hair=np.maximum(hair, lock.astype(np.float32)))
    return replace(face, image=image), regions


def painted(style, photo, quality):
    exemplar, known = style
    regions = find_regions(photo.image, photo.landmarks, photo.mask, networks=False)
    return Transfer(exemplar, TransferConfig(quality=quality), regions=known).apply(
        photo.image, photo.landmarks, regions=regions).image


def test_a_lock_of_the_exemplars_is_not_laid_on_a_bare_cheek(style):
    photo = drawn_face(HEIGHT, WIDTH, seed=1)
    cheeks = np.indices((HEIGHT, WIDTH))[0] > photo.landmarks[36:48, 1].max() + 3
    cheeks &= np.abs(photo.image.astype(int) - (225, 180, 150)).max(axis=-1) < 40
    hairy = {}
    for quality in ("fast", "best"):
        away = [np.linalg.norm(painted(style, photo, quality) * 255 - color, axis=-1)
                for color in (HAIR, SKIN)]
        hairy[quality] = int((cheeks & (away[0] < away[1])).sum())
    assert hairy["fast"] > 60
    assert hairy["best"] < 0.25 * hairy["fast"]


def test_light_is_carried_on_from_the_face_and_fades():
    photo = drawn_face(HEIGHT, WIDTH, seed=1)
    regions = find_regions(photo.image, photo.landmarks, photo.mask, networks=False)
    core = np.zeros((HEIGHT, WIDTH), bool)
    core[80:160, 60:110] = True
    tone = np.full(core.shape, 0.6, np.float32)

    def carried(paint):
        shade = np.full((*core.shape, 3), paint, np.float32)
        work = module._Work(photo.image, photo.landmarks, regions, shade[..., :2], shade[..., :2],
                            shade, 1.0, False)
        return module._extrapolated_light(work, core, tone)

    light = carried(0.45)
    assert not light[core].any()
    assert -0.16 < light[120, 114] < -0.12 and abs(light[120, 190]) < 0.02
    assert (np.diff(light[120, 114:190]) > -1e-3).all()
    # What is darker by more is a shadow's.
    assert carried(0.0).min() >= -module.UTMOST - 1e-6
    assert not carried(0.6).any()
