"""A head stylised on its skin: previews, several styles, what is told and what is kept."""

from dataclasses import replace

import numpy as np
import pytest

from lfportrait.capture import Camera
from lfportrait.errors import UserError
from lfportrait.example import Exemplar, Skin, SkinPainter, eye_openings
from lfportrait.example.skin.storage import save_skin
from lfportrait.job.warmup import ball_capture
from lfportrait.stylize import (
    Painters,
    StyledField,
    StylizeConfig,
    kept_skin,
    paint,
    stylization,
    stylize_with_figures,
)
from lfportrait.stylize.stylization import mouth_opening, notices
from tests.fields import head_field
from tests.portraits import HEAD_LANDMARKS, drawn_face

SMALL = StylizeConfig(pixels=80.0, steps=2, content_network="embedded", style_network="embedded")
PREVIEW = replace(SMALL, preview=True)


def named(name, seed=0, **colors):
    face = drawn_face(160, 120, seed=seed, **colors)
    return Exemplar(face.image, face.landmarks, name, face.mask)


@pytest.fixture(scope="module")
def head():
    return head_field()


@pytest.fixture(scope="module")
def capture():
    return replace(ball_capture(), landmarks=HEAD_LANDMARKS)


@pytest.fixture(scope="module")
def violet():
    return named("violet", skin=(120, 90, 200), hair=(20, 90, 40))


@pytest.fixture(scope="module")
def skin(head, capture):
    """The head's surface, as a stylisation that is given none finds it."""
    return Skin.of(head, capture.landmarks, capture.cameras, SMALL.pixels)


@pytest.fixture(scope="module")
def styled(head, capture, violet):
    return stylize_with_figures(head, capture, violet, SMALL)


def front(field):
    camera = Camera.arc([0.0], distance=4.0, width=96, height=96, focal=170.0)
    return np.clip(field.render(camera).color, 0, 1), field.render(camera).alpha > 0.9


def test_a_head_takes_on_the_exemplars_colors(head, styled, violet):
    field, figures = styled
    assert isinstance(field, StyledField) and field.basis == 1
    assert np.array_equal(field.density, head.density) and field.links is head.links
    picture, inside = front(field)
    # Of head and hair: the exemplar's red collar is nothing for a bare neck.
    chin = int(violet.landmarks[8, 1])
    palette = violet.image[:chin][violet.mask[:chin] > 0.5].mean(0) / 255
    real = front(head)[0][inside].mean(0)
    assert np.linalg.norm(picture[inside].mean(0) - palette) < 0.6 * np.linalg.norm(real - palette)
    assert figures["method"] == "skin" and "fit" not in figures
    assert field.texture is not None and field.texture.texels.any()
    assert figures["refinement"]["steps"] == 2
    assert set(figures["pose"]) == {"yaw", "pitch", "roll"} and abs(figures["pose"]["yaw"]) < 9
    assert set(figures["seconds"]) == {"paint", "fit", "texture", "refine", "ground", "vignette",
                                       "total"}


@pytest.fixture(scope="module")
def large():
    face = drawn_face(640, 480, seed=2, skin=(200, 160, 90))
    return Exemplar(face.image, face.landmarks, "large", face.mask)


def test_a_preview_is_painted_by_a_picture_that_is_no_finer_than_itself(
        skin, large, monkeypatch):
    # What painters are made of: to prepare them takes a second each.
    monkeypatch.setattr(stylization, "SkinPainter", lambda exemplar, *_: exemplar)
    monkeypatch.setattr(stylization, "LEAST", 10.0)
    quick, whole = (Painters().of(large, skin, one) for one in (PREVIEW, SMALL))
    assert 0.94 * skin.face / 2 < quick.size < 1.02 * skin.face / 2
    assert 0.95 * 2 * skin.face < whole.size < 1.05 * 2 * skin.face < large.size
    monkeypatch.setattr(stylization, "LEAST", 48.0)
    assert 45 < Painters().of(large, skin, PREVIEW).size < 49


def test_the_picture_of_a_preview_stays_the_same_while_a_landmark_moves(skin, large, monkeypatch):
    monkeypatch.setattr(stylization, "SkinPainter", lambda exemplar, *_: exemplar)
    pictures = []
    for aside in (0.0, 4.0):
        points = large.landmarks.copy()
        points[30, 0] += aside
        pictures.append(Painters().of(replace(large, landmarks=points), skin, PREVIEW))
    assert all(np.array_equal(one.image, pictures[0].image) for one in pictures)
    assert pictures[1].landmarks[30, 0] > pictures[0].landmarks[30, 0]


@pytest.mark.slow  # how fine its picture is: above
def test_a_preview_by_a_small_picture_is_like_one_by_the_whole(head, capture, large, monkeypatch):
    skin = Skin.of(head, capture.landmarks, capture.cameras, 160.0)
    quick, inside = front(stylize_with_figures(head, capture, large, PREVIEW, skin=skin)[0])
    monkeypatch.setattr(stylization, "PREVIEWED", 4.0)
    whole, _ = front(stylize_with_figures(head, capture, large, PREVIEW, skin=skin)[0])
    away = np.abs(quick - whole)[inside]
    assert 0 < away.mean() < 0.02 and np.quantile(away, 0.95) < 0.1


@pytest.mark.slow  # so does its painter: tests/example/skin/test_painting.py
def test_the_same_seed_gives_the_same_bytes(head, capture, violet, styled, skin):
    again, _ = stylize_with_figures(head, capture, violet, SMALL, skin=skin)
    assert np.array_equal(again.sh, styled[0].sh)
    other, _ = stylize_with_figures(head, capture, violet, replace(SMALL, seed=1), skin=skin)
    assert not np.array_equal(other.sh, styled[0].sh)


def test_a_preview_is_like_the_whole_without_fit_and_losses(head, capture, violet, styled, skin):
    field, figures = stylize_with_figures(head, capture, violet, PREVIEW, skin=skin)
    assert "fit" not in figures and "refinement" not in figures
    whole, inside = front(styled[0])
    assert np.abs(front(field)[0] - whole)[inside].mean() < 0.06


@pytest.mark.slow  # fits: tests/stylize/test_stylize.py
def test_the_fit_comes_nearer_to_what_was_painted(head, capture, violet, skin, monkeypatch):
    monkeypatch.setattr(stylization, "RELAXATION", 1.0)
    config = replace(SMALL, steps=0, fit_iterations=6)
    errors = stylize_with_figures(head, capture, violet, config, skin=skin)[1]["fit"]["rmse"]
    assert errors[-1] < 0.9 * errors[0]


@pytest.mark.slow  # paints thrice; what a file of two does: test_mixing.py
def test_several_styles_share_one_file(head, capture, violet, styled, skin, tmp_path):
    green = named("green", seed=2, skin=(90, 200, 90), hair=(200, 30, 30))
    both, figures = stylize_with_figures(head, capture, [violet, green], SMALL, skin=skin)
    assert both.styles == ("violet", "green")
    assert np.array_equal(both.painted[0], styled[0].painted[0]), "the first is as if alone"
    assert [row["style"] for row in figures["styles"]] == ["violet", "green"]
    both.save(tmp_path / "both.npz")
    other = StyledField.load(tmp_path / "both.npz").mix(style="green")
    alone, _ = stylize_with_figures(head, capture, green, SMALL, skin=skin)
    assert np.abs(front(other)[0] - front(alone)[0]).max() < 0.02
    with pytest.raises(UserError, match="at least one"):
        stylize_with_figures(head, capture, [], SMALL)


def test_regions_can_be_kept_from_the_photo(head, capture, violet, skin):
    kept, _ = stylize_with_figures(head, capture, violet, replace(PREVIEW, keep=("clothes",)),
                                   skin=skin)
    clothes = kept.labels[:, kept.regions.index("clothes")] > 250
    assert clothes.sum() > 100
    assert np.abs(kept.sh[clothes, :, 0] * 0.28209479 + 0.5 - kept.photo[clothes]).max() < 0.02
    with pytest.raises(UserError, match="hat"):
        stylize_with_figures(head, capture, violet, replace(PREVIEW, keep=("hat",)), skin=skin)


@pytest.mark.slow  # how much is used: `test_a_preview_is_painted_by_a_picture_that_is_no_finer...`
def test_of_a_large_exemplar_no_more_is_used_than_the_skin_can_show(head, capture):
    skin = Skin.of(head, capture.landmarks, capture.cameras, 40.0)
    large = drawn_face(640, 480)
    assert large.size > 2 * skin.face
    painting = paint(skin, large, PREVIEW)
    assert np.array_equal(painting.color, paint(skin, large.within(2 * skin.face), PREVIEW).color)
    # The same paint: in the mean hardly other than that of all pixels.
    whole = SkinPainter(large).paint(skin, 2)
    own = np.isfinite(whole.color).all(axis=-1) & (whole.color.sum(axis=-1) > 0)
    assert np.abs(painting.color[own].mean(axis=0) - whole.color[own].mean(axis=0)).max() < 0.03


def test_without_agreement_chunks_alone_paint_the_head(head, capture, violet, skin):
    config = replace(PREVIEW, skin=replace(PREVIEW.skin, patchmatch=False))
    field, figures = stylize_with_figures(head, capture, violet, config, skin=skin)
    assert "patches" not in figures["painting"]
    assert np.isfinite(field.sh).all()


@pytest.mark.slow  # one that is too old: below
def test_a_skin_is_kept_beside_its_field(head, capture, tmp_path, monkeypatch):
    path = tmp_path / "field.npz"
    head.save(path)
    skin = kept_skin(path, head, capture, 40.0)
    assert (tmp_path / "field.skin.npz").exists()
    monkeypatch.setattr("lfportrait.example.Skin.of", None)
    again = kept_skin(path, head, capture, 40.0)
    assert np.array_equal(again.rows, skin.rows, equal_nan=True)
    violet = named("violet", skin=(120, 90, 200))
    assert np.abs(paint(skin, violet, PREVIEW).color
                  - paint(again, violet, PREVIEW).color).mean() < 0.02
    with pytest.raises(TypeError):  # another resolution is another skin
        kept_skin(path, head, capture, 44.0)
    monkeypatch.undo()
    with pytest.raises(UserError, match="landmarks"):
        kept_skin(path, head, replace(capture, landmarks=None), 40.0)


def test_an_older_file_is_made_again(head, capture, tmp_path):
    path, beside = tmp_path / "field.npz", tmp_path / "field.skin.npz"
    head.save(path)
    skin = kept_skin(path, head, capture, 40.0)
    fresh = beside.read_bytes()
    save_skin(skin, beside, "the key of other code")
    assert np.array_equal(kept_skin(path, head, capture, 40.0).rows, skin.rows, equal_nan=True)
    assert beside.read_bytes() == fresh


def test_a_skin_that_cannot_be_written_is_computed_each_time(head, capture, tmp_path):
    path = tmp_path / "head.npz"
    head.save(path)
    beside = path.with_suffix(".skin.npz")
    beside.mkdir()  # a file can't take its place
    (beside / "mine").touch()
    assert len(kept_skin(path, head, capture, 40.0).index) > 1000
    assert sorted(file.name for file in tmp_path.iterdir()) == ["head.npz", "head.skin.npz"]


def test_closed_eyes_and_open_mouths_are_told(capture, violet):
    shut, wide = violet.landmarks.copy(), violet.landmarks.copy()
    for upper, lower in ((37, 41), (38, 40), (43, 47), (44, 46)):
        middle = 0.5 * (shut[upper] + shut[lower])
        shut[upper], shut[lower] = middle, middle
        half = np.array([0, 0.16 * np.linalg.norm(shut[39] - shut[36])])
        wide[upper], wide[lower] = middle - half, middle + half
    for upper, lower in ((61, 67), (62, 66), (63, 65)):
        middle = 0.5 * (wide[upper] + wide[lower])
        gap = np.array([0, 8])
        wide[upper], wide[lower] = middle - gap, middle + gap
        shut[upper], shut[lower] = middle, middle
    assert max(eye_openings(shut)) == 0 and min(eye_openings(wide)) > 0.3
    assert mouth_opening(shut) == 0 and mouth_opening(wide) > 0.2
    asleep = replace(capture, landmarks=np.column_stack([shut, np.zeros(68)]))
    awake = Exemplar(np.zeros((900, 900, 3), np.uint8), wide * 6, "awake")
    lines = notices(asleep, [awake], SMALL)
    assert len(lines) == 2 and "eyes are closed" in lines[0] and "mouth is closed" in lines[1]
    assert notices(asleep, [awake], replace(SMALL, keep=("eyes", "lips"))) == []
    small = Exemplar(np.zeros((900, 900, 3), np.uint8), shut, "small")
    assert ["coarse" in line for line in notices(asleep, [small], SMALL)] == [True]


@pytest.mark.parametrize(("changes", "message"), [
    ({"pixels": 0.0}, "--pixels"), ({"pixels": 1e6}, "--pixels"),
    ({"method": "paper", "preview": True}, "--preview")])
def test_parameters_out_of_range_are_told(head, capture, violet, changes, message):
    with pytest.raises(UserError, match=message):
        stylize_with_figures(head, capture, violet, replace(SMALL, **changes))
