"""A painting that is finer than the lattice comes back from a field with its texture."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from lfportrait.capture import Camera
from lfportrait.example import Painting, Skin
from lfportrait.field import VoxelField
from lfportrait.stylize import StyledField
from lfportrait.stylize.fit import ColorModel
from lfportrait.stylize.mixing import mixed_texels
from lfportrait.stylize.skin import (
    MARGIN,
    SOLID,
    ChartLattice,
    _keen,
    chart_camera,
    chart_lattice,
    look_up_rows,
    projections,
    row_charts,
    row_labels,
    surface_texture,
    texel_rows,
)
from lfportrait_eval.metrics.repeats import sharpness
from tests.fields import head_field
from tests.portraits import HEAD_LANDMARKS

C0 = 0.28209479177387814


def strokes(points):
    """Stripes of a width of less than a lattice point (48 across two units)."""
    grid = np.nan_to_num(points) @ np.array([[60.0, 0, 25], [40, 55, 0], [0, 70, 20]])
    return (0.5 + 0.3 * np.sin(grid)).astype(np.float32)


@pytest.fixture(scope="module")
def field():
    return head_field()


@pytest.fixture(scope="module")
def painting(field):
    skin = Skin.of(field, HEAD_LANDMARKS, pixels=160.0, networks=False)
    atlas = skin.atlas
    color = strokes(atlas.points.reshape(-1, 3)[np.maximum(atlas.owner, 0)])
    color[atlas.owner < 0] = 0
    return Painting(skin, color, 1, {})


@pytest.fixture(scope="module")
def looked_up(field, painting):
    model = ColorModel(field, 1.0)
    look_up_rows(model, painting)
    model.fill_unseen()
    return model.shown(field)


@pytest.fixture(scope="module")
def texture(looked_up, painting):
    return surface_texture(looked_up, painting)


def styled_field(field, looked_up, painting, textures, names):
    colors = np.clip(C0 * looked_up.sh[:, :, 0] + 0.5, 0, 1)
    labels, regions = row_labels(painting.skin)
    return StyledField.of(field, np.stack([colors] * len(names)), names, 1 - colors, labels,
                          regions, textures, texel_rows(painting.skin, textures[0]))


@pytest.mark.parametrize("step", [1, 2])
def test_what_the_lattice_leaves_out_is_told_as_by_rendering_it(looked_up, painting, step):
    skin, stride = painting.skin, 0.5 if step == 1 else 1.0
    lattice = chart_lattice(looked_up, skin, step)
    picture = np.ascontiguousarray(painting.color[::step, ::step])
    detail = lattice.left_out(picture, np.asarray(C0 * looked_up.sh[:, :, 0] + 0.5, np.float32))
    assert not detail[~lattice.near].any()
    for n, (x0, y0, x1, y1, dx, dy) in enumerate(skin.atlas.boxes.tolist()):
        part = (slice((y0 + dy) // step, (y0 + dy) // step + (y1 - y0) // step),
                slice((x0 + dx) // step, (x0 + dx) // step + (x1 - x0) // step))
        shot = looked_up.render(chart_camera(skin, n, step), 0, background=0.0, step=stride)
        solid = (shot.alpha > SOLID + 0.02) & lattice.near[part]
        wanted = picture[part] - shot.color / np.maximum(shot.alpha, SOLID)[..., None]
        assert solid.mean() > 0.02
        assert np.sqrt(((detail[part] - wanted)[solid] ** 2).mean()) < 0.004


def test_maps_of_previews_are_kept_for_the_same_density(looked_up, painting):
    skin = painting.skin
    first = chart_lattice(looked_up, skin, 2)
    other = looked_up.with_sh(looked_up.sh * 0.5)
    assert chart_lattice(other, skin, 2) is first
    thinner = replace(looked_up, density=looked_up.density * 0.5)
    assert chart_lattice(thinner, skin, 2) is not first
    assert chart_lattice(looked_up, skin, 1) is not chart_lattice(looked_up, skin, 1)


def test_maps_of_previews_come_back_from_the_cache(looked_up, painting, kept_folder, monkeypatch):
    """Those of a skin from a file, which knows what it was made of."""
    picture = np.ascontiguousarray(painting.color[::2, ::2])
    colors = np.asarray(C0 * looked_up.sh[:, :, 0] + 0.5, np.float32)
    made = chart_lattice(looked_up, replace(painting.skin, kept={}), 2)
    assert not (kept_folder / "lattices").exists()
    first = chart_lattice(looked_up, replace(painting.skin, kept={"key": "head"}), 2)
    monkeypatch.setattr(ChartLattice, "arrays", None)  # nothing is written again
    skin = replace(painting.skin, kept={"key": "head"})
    read = chart_lattice(looked_up, skin, 2)
    assert read is not first and np.array_equal(read.near, made.near)
    assert np.array_equal(read.left_out(picture, colors), first.left_out(picture, colors))
    assert np.abs(read.left_out(picture, colors) - made.left_out(picture, colors)).max() < 2e-3
    for other, key in ((looked_up, "another"),
                       (replace(looked_up, density=looked_up.density * 0.5), "head")):
        with pytest.raises(TypeError):
            chart_lattice(other, replace(painting.skin, kept={"key": key}), 2)


# Before and behind.
@pytest.mark.parametrize("degrees", [
    30.0, 150.0, *(pytest.param(turn, marks=pytest.mark.slow) for turn in (0.0, -70.0))])
def test_views_show_the_strokes_as_they_were_painted(field, looked_up, painting, texture, degrees):
    camera = Camera.arc([degrees], distance=4.0, width=300, height=300, focal=980.0, pitch=8.0)
    bare = looked_up.render(camera, 0)
    points = bare.points(camera, 0)
    inside = np.isfinite(points[..., 0]) & (bare.alpha > 0.95) & (points[..., 1] > -0.3)
    wanted = np.where(inside[..., None], strokes(points), np.nan).astype(np.float32)
    shown = StyledField(**{**vars_of(looked_up), "texture": texture}).render(camera, 0)
    before, after = (sharpness(shot.color, wanted, inside) for shot in (bare, shown))
    # The head's surface is soft here, and the strokes go on into it: views differ a little.
    assert before < 0.2 and 0.55 < after < 1.2
    blurred, sharp = (np.abs(shot.color - wanted)[inside].mean() for shot in (bare, shown))
    assert sharp < 0.7 * blurred


def vars_of(field):
    colors = np.zeros((1, len(field.density), 3), np.float32)
    names = ("links", "density", "sh", "center", "radius", "frame", "background")
    return {**{name: getattr(field, name) for name in names}, "painted": colors, "styles": ("a",),
            "photo": colors[0], "labels": np.zeros((len(colors[0]), 0), np.uint8), "regions": ()}


def test_projections_lead_to_the_atlas(painting):
    skin = painting.skin
    atlas = skin.atlas
    maps = projections(skin)
    for n, (x0, y0, x1, y1, dx, dy) in enumerate(atlas.boxes.tolist()):
        rows, columns = np.nonzero(np.isfinite(atlas.depth[y0 + dy:y1 + dy, x0 + dx:x1 + dx]))
        rows, columns = rows[::97] + y0 + dy, columns[::97] + x0 + dx
        place = np.c_[atlas.points[rows, columns], np.ones(len(rows))] @ maps[n].T
        assert np.allclose(place[:, :2] / place[:, 2:], np.c_[columns, rows] + 0.5, atol=0.02)
        halved = np.c_[atlas.points[rows, columns], np.ones(len(rows))] @ projections(skin, 2)[n].T
        assert np.allclose(halved[:, :2] / halved[:, 2:], np.c_[columns, rows] / 2 + 0.25,
                           atol=0.02)


def test_rows_name_the_chart_that_shows_them(painting):
    skin = painting.skin
    charts = row_charts(skin)
    known = np.isfinite(skin.rows[:, 0])
    assert np.array_equal(charts == 255, ~known)
    boxes = skin.atlas.boxes[charts[known]]
    corner = boxes[:, :2] + boxes[:, 4:]
    assert (skin.rows[known] >= corner).all()
    assert (skin.rows[known] < corner + boxes[:, 2:4] - boxes[:, :2]).all()
    assert len(np.unique(charts[known])) > 3


def test_nothing_is_kept_far_from_what_a_chart_owns(painting, texture):
    own = painting.skin.atlas.own
    rows, columns = np.nonzero(texture.texels.any(axis=2))
    far = [not own[max(y - MARGIN, 0):y + MARGIN + 1, max(x - MARGIN, 0):x + MARGIN + 1].any()
           for y, x in zip(rows[::53], columns[::53])]
    assert len(far) > 100 and not any(far)


def test_blocks_have_the_rows_that_lie_there(painting, texture):
    skin = painting.skin
    rows = texel_rows(skin, texture)
    known = np.flatnonzero(np.isfinite(skin.rows[:, 0]))
    place = (skin.rows[known] / 4).astype(int)
    there = skin.rows[rows[place[:, 1], place[:, 0]]]
    assert np.abs(there - skin.rows[known]).max() < 4


def test_a_mix_takes_shares_of_textures_as_of_colors(field, looked_up, painting, texture):
    other = texture.with_texels((-texture.texels[:, ::-1].astype(int)).clip(-127, 127)
                                .astype(np.int8))
    both = styled_field(field, looked_up, painting, [texture, other], ["a", "b"])
    assert np.array_equal(both.texture.texels, texture.texels)
    assert np.array_equal(both.mix(style="b").texture.texels, other.texels)
    assert not both.mix(0.0).texture.texels.any()
    half = both.mix(0.5).texture.texels.astype(float)
    assert np.abs(half - 0.5 * texture.texels).max() <= 0.5
    hair = both.labels[both.texel_rows, both.regions.index("hair")].repeat(4, 0).repeat(4, 1)
    hair = hair[:texture.texels.shape[0], :texture.texels.shape[1]]
    mixed = both.mix(regions={"hair": "b"}, keep=("lips",)).texture.texels
    assert (hair == 255).sum() > 1000
    assert np.array_equal(mixed[hair == 255], other.texels[hair == 255])
    kept = both.labels[both.texel_rows, both.regions.index("lips")].repeat(4, 0).repeat(4, 1)
    assert not mixed[kept[:hair.shape[0], :hair.shape[1]] == 255].any()


def test_luma_gives_way_as_in_the_colors():
    random = np.random.default_rng(0)
    texels = random.integers(-80, 80, (2, 9, 11, 3)).astype(np.int8)
    rows = random.integers(0, 5, (3, 3)).astype(np.int32)
    light = np.array([0.299, 0.587, 0.114])
    shaded = mixed_texels(texels, rows, {1: np.float32(1)}, identity=0.75)
    was, now = texels[1] @ light, shaded @ light
    assert np.abs(now - 0.25 * was).max() < 1
    assert np.abs((shaded - now[..., None]) - (texels[1] - was[..., None])).max() < 1
    grey = mixed_texels(texels, rows, {0: np.float32(1)}, luma_alone=True)
    assert np.abs(grey - (texels[0] @ light)[..., None]).max() <= 0.5
    shares = {0: random.random(5), 1: random.random(5)}
    mixed = mixed_texels(texels, rows, shares)
    block = rows.repeat(4, 0).repeat(4, 1)[:9, :11]
    wanted = sum(shares[n][block][..., None] * texels[n] for n in (0, 1))
    assert np.abs(mixed - wanted.clip(-127, 127)).max() <= 0.5 + 1e-4


@pytest.mark.parametrize("names", [["a"], ["a", "b"]])
def test_a_file_keeps_the_textures_of_all_styles(tmp_path, field, looked_up, painting, texture,
                                                 names):
    other = texture.with_texels(texture.texels[::-1].copy())
    styled = styled_field(field, looked_up, painting, [texture, other][:len(names)], names)
    for strength in (1.0, 0.3):
        mixed = styled.mix(strength)
        mixed.save(tmp_path / "a.npz")
        assert np.array_equal(VoxelField.load(tmp_path / "a.npz").texture.texels,
                              mixed.texture.texels)
        again = StyledField.load(tmp_path / "a.npz")
        assert np.array_equal(again.painted_texels, styled.painted_texels)
        assert np.array_equal(again.mix().texture.texels, styled.texture.texels)


@pytest.mark.parametrize("width", [0.8, 1.2])
def test_what_is_looked_up_between_texels_is_as_sharp_as_painted(width):
    rng = np.random.default_rng(3)
    painted = cv2.GaussianBlur(rng.normal(size=(120, 140, 3)).astype(np.float32), (0, 0), width)
    # A view that is turned and a little larger: its pixels fall anywhere between texels.
    place = cv2.getRotationMatrix2D((70, 60), 17.0, 1.13)

    def seen(picture, how):
        return cv2.warpAffine(picture, place, (140, 120), flags=how)[20:-20, 20:-20]

    wanted = seen(painted, cv2.INTER_LANCZOS4)
    plain, keen = (seen(one, cv2.INTER_LINEAR) for one in (painted, _keen(painted)))

    def energy(picture):
        return sum((np.diff(picture, axis=axis) ** 2).mean() for axis in (0, 1))

    assert ((keen - wanted) ** 2).mean() < 0.7 * ((plain - wanted) ** 2).mean()
    assert 0.85 < energy(keen) / energy(wanted) < 1.1
    assert energy(plain) < 0.85 * energy(wanted)
    # What is plain stays as it is.
    assert np.allclose(_keen(np.full((9, 9, 3), 0.25, np.float32)), 0.25, atol=1e-6)
