"""Quality best of a photo: patches of like material around the face that StyleBlit painted."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import binary_erosion, gaussian_filter

from lfportrait.cli import main
from lfportrait.example import Exemplar, Transfer, TransferConfig
from lfportrait.example.guides.regions import find_regions, soft_face
from lfportrait.example.painter import photo as module
from lfportrait.files import write_image
from tests.portraits import drawn_face

HEIGHT, WIDTH = 240, 200
GROUND, HAIR, SKIN = (240, 235, 220), (200, 60, 20), (90, 150, 200)


def dressed(face: Exemplar, pattern) -> Exemplar:
    """The same with another shirt: the luma of ``pattern(x, y)`` in [-1, 1] on a plain color."""
    image = face.image.copy()
    shirt = np.abs(np.int32(image) - (160, 60, 50)).max(axis=-1) < 40
    shirt &= np.indices(shirt.shape)[0] > face.landmarks[8, 1]
    y, x = np.nonzero(shirt)
    image[shirt] = np.clip(np.array([70, 110, 60]) + 60 * pattern(x, y)[:, None], 0, 255)
    return replace(face, image=image)


@pytest.fixture(scope="module")
def style():
    """A painting on plain paper with a shirt of all tones."""
    face = drawn_face(HEIGHT, WIDTH, seed=3, skin=SKIN, hair=HAIR, ground=GROUND)
    cloth = gaussian_filter(np.random.default_rng(0).normal(0, 1, (HEIGHT, WIDTH)), 2.0)
    cloth /= np.abs(cloth).max()
    return dressed(face, lambda x, y: cloth[y, x])


@pytest.fixture(scope="module")
def photo():
    """A smaller face before a loud wall, in a striped shirt."""
    face = drawn_face(HEIGHT, WIDTH, seed=1)
    face = dressed(face, lambda x, y: np.sign(np.sin(x / 4)))
    wall = face.mask < 0.5
    image = face.image.copy()
    image[wall] = (np.indices(wall.shape).sum(axis=0)[wall] // 9 % 2)[:, None] * 200
    return replace(face, image=image)


@pytest.fixture(scope="module")
def regions(photo):
    return find_regions(photo.image, photo.landmarks, photo.mask, networks=False)


@pytest.fixture(scope="module")
def results(style, photo, regions):
    """The photo painted in both qualities."""
    return {quality: Transfer(style, TransferConfig(quality=quality)).apply(
        photo.image, photo.landmarks, regions=regions) for quality in ("fast", "best")}


def inside(mask, border=4):
    return binary_erosion(mask, iterations=border)


def below_brows(photo):
    return np.indices(photo.mask.shape)[0] > photo.landmarks[17:27, 1].max()


def test_fast_is_the_default_of_the_class(style, photo, regions, results):
    assert TransferConfig().quality == "fast"
    plain = Transfer(style).apply(photo.image, photo.landmarks, regions=regions)
    assert plain.image.tobytes() == results["fast"].image.tobytes()
    assert "patches_seconds" not in results["fast"].seconds
    assert results["best"].seconds["patches_seconds"] > 0


def test_frames_of_videos_are_fast(style, photo, regions):
    anchor = np.float32(np.moveaxis(np.indices((HEIGHT, WIDTH))[::-1], 0, -1) + 0.5)
    made = [Transfer(style, TransferConfig(quality=quality)).apply(
        photo.image, photo.landmarks, regions=regions, seeds_anchor=anchor).image
        for quality in ("fast", "best")]
    assert made[0].tobytes() == made[1].tobytes()


def test_the_face_stays(photo, results):
    face = inside(soft_face(photo.image.shape, photo.landmarks) > 140, 2)
    assert face.sum() > 1000
    same = (results["best"].image == results["fast"].image).all(axis=-1)
    # At the temples and under a fringe the shade of the exemplar's hair may lie.
    low = face & below_brows(photo)
    assert same[face].mean() > 0.95 and same[low].mean() > 0.98
    assert same[inside(face, 6) & low].all()


def test_outline_and_hair_are_the_photos(photo, regions, results):
    colors = np.float32([GROUND, HAIR, SKIN]) / 255
    away = np.linalg.norm(results["best"].image[:, :, None] - colors, axis=-1)
    nearest = away.argmin(axis=-1)
    wall, hair = inside(photo.mask < 0.5), inside(regions.hair > 0.8)
    assert wall.sum() > 5000 and hair.sum() > 500
    assert (nearest[wall] == 0).mean() > 0.995
    assert (nearest[hair] == 1).mean() > 0.95
    assert (away[..., 0][inside(photo.mask > 0.5, 6)] > 0.15).mean() > 0.98


def test_a_painted_scarf_is_no_neck(style, photo):
    def with_neck(face, color):
        """The face with the neck, which is drawn in the shirt's color, in another."""
        x, y = face.landmarks[8]
        rows, columns = np.indices(face.mask.shape)
        neck = (np.abs(columns - x) < 17) & (rows > y + 2) & (rows < y + 20)
        image = face.image.copy()
        image[neck] = np.clip(np.random.default_rng(0).normal(color, 6, (neck.sum(), 3)), 0, 255)
        return replace(face, image=image), inside(neck, 3)

    scarf = (40, 190, 60)
    painting, _ = with_neck(style, scarf)
    sitter, neck = with_neck(photo, (225, 180, 150))
    found = find_regions(sitter.image, sitter.landmarks, sitter.mask, networks=False)
    made = Transfer(painting, TransferConfig(quality="best")).apply(
        sitter.image, sitter.landmarks, regions=found).image
    skin, green = (np.linalg.norm(made[neck] - np.float32(color) / 255, axis=-1)
                   for color in (SKIN, scarf))
    assert neck.sum() > 150 and (skin < green).mean() > 0.95


def test_paper_stays_plain(style, photo, results):
    wall = inside(photo.mask < 0.5, 6)
    paper = inside(style.mask < 0.5, 6)
    assert results["best"].image[wall].std(axis=0).max() <= 1.5 * (
        style.image[paper] / 255).std(axis=0).max()


def test_a_pattern_survives_in_the_exemplars_paint(photo, results):
    below = np.indices(photo.mask.shape)[0] > photo.landmarks[8, 1] + 12
    shirt = inside((photo.mask > 0.5) & below, 5)
    assert shirt.sum() > 1000

    def agreement(image):
        across = [np.gradient(gaussian_filter(np.float32(picture).mean(axis=-1), 1), axis=1)[shirt]
                  for picture in (photo.image, image)]
        return np.corrcoef(*across)[0, 1]

    assert agreement(results["best"].image) > max(0.5, agreement(results["fast"].image) + 0.2)


@pytest.mark.slow  # paints a photo twice; in a video: test_video.py
def test_the_seed_decides(style, photo, regions, results):
    config = TransferConfig(quality="best")
    again = Transfer(style, config).apply(photo.image, photo.landmarks, regions=regions)
    assert again.image.tobytes() == results["best"].image.tobytes()
    other = Transfer(style, replace(config, seed=1)).apply(photo.image, photo.landmarks,
                                                           regions=regions)
    assert other.image.tobytes() != again.image.tobytes()


def test_large_photos_are_refined_small(style, photo, regions, results, monkeypatch):
    monkeypatch.setattr(module, "LARGEST", HEIGHT * WIDTH / 2)
    made = Transfer(style, TransferConfig(quality="best")).apply(photo.image, photo.landmarks,
                                                                 regions=regions).image
    face = inside(soft_face(photo.image.shape, photo.landmarks) > 140, 8) & below_brows(photo)
    assert made.shape == photo.image.shape and np.isfinite(made).all()
    assert np.abs(made[face] - results["fast"].image[face]).max() < 1e-6
    assert np.abs(made - results["best"].image).mean() < 0.06


def test_a_part_of_a_photo_in_floats(style, photo, regions):
    config = TransferConfig(quality="best", extent="head", strength=0.5)
    image = np.float32(photo.image / 255)
    made = Transfer(style, config).apply(image, photo.landmarks, regions=regions).image
    wall = inside(photo.mask < 0.5, 10)
    assert np.abs(made[wall] - image[wall]).max() < 0.02


@pytest.mark.parametrize("words, wanted", [
    ([], "best"), (["--quality", "fast"], "fast"), (["--quality", "best"], "best")])
def test_the_command_line_chooses(tmp_path, style, monkeypatch, words, wanted):
    asked = []
    monkeypatch.setattr("lfportrait.cli.stylization.Exemplar.load", lambda name: style)
    monkeypatch.setattr("lfportrait.cli.stylization.transfer_photo",
                        lambda path, out, exemplar, config, *_: asked.append(config.quality) or {})
    monkeypatch.setattr("lfportrait.cli.stylization.transfer_video",
                        lambda path, out, exemplar, config, *_: asked.append(config.quality) or {})
    write_image(tmp_path / "photo.png", style.image)
    (tmp_path / "film.mp4").write_bytes(b"")
    for name in ("photo.png", "film.mp4"):
        assert main(["transfer", str(tmp_path / name), "--style", "any", "--out",
                     str(tmp_path / "out.png"), "--quiet", *words]) == 0
    assert asked == [wanted, "fast"]
