"""Busts that the photos cut off end in strokes; others stay as they are."""

from dataclasses import replace

import numpy as np
import pytest

from lfportrait.capture import Camera, Capture
from lfportrait.field import VoxelField
from lfportrait.stylize.vignette import _Low, _thickness, vignetted

POINTS = 80
LOWEST = -1.0


def landmarks() -> np.ndarray:
    """Sixty-eight places of a flat face from y = -0.45 to 0.2."""
    turn = 2 * np.pi * np.arange(68) / 68
    out = np.stack([0.3 * np.cos(turn), 0.3 * np.sin(turn) - 0.1, np.full(68, 0.5)], axis=1)
    out[8], out[17:27, 1] = (0, -0.45, 0.5), 0.2
    return out


def bust(shoulders: float = 0.7) -> VoxelField:
    """A ball on a body that a plane ends, with shoulders so wide."""
    size, radius = (POINTS, POINTS, POINTS), 1.4
    axis = radius * (2 * (np.arange(POINTS) + 0.5) / POINTS - 1)
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    head = np.sqrt(x ** 2 + y ** 2 + z ** 2) - 0.55
    body = (np.sqrt((x / shoulders) ** 2 + ((y + 1.0) / 0.6) ** 2 + (z / 0.4) ** 2) - 1) * 0.4
    inside = -np.maximum(np.minimum(head, body), LOWEST - y) * POINTS / (2 * radius)
    shell = (inside > -2) & (inside < 4)
    links = np.full(size, -1, np.int32)
    links[shell] = np.arange(int(shell.sum()))
    density = np.clip(4 * inside[shell], 0, 8) * POINTS / (2 * radius)
    return VoxelField(links, density.astype(np.float32),
                      np.zeros((len(density), 3, 1), np.float32), radius=np.full(3, radius))


def photographed(field: VoxelField, half: float) -> Capture:
    """Photos from five sides that show ``half`` a unit above and below the head's middle."""
    cameras = Camera.arc(np.linspace(-20, 20, 5), distance=4.0, width=96, height=96,
                         focal=48 * 4 / half)
    mattes = [np.rint(255 * field.render(cameras, view).alpha).astype(np.uint8)
              for view in range(5)]
    return Capture(cameras, [np.zeros((96, 96, 3), np.uint8)] * 5, mattes, list("abcde"),
                   np.zeros(5, bool), landmarks=landmarks())


@pytest.fixture(scope="module")
def cut() -> tuple[VoxelField, Capture]:
    """A bust whose photos end where it does."""
    field = bust()
    return field, photographed(field, 0.9)


def opacity(field: VoxelField, yaw: float = 0.0) -> np.ndarray:
    """From the front, 24 pixels to a unit around the head's middle at the lower left."""
    return field.render(Camera.arc([yaw], distance=4.0, width=96, height=96, focal=160.0)).alpha


def row(height: float) -> int:
    """Of such a picture."""
    return round(48 - 160 * height / 4)


def test_a_bust_that_the_photos_cut_off_fades_out_below(cut):
    field, capture = cut
    shown, ends = vignetted(field, capture)
    assert [end.name for end in ends] == ["below"]
    before, after = opacity(field), opacity(shown)
    middle = slice(34, 62)
    assert before[row(-0.9), middle].min() > 0.95
    assert after[row(-0.97), middle].max() < 0.1
    ways = [float(after[row(height), middle].mean()) for height in (-0.6, -0.82, -0.88, -0.95)]
    assert ways == sorted(ways, reverse=True) and ways[0] > 0.95 > ways[1] and ways[3] < 0.2
    # It is no straight line: strokes give out at different heights.
    last = (after[:, middle] > 0.5).cumsum(axis=0).argmax(axis=0)
    assert last.std() > 0.5


def test_the_head_stays_as_it_is(cut):
    field, capture = cut
    shown, _ = vignetted(field, capture)
    above = field.lattice_points()[:, 1] > -0.5
    assert np.array_equal(shown.density[above], field.density[above])
    assert np.array_equal(shown.links, field.links) and np.array_equal(shown.sh, field.sh)
    for yaw in (-40, 40):
        high = slice(0, row(-0.45))
        assert np.array_equal(opacity(field, yaw)[high], opacity(shown, yaw)[high])


def test_strokes_only_take_away(cut):
    field, capture = cut
    shown, _ = vignetted(field, capture)
    assert (np.abs(shown.density) <= np.abs(field.density)).all()
    assert (shown.density != field.density).any()


def test_a_bust_that_ends_by_itself_stays(cut):
    field, _ = cut
    shown, ends = vignetted(field, photographed(field, 1.8))
    assert shown is field and ends == []


def test_a_person_who_goes_on_is_cut_off_wherever_the_photos_end(cut):
    field, _ = cut
    capture = photographed(field, 1.8)
    mattes = [np.maximum(matte, np.where(np.arange(96)[:, None] > 70, matte[70], 0))
              for matte in capture.alphas]
    assert [end.name for end in vignetted(field, replace(capture, alphas=mattes))[1]] == ["below"]


def test_shoulders_beyond_the_photos_end_in_strokes_too():
    field = bust(1.6)
    _, ends = vignetted(field, photographed(field, 1.25))
    assert [end.name for end in ends] == ["left", "right"]
    left, right = ends
    assert left.normal[0] > 0.9 and right.normal[0] < -0.9


def test_strokes_follow_the_seed(cut):
    field, capture = cut
    first, again, other = (vignetted(field, capture, seed)[0].density for seed in (1, 1, 2))
    assert np.array_equal(first, again) and not np.array_equal(first, other)


def test_without_a_face_nothing_is_done(cut):
    field, capture = cut
    shown, ends = vignetted(field, replace(capture, landmarks=None))
    assert shown is field and ends == []


def test_a_sheet_is_as_thick_as_its_density_says():
    links = np.full((40, 40, 40), -1, np.int32)
    links[18:21] = np.arange(3 * 1600).reshape(3, 40, 40)
    field = VoxelField(links, np.full(4800, 7.0, np.float32), np.zeros((4800, 3, 1), np.float32))
    face = landmarks()
    face[:, 1] += 1.3
    thick = _thickness(field, _Low.of(field, face))
    assert np.allclose(thick, 7.0 * 3 * 2 / 40, rtol=1e-4)
