"""The texture's streams: read back as they are told, at the places where they were."""

import zlib

import numpy as np
import pytest

from lfportrait.field import VoxelField
from lfportrait.field.background import Background
from lfportrait.field.kernels.texture import halve
from lfportrait.share import PageConfig, write_page
from lfportrait.share.page.packing import (
    Lattice,
    PageTexture,
    coarser,
    color_sets,
    fit,
    pack,
    pack_texels,
    with_texels,
)
from tests.fields import shell_field
from tests.reference.page import restore
from tests.share.page.portraits import painted_head


@pytest.fixture(scope="module")
def head():
    return painted_head(32, strokes=True)


def lattice_of(field):
    return Lattice.of(field.links, field.density, color_sets(field), field.center, field.radius,
                      field.texture.charts)


@pytest.fixture(scope="module")
def texture(head):
    return PageTexture.of(head.texture, color_sets(head), head.lattice_points(),
                          1.8 * lattice_of(head).voxel)


def looked_up(texels, projections, charts, points):
    """The nearest texel at each point, in its chart."""
    places = np.einsum("nij,nj->ni", projections[charts], np.insert(points, 3, 1, axis=1))
    column, row = np.floor(places[:, :2] / places[:, 2:]).astype(int).T
    return texels[row, column]


def test_charts_lie_closer_together_and_show_what_they_showed(head, texture):
    height, width = texture.shape
    assert height * width < 0.8 * head.texture.texels[..., 0].size
    shown = head.texture.charts != 255
    points, charts = head.lattice_points()[shown], head.texture.charts[shown]
    # Between the rows, too: a ray ends anywhere in a cell.
    points = points + np.random.default_rng(0).uniform(-0.06, 0.06, points.shape)
    assert texture.texels[0] is None  # the photo has none
    for number, texels in enumerate(head.painted_texels, 1):
        before = looked_up(texels, head.texture.projections, charts, points)
        assert (looked_up(texture.texels[number], texture.projections, charts, points)
                == before).all()
        assert before.std() > 10


def test_a_chart_that_shows_nothing_takes_no_room(head, texture):
    charts = np.where(head.texture.charts == 2, 255, head.texture.charts).astype(np.uint8)
    less = PageTexture.of(type(head.texture)(head.texture.texels, head.texture.projections, charts,
                                             head.texture.pixels), color_sets(head),
                          head.lattice_points(), 0.1)
    assert less.shape[0] * less.shape[1] < 0.85 * texture.shape[0] * texture.shape[1]


@pytest.mark.parametrize("tolerance", [0, 1, 5])
def test_texels_are_read_back_as_they_are_told(texture, tolerance):
    small = PageTexture([each if each is None else each[60:125, 70:147].copy()
                         for each in texture.texels],
                        texture.projections, texture.pixels)
    packed = pack_texels(small, tolerance)
    height, _, width = packed.header["shape"]
    mask = np.unpackbits(np.frombuffer(zlib.decompress(packed.streams["texels"]), np.uint8))
    kept = mask[:height * width].reshape(height, width).astype(bool)
    assert packed.header["rows"] == kept.sum() and packed.header["sets"] == [False, True, True]
    assert set(packed.streams) == {"texels", "texels1", "texels2"}
    for number in (1, 2):
        values = restore(kept[:, None], zlib.decompress(packed.streams[f"texels{number}"]), 3)
        shown = packed.shown.texels[number]
        assert (shown[kept] == values[:, (1, 0, 2)].astype(int) - 128).all()
        off = np.abs(shown.astype(int) - small.texels[number])
        assert off.max() <= tolerance


def test_a_halved_texture_is_the_next_level_of_the_pyramid(texture):
    half = texture.halved()
    height, width = texture.shape
    whole = np.zeros((height, width, 4), np.int8)
    whole[..., :3] = texture.texels[1]
    level = np.zeros((height // 2, width // 2, 4), np.int8)
    halve(whole, level)
    assert (half.texels[1] == level[..., :3]).all() and half.texels[0] is None
    assert half.pixels == texture.pixels / 2
    assert half.projections[:, :2] == pytest.approx(texture.projections[:, :2] / 2)
    assert (half.projections[:, 2] == texture.projections[:, 2]).all()


def test_the_texture_is_rounded_before_it_is_halved(head, texture):
    lattice = lattice_of(head)
    whole = with_texels(pack(lattice, 1), pack_texels(texture, 1))
    assert fit(lattice, whole.size, texture).size == whole.size
    rounded = fit(lattice, 0.75 * whole.size, texture)
    assert rounded.size <= 0.75 * whole.size
    assert rounded.header["texture"]["shape"] == whole.header["texture"]["shape"]
    halved = fit(lattice, 0.45 * whole.size, texture)
    assert halved.size <= 0.45 * whole.size and halved.header["shape"] == whole.header["shape"]
    assert halved.header["texture"]["pixels"] == texture.pixels / 2
    least = fit(lattice, 0.1 * whole.size, texture)
    assert least.size <= 0.1 * whole.size and least.header["shape"] < whole.header["shape"]


def test_a_coarser_lattice_names_the_nearest_rows_charts(head):
    small = coarser(lattice_of(head), 0.5)
    assert small.charts.shape == small.density.shape
    z, y, x = np.nonzero(small.filled)
    points = 2 * (np.stack([x, y, z], 1) + 0.5) / np.array(small.filled.shape[::-1]) - 1
    side = np.abs(np.abs(points[:, 0]) - np.abs(points[:, 2])) > 0.2
    clear = side & (points[:, 1] > -0.7)
    x, _, z = points[clear].T
    assert clear.sum() > 500
    assert (small.charts[clear] == np.stack([z, x, -z, -x]).argmax(axis=0)).all()


def test_the_page_tells_of_its_texture(head, tmp_path):
    figures = write_page(head, tmp_path / "page.html", PageConfig())
    assert figures["texture"] and figures["stream_bytes"]["texels2"] > 1000
    plain = write_page(head.with_sh(head.sh), tmp_path / "plain.html", PageConfig())
    assert plain["texture"] is None and "charts" not in plain["stream_bytes"]
    # A stylised field that is read as a plain one keeps its texture.
    shown = VoxelField(head.links, head.density, head.sh, texture=head.texture)
    assert write_page(shown, tmp_path / "shown.html")["texture"] == figures["texture"]


def test_a_room_that_is_left_out_is_told(tmp_path):
    field = shell_field(16, basis=1)
    field.background = Background(np.full((8, 4), -1, np.int32), np.zeros((0, 2, 4), np.float32))
    with pytest.warns(UserWarning, match="the room that this field contains"):
        write_page(field, tmp_path / "page.html")
