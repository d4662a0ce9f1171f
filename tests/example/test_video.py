"""Transfer to videos: threads that keep order, planes that are carried, what is found how often."""

import importlib
import threading

import numpy as np
import pytest
from scipy.ndimage import shift as moved

from lfportrait.example import Transfer, VideoTransfer, parts_lips
from lfportrait.example.guides.position import pixel_centres
from lfportrait.example.kernels.video import (
    carry_shifts,
    repair,
    squared_changes,
    to_bytes,
    trust,
    unfold,
)
from lfportrait.example.video import Flow, Motion, _taken_up, ahead, in_turn, paint_onward, reduced
from tests.portraits import drawn_face

# The package's name for it is a function's.
video_module = importlib.import_module("lfportrait.example.video")


def test_items_come_in_order_from_other_threads():
    names = set()

    def square(n):
        names.add(threading.current_thread())
        return n * n

    assert list(in_turn(square, ahead(iter(range(50))), 3)) == [n * n for n in range(50)]
    assert threading.current_thread() not in names


def test_what_is_raised_elsewhere_is_raised_here():
    def items():
        yield 1
        raise KeyError("gone")

    taken = ahead(items())
    assert next(taken) == 1
    with pytest.raises(KeyError, match="gone"):
        next(taken)
    with pytest.raises(ZeroDivisionError):
        list(in_turn(lambda n: 1 // n, iter([1, 0, 2]), 2))


def test_leaving_early_ends_the_threads():
    closed = []

    def endless():
        try:
            n = 0
            while True:
                yield (n := n + 1)
        finally:
            closed.append(True)

    before = set(threading.enumerate())
    made = in_turn(lambda n: n, ahead(endless()), 2)
    assert next(made) == 1
    made.close()
    assert closed == [True]
    assert set(threading.enumerate()) <= before  # one of another test may end meanwhile


def _textured(shape, seed=3):
    noise = np.random.default_rng(seed).random((shape[0] // 4, shape[1] // 4, 3))
    picture = np.asarray(noise.repeat(4, 0).repeat(4, 1) * 255)
    return moved(picture, (0.5, 0.5, 0), order=1, mode="nearest").astype(np.uint8)


@pytest.mark.parametrize("shape", [(240, 320), (120, 160)])
def test_the_flow_of_a_shift(shape):
    """At half and at full size: back, there, and points; and none across a cut."""
    pytest.importorskip("cv2")
    flow, picture = Flow(), _textured(shape)
    assert flow.next(picture) is None
    motion = flow.next(np.roll(picture, (4, 6), (0, 1)))
    middle = (slice(30, -30), slice(30, -30))
    assert np.median(np.abs(motion.back[middle] - [-6, -4]).max(-1)) < 0.5
    assert motion.trusted[middle].mean() > 0.8
    points = np.array([[60.0, 50.0], [80.0, 70.0]])
    assert np.abs(motion.onward(points) - points - [6, 4]).max() < 0.7
    assert flow.next(_textured(shape, 9)) is None


def test_trust_needs_both_directions_and_the_picture():
    back = np.zeros((6, 9, 2), np.float32)
    back[..., 0] = 2
    there = -back
    there[:, :5] = 0
    out = np.empty((6, 9), np.bool_)
    trust(back, there, np.float32(0.5), out)
    # Column 3 comes from column 5; columns 7 and 8 come from outside.
    assert out[0].tolist() == [False] * 3 + [True] * 4 + [False] * 2


@pytest.mark.parametrize("factor", [1, 2])
def test_a_plane_on_blocks_is_the_plane(factor):
    coarse = pixel_centres((15, 11)) * np.float32(1.6 * factor)
    out = np.empty((15 * factor, 11 * factor - (factor - 1), 2), np.float32)
    unfold(coarse, factor, np.float32(1.6), np.float32(1.7), out)
    assert np.allclose(out, pixel_centres(out.shape) * 1.6, atol=1e-4)
    # Two pieces that are far apart do not blend.
    coarse[:, 6:] += 100
    unfold(coarse, factor, np.float32(1.6), np.float32(1.7), out)
    off = out - pixel_centres(out.shape) * 1.6
    assert (np.isclose(off, 0, atol=1e-3) | np.isclose(off, 100, atol=1e-3)).all()


def test_pieces_of_a_plane_keep_their_size():
    """Only what can't be trusted or is torn on both sides is anew."""
    plane = pixel_centres((20, 30)) * np.float32(2)
    plane[:, 12:] += 50
    trusted = np.ones((20, 30), bool)
    trusted[4, 20] = False
    torn = plane.copy()
    torn[9, 3] += 20
    out = np.empty_like(plane)
    repair(torn, trusted, 2, np.float32(1), np.float32(0.6), np.float32(1.7), 1j, 3 + 0j, out)
    anew = np.zeros((20, 30), bool)
    anew[4, 20] = anew[9, 3] = True
    assert np.array_equal(out[~anew], torn[~anew])
    x, y = (np.array([20.5, 3.5]) * 2, np.array([4.5, 9.5]) * 2)
    assert np.allclose(out[anew], np.stack([3 - y, x], -1))


def test_changes_are_those_of_the_carried_frame():
    random = np.random.default_rng(0)
    before = random.random((12, 16, 3)).astype(np.float32)
    image = np.roll(before, 2, 1)
    image[:, :2] = 0
    back = np.zeros((6, 8, 2), np.float32)
    back[..., 0] = -2
    trusted = np.ones((6, 8), bool)
    trusted[:, 0] = False
    sums = np.empty((6, 8))
    squared_changes(image, before, back, 2, trusted, 1, sums)
    seen = image[1::2, 3::2]
    assert sums[:, 0].sum() == 42 and sums[:, 1].sum() < 1e-9
    assert np.allclose(sums[:, 2:5].sum(0), seen.sum((0, 1)), rtol=1e-5)
    assert np.allclose(sums[:, 5:].sum(0), (seen ** 2).sum((0, 1)), rtol=1e-5)
    eight = np.empty((12, 16, 3), np.uint8)
    to_bytes(image * 1.5 - 0.2, eight)
    assert np.array_equal(eight, (np.clip(image * np.float32(1.5) - np.float32(0.2), 0, 1) * 255
                                  + 0.5).astype(np.uint8))


def _walk(count):
    face = drawn_face(260, 220)
    noise = np.random.default_rng(1).normal(0, 8, face.image.shape)
    base = np.clip(face.image + moved(noise, (1, 1, 0)), 0, 255)
    for n in range(count):
        yield (np.uint8(moved(base, (n, 2 * n, 0), order=1, mode="nearest")),
               face.landmarks + np.array([2 * n, n]))


@pytest.fixture
def counted(monkeypatch):
    """Exact landmarks, and how often landmarks and regions were found."""
    pytest.importorskip("cv2")
    frames, counts = list(_walk(9)), {"landmarks": 0, "regions": 0}

    def find(self, frame):
        counts["landmarks"] += 1
        return next(points for other, points in frames if np.array_equal(other, frame))

    regions = video_module.find_regions

    def find_regions(*arguments, **options):
        counts["regions"] += 1
        return regions(*arguments, **options, networks=False)

    monkeypatch.setattr(VideoTransfer, "_find", find)
    monkeypatch.setattr(video_module, "find_regions", find_regions)
    return frames, counts


def test_most_is_carried_from_frame_to_frame(counted):
    frames, counts = counted
    video = VideoTransfer(Transfer(drawn_face(200, 160, seed=5)))
    for frame, points in frames:
        followed = video._follow(frame)
        # Neither the landmarks nor the masks lag behind.
        assert np.abs(followed.points - points).max() < 1.5
        assert np.abs(followed.points - points).mean() < 0.5
    assert counts == {"landmarks": 3, "regions": 2}
    found = video_module.find_regions(frames[8][0], frames[8][1])
    person = followed.regions.person
    assert ((person > 0.5) == (found.person > 0.5)).mean() > 0.98


def test_shifts_go_along_and_start_anew():
    """Kept blocks take the shift that lay where they came from, others the guided place."""
    random = np.random.default_rng(2)
    before, position, anchor = (random.random((6, 10, 2)).astype(np.float32) for _ in range(3))
    motion = np.zeros((3, 5, 2), np.float32)
    motion[..., 0], motion[..., 1] = -2.3, 0.6
    kept = np.ones((3, 5), bool)
    kept[1, 2] = False
    out = np.empty_like(before)
    carry_shifts(before, motion, 2, kept, position, anchor, out)
    y, x = np.mgrid[:6, :10]
    wanted = before[np.minimum(y + 1, 5), np.maximum(x - 2, 0)]
    anew = np.zeros((6, 10), bool)
    anew[2:4, 4:6] = True
    assert np.array_equal(out[~anew], wanted[~anew])
    assert np.array_equal(out[anew], (position - anchor)[anew])


def test_a_frame_painted_onward_shows_what_the_one_before_did():
    """Of a picture that stands still the same; of one that moves the same strokes, moved."""
    style = Transfer(drawn_face(200, 160, seed=5))
    (frame, points), *_ = _walk(1)
    plane = pixel_centres(frame.shape)
    first = style.apply(frame, points, seeds_anchor=plane)
    height, width = (-(-n // 2) for n in frame.shape[:2])
    back = np.zeros((height, width, 2), np.float32)
    motion = Motion(back, -back, np.ones((height, width), bool), 2)

    def unused():
        raise AssertionError("nothing of the photo is left, so no mask is needed")

    assert not parts_lips(style.exemplar, points), "a smile follows its own photo"
    still = paint_onward(style, frame, points, unused, plane, motion, motion.trusted, first)
    assert np.abs(still.image - first.image).max() < 1e-5
    back[..., 0] = -4
    moved_plane = plane - np.array([4, 0], np.float32)
    later = paint_onward(style, frame, points, unused, moved_plane, motion, motion.trusted, first)
    # Shifts have fractions: a color may be one step of 255 off.
    assert np.abs(later.image[:, 8:-4] - first.image[:, 4:-8]).max() < 1.01 / 255


def test_a_smile_is_painted_onward_too():
    drawn = drawn_face(200, 160, seed=5)
    drawn.landmarks[[61, 62, 63]] = drawn.landmarks[[67, 66, 65]]
    style = Transfer(drawn)
    (frame, points), *_ = _walk(1)
    points = points.copy()
    width = np.linalg.norm(points[54] - points[48])
    points[[61, 62, 63], 1] -= 0.15 * width
    points[[67, 66, 65], 1] += 0.15 * width
    assert parts_lips(drawn, points)
    plane = pixel_centres(frame.shape)
    first = style.apply(frame, points, seeds_anchor=plane)
    still = np.zeros((-(-frame.shape[0] // 2), -(-frame.shape[1] // 2), 2), np.float32)
    motion = Motion(still, -still, np.ones(still.shape[:2], bool), 2)
    later = paint_onward(style, frame, points, lambda: first.mask, plane, motion, motion.trusted,
                         first)
    assert np.abs(later.image - first.image).max() < 1e-5
    style.palette = None
    bare = paint_onward(style, frame, points, lambda: first.mask, plane, motion, motion.trusted,
                        first)
    assert np.abs(later.image - bare.image).max() > 0.1


def test_an_exemplar_of_half_the_size_paints_alike():
    exemplar = drawn_face(400, 320, seed=5)
    whole = Transfer(exemplar)
    half = reduced(whole, 2.0)
    assert half.exemplar.image.shape == (200, 160, 3)
    assert half.config.blit.levels == whole.config.blit.levels - 1
    (frame, points), *_ = _walk(1)
    one, other = (style.apply(frame, points).image for style in (whole, half))
    assert np.abs(one - other).mean() < 0.03


def test_frames_are_the_same_bytes_as_one_after_the_other(counted):
    frames, _ = counted
    style = Transfer(drawn_face(200, 160, seed=5))
    together = VideoTransfer(style)
    made = list(together.frames(frame for frame, _ in frames))
    alone = VideoTransfer(style)
    for (frame, _), picture in zip(frames, made, strict=True):
        assert np.array_equal(picture, video_module._bytes_of(alone.apply(frame)))
    assert np.allclose(together.flicker, alone.flicker)


def test_fields_are_carried_along_the_flow():
    field = np.random.default_rng(1).random((8, 10, 2)).astype(np.float32)
    back = np.full((8, 10, 2), (-2.0, 2.0), np.float32)
    motion = Motion(back, -back, np.ones((8, 10), bool), 2)
    # Two pixels are one block.
    assert np.allclose(motion.carry(field)[:-1, 1:], field[1:, :-1])


def test_masks_follow_what_is_found_and_hair_stays():
    old, new = np.zeros((3, 4, 2), np.float32), np.ones((3, 4, 1), np.float32)
    old[..., 1] = 0.75
    share = np.full((3, 4, 1), 0.5, np.float32)
    mixed = _taken_up(old, new, share)
    assert np.allclose(mixed[..., 0], 0.5)
    assert np.allclose(mixed[..., 1], 0.75)
    found = _taken_up(new, old, share)
    assert np.allclose(found[..., 0], 0.5)
    assert np.allclose(found[..., 1], 0.75)
