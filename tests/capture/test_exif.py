"""Focal lengths and lenses as cameras note them, well and badly."""

import numpy as np
import pytest
from PIL import Image

from lfportrait.capture.photos import noted


def exif(base: dict[int, object] | None = None, sub: dict[int, object] | None = None) -> Image.Exif:
    result = Image.Exif()
    result.update(base or {})
    result.get_ifd(0x8769).update(sub or {})
    return result


PLANE = {0x920A: 55.0, 0xA20E: 4272 / 22.2 * 25.4, 0xA210: 2}
CANON = {0x010F: "Canon", 0x0110: "Canon EOS 400D DIGITAL"}


@pytest.mark.parametrize("base, sub, focal, source", [
    ({}, {0xA405: 54}, 54 / 36, "35 mm"),
    ({}, {0xA405: 54, **PLANE}, 54 / 36, "35 mm"),
    ({}, PLANE, 55 / 22.2, "focal plane"),
    ({}, {**PLANE, 0xA20E: 4272 / 2.22, 0xA210: 3}, 55 / 22.2, "focal plane"),
    # A copy of half the size keeps the note of what was taken.
    ({}, {**PLANE, 0xA20E: 8544 / 22.2 * 25.4, 0xA002: 8544, 0xA003: 5696}, 55 / 22.2,
     "focal plane"),
    (CANON, {0x920A: 55.0}, 55 / 22.2, "camera model"),
    ({0x010F: "Nobody", 0x0110: "Box 1"}, {0x920A: 55.0}, None, ""),
    ({}, {0x920A: 55.0}, None, ""),
    ({}, {0xA405: 0}, None, ""),
    ({}, {0xA405: "wide"}, None, ""),
    ({}, {**PLANE, 0xA20E: 1.0}, None, ""),
    ({}, {0x920A: 55.0, 0xA20E: 1e9, 0xA210: 2}, None, ""),
    ({}, {}, None, "")])
def test_focal_length(base, sub, focal, source):
    found = noted(exif(base, sub), (4272, 2848))
    assert found.source == source
    # COLMAP's sensor widths are rounded otherwise.
    assert (found.focal is None) if focal is None else found.focal == pytest.approx(focal, rel=0.01)


def test_a_reduced_copy_of_a_known_camera():
    small, large = (noted(exif(CANON, {0x920A: 55.0}), size) for size in ((427, 285), (285, 427)))
    assert small.focal == pytest.approx(55 / 22.2, rel=0.01)
    assert large.focal == pytest.approx(small.focal, rel=0.01)


def test_a_lens_is_told_from_others_of_the_same_phone():
    phone = {0x010F: "Apple", 0x0110: "iPhone 12"}
    wide, tele = (noted(exif(phone, {0x920A: mm, 0xA405: film}), (4032, 3024))
                  for mm, film in ((4.2, 26), (6.0, 52)))
    assert wide.lens != tele.lens
    assert wide.lens == noted(exif(phone, {0x920A: 4.2, 0xA405: 26}), (3024, 4032)).lens


@pytest.mark.parametrize("orientation, turns", [(1, 0), (6, 1), (3, 2), (8, 3), (0, 0), (99, 0)])
def test_the_turn_back_to_the_sensor(orientation, turns):
    found = noted(exif({0x0112: orientation}), (40, 30))
    assert found.turns == turns
    if orientation in (3, 6, 8):
        # Turning the upright picture so gives what the sensor saw.
        from PIL import ImageOps

        sensor = np.arange(12, dtype=np.uint8).reshape(3, 4)
        picture = Image.fromarray(sensor)
        picture.getexif()[0x0112] = orientation
        upright = np.asarray(ImageOps.exif_transpose(picture))
        assert np.array_equal(np.rot90(upright, turns), sensor)
