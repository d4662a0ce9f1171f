"""Displays, the mask guide, coding, de-interlacing, simulation, quilts and patterns."""

import dataclasses
import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lfportrait.errors import UserError
from lfportrait.field import VoxelField
from lfportrait.lightfield import (
    Display,
    EncodeConfig,
    Placement,
    QuiltLayout,
    ViewMask,
    deinterlace,
    depth_budget,
    encode,
    encode_with_figures,
    interlace,
    quilt_of,
    quilt_tiles,
    render_view,
    simulate,
    view_camera,
)
from lfportrait.metrics import psnr
from tests.fields import shell_field
from tests.reference.raycast import cast

SMALL = Display(60, 40, views=12, pitch=7.3, slant=math.radians(9), offset=2.1, cone=50, distance=3,
                name="small")
# Published calibration of an 8.9 inch Looking Glass.
LOOKING_GLASS = {"screenW": {"value": 2560.0}, "screenH": {"value": 1600.0},
                 "DPI": {"value": 338.0}, "slope": {"value": 5.0443}, "center": {"value": 0.1769},
                 "pitch": {"value": 49.818}, "viewCone": {"value": 40.0}, "invView": {"value": 0.0},
                 "flipImageX": {"value": 0.0}, "flipImageY": {"value": 0.0},
                 "flipSubp": {"value": 0.0}, "serial": {"value": "LKG-TEST"}}


EVERY = 7  # Rows of large panels that are looked at: all follow one formula.


def grid(display, every=1):
    rows, columns = np.ogrid[:display.height:every, :display.width]
    return np.stack([display.view_of(rows, columns, k) for k in range(3)], -1)


@pytest.mark.parametrize("name", ["generic-1k", "lookingglass-portrait", "generic-1080p"])
def test_views_follow_equation_8(name):
    display = Display.preset(name)
    display = dataclasses.replace(display, inverted=False)
    # The paper's i, j, k: row, mirrored column, sub-pixel; its value is centred.
    i = np.arange(0, display.height, EVERY)[:, None, None]
    j = (display.width - np.arange(display.width))[None, :, None]
    k = np.arange(3)[None, None]
    mirrored = 3 * (display.width - j) + 3 * i * math.tan(display.slant) + k + display.offset
    vd = (mirrored % display.pitch - display.pitch / 2) * display.views / display.pitch
    away = np.abs(grid(display, EVERY) - (vd + display.views / 2))
    # On a lens' border rounding may put a sub-pixel on either side of it.
    assert np.minimum(away, display.views - away).max() < 1e-6


def looking_glass_views(calibration, views):
    """The vendor's shader, written out (view of every sub-pixel, fractional)."""
    value = {key: entry["value"] for key, entry in calibration.items() if key != "serial"}
    width, height = int(value["screenW"]), int(value["screenH"])
    pitch = value["pitch"] * width / value["DPI"] * math.cos(math.atan(1 / value["slope"]))
    tilt = height / (width * value["slope"])
    s = ((np.arange(width) + 0.5) / width)[None, :, None]
    t = (1 - (np.arange(0, height, EVERY) + 0.5) / height)[:, None, None]
    k = np.arange(3)[None, None]
    a = (s + t * tilt + k / (3 * width)) * pitch - value["center"]
    a = a - np.floor(a)
    if value["invView"]:
        a = 1 - a
    return a * views


@pytest.mark.parametrize("change", [{}, {"slope": -7.15, "screenW": 1536.0, "screenH": 2048.0,
                                         "DPI": 324.0, "pitch": 52.59}, {"invView": 1.0}])
def test_views_follow_looking_glass(change):
    calibration = {**LOOKING_GLASS, **{key: {"value": v} for key, v in change.items()}}
    display = Display.from_looking_glass(calibration, views=45)
    wanted = looking_glass_views(calibration, 45)
    away = np.abs(grid(display, EVERY) - wanted)
    assert np.minimum(away, 45 - away).max() < 1e-6


@settings(max_examples=60, deadline=None)
@given(st.integers(20, 400), st.integers(20, 400), st.floats(1.5, 60.0),
       st.floats(0.01, 1.2), st.booleans(), st.floats(0, 50), st.integers(2, 200), st.booleans())
def test_calibrations_convert_back_and_forth(width, height, pitch, slant, left, offset, views,
                                             inverted):
    display = Display(width, height, views, pitch, -slant if left else slant, offset % pitch,
                      inverted=inverted)
    back = Display.from_looking_glass(display.looking_glass(), views=views)
    away = np.abs(grid(display) - grid(back))
    assert np.minimum(away, views - away).max() < 1e-6 * views


def test_the_mask_equals_the_display_and_survives_the_cache(tmp_path):
    for display in (SMALL, dataclasses.replace(SMALL, views=300, inverted=True)):
        fresh = ViewMask.build(display, cache=tmp_path)
        assert not fresh.loaded
        assert np.array_equal(fresh.views, np.minimum(grid(display), display.views - 1).astype(int))
        again = ViewMask.build(display, cache=tmp_path)
        assert again.loaded
        assert np.array_equal(again.views, fresh.views)
    assert len(list(tmp_path.iterdir())) == 2
    for file in tmp_path.iterdir():
        file.write_bytes(b"torn")
    assert not ViewMask.build(SMALL, cache=tmp_path).loaded


@pytest.mark.parametrize("change", [
    {"width": 61}, {"height": 41}, {"views": 13}, {"pitch": 7.31}, {"slant": 0.1}, {"offset": 2.2},
    {"subpixels": "BGR"}, {"inverted": True}])
def test_the_hash_tells_panels_apart(change):
    assert dataclasses.replace(SMALL, **change).hash() != SMALL.hash()


def test_displays_survive_the_disk(tmp_path):
    for name in Display.names():
        display = Display.preset(name)
        display.save(tmp_path / "d.toml")
        assert Display.load(tmp_path / "d.toml") == display
    (tmp_path / "visual.json").write_text(json.dumps(LOOKING_GLASS))
    assert Display.resolve(tmp_path / "visual.json").name == "LKG-TEST"


@pytest.mark.parametrize(("text", "complaint"), [
    ("width = 10", "lacks"), ("width = [", "not valid TOML"),
    ("width=9\nheight=9\nviews=2\npitch=4\nlenses=3", "lenses"),
    ("width=9\nheight=9\nviews=2\npitch='4'", "not a number"),
    ("width=9\nheight=9\nviews=0\npitch=4", "views"),
    ("width=9\nheight=9\nviews=2\npitch=0.5", "pitch"),
    ("width=9\nheight=9\nviews=2\npitch=4\nsubpixels='RBG'", "subpixels"),
    ("width=9\nheight=9\nviews=2\npitch=4\ncone=200", "cone")])
def test_bad_display_files_are_told_in_one_line(tmp_path, text, complaint):
    (tmp_path / "bad.toml").write_text(text)
    with pytest.raises(UserError, match=complaint):
        Display.load(tmp_path / "bad.toml")


def test_unknown_displays_and_calibrations(tmp_path):
    with pytest.raises(UserError, match="generic-4k"):
        Display.resolve("holodeck")
    with pytest.raises(UserError, match="pitch"):
        Display.from_looking_glass({"screenW": 10, "screenH": 10, "slope": 3, "DPI": 100})
    (tmp_path / "bad.json").write_text("{")
    with pytest.raises(UserError, match="not valid JSON"):
        Display.load(tmp_path / "bad.json")


# -- coding ---------------------------------------------------------------------------------------


# Casting with nine coefficients compiles for seconds what takes the same rays as with one. What
# nine are on a ray: `test_raycast`, and in slices: `test_views`.
@pytest.fixture(scope="module", params=[1, pytest.param(9, marks=pytest.mark.slow)])
def field(request):
    return shell_field(basis=request.param, size=28, density=40.0)


def test_every_sub_pixel_is_the_ray_of_its_view(field):
    config = EncodeConfig(background=0.2, focus=0.1, method="direct")
    image = encode(field, SMALL, config, mask=ViewMask.build(SMALL, cache=False))
    placement = Placement.of(SMALL, config)
    eyes = SMALL.eyes()
    views = grid(SMALL).astype(int)
    random = np.random.default_rng(0)
    for y, x, k in zip(random.integers(0, 40, 60), random.integers(10, 50, 60),
                       random.integers(0, 3, 60)):
        eye = np.array([eyes[views[y, x, k]], SMALL.eye_height, SMALL.distance])
        place = np.array([SMALL.aspect * (2 * (x + (k + 0.5) / 3) / 60 - 1),
                          1 - 2 * (y + 0.5) / 40, 0.0])
        color, through, _, _ = cast(field, (eye - placement.shift) / placement.scale, place - eye)
        wanted = np.clip(color[k] + 0.2 * through, 0, 1) * 255
        assert abs(float(image[y, x, k]) - wanted) <= 0.5 + 0.1


@pytest.mark.parametrize(("order", "basis"), [
    ("RGB", 1), ("BGR", 1),
    *(pytest.param(*each, marks=pytest.mark.slow) for each in (("RGB", 9), ("BGR", 4)))])
def test_deinterlacing_gives_back_the_rendered_views(order, basis):
    field = shell_field(basis=basis, size=20, density=40.0)
    display = dataclasses.replace(SMALL, subpixels=order)
    image = encode(field, display, mask=ViewMask.build(display, cache=False))
    total = np.zeros(image.shape, int)
    for view in range(display.views):
        direct = render_view(field, display, view)
        picture, owned = deinterlace(image, display, view)
        assert np.array_equal(picture[owned], direct[owned])
        total += owned
    assert (total == 1).all()


def test_a_rendered_view_is_an_ordinary_off_axis_picture(field):
    """The same view by the pinhole renderer: other kernel, all channels, a camera 3 W wide."""
    for view in (0, 5, 11):
        direct = render_view(field, SMALL, view, EncodeConfig(background=0.3, method="direct"))
        camera = view_camera(SMALL, EncodeConfig(), SMALL.eyes()[view], width=180, height=40)
        wide = field.render(camera, 0, background=0.3).color.reshape(40, 60, 3, 3)
        picture = np.clip(np.stack([wide[:, :, k, k] for k in range(3)], -1), 0, 1)
        assert np.abs(picture * 255 - direct).max() <= 0.51


def block(x, y, z, half=0.12, size=48):
    """A dense white cube at a place in the world."""
    axis = 2 * (np.arange(size) + 0.5) / size - 1
    inside = ((np.abs(axis - z) < half)[:, None, None] & (np.abs(axis - y) < half)[None, :, None]
              & (np.abs(axis - x) < half)[None, None, :])
    links = np.full((size,) * 3, -1, np.int32)
    links[inside] = np.arange(inside.sum())
    return VoxelField(links, np.full(inside.sum(), 800.0, np.float32),
                      np.full((inside.sum(), 3, 1), 2.0, np.float32))


def middle_of(image):
    weight = image.astype(float).sum(-1)
    rows, columns = np.indices(weight.shape)
    return (weight * columns).sum() / weight.sum(), (weight * rows).sum() / weight.sum()


@pytest.mark.parametrize(("depth", "sign"), [(0.6, -1), (-0.6, 1)])
def test_parallax_has_the_right_sign_and_no_vertical_part(depth, sign):
    """In front of the panel things move against the eye, behind it with the eye."""
    display = dataclasses.replace(SMALL, width=240, height=160)
    thing = block(0.0, 0.2, depth)
    places = [middle_of(render_view(thing, display, view)) for view in (0, 5, 11)]
    moves = np.diff([place[0] for place in places])
    assert (np.sign(moves) == sign).all()
    assert np.ptp([place[1] for place in places]) < 0.3


def test_what_lies_on_the_panel_does_not_move():
    display = dataclasses.replace(SMALL, width=240, height=160)
    places = [middle_of(render_view(block(0.1, 0.0, 0.0), display, view)) for view in (0, 11)]
    assert abs(places[0][0] - places[1][0]) < 4


@pytest.mark.slow  # which view: `test_views_follow...`, above
def test_the_simulated_eye_sees_the_right_view():
    display = Display(1440, 600, views=24, pitch=9.4, slant=math.radians(8), cone=40, distance=4)
    field = shell_field(basis=1, size=48, density=60.0)
    # Smooth colors: between its sub-pixels an eye can't see detail of one pixel.
    field.density[:] = 60.0
    points = field.lattice_points()
    field = field.with_sh((0.8 * np.stack([points[:, 0], points[:, 1], points[:, 2]], 1)
                           )[:, :, None])
    image = encode(field, display, mask=ViewMask.build(display, cache=False))
    rendered = [render_view(field, display, view) / 255.0 for view in range(24)]
    for view in np.linspace(0, 23, 9).astype(int):
        seen = simulate(image, display, (display.eyes()[view],))
        scores = [psnr(seen, rendered[other]) for other in range(0, 24, 2)] + [0]
        right = psnr(seen, rendered[view])
        assert right > 28
        assert abs(2 * int(np.argmax(scores)) - view) <= 2


def test_crosstalk_blurs():
    display = Display(300, 120, views=24, pitch=9.4, cone=40)
    image = encode(block(0.0, 0.0, 0.7), display, mask=ViewMask.build(display, cache=False))
    sharp = simulate(image, display, (0.0,))
    soft = simulate(image, display, (0.0,), crosstalk=4.0)
    assert np.abs(np.diff(soft, axis=1)).max() < np.abs(np.diff(sharp, axis=1)).max()


@pytest.mark.parametrize("crosstalk", [0.0, 2.0])
def test_blocks_show_the_mean_light_of_their_pixels(crosstalk):
    display = Display(301, 122, views=24, pitch=9.4, cone=40)
    image = np.random.default_rng(0).integers(0, 256, (122, 301, 3)).astype(np.uint8)
    whole = simulate(image, display, (0.2,), crosstalk=crosstalk)
    small = simulate(image, display, (0.2,), crosstalk=crosstalk, block=3)
    assert small.shape == (40, 100, 3)
    light = whole[:120, :300].astype(float) ** display.gamma
    mean = light.reshape(40, 3, 100, 3, 3).mean((1, 3))
    assert np.abs(small - mean ** (1 / display.gamma)).max() < 1e-4
    assert small.std() > 0.05


# More views than a byte counts have a kernel of their own.
@pytest.mark.parametrize("views", [250, pytest.param(1000, marks=pytest.mark.slow)])
def test_continuous_views_lie_between_the_nearest_ones(field, views):
    nearest = encode(field, SMALL, mask=ViewMask.build(SMALL, cache=False))
    smooth = encode(field, SMALL, EncodeConfig(blend="continuous"),
                    mask=ViewMask.build(SMALL, cache=False))
    assert not np.array_equal(nearest, smooth)
    many = dataclasses.replace(SMALL, views=views)
    fine = encode(field, many, mask=ViewMask.build(many, cache=False))
    assert psnr(fine / 255.0, smooth / 255.0) > psnr(fine / 255.0, nearest / 255.0)


def test_coding_is_deterministic_and_tells_its_figures(field):
    image, figures = encode_with_figures(field, SMALL, mask=ViewMask.build(SMALL, cache=False))
    assert np.array_equal(image, encode(field, SMALL, mask=ViewMask.build(SMALL, cache=False)))
    assert figures["subpixels"] == 7200
    assert figures["views"] == 12
    assert figures["method"] == "slices"
    assert figures["depth_budget"]["sharp_percent"] <= 100


def test_a_mask_of_another_panel_is_refused(field):
    other = dataclasses.replace(SMALL, pitch=8.0)
    with pytest.raises(ValueError, match="another display"):
        encode(field, SMALL, mask=ViewMask.build(other, cache=False))


def test_depth_budget_shrinks_with_fewer_views():
    placement = Placement(0.8, (0.0, 0.0, 0.0))
    few, many = (depth_budget(dataclasses.replace(SMALL, views=n), placement) for n in (8, 32))
    assert few["sharp_depth"] < many["sharp_depth"]


# -- quilts, interlacing ---------------------------------------------------------------------------


def test_quilt_names_tell_their_layout():
    layout = QuiltLayout.of_name("portrait_qs8x6a0.75.png")
    assert layout == QuiltLayout(8, 6, 0.75)
    assert QuiltLayout.of_name(f"x{layout.suffix()}.png") == layout
    assert QuiltLayout.of_name("portrait.png") is None
    with pytest.raises(UserError, match="impossible"):
        QuiltLayout.of_name("x_qs0x6a0.75.png")


def test_quilts_run_from_the_bottom_left_view_to_the_top_right():
    display = dataclasses.replace(SMALL, quilt=(3, 2), quilt_size=(240, 160))
    quilt, name = quilt_of(block(0.0, 0.0, 0.7), display)
    assert QuiltLayout.of_name(name) == QuiltLayout(3, 2, 1.5)
    tiles = quilt_tiles(quilt, QuiltLayout(3, 2, 1.5))
    assert tiles.shape == (6, 80, 80, 3)
    assert np.array_equal(tiles[0], quilt[80:, :80])
    places = [middle_of(tile)[0] for tile in tiles]
    assert (np.diff(places) < 0).all()  # in front of the panel: against the eye


def test_interlacing_gives_each_view_its_sub_pixels():
    views = np.zeros((12, 40, 60, 3), np.uint8)
    views[:] = (np.arange(12) * 20)[:, None, None, None]
    image = interlace(views, SMALL)
    assert np.array_equal(image, grid(SMALL).astype(int) * 20)


def test_scaled_pictures_are_refused():
    with pytest.raises(UserError, match="must not be scaled"):
        simulate(np.zeros((10, 10, 3), np.uint8), SMALL)
    with pytest.raises(UserError, match="views 0 to 11"):
        deinterlace(np.zeros((40, 60, 3), np.uint8), SMALL, 12)
