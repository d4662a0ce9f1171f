"""The last adjustment frees as many terms of the lens as there are, in made-up scenes."""

import numpy as np
import pytest

from lfportrait.capture.calibration import mapping
from lfportrait.capture.calibration.mapping import adjust, starting_model
from lfportrait.capture.lenses import Lens


def scene(pycolmap, model, parameters, noise=0.3, views=14, points=200):
    """A reconstruction as it would be found with a lens without terms: true places, but pixels of a
    lens that has some."""
    random = np.random.default_rng(4)
    pycolmap.set_random_seed(0)
    truth = pycolmap.Camera(model=model, width=800, height=600, params=parameters, camera_id=1)
    found = pycolmap.Reconstruction()
    guess = pycolmap.Camera.create_from_model_name(1, "SIMPLE_PINHOLE", parameters[0], 800, 600)
    found.add_camera_with_trivial_rig(guess)
    # As wide as the picture, so that its corners show something.
    reach = 0.45 * 800 / parameters[0] * 4
    places = random.uniform(-1, 1, (points, 3)) * (reach, 0.75 * reach, 0.8)
    tracks = [pycolmap.Track() for _ in places]
    for view in range(views):
        angle = np.radians(-30 + 60 * view / (views - 1))
        rotation = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0],
                             [-np.sin(angle), 0, np.cos(angle)]])
        shift = np.array([0.1 * np.sin(view), 0.1 * np.cos(view), 4.0])
        local = places @ rotation.T + shift
        pixels = np.array(truth.img_from_cam(local)) + random.normal(0, noise, (points, 2))
        inside = (pixels > 0).all(1) & (pixels < (800, 600)).all(1)
        image = pycolmap.Image(name=f"{view:05d}", keypoints=pixels[inside], camera_id=1,
                               image_id=view + 1)
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(rotation), shift)
        found.add_image_with_trivial_frame(image, pose)
        for place, point in enumerate(np.flatnonzero(inside)):
            tracks[point].add_element(view + 1, place)
    for place, track in zip(places, tracks):
        if track.length() >= 3:
            found.add_point3D(place, track)
    return found


@pytest.fixture(scope="module")
def pycolmap():
    import pycolmap

    pycolmap.logging.minloglevel = pycolmap.logging.Level.FATAL.value
    return pycolmap


# Longer lenses have their terms counted as short ones.
@pytest.mark.parametrize("model, parameters, expected", [
    ("SIMPLE_PINHOLE", [900.0, 400, 300], "SIMPLE_PINHOLE"),
    pytest.param("SIMPLE_PINHOLE", [3000.0, 400, 300], "SIMPLE_PINHOLE", marks=pytest.mark.slow),
    ("SIMPLE_RADIAL", [900.0, 400, 300, -0.08], "SIMPLE_RADIAL"),
    ("RADIAL", [600.0, 400, 300, -0.2, 0.12], "RADIAL")])
def test_as_many_terms_as_there_are(pycolmap, model, parameters, expected):
    found = adjust(scene(pycolmap, model, parameters), "auto")
    camera = found.cameras[1]
    assert camera.model.name == expected
    terms = np.array(camera.params)[list(camera.extra_params_idxs())]
    assert np.allclose(terms, parameters[3:], atol=0.02)
    assert found.compute_mean_reprojection_error() < 0.5


def test_the_centre_of_a_cropped_picture(pycolmap):
    found = adjust(scene(pycolmap, "SIMPLE_PINHOLE", [900.0, 450, 260]), "auto")
    assert found.cameras[1].principal_point_x == pytest.approx(450, abs=4)
    assert found.cameras[1].principal_point_y == pytest.approx(260, abs=4)


def test_a_lens_that_is_wished_for_is_fitted(pycolmap):
    found = adjust(scene(pycolmap, "SIMPLE_PINHOLE", [900.0, 400, 300]), "OPENCV")
    assert found.cameras[1].model.name == "OPENCV"
    assert found.cameras[1].focal_length_x == pytest.approx(900, rel=0.02)
    assert starting_model("OPENCV") == starting_model("auto") == "SIMPLE_RADIAL"


@pytest.mark.parametrize("turns", [1, 2, 3, 4])
def test_a_turned_lens_sees_the_turned_picture(turns):
    lens = Lens(80, 60, (70.0, 71.0), (41.0, 28.0), "opencv", (-0.1, 0.03), (0.01, -0.02))
    turned = lens
    pixels = np.array([[3.0, 5.0], [70.0, 11.0], [44.0, 52.0]])
    flat = (pixels - lens.center) / lens.focal
    there = lens.distort(flat) * lens.focal + lens.center
    for _ in range(turns):
        # Clockwise: (x, y) -> (H - y, x), and directions likewise.
        there = np.stack([turned.height - there[:, 1], there[:, 0]], 1)
        flat = np.stack([-flat[:, 1], flat[:, 0]], 1)
        turned = turned.turned()
    assert np.allclose(turned.distort(flat) * turned.focal + turned.center, there)
    if turns == 4:
        assert turned == lens


def sweep(pycolmap, wrong=0.3, noise=0.25, focal=648.0, views=32, points=400):
    """A narrow sweep before a head, as it would be found with a focal length that is 6 % too short.

    From some photo on, wrong tracks go on at a place up to three pixels aside, in each direction.
    """
    random = np.random.default_rng(0)
    pycolmap.set_random_seed(0)
    size = np.array((405, 720))
    found = pycolmap.Reconstruction()
    found.add_camera_with_trivial_rig(pycolmap.Camera.create_from_model_name(
        1, "SIMPLE_PINHOLE", 0.94 * focal, *size))
    places = random.normal(size=(points, 3))
    places[:, 2] = np.abs(places[:, 2])
    places *= np.array((0.35, 0.5, 0.45)) / np.linalg.norm(places, axis=1, keepdims=True)
    aside = random.uniform(-3, 3, (points, 2))
    since = random.integers(0, views, points)
    strays = random.random(points) < wrong
    tracks = [pycolmap.Track() for _ in places]
    for view in range(views):
        angle = np.radians(-14 + 28 * view / (views - 1))
        rotation = np.array([[np.cos(angle), 0, np.sin(angle)], [0, -1, 0],
                             [np.sin(angle), 0, -np.cos(angle)]])
        shift = np.array([0.02 * np.sin(view), 0.02 * np.cos(view), 2.45 + 0.05 * np.sin(view / 5)])
        local = places @ rotation.T + shift
        pixels = local[:, :2] / local[:, 2:] * focal + size / 2
        pixels += random.normal(0, noise, (points, 2)) + aside * (strays & (view >= since))[:, None]
        seen = np.flatnonzero(np.abs(view - since) < 12)
        image = pycolmap.Image(name=f"{view:05d}", keypoints=pixels[seen], camera_id=1,
                               image_id=view + 1)
        found.add_image_with_trivial_frame(
            image, pycolmap.Rigid3d(pycolmap.Rotation3d(rotation), shift))
        for keypoint, point in enumerate(seen):
            tracks[point].add_element(view + 1, keypoint)
    for place, track in zip(places, tracks):
        found.add_point3D(place, track)
    return found


@pytest.mark.slow  # many matches
def test_wrong_matches_do_not_bend_the_focal_length_of_a_narrow_sweep(pycolmap):
    found = adjust(sweep(pycolmap), "auto")
    camera = found.cameras[1]
    assert camera.model.name == "SIMPLE_PINHOLE"
    assert camera.mean_focal_length() == pytest.approx(648, rel=0.015)


def test_right_matches_err_the_same_whatever_wrong_ones_do():
    random = np.random.default_rng(0)
    right = np.linalg.norm(random.normal(0, 0.2, (7000, 2)), axis=1)
    matches = np.concatenate([right, random.uniform(1, 6, 3000)])
    for nearest in (0.25, 0.5):
        assert mapping._deviation(right, nearest) == pytest.approx(0.2, rel=0.04)
    assert mapping._deviation(matches, 0.25) < 0.25 < mapping._deviation(matches)


def test_the_last_loss_is_not_as_wide_as_points_that_were_just_found_again(pycolmap, monkeypatch):
    widths = []
    solve = mapping._solve

    def noting(model, deviation, *options, **more):
        widths.append(deviation)
        return solve(model, deviation, *options, **more)

    def found_again(model):
        random = np.random.default_rng(1)
        for point in model.points3D.values():
            point.xyz = point.xyz + random.normal(0, 0.01, 3)
        return model

    monkeypatch.setattr(mapping, "_solve", noting)
    found = adjust(scene(pycolmap, "SIMPLE_PINHOLE", [900.0, 400, 300]),
                   "SIMPLE_PINHOLE", found_again)
    assert widths[-1] < 0.35  # not the 2 pixels that the points were moved by
    assert found.cameras[1].mean_focal_length() == pytest.approx(900, rel=0.01)
