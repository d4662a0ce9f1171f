"""What an exemplar knows of itself."""

from dataclasses import replace

import numpy as np
import pytest

from lfportrait import models
from lfportrait.errors import UserError
from lfportrait.example import Exemplar
from lfportrait.example import exemplar as module
from lfportrait.face import face_pose
from lfportrait.files import write_image
from tests.portraits import drawn_face


@pytest.fixture
def found(monkeypatch):
    """Networks that are at hand, and how often a picture was looked at."""
    looked = []

    def find(image, landmarks, mask=None):
        looked.append(image.shape)
        return real(image, landmarks, mask, networks=False)
    real = module.find_regions
    monkeypatch.setattr(module, "find_regions", find)
    monkeypatch.setattr(models, "in_use", lambda names: ["a hash"])
    return looked


def test_what_networks_see_in_a_painting_is_kept(found, monkeypatch, kept_folder):
    face = drawn_face(96, 72)
    first, again = face.regions(), drawn_face(96, 72).regions()
    assert len(found) == 1 and len(list((kept_folder / "regions").iterdir())) == 1
    assert np.array_equal(first.person, again.person) and np.array_equal(first.hair, again.hair)
    whole = module.find_regions(face.image, face.landmarks, face.mask)
    assert np.abs(first.person - whole.person).max() < 1e-5
    assert np.abs(first.hair - whole.hair).max() < 1e-5
    # Another painting, other landmarks, other networks.
    drawn_face(96, 72, seed=1).regions()
    face.landmarks += 0.5
    face.regions()
    monkeypatch.setattr(models, "in_use", lambda names: ["another"])
    face.regions()
    assert len(found) == 5


def test_the_pose_of_a_painted_face_is_kept(monkeypatch, kept_folder):
    face = drawn_face(96, 72)
    wanted = face_pose(face.landmarks)
    first = face.pose()
    monkeypatch.setattr(module.face, "face_pose", lambda landmarks: pytest.fail("computed again"))
    for pose in (first, drawn_face(96, 72).pose()):
        assert np.array_equal(pose.rotation, wanted.rotation)
        assert np.array_equal(pose.shift, wanted.shift)
        assert (pose.scale, pose.residual) == (wanted.scale, wanted.residual)


def test_a_painting_whose_hair_is_not_told_has_none(found, monkeypatch):
    face = drawn_face(96, 72)
    monkeypatch.setattr(module, "find_regions", lambda image, landmarks, mask: module.Regions(
        landmarks, mask, None))
    assert face.regions().hair is None and face.regions().hair is None


def test_without_networks_nothing_is_written(found, monkeypatch, kept_folder):
    monkeypatch.setattr(models, "in_use", lambda names: [])
    face = drawn_face(96, 72)
    face.regions()
    face.regions()
    assert len(found) == 2 and not kept_folder.exists()


def test_the_face_of_a_painting_is_looked_for_once(monkeypatch, tmp_path):
    face, looked = drawn_face(96, 72), []

    def find(image, thorough):
        looked.append(thorough)
        return [face.landmarks, face.landmarks + 1]
    monkeypatch.setattr("lfportrait.face.detect_faces", find)
    write_image(tmp_path / "painting.png", face.image)
    for _ in range(2):
        exemplar = Exemplar.load(tmp_path / "painting.png")
        assert exemplar.faces == 2 and np.array_equal(exemplar.landmarks, face.landmarks)
    assert looked == [False]
    # That there is none, too.
    monkeypatch.setattr("lfportrait.face.detect_faces", lambda image, thorough: [])
    write_image(tmp_path / "wall.png", face.image[::-1])
    for _ in range(2):
        with pytest.raises(UserError, match="no face found in the style"):
            Exemplar.load(tmp_path / "wall.png")


def test_an_exemplar_is_made_as_small_as_asked():
    face = drawn_face(240, 180)
    small = face.within(face.size / 3)
    assert small.image.shape == (80, 60, 3) and small.mask.shape == (80, 60)
    assert small.size == pytest.approx(face.size / 3, rel=1e-6) and small.name == face.name
    # Each pixel is the mean of those that it covers.
    means = face.image.reshape(80, 3, 60, 3, 3).mean(axis=(1, 3))
    assert np.abs(small.image - means).max() <= 1
    assert np.allclose(small.mask, face.mask.reshape(80, 3, 60, 3).mean(axis=(1, 3)), atol=1e-5)
    hatted = replace(face, hat=face.mask.copy()).within(face.size / 3)
    assert hatted.hat.shape == hatted.image.shape[:2]
    bare = Exemplar(face.image, face.landmarks).within(face.size / 2.3)
    assert bare.mask is None and bare.size == pytest.approx(face.size / 2.3, rel=0.02)
    assert face.within(face.size) is face and face.within(1e9) is face
