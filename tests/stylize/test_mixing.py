"""Colors mixed from photo and paintings: what each control does, where; what a file keeps."""

import json
import zipfile

import numpy as np
import pytest

from lfportrait.errors import UserError
from lfportrait.field import VoxelField, save_field
from lfportrait.labels import PICTURE_LABELS as LABELS
from lfportrait.stylize import MixConfig, StyledField
from lfportrait.stylize.mixing import BINS, colored, luma, matching_curve, tone_histogram, toned
from tests.fields import shell_field
from tests.reference.svox2 import Checkpoint

C0 = 0.28209479177387814
REGIONS = ("face", "hair", "ears")
SIZE = 20


def shown(field):
    """The colors that a field shows, [N, 3]."""
    return C0 * field.sh[:, :, 0] + 0.5


def light(colors):
    return colors @ np.float32([0.299, 0.587, 0.114])


@pytest.fixture(scope="module")
def styled():
    """A shell, photographed in greenish and painted in two ways; hair above, an ear on one side."""
    field = shell_field(basis=4, size=SIZE, density=60.0)
    points = np.float32(field.lattice_points())
    x, y = points[:, :1], points[:, 1:2]
    grain = 0.03 * np.random.default_rng(0).standard_normal((3, len(points), 3))
    photo = np.float32([0.4, 0.5, 0.35]) + 0.2 * np.sin(np.float32([3, 4, 5]) * x) + grain[2]
    painted = grain[:2] + np.stack(
        [np.float32([0.6, 0.4, 0.3]) + 0.25 * np.cos(np.float32([4, 5, 3]) * y) ** 3,
         np.float32([0.2, 0.3, 0.6]) + 0.15 * np.sin(np.float32([5, 2, 3]) * y)])
    hair = np.clip(4 * y[:, 0] - 1, 0, 1)
    ears = (1 - hair) * np.clip(5 * x[:, 0] - 2, 0, 1)
    labels = np.uint8(255 * np.stack([1 - hair - ears, hair, ears], 1) + 0.5)
    return StyledField.of(field, painted, ["ken", "ink"], photo, labels, REGIONS)


# -- strength, identity, colors ------------------------------------------------------------------


def test_a_styled_field_shows_its_first_style_and_shares_the_rest(styled):
    assert styled.basis == 1 and isinstance(styled, VoxelField)
    assert np.allclose(shown(styled), styled.painted[0], atol=1e-6)
    mixed = styled.mix(0.3)
    for name in ("links", "density", "center", "radius", "frame", "painted", "photo", "labels"):
        assert getattr(mixed, name) is getattr(styled, name), name
    assert mixed.sh is not styled.sh


def test_the_regions_are_those_of_the_example_unless_told():
    field = shell_field(size=8, basis=1)
    count = len(field.density)
    colors = np.full((count, 3), 2.0)
    styled = StyledField.of(field, colors[None], ["ken"], colors - 1.7,
                            np.zeros((count, len(LABELS)), np.uint8))
    assert styled.regions == LABELS
    assert styled.painted.max() == 1.0 and styled.painted.dtype == styled.photo.dtype == np.float32


def test_strength_leads_from_the_photo_to_the_painting(styled):
    photo, painted = styled.photo, styled.painted[0]
    assert np.allclose(shown(styled.mix(0.0)), photo, atol=1e-6)
    assert np.allclose(shown(styled.mix(1.0)), painted, atol=1e-6)
    # Whatever was mixed before, one begins at the photo and the paintings.
    quarter = styled.mix(0.7, keep=("hair",)).mix(0.25)
    assert np.allclose(shown(quarter), 0.75 * photo + 0.25 * painted, atol=1e-6)


def weighted_levels(values, weights, ranks):
    """Levels below which the given shares of the weight lie."""
    order = np.argsort(values)
    share = (np.cumsum(weights[order]) - 0.5 * weights[order]) / weights.sum()
    return np.interp(ranks, share, values[order])


def test_identity_has_the_photos_shading_in_the_paintings_tones(styled):
    assert np.array_equal(styled.mix(identity=0.0).sh, styled.sh)
    whole, half = shown(styled.mix(identity=1.0)), shown(styled.mix(identity=0.5))
    painted = styled.painted[0]
    # Light and shade follow the photo alone: its order of luma is kept.
    order = np.argsort(light(styled.photo))
    assert np.diff(light(whole)[order]).min() > -1e-5
    assert np.corrcoef(light(painted), light(styled.photo))[0, 1] < 0.3
    assert np.corrcoef(light(whole), light(styled.photo))[0, 1] > 0.9
    opacity = 1 - np.exp(-styled.density * 2 / SIZE)
    ranks = np.linspace(0.02, 0.98, 49)
    levels = [weighted_levels(light(colors), opacity, ranks) for colors in (whole, painted)]
    assert np.abs(levels[0] - levels[1]).max() < 2 / 255
    assert np.allclose(light(half), (light(whole) + light(painted)) / 2, atol=1e-5)
    # Chroma is the painting's, or that drawn in where colors end.
    was, now = (colors - light(colors)[:, None] for colors in (painted, whole))
    share = (was * now).sum(1) / (was * was).sum(1)
    assert np.allclose(now, share[:, None] * was, atol=1e-5)
    assert share.max() < 1 + 1e-5 and np.median(share) > 1 - 1e-5


def test_rows_of_thin_air_do_not_count_for_the_tones(styled):
    air = np.arange(len(styled.density)) % 3 == 0
    density = np.where(air, 0, styled.density)
    rest = VoxelField(styled.links, density, styled.sh)
    made = [StyledField.of(rest, np.where(air[:, None], grey, styled.painted), styled.styles,
                           styled.photo, styled.labels, styled.regions).mix(identity=1.0)
            for grey in (0.0, 1.0)]
    assert np.array_equal(made[0].sh[~air], made[1].sh[~air])


def test_kept_colors_are_the_photos_in_the_mixtures_light(styled):
    plain, kept = (shown(styled.mix(0.8, keep_colors=flag)) for flag in (False, True))
    assert np.abs(light(kept) - light(plain)).max() < 1e-5
    was, now = (colors - light(colors)[:, None] for colors in (styled.photo, kept))
    share = (was * now).sum(1) / (was * was).sum(1)
    assert np.allclose(now, share[:, None] * was, atol=1e-5)
    assert np.median(share) > 1 - 1e-5
    assert kept.min() > -1e-6 and kept.max() < 1 + 1e-6
    assert np.allclose(shown(styled.mix(0.0, keep_colors=True)), styled.photo, atol=1e-6)


# -- regions and styles ---------------------------------------------------------------------------


def test_a_regions_strength_acts_there_and_fades_with_its_label(styled):
    hair = styled.labels[:, 1:2] / 255
    assert (hair == 0).any() and (hair == 1).any() and ((hair > 0.2) & (hair < 0.8)).any()
    mixed = shown(styled.mix(0.6, regions={"hair": 0.5}))
    amount = 0.6 * (1 - hair) + 0.3 * hair
    assert np.allclose(mixed, styled.photo + amount * (styled.painted[0] - styled.photo), atol=1e-6)


def test_more_than_the_painting_goes_on_away_from_the_photo(styled):
    far = styled.photo + 2 * (styled.painted[0] - styled.photo)
    hair = styled.labels[:, 1] == 255
    mixed = shown(styled.mix(regions={"hair": 2}))
    assert np.abs(mixed - np.clip(far, 0, 1))[hair].max() < 1e-5
    assert (far[hair].min() < 0) and mixed.min() > -1e-6


@pytest.mark.parametrize("value, amount", [("ink", 1.0), ("ink:0.5", 0.5), (("ink", 0.5), 0.5),
                                           (["ink", 2], 2.0)])
def test_a_region_may_have_another_style(styled, value, amount):
    mixed = shown(styled.mix(regions={"hair": value}))
    hair, none = styled.labels[:, 1] == 255, styled.labels[:, 1] == 0
    wanted = styled.photo + amount * (styled.painted[1] - styled.photo)
    assert np.abs(mixed - np.clip(wanted, 0, 1))[hair].max() < 1e-5
    assert np.abs(mixed - styled.painted[0])[none].max() < 1e-6


def test_text_is_read_like_numbers(styled):
    assert np.array_equal(styled.mix(regions={"hair": "0.5"}).sh,
                          styled.mix(regions={"hair": 0.5}).sh)
    assert np.array_equal(styled.mix(regions={"hair": "off"}).sh, styled.mix(keep=["hair"]).sh)


def test_another_style_can_be_everywhere(styled):
    assert np.allclose(shown(styled.mix(style="ink")), styled.painted[1], atol=1e-6)
    both = styled.mix(identity=1.0, style="ink", regions={"hair": "ken"})
    hair = styled.labels[:, 1] == 255
    assert np.array_equal(both.sh[hair], styled.mix(identity=1.0).sh[hair])
    assert np.array_equal(both.sh[~hair & (styled.labels[:, 1] == 0)],
                          styled.mix(identity=1.0, style="ink").sh[styled.labels[:, 1] == 0])


def test_nothing_of_the_rest_shows_at_the_seam_of_two_regions(styled):
    kept = styled.mix(keep=REGIONS)
    # Labels in 255ths add up to 1 but for their rounding.
    assert np.abs(shown(kept) - styled.photo).max() < 2 / 255


def test_where_regions_overlap_the_later_one_counts():
    field = shell_field(size=8, basis=1)
    count = len(field.density)
    colors = np.full((count, 3), 0.5)
    styled = StyledField.of(field, colors[None] + 0.4, ["ken"], colors,
                            np.full((count, 2), 255, np.uint8), ("beard", "chin"))
    for regions, amount in (({"beard": 0.25, "chin": 0.75}, 0.75),
                            ({"chin": 0.75, "beard": 0.25}, 0.25)):
        assert np.allclose(shown(styled.mix(regions=regions)), 0.5 + 0.4 * amount, atol=1e-6)
    assert np.allclose(shown(styled.mix(regions={"chin": 2}, keep="beard")), 0.5, atol=1e-6)


@pytest.mark.parametrize("options, words", [
    ({"strength": 1.5}, "strength must be a number from 0 to 1, not 1.5"),
    ({"strength": float("nan")}, "strength must be a number from 0 to 1"),
    ({"identity": -0.1}, "identity must be a number from 0 to 1, not -0.1"),
    ({"style": "oil"}, "no style 'oil' in this field; it has ken, ink"),
    ({"keep": ("eyes",)}, "no region 'eyes' here; there are face, hair, ears"),
    ({"regions": {"eyes": 1}}, "no region 'eyes' here; there are face, hair, ears"),
    ({"regions": {"hair": 5}}, "strength of hair must be a number from 0 to 4, not 5"),
    ({"regions": {"hair": "-1"}}, "strength of hair must be a number from 0 to 4, not '-1'"),
    ({"regions": {"hair": "ink:9"}}, "strength of hair must be a number from 0 to 4, not '9'"),
    ({"regions": {"hair": "oil"}}, "no style 'oil' in this field; it has ken, ink"),
    ({"regions": {"hair": "oil:1"}}, "no style 'oil' in this field; it has ken, ink"),
    ({"regions": {"hair": ("oil", 1)}}, "no style 'oil'"),
    ({"regions": {"hair": ("ink",)}}, "a strength, a style, or a style and a strength"),
    ({"regions": {"hair": None}}, "strength of hair must be a number from 0 to 4, not None")])
def test_what_a_field_does_not_have_is_told(styled, options, words):
    with pytest.raises(UserError) as told:
        styled.mix(**options)
    assert words in str(told.value) and "\n" not in str(told.value)


def test_options_as_typed_are_read():
    arguments = MixConfig(strength=0.5, region=(("hair=2", "ears=a:b=0.5"), ("hair=ink",)),
                          keep=(("eyes",), ("lips", "nose"))).arguments()
    assert arguments == {"strength": 0.5, "identity": 0.0, "keep_colors": False, "style": None,
                         "regions": {"ears": "a:b=0.5", "hair": "ink"},
                         "keep": ("eyes", "lips", "nose")}
    assert list(arguments["regions"]) == ["ears", "hair"]
    with pytest.raises(UserError, match="can't read the region 'hair'"):
        MixConfig(region=(("hair",),)).arguments()


# -- tones ----------------------------------------------------------------------------------------


def test_matched_values_are_those_of_sorted_ranks():
    random = np.random.default_rng(0)
    source, target = np.float32(random.beta(2, 4, 5000)), np.float32(random.beta(3, 2, 5000))
    weights = np.float32(random.random(5000))
    curve = matching_curve(tone_histogram(source, weights), tone_histogram(target, weights))
    order = np.argsort(source)
    ranks = np.empty(5000)
    ranks[order] = (np.cumsum(weights[order]) - 0.5 * weights[order]) / weights.sum()
    wanted = weighted_levels(target, weights, ranks)
    assert np.abs(toned(source, curve) - wanted).max() < 0.01
    assert np.abs(toned(source, curve) - wanted).mean() < 1 / BINS
    assert np.diff(curve).min() >= 0


def test_many_equal_values_get_the_middle_of_their_tones():
    values, weights = np.float32([0.0] * 50 + [1.0] * 50), np.ones(100, np.float32)
    target = np.float32(np.linspace(0.2, 0.8, 100))
    curve = matching_curve(tone_histogram(values, weights), tone_histogram(target, weights))
    assert np.allclose(toned(np.float32([0, 1]), curve), [0.35, 0.65], atol=0.01)
    same = matching_curve(tone_histogram(target, weights), tone_histogram(target, weights))
    assert np.allclose(toned(target, same), target, atol=2 / BINS)


def test_a_histogram_of_nothing_changes_nothing():
    values = np.float32(np.linspace(0.01, 0.99, 7))
    some = tone_histogram(values, np.ones(7, np.float32))
    for pair in ((some, 0 * some), (0 * some, some)):
        assert np.allclose(toned(values, matching_curve(*pair)), values, atol=1e-6)


def test_chroma_is_drawn_in_without_a_change_of_luma():
    random = np.random.default_rng(1)
    colors = random.random((3, 2000), np.float32)
    chroma = 2 * (colors - luma(colors))
    wanted = random.random(2000, np.float32)
    wanted[:2] = 0, 1
    made = colored(wanted, chroma)
    assert made.min() >= 0 and made.max() <= 1
    assert np.abs(luma(made) - wanted).max() < 1e-6
    inside = ((wanted + chroma >= 0) & (wanted + chroma <= 1)).all(0)
    assert 0.05 < inside.mean() < 0.9
    assert np.abs(made - wanted - chroma)[:, inside].max() < 1e-6


# -- the file -------------------------------------------------------------------------------------


def test_a_styled_field_survives_the_disk(styled, tmp_path):
    mixed = styled.mix(0.5, 0.25, {"hair": ("ink", 2.0), "ears": 0.5}, True, ("face",))
    mixed.save(tmp_path / "one.npz")
    back = StyledField.load(tmp_path / "one.npz")
    assert (back.styles, back.regions) == (("ken", "ink"), REGIONS)
    assert np.array_equal(back.labels, styled.labels)
    for name in ("painted", "photo"):
        assert np.abs(getattr(back, name) - getattr(styled, name)).max() <= 0.501 / 255
    assert np.abs(shown(back) - shown(mixed)).max() < 0.5 / 255
    assert back.mixture == mixed.mixture == json.loads(json.dumps(mixed.mixture))
    # What it was mixed from makes it again, and is as good at the second saving.
    assert np.abs(shown(back.mix(**back.mixture)) - shown(mixed)).max() < 3 / 255
    back.save(tmp_path / "two.npz")
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()


def test_others_read_the_mix_alone(styled, tmp_path):
    path = tmp_path / "f.npz"
    mixed = styled.mix(0.4)
    mixed.save(path)
    plain, theirs = VoxelField.load(path), Checkpoint(path)
    assert type(plain) is VoxelField
    assert np.array_equal(plain.links, styled.links)
    assert np.allclose(shown(plain), shown(mixed), atol=1e-3)
    assert np.array_equal(theirs.sh, plain.sh[:, :, 0])
    with zipfile.ZipFile(path) as archive:
        deflated = {entry.filename for entry in archive.infolist() if entry.compress_type}
        assert deflated == {f"{name}.npy" for name in (
            "links", "density_data", "sh_data", "labels", "painted", "photo")}
    with np.load(path, allow_pickle=False) as data:
        assert {"radius", "center", "links", "density_data", "sh_data", "basis_type",
                "frame"} < {*data.files}
        assert list(data["style_names"]) == ["ken", "ink"]
        assert json.loads(str(data["mix"]))["strength"] == 0.4
        assert data["painted"].dtype == data["photo"].dtype == np.uint8


def test_a_plain_field_has_nothing_to_mix(tmp_path):
    shell_field(size=8).save(tmp_path / "plain.npz")
    with pytest.raises(UserError, match=r"plain\.npz holds no colors to mix.*run that again"):
        StyledField.load(tmp_path / "plain.npz")
    with pytest.raises(UserError, match="no such"):
        StyledField.load(tmp_path / "none.npz")


@pytest.mark.parametrize("key, spoilt", [
    ("photo", None),
    ("painted", lambda a: a[:, 1:]),
    ("painted", lambda a: a[0]),
    ("painted", lambda a: np.where(a > 9, np.nan, a)),
    ("photo", lambda a: a[..., :2]),
    ("photo", lambda a: a / 255),
    ("labels", lambda a: a[:, :1]),
    ("labels", lambda a: a.astype(str)),
    ("style_names", lambda a: a[:1]),
    ("style_names", lambda a: a[[0, 0]]),
    ("style_names", lambda a: np.arange(2)),
    ("region_names", lambda a: a[[1, 1, 2]]),
    ("mix", lambda a: np.str_("{")),
    ("mix", lambda a: np.str_("[]"))])
def test_damaged_files_are_told_in_one_line(tmp_path, styled, key, spoilt):
    path = tmp_path / "f.npz"
    styled.save(path)
    with np.load(path) as data:
        arrays = dict(data)
    if spoilt is None:
        del arrays[key]
    else:
        arrays[key] = spoilt(arrays[key])
    np.savez(path, **arrays)
    with pytest.raises(UserError, match=r"f\.npz is damaged") as told:
        StyledField.load(path)
    assert "\n" not in str(told.value)
    assert len(VoxelField.load(path).density) == len(styled.density)


def test_a_style_comes_once(styled):
    with pytest.raises(UserError, match="two styles have the name ken"):
        StyledField.of(styled, styled.painted, ["ken", "ken"], styled.photo, styled.labels, REGIONS)
    with pytest.raises(ValueError, match="finite"):
        StyledField.of(styled, styled.painted * np.nan, styled.styles, styled.photo, styled.labels,
                       REGIONS)


def test_further_arrays_stand_beside_a_fields_own(tmp_path):
    field = shell_field(size=8, basis=1)
    save_field(field, tmp_path / "f.npz", deflated=("more",), more=np.zeros(1000), other=np.ones(3))
    with zipfile.ZipFile(tmp_path / "f.npz") as archive:
        deflated = {entry.filename for entry in archive.infolist() if entry.compress_type}
        assert deflated == {"links.npy", "density_data.npy", "sh_data.npy", "more.npy"}
    assert np.array_equal(VoxelField.load(tmp_path / "f.npz").sh, field.sh)
