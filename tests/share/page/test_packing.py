"""A field's streams: read back exactly as they are told, and within the size that is asked for."""

import zlib

import numpy as np
import pytest
from scipy import ndimage

from lfportrait.errors import UserError
from lfportrait.field import VoxelField
from lfportrait.share import PageConfig, orbit_cameras, write_page
from lfportrait.share.page.packing import Lattice, coarser, color_sets, fit, pack
from tests.fields import head_field, shell_field
from tests.reference.page import restore
from tests.share.page.browser import decibels
from tests.share.page.portraits import painted_head


def lattice_of(field, degree=0):
    return Lattice.of(field.links, field.density, color_sets(field, degree), field.center,
                      field.radius)


def field_of(lattice, number=0):
    links = np.full(lattice.filled.shape, -1, np.int32)
    links[lattice.filled] = np.arange(lattice.filled.sum(), dtype=np.int32)
    return VoxelField(links, lattice.density, lattice.sets[number].sh, lattice.center,
                      lattice.radius)


def seen(field, size=96):
    cameras = orbit_cameras(3, size, head_field(16))
    return [np.clip(field.render(cameras, view).color, 0, 1) for view in range(3)]


# None, and the most.
@pytest.mark.parametrize("tolerance", [0, pytest.param(1, marks=pytest.mark.slow), 4])
def test_streams_are_read_back_as_they_are_told(tolerance):
    field = shell_field(basis=4, box=(1.0, 1.2, 0.8), shape=(19, 24, 21))
    lattice = lattice_of(field, 1)
    packed = pack(lattice, tolerance)
    mask = np.unpackbits(np.frombuffer(zlib.decompress(packed.streams["mask"]), np.uint8))
    filled = mask[:lattice.filled.size].reshape(lattice.filled.shape).astype(bool)
    assert (filled == lattice.filled).all()
    codes = restore(filled, zlib.decompress(packed.streams["density"]), 1)[:, 0]
    top, zero = packed.header["top"], packed.header["zero"]
    told = (codes.astype(float) - zero) / (255 - zero)
    assert lattice.density.min() < 0 < zero
    assert packed.shown.density == pytest.approx(told * np.abs(told) * top, rel=1e-5)
    root = np.sign(lattice.density) * np.sqrt(np.abs(lattice.density) / top)
    assert np.abs(told - root).max() <= (tolerance + 0.501) / (255 - zero)
    # What is empty stays so: nothing else shifts the edges.
    assert (codes[lattice.density == 0] == zero).all()
    for band in range(4):
        values = restore(filled, zlib.decompress(packed.streams[f"set0.{band}"]), 3)
        ends = packed.header["sets"][0]["bands"][band]
        told = values[:, (1, 0, 2)] / 255 * (ends["high"] - ends["low"]) + ends["low"]
        shown = packed.shown.sets[0].sh[:, :, band]
        shown = 0.28209479 * shown + 0.5 if band == 0 else shown
        assert told == pytest.approx(shown, abs=1e-5)


def test_a_larger_tolerance_is_smaller_and_still_near(tmp_path):
    field = painted_head(40)
    lattice = lattice_of(field)
    fine, rough = pack(lattice, 1), pack(lattice, 6)
    assert rough.size < 0.8 * fine.size
    reference = seen(field.with_sh(field.mix(style=field.styles[0]).sh))
    for packed, least in ((fine, 50), (rough, 40)):
        for one, other in zip(seen(field_of(packed.shown, 1)), reference, strict=True):
            assert decibels(one, other) > least


def test_rows_that_no_sample_meets_are_left_out():
    field = shell_field(basis=1)
    field.density[field.lattice_points()[:, 0] < -0.2] = 0
    lattice = lattice_of(field)
    assert lattice.filled.sum() < 0.8 * len(field.density)
    for one, other in zip(seen(field_of(lattice)), seen(field), strict=True):
        assert np.abs(one - other).max() < 1e-4


def test_the_largest_density_around_each_row():
    field = shell_field(basis=1, shape=(19, 24, 21))
    field.density[:] = np.random.default_rng(0).normal(size=len(field.density))
    lattice = lattice_of(field)
    whole = ndimage.maximum_filter(np.append(field.density, 0)[field.links], 3)
    assert (lattice.filled == ((field.links >= 0) & (whole > 0.01))).all()
    around = ndimage.maximum_filter(lattice.dense(lattice.density), 3)
    assert (lattice.around == around[lattice.filled]).all()


def test_a_coarser_lattice_looks_alike():
    field = head_field(64)
    small = coarser(lattice_of(field), 0.5)
    assert small.filled.shape == (32, 32, 32)
    for one, other in zip(seen(field_of(small)), seen(field), strict=True):
        # Edges lie up to half a coarse voxel, one pixel here, further out.
        assert decibels(one, other) > 19
        assert abs(one.mean() - other.mean()) < 0.03


def test_the_size_is_kept_by_precision_then_by_resolution(tmp_path):
    lattice = lattice_of(painted_head(64))
    fine = pack(lattice, 1).size
    assert fit(lattice, fine).size == fine
    some = fit(lattice, 0.8 * fine)
    assert some.size <= 0.8 * fine and some.header["shape"] == [64, 64, 64]
    less = fit(lattice, 0.2 * fine)
    assert less.size <= 0.2 * fine and less.header["shape"][0] < 64
    with pytest.raises(UserError, match="does not fit into that size"):
        fit(lattice, 1000)


def test_the_sets_of_colors_are_the_photo_what_is_shown_and_the_styles():
    field = painted_head(24)
    names = [(each.name, each.kind) for each in color_sets(field)]
    assert names == [("photo", "photo"), ("waves", "style"), ("ink & <b>wash", "style")]
    other = [each.name for each in color_sets(field.mix(style="ink & <b>wash"))]
    assert other == ["photo", "ink & <b>wash", "waves"]
    mixed = field.mix(strength=0.5)
    assert [each.kind for each in color_sets(mixed)] == ["photo", "mix", "style", "style"]
    assert (color_sets(mixed)[1].sh == mixed.sh).all()
    assert [each.kind for each in color_sets(shell_field())] == ["field"]


@pytest.mark.parametrize(("config", "told"), [
    (PageConfig(sh=1), "degree 0, not 1"), (PageConfig(sh=3), "0, 1 or 2"),
    (PageConfig(max_size=0), "--max-size must be"),
    (PageConfig(max_size=0.1), "does not fit into that size")])
def test_what_can_not_be_is_told_and_nothing_is_written(tmp_path, config, told):
    with pytest.raises(UserError, match=told):
        write_page(painted_head(24), tmp_path / "page.html", config)
    assert list(tmp_path.iterdir()) == []


def test_an_empty_field_is_told(tmp_path):
    field = shell_field(basis=1)
    field.density[:] = 0
    with pytest.raises(UserError, match="the field is empty"):
        write_page(field, tmp_path / "page.html")
