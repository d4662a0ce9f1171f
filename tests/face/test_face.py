"""Landmark files, triangulation, the face mask, and the detectors on real pictures."""

import json
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lfportrait.capture import Camera, Capture
from lfportrait.errors import UserError
from lfportrait.face import (
    detect_landmarks,
    face_mask,
    face_mesh,
    face_yaw,
    frontal_order,
    hair_mask,
    landmarks_of_capture,
    person_matte,
    read_landmarks,
    triangulate,
    write_landmarks,
)
from lfportrait.face.landmarks import FROM_MEDIAPIPE
from lfportrait.media.pictures import read_image
from tests.portraits import HEAD_LANDMARKS, drawn_face


def test_landmark_files_survive_the_disk(tmp_path):
    points = np.random.default_rng(0).uniform(0, 900, (68, 2)).round(2)
    write_landmarks(tmp_path / "a.txt", points)
    assert np.array_equal(read_landmarks(tmp_path / "a.txt"), points)


@pytest.mark.parametrize("text", ["", "1 2\n3 4\n", "a b\n" * 68, "1 2 3\n" * 68, "nan 1\n" * 68])
def test_bad_landmark_files_are_told(tmp_path, text):
    (tmp_path / "a.txt").write_text(text)
    with pytest.raises(UserError, match="68"):
        read_landmarks(tmp_path / "a.txt")
    with pytest.raises(UserError, match="can't read"):
        read_landmarks(tmp_path / "none.txt")


def test_the_mesh_points_are_68_different_ones():
    assert len(FROM_MEDIAPIPE) == len(set(FROM_MEDIAPIPE.tolist())) == 68
    assert FROM_MEDIAPIPE.max() < 478


def rig(count, seed):
    random = np.random.default_rng(seed)
    yaw = np.radians(random.uniform(-50, 50, count))
    pitch = np.radians(random.uniform(-20, 20, count))
    places = 4 * np.stack([np.sin(yaw) * np.cos(pitch), np.sin(pitch),
                           np.cos(yaw) * np.cos(pitch)], 1)
    return Camera.look_at(places, np.zeros(3), width=500, height=500, focal=900)


@settings(max_examples=25, deadline=None)
@given(st.integers(2, 9), st.integers(0, 1000))
def test_exact_points_are_found_exactly(count, seed):
    cameras = rig(count, seed)
    baseline = np.linalg.norm(cameras.position[:, None] - cameras.position[None], axis=-1).max()
    truth = np.random.default_rng(seed).uniform(-0.7, 0.7, (6, 3))
    pixels, _ = cameras.project(truth)
    found, errors, inliers = triangulate(cameras, pixels)
    if baseline > 0.3:
        assert np.abs(found - truth).max() < 1e-5
        assert inliers.all()
        assert np.nanmax(errors) < 1e-4


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 1000))
def test_outliers_have_no_say(seed):
    cameras = rig(9, seed)
    random = np.random.default_rng(seed)
    truth = random.uniform(-0.7, 0.7, (5, 3))
    pixels, _ = cameras.project(truth)
    pixels += random.normal(0, 0.3, pixels.shape)
    wrong = random.permutation(9)[:3]
    pixels[wrong] += random.uniform(40, 120, (3, 5, 2)) * random.choice([-1, 1], (3, 5, 2))
    found, _, inliers = triangulate(cameras, pixels)
    assert np.abs(found - truth).max() < 0.03
    assert not inliers[wrong].any()


def test_points_seen_once_are_unknown():
    cameras = rig(4, 0)
    pixels, _ = cameras.project(np.zeros((2, 3)))
    pixels[1:, 0] = np.nan
    found, errors, inliers = triangulate(cameras, pixels)
    assert np.isnan(found[0]).all()
    assert np.isnan(errors[0])
    assert not inliers[:, 0].any()
    assert np.abs(found[1]).max() < 1e-6
    with pytest.raises(ValueError, match="points must be"):
        triangulate(cameras, pixels[:2])


def test_frontal_views_come_first():
    cameras = Camera.arc([60, -10, 30, 0, -80], distance=4, width=9, height=9, focal=9)
    assert list(frontal_order(cameras)) == [3, 1, 2, 0, 4]


def test_yaw_has_the_sign_of_the_nose():
    points = np.zeros((68, 2))
    points[36], points[45] = (0, 0), (10, 0)
    for nose, yaw in ((5, 0), (8, 0.6), (2, -0.6)):
        points[30] = (nose, 4)
        assert face_yaw(points) == pytest.approx(yaw)


def test_the_mask_covers_the_face_and_not_the_surroundings():
    drawn = drawn_face(320, 240)
    image, landmarks = drawn.image, drawn.landmarks
    mask = face_mask(image, landmarks)
    assert mask.dtype == np.float32
    assert mask.shape == image.shape[:2]
    assert mask.min() >= 0
    assert mask.max() <= 1
    for point in landmarks[[27, 30, 33, 51, 57, 39, 42]]:
        assert mask[int(point[1]), int(point[0])] > 0.8
    assert mask[:4].max() < 0.05
    assert mask[-4:].max() < 0.05
    assert mask[:, :4].max() < 0.05
    # A brow's width above the brows is still forehead.
    up = landmarks[19] - 0.12 * (landmarks[8] - landmarks[27])
    assert mask[int(up[1]), int(up[0])] > 0.5


def test_the_mask_of_a_large_face_is_that_of_a_small_one():
    """Blocks of pixels are looked at where there are many; places must not shift by part of one."""
    drawn = drawn_face(320, 240)
    mask = face_mask(drawn.image, drawn.landmarks)
    large = face_mask(drawn.image.repeat(5, 0).repeat(5, 1), drawn.landmarks * 5)
    height, width = mask.shape
    difference = large.reshape(height, 5, width, 5).mean((1, 3)) - mask
    assert np.abs(difference).mean() < 0.01
    # The middles agree to half a pixel of the small picture.
    rows, columns = np.indices(mask.shape)
    for axis in (rows, columns):
        assert abs((axis * difference).sum() / mask.sum()) < 0.5


def test_a_face_beyond_the_border_has_an_empty_mask():
    drawn = drawn_face(320, 240)
    assert not face_mask(drawn.image, drawn.landmarks + 2000).any()
    half = face_mask(drawn.image, drawn.landmarks - [drawn.landmarks[30, 0], 0])
    assert half.shape == drawn.image.shape[:2]
    assert half[:, :8].max() > 0.9


@pytest.mark.parametrize("turn", [1, 2, 3])
def test_the_mask_turns_with_the_picture(turn):
    drawn = drawn_face(320, 240)
    mask = face_mask(drawn.image, drawn.landmarks)
    image, landmarks = drawn.image, drawn.landmarks
    for _ in range(turn):
        landmarks = np.stack([landmarks[:, 1], image.shape[1] - landmarks[:, 0]], axis=1)
        image = np.ascontiguousarray(np.rot90(image))
    assert np.abs(np.rot90(mask, turn) - face_mask(image, landmarks)).mean() < 0.005


@pytest.mark.parametrize("hair", [(60, 40, 30), (250, 205, 120), (120, 170, 255)])
def test_hair_stays_out_of_the_mask_on_either_side_of_the_skin_color(hair):
    """Dark, warmer and cooler hair: the test of the color must be two-sided."""
    drawn = drawn_face(320, 240, hair=hair)
    mask = face_mask(drawn.image, drawn.landmarks)
    scale = drawn.landmarks[16, 0] - drawn.landmarks[0, 0]
    crown = drawn.landmarks[27] - (0, 0.72 * scale)
    assert (np.abs(drawn.image[int(crown[1]), int(crown[0])] - np.array(hair)) < 30).all()
    assert mask[int(crown[1]), int(crown[0])] < 0.2


def test_a_face_in_3d_is_found_again(monkeypatch):
    """With a detector that sees the truth but for half a pixel."""
    module = sys.modules["lfportrait.face.detect"]
    cameras = rig(16, 3)
    cameras = cameras[np.argsort(np.abs(cameras.position[:, 0]))]
    pixels, _ = cameras.project(HEAD_LANDMARKS)

    def detect(capture, view, thorough):
        return pixels[view] + np.random.default_rng(view).normal(0, 0.5, (68, 2))

    monkeypatch.setattr(module, "_detect", detect)
    capture = Capture(cameras, [np.zeros((500, 500, 3), np.uint8)] * 16, None,
                      [f"{i}" for i in range(16)], np.zeros(16, bool))
    points, figures = landmarks_of_capture(capture)
    assert np.abs(points - HEAD_LANDMARKS).max() < 0.03
    assert figures["views"] >= 14
    monkeypatch.setattr(module, "_detect", lambda capture, view, thorough: None)
    assert landmarks_of_capture(capture)[0] is None


@pytest.fixture
def networks(shared_weights, monkeypatch):
    monkeypatch.setenv("LFPORTRAIT_MODELS", str(shared_weights))


@pytest.mark.data
def test_detected_landmarks_agree_with_the_exemplars(shared_data, networks):
    """On all 14, faces that the landmarker alone misses included; two networks beat one."""
    single, mean = [], []
    for path in sorted((shared_data / "styles").glob("*.png")):
        image = np.ascontiguousarray(read_image(path)[..., :3])
        truth = read_landmarks(path.with_suffix(".landmarks.txt"))
        eyes = np.linalg.norm(truth[36] - truth[45])
        found = detect_landmarks(image)
        assert found is not None, path.name
        mean.append(np.linalg.norm(found - truth, axis=1).mean() / eyes)
        alone = detect_landmarks(image, thorough=False)
        single.append(np.nan if alone is None
                      else np.linalg.norm(alone - truth, axis=1).mean() / eyes)
    assert len(mean) == 14
    assert np.mean(mean) < 0.038
    assert max(mean) < 0.08
    both = np.isfinite(single)
    assert np.mean(np.array(mean)[both]) < np.mean(np.array(single)[both])


@pytest.mark.data
def test_turned_pictures_are_turned_back(shared_data, networks):
    image = np.ascontiguousarray(read_image(shared_data / "faceblit_reference" / "target1.png")
                                 [::2, ::2, :3])
    upright = detect_landmarks(image, thorough=False)
    for turn in (1, 2, 3):
        turned = np.ascontiguousarray(np.rot90(image, -turn))
        found = detect_landmarks(turned, turns=(turn,), thorough=False)
        height, width = image.shape[:2]
        x, y = upright.T
        wanted = {1: np.stack([height - y, x], 1), 2: np.stack([width - x, height - y], 1),
                  3: np.stack([y, width - x], 1)}[turn]
        assert np.abs(found - wanted).max() < 4


@pytest.mark.data
def test_the_face_api_network_gives_the_published_points(shared_data, shared_weights, networks):
    from lfportrait.face.detect import detect_face, landmarks_in_box

    expected = json.loads((shared_weights / "expected.json").read_text())["faceapi"]
    image = np.ascontiguousarray(read_image(shared_data / "faceblit_reference" / "target1.png")
                                 [..., :3])
    box, score = detect_face(image)
    assert np.abs(box - expected["tiny detector box x,y,w,h (416 input, conv0 without padding)"]
                  ).max() < 3
    assert score == pytest.approx(expected["score"], abs=0.01)
    assert np.abs(landmarks_in_box(image, box) - expected["landmarks68"]).max() < 2


@pytest.mark.data
def test_mattes_find_person_and_hair(shared_data, networks):
    image = np.ascontiguousarray(read_image(shared_data / "faceblit_reference" / "target1.png")
                                 [..., :3])
    person, hair = person_matte(image), hair_mask(image)
    assert person[600, 384] > 0.95  # the face
    assert person[40, 60] < 0.05  # the sky
    assert hair[80, 380] > 0.7
    assert hair[600, 384] < 0.05
    lying = person_matte(np.ascontiguousarray(np.rot90(image)), up=np.array([-1.0, 0.0]))
    assert np.abs(np.rot90(lying, -1) - person).mean() < 0.02


@pytest.mark.data
def test_no_face_is_found_where_there_is_none(shared_data, networks):
    noise = np.random.default_rng(0).integers(0, 256, (200, 200, 3), dtype=np.uint8)
    assert detect_landmarks(noise) is None


@pytest.mark.parametrize(("radius", "kept"), [(150, False), (30, True)])
def test_an_ear_in_a_crop_is_no_face(monkeypatch, radius, kept):
    """A profile's ear is taken for a face in crops; a person is all around it."""
    module = sys.modules["lfportrait.face.detect"]
    photo = np.zeros((300, 300, 3), np.uint8)
    photo[150, 150] = 255
    ear = np.zeros((68, 2))
    ear[17:27, 1], ear[8, 1] = -10.0, 15.0

    def meshes(image, most=1):
        row, column = np.argwhere(image[..., 0] == 255)[0]
        return [] if len(image) == 300 else [ear + np.array([column, row])]

    y, x = np.mgrid[:300, :300]
    matte = (np.hypot(x - 150, y - 150) < radius).astype(np.float32)
    monkeypatch.setattr(module, "_meshes", meshes)
    monkeypatch.setattr(module, "_second_opinion", lambda image, points: points)
    monkeypatch.setattr(module.models, "available", lambda name: name == "person-segmentation")
    monkeypatch.setattr("lfportrait.face.segmentation.person_matte", lambda image: matte)
    monkeypatch.setattr(module, "_windows", lambda height, width: [
        (0, 0, width, height), (45, 45, 255, 255)])
    found = module.detect_landmarks(photo)
    assert (found is not None) == kept
    assert not kept or np.array_equal(found, ear + 150)


def test_the_whole_mesh_is_in_pixels(monkeypatch):
    module = sys.modules["lfportrait.face.detect"]
    points = [SimpleNamespace(x=0.25, y=0.5)] * 478
    faces = [[points], []]
    detector = SimpleNamespace(detect=lambda _: SimpleNamespace(face_landmarks=faces.pop(0)))
    monkeypatch.setattr(module, "_landmarker", lambda path, most: detector)
    monkeypatch.setattr(module.models, "fetch", lambda name: name)
    monkeypatch.setattr(module, "picture", lambda image: image)
    image = np.zeros((40, 80, 3), np.uint8)
    mesh = face_mesh(image)
    assert mesh.shape == (478, 2) and (mesh == (20, 20)).all()
    assert face_mesh(image) is None
