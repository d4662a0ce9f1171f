"""Coding by slices: against its plain twin, against direct casting, and its parts one by one."""

import dataclasses
import functools
import importlib
import math

import numpy as np
import pytest
from numba import njit

from lfportrait.errors import UserError
from lfportrait.field.kernels.bricks import fill_stretches, place_stretches
from lfportrait.lightfield import (
    Display,
    EncodeConfig,
    Placement,
    ViewMask,
    encode,
    encode_with_figures,
    render_view,
)
from lfportrait.lightfield.kernels.slab import plane_matrix
from lfportrait.lightfield.kernels.slices import slice_kernel
from lfportrait.metrics import psnr
from lfportrait.simd import interleaved
from lfportrait.simd import vectors as lanes
from lfportrait.simd.processor import features
from tests.fields import shell_field
from tests.reference.raycast import sh_basis
from tests.reference.slices import cast

# The package exports a function of the module's name.
encode_module = importlib.import_module("lfportrait.lightfield.coding")
SMALL = Display(60, 40, views=12, pitch=7.3, slant=math.radians(9), offset=2.1, cone=50, distance=3,
                name="small")


def coded(field, display, **options):
    return encode(field, display, EncodeConfig(method="slices", **options),
                  mask=ViewMask.build(display, cache=False))


CASES = [
    ({}, {}, {}),
    ({"size": 17}, {"subpixels": "BGR"}, {"focus": 0.3}),
    ({"shape": (20, 14, 31)}, {"eye_height": 0.7}, {"background": 0.2}),
    ({"box": (0.8, 1.1, 0.9), "center": (0.1, -0.05, 0.2)}, {}, {"turn": 25.0}),
    ({"size": 30}, {"eye_height": -0.5, "inverted": True}, {"turn": -30.0}),
    ({"size": 40}, {}, {"draft": True}),
    ({"size": 5, "density": 4.0}, {"cone": 20}, {"size": 1.1, "shift_x": 0.4, "shift_y": 0.3}),
    ({"shape": (3, 2, 2), "density": 3.0}, {}, {}),
]


# The kernel for nine coefficients takes five seconds to compile. Slices of nine are built and
# followed for views, too, whose kernel is smaller and compared with a twin (`test_views`).
BASES = [1, pytest.param(9, marks=pytest.mark.slow)]
# Four have terms of their own (`make_build`), but who reconstructs has one or nine: of the tests of
# coding only this one has any.
FOUR = pytest.param(4, marks=pytest.mark.slow)


@pytest.mark.parametrize("basis", [*BASES, FOUR])
@pytest.mark.parametrize(("field", "panel", "options"), CASES)
def test_every_sub_pixel_equals_the_twin(field, panel, options, basis):
    field = shell_field(**{"size": 24, "basis": basis, **field})
    display = dataclasses.replace(SMALL, **panel)
    config = EncodeConfig(**options)
    image = coded(field, display, **options)
    placement = Placement.of(display, config)
    matrix = placement.to_lattice(field.lattice)
    stride = 2 if config.draft else 1
    rows, columns = np.ogrid[:40, :60]
    eyes, away, lit = display.eyes(), [], 0
    random = np.random.default_rng(0)
    for place in range(3):
        views = np.minimum(display.view_of(rows, columns, place), display.views - 1).astype(int)
        channel = place if display.subpixels == "RGB" else 2 - place
        for _ in range(150):
            y, x = random.integers(0, 40), random.integers(5, 55)
            eye = np.array([eyes[views[y, x]], display.eye_height, display.distance])
            spot = np.array([display.aspect * (2 * (x + (place + 0.5) / 3) / 60 - 1),
                             1 - 2 * (y + 0.5) / 40, 0.0])
            color, through = cast(field, matrix, placement.to_world, eye, spot, stride,
                                  threshold=1e-3 * field.lattice[5] / stride, stop=1e-2)
            wanted = np.clip(color[channel] + config.background * through, 0, 1) * 255
            away.append(abs(float(image[y, x, channel]) - wanted))
            lit += through < 0.5
    # Coefficients and densities are kept as halves, cos(2 phi) as a straight line in cos(phi).
    assert np.mean(away) < 0.5
    assert np.quantile(away, 0.99) < 1.5
    # One sample in a thousand lies so near a threshold that the twin decides otherwise.
    assert np.max(away) < 4
    assert lit > 20 or field.links.size < 200


# The test's own processor need not read as others do; all x86 processors of today have AVX2.
OTHER_WAYS = [way for way in (
    ["gathered", "near"] if features().get("avx2") and features().get("f16c") else ["gathered"])
    if way != interleaved.look_up_way()]


@pytest.mark.slow  # `test_neighbours_are_looked_up` reads otherwise by a smaller kernel
@pytest.mark.parametrize("way", OTHER_WAYS)
def test_reading_otherwise_codes_the_same(way, monkeypatch):
    # What is read so are values, whatever they are coefficients of: the smallest kernel will do.
    # Of a packet of the wider panel, rays lie within sixteen columns in some places, not in others.
    field = shell_field(size=24, basis=1)
    wide = dataclasses.replace(SMALL, width=180, cone=80)
    images = [coded(field, panel) for panel in (SMALL, wide)]
    monkeypatch.setattr(encode_module, "slice_kernel", functools.partial(slice_kernel, way=way))
    for panel, image in zip((SMALL, wide), images, strict=True):
        assert np.abs(coded(field, panel).astype(int) - image).max() <= 1


@pytest.mark.slow  # twins of all ways: above
def test_wide_packets_go_in_parts():
    """A wide cone on a small panel: neighbours by view are far apart in the lattice."""
    field = smooth_field(1, 160)
    display = Display(90, 60, views=6, pitch=31.3, cone=100, distance=4)
    mask = ViewMask.build(display, cache=False)
    direct = encode(field, display, EncodeConfig(method="direct", step_size=0.25), mask=mask)
    image = encode(field, display, EncodeConfig(method="slices"), mask=mask)
    assert psnr(image / 255.0, direct / 255.0) > 44


@functools.cache
def smooth_field(basis, size=64):
    """A ball whose density and colors change over many voxels. Not to be changed."""
    field = shell_field(basis=basis, size=size, density=1.0)
    points = field.lattice_points()
    radius = np.linalg.norm(points, axis=1)
    field.density[:] = 30 * np.clip(np.cos(6 * (radius - 0.6)), 0, 1)
    sh = np.zeros((len(points), 3, basis), np.float32)
    # As in real heads, color changes little with direction.
    strength = [0.4] + 3 * [0.2] + 5 * [0.1]
    for channel in range(3):
        for part in range(basis):
            phase = points @ np.array([2, 1, 1.5]) + channel + 2 * part
            sh[:, channel, part] = strength[part] * np.sin(phase)
    return field.with_sh(sh)


@pytest.mark.parametrize("options", [
    {}, {"turn": 20.0}, {"blend": "continuous"}, {"focus": -0.3, "size": 0.6}, {"draft": True}])
@pytest.mark.parametrize("panel", [
    {}, {"subpixels": "BGR", "eye_height": 0.4}, {"cone": 20, "inverted": True}])
@pytest.mark.parametrize("basis", BASES)
def test_slices_show_what_direct_casting_shows(options, basis, panel):
    field = smooth_field(basis)
    display = dataclasses.replace(SMALL, width=240, height=160, **panel)
    mask = ViewMask.build(display, cache=False)
    direct = encode(field, display, EncodeConfig(method="direct", step_size=0.25, **options),
                    mask=mask)
    image = encode(field, display, EncodeConfig(method="slices", **options), mask=mask)
    assert direct.std() > 20
    assert psnr(image / 255.0, direct / 255.0) > (40 if "draft" in options else 44)


@pytest.mark.parametrize("basis", BASES)
def test_one_view_is_what_that_view_has_in_the_coded_picture(basis):
    field = smooth_field(basis, 32)
    image = coded(field, SMALL)
    rows, columns = np.ogrid[:40, :60]
    config = EncodeConfig(method="slices")
    for view in (0, 5, 11):
        whole = render_view(field, SMALL, view, config)
        for place in range(3):
            own = np.floor(SMALL.view_of(rows, columns, place)) == view
            assert own.any()
            assert np.array_equal(image[..., place][own], whole[..., place][own])


@pytest.mark.parametrize("basis", BASES)
def test_masks_that_were_built_or_read_need_one_compilation(tmp_path, basis):
    field = smooth_field(basis, 32)
    for loaded in (False, True):
        mask = ViewMask.build(SMALL, cache=tmp_path)
        assert mask.loaded == loaded
        encode(field, SMALL, EncodeConfig(method="slices"), mask=mask)
    render_view(field, SMALL, 3, EncodeConfig(method="slices"))
    # Of each width of the mask's numbers there is one kernel: Numba tells arrays that can't be
    # written to from others.
    kinds = [signature[12].dtype for signature in slice_kernel(basis).kernel.signatures]
    assert len(kinds) == len(set(kinds))


def test_the_method_follows_the_placement():
    field = shell_field(size=12, basis=1)
    mask = ViewMask.build(SMALL, cache=False)

    def method(**options):
        return encode_with_figures(field, SMALL, EncodeConfig(**options), mask=mask)[1]["method"]
    assert method() == "slices"
    assert method(turn=90.0) == "direct"
    assert method(focus=2.5) == "direct"
    assert method(method="direct") == "direct"
    with pytest.raises(UserError, match="faces the panel"):
        method(method="slices", turn=120.0)


@pytest.mark.parametrize("basis", BASES)
def test_an_empty_field_leaves_the_background(basis):
    field = shell_field(size=12, basis=basis)
    field.density[:] = 0.0
    assert (coded(field, SMALL, background=0.4) == 102).all()


# -- parts ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("count", "tolerance"), [(1, 1e-6), (4, 1e-6), (9, 4e-3)])
def test_harmonics_in_a_plane(count, tolerance):
    random = np.random.default_rng(count)
    across = random.standard_normal(3)
    across /= np.linalg.norm(across)
    along = np.cross(across, random.standard_normal(3))
    along /= np.linalg.norm(along)
    least = np.float32(math.cos(math.radians(25)))
    matrix, scratch = np.full(count * 16, np.nan, np.float32), np.zeros(80, np.float32)
    plane_matrix(across.astype(np.float32), along.astype(np.float32), count, least, matrix, scratch)
    table = matrix.reshape(count, 16)
    assert np.array_equal(table[:, 0:4], table[:, 4:8])
    assert np.array_equal(table[:, 0:4], table[:, 8:12])
    for phi in np.radians(np.linspace(-25, 25, 11)):
        direction = math.cos(phi) * along + math.sin(phi) * across
        terms = np.array([1, math.cos(phi), math.sin(phi), math.sin(2 * phi)])
        assert np.abs(table[:, :4] @ terms - sh_basis(direction, count)).max() < tolerance


@pytest.mark.parametrize("way", [None, "gathered"])
def test_neighbours_are_looked_up(way):
    look_up = interleaved.make_look_up(way)

    @njit
    def fetch(array, start, places, out):
        a, b = look_up(array, np.uintp(start), lanes.ints(lanes.load(places, 0)))
        lanes.store(out, 0, a)
        lanes.store(out, 16, b)
    random = np.random.default_rng(1)
    values = random.standard_normal(100).astype(np.float16)
    places = random.integers(0, 63, 16)
    places[:3] = 0, 62, 31
    for start in (0, 5, 36):
        out = np.zeros(32, np.float32)
        fetch(values.view(np.uint16), start, places.astype(np.float32), out)
        assert np.array_equal(out, values[start + np.concatenate([places, places + 1])])


@pytest.mark.skipif(not (features().get("avx2") and features().get("f16c")),
                    reason="its instructions are those of AVX2")
def test_neighbours_of_two_short_stretches_are_looked_up():
    look_up = interleaved.make_near_look_up()

    @njit
    def fetch(array, start, other, places, out):
        a, b = look_up(array, np.uintp(start), np.uintp(other), lanes.ints(lanes.load(places, 0)))
        lanes.store(out, 0, a)
        lanes.store(out, 16, b)
    random = np.random.default_rng(2)
    values = random.standard_normal(60).astype(np.float16)
    for start, other in ((0, 43), (43, 5), (7, 7)):
        places = random.permutation(16)
        out = np.zeros(32, np.float32)
        fetch(values.view(np.uint16), start, other, places.astype(np.float32), out)
        at = places + np.repeat([start, other], 8)
        assert np.array_equal(out, values[np.concatenate([at, at + 1])])


@pytest.mark.parametrize(("wide", "basis"), [(9, 1), (17, 4), (33, 9), (1030, 1)])
def test_stretches_hold_every_lattice_point(wide, basis):
    field = shell_field(shape=(5, 4, wide), basis=basis)
    kept = fill_stretches(place_stretches(field.links), field.links, field.density, field.sh)
    lines = 1 + 3 * basis
    values = kept.values.view(np.float16).astype(np.float32).reshape(-1, lines, 16)
    assert not values[-1].any()
    there = np.moveaxis(values[kept.places], -1, 3).reshape(4, 5, -1, lines)
    assert not there[:, :, wide:].any()
    there = there[:, :, :wide].transpose(1, 0, 2, 3)
    filled = field.links >= 0
    assert filled.any() and not filled.all()
    assert np.array_equal(there[filled][:, 0], field.density[field.links[filled]])
    assert np.array_equal(there[filled][:, 1:].reshape(-1, 3, basis), field.sh[field.links[filled]])
    assert not there[~filled].any()
    blocks = np.minimum(np.arange(kept.places.shape[2]), 63).astype(np.uint64)
    marked = (kept.occupied[..., None] >> blocks & np.uint64(1)).astype(bool)
    assert marked[kept.places < len(values) - 1].all()
    assert np.array_equal(marked[..., :63], (kept.places < len(values) - 1)[..., :63])


@njit
def round_trip(values, halves, extremes):
    x = lanes.load(values, 0)
    interleaved.store_half(halves, np.uintp(3), x)
    extremes[0], extremes[1] = interleaved.smallest(x), interleaved.largest(x)
    extremes[2], extremes[3] = interleaved.smallest_of_halves(x)
    extremes[4], extremes[5] = interleaved.largest_of_halves(x)


def test_lanes_are_stored_as_halves_and_their_extremes_found():
    values = np.linspace(-7, 9, 16).astype(np.float32)
    values[5], values[9] = -1e4, 3e4
    halves, extremes = np.zeros(24, np.float16), np.zeros(6, np.float32)
    round_trip(values, halves.view(np.uint16), extremes)
    assert np.array_equal(halves[3:19], values.astype(np.float16))
    assert not halves[:3].any() and not halves[19:].any()
    assert extremes.tolist() == [-1e4, 3e4, -1e4, values[8], values[7], 3e4]
