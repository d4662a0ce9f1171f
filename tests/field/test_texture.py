"""The texture of a surface: against plain NumPy, from all renderers, on disk, seen from afar."""

import dataclasses
import math

import numpy as np
import pytest
from scipy import ndimage

from lfportrait.capture import Camera
from lfportrait.errors import UserError
from lfportrait.field import SurfaceTexture, VoxelField, save_checkpoint
from lfportrait.field.grid import TEXEL
from lfportrait.field.kernels.bricks import build_bricks
from lfportrait.field.kernels.texture import NONE, PROBES, REACH, cell_charts, halve
from lfportrait.field.texture import FULL, STEPS
from lfportrait.lightfield import Display, EncodeConfig, ViewMask, encode, render_view, view_camera
from tests.fields import head_field, shell_field

SHAPE = (90, 70)
NEAR = Camera.arc([25.0], distance=3.0, width=41, height=37, focal=60.0, pitch=12.0)


def textured(field, seed=0, charts=3, pixels=30.0):
    """A field with a texture of noise in charts all over it, some rows without any."""
    random = np.random.default_rng(seed)
    texels = random.integers(-127, 128, (*SHAPE, 3)).astype(np.int8)
    cameras = Camera.arc(random.uniform(-40, 40, charts), distance=20.0, width=70, height=90,
                         focal=20.0 * pixels)
    maps = np.empty((charts, 3, 4))
    for n in range(charts):
        lens = np.array([[20 * pixels, 0, 35.0], [0, 20 * pixels, 45.0], [0, 0, 1]])
        turn = cameras.pose[n, :3, :3].T
        maps[n] = lens @ np.concatenate([turn, -turn @ cameras.pose[n, :3, 3:]], axis=1)
    # Charts in patches of space, so that cells disagree at their borders alone.
    patch = np.floor(field.lattice_points() * 3).astype(int) @ [1, 5, 3]
    numbers = np.array([*range(charts), NONE], np.uint8)[patch % (charts + 1)]
    return dataclasses.replace(field, texture=SurfaceTexture(texels, maps, numbers, pixels))


def voted(links, charts):
    """Chart of each cell, [Z - 1, Y - 1, X - 1]; of two that are named as often, the first."""
    names = np.append(charts.astype(int), NONE)[links]
    out = np.full([n - 1 for n in links.shape], -1)
    for z, y, x in np.ndindex(out.shape):
        corners = [names[z + k, y + j, x + i] for k in (0, 1) for j in (0, 1) for i in (0, 1)]
        known = [name for name in corners if name != NONE]
        if known:
            out[z, y, x] = max(known, key=lambda name: (known.count(name), -known.index(name)))
    return out


def halved(texels):
    """Texels [H, W, 3] blurred by 1, 3, 3, 1 along both axes, at every second place."""
    weights = np.array([1, 3, 3, 1])
    blurred = ndimage.correlate(texels.astype(float), np.outer(weights, weights)[..., None],
                                mode="constant", origin=(0, 0, 0))
    # The middle of four weights is taken to be the third: that of 2 i - 1 ... 2 i + 2 is 2 i + 1.
    high, wide = (n // 2 for n in texels.shape[:2])
    return np.floor((blurred[1::2, 1::2][:high, :wide] + 32) / 64)


def charts_at(field, points):
    """The chart of the cell of each world point [N, 3], -1 for none."""
    scale, offset = field.lattice[3:6], field.lattice[6:9]
    cells = voted(field.links, field.texture.charts)
    places = np.clip((points * scale + offset).astype(int), 0,
                     np.array(field.links.shape[::-1]) - 2)
    return cells[places[:, 2], places[:, 1], places[:, 0]]


def looked_up(field, points, charts, level=0):
    """What a texture says at world points [N, 3] in these charts, float64 [N, 3]."""
    texture = field.texture
    size = 2 ** (level // STEPS)
    texels = np.ascontiguousarray(texture.words(level)).view(np.int8).reshape(
        *texture.words(level).shape, 4)[..., :3].astype(float)
    out = np.zeros((len(points), 3))
    for n, point in enumerate(points):
        if charts[n] < 0:
            continue
        u, v, w = texture.projections[charts[n]] @ np.append(point, 1)
        u, v = u / w / size - 0.5, v / w / size - 0.5
        if not (0 <= u < texels.shape[1] - 1 and 0 <= v < texels.shape[0] - 1):
            continue
        i, j = int(u), int(v)
        part = texels[j:j + 2, i:i + 2]
        row = part[0] + (v - j) * (part[1] - part[0])
        out[n] = (row[0] + (u - i) * (row[1] - row[0])) / FULL
    return out


def slope(depths, middle, apart):
    """The smaller of the ways from depths[middle] to either side, per pixel; 0 where unknown."""
    ways = []
    for side in (-1, 1):
        steps = min(apart, middle if side < 0 else len(depths) - 1 - middle)
        if steps > 0 and np.isfinite(depths[middle + side * steps]):
            ways.append(side * (depths[middle + side * steps] - depths[middle]) / steps)
    return min(ways, key=abs, default=0.0)


def piece(shot, camera, y, x, spacing, covered):
    """Places in the world that the pixel of a rendering looks up, [n, 3]."""
    focal, away = camera.focal[0, 0], float(shot.depth[y, x])
    position, turn = camera.pose[0, :3, 3], camera.pose[0, :3, :3]
    apart = max(1, int(focal / away * spacing + 0.5))
    slopes = np.array([slope(shot.depth[y].astype(float), x, apart),
                       slope(shot.depth[:, x].astype(float), y, apart)])

    def at(right, down):
        """The plane through the pixel's place with these slopes, so many pixels away."""
        depth = away + slopes @ [right, down]
        eye = [(x + 0.5 + right - camera.center[0, 0]) / focal,
               (y + 0.5 + down - camera.center[0, 1]) / focal, 1.0]
        return position + turn @ (depth * np.array(eye))

    place = at(0.0, 0.0)
    steepest = slopes / max(np.linalg.norm(slopes), 1e-12)
    # A short way, as if there were no perspective.
    along = (at(*(1e-3 * steepest)) - at(*(-1e-3 * steepest))) / 2e-3
    length = math.hypot(np.linalg.norm(slopes), away / focal)
    across = max(away / focal, covered)
    longer = min(length / across, PROBES)
    if longer <= 1.0:
        return place[None]
    count = math.ceil(longer)
    reach = REACH * math.sqrt(longer ** 2 - 1) * across / length
    return place + ((np.arange(count) + 0.5) / count - 0.5)[:, None] * reach * along


@pytest.mark.parametrize("field", [shell_field(), shell_field(basis=1, shape=(9, 24, 13)),
                                   head_field(24)], ids=["shell", "flat", "head"])
@pytest.mark.parametrize("far", [1.0, 0.3])
def test_a_view_shows_what_a_plain_look_up_finds(field, far):
    field = textured(field)
    camera = NEAR.scaled(far)
    plain = dataclasses.replace(field, texture=None).render(camera, background=0.0)
    shot = field.render(camera, background=0.0)
    assert np.array_equal(shot.alpha, plain.alpha) and np.array_equal(shot.depth, plain.depth)
    known = np.argwhere(np.isfinite(plain.depth) & (plain.alpha > 0.5))
    assert len(known) > 20
    footprint = np.linalg.norm(camera.pose[0, :3, 3] - field.center) / camera.focal[0].mean()
    level = field.texture.level(TEXEL * footprint)
    assert level == (5 if far == 1.0 else 12)
    covered = 2 ** (level / STEPS) / field.texture.pixels / TEXEL
    pieces = [piece(plain, camera, y, x, 1 / field.lattice[3], covered) for y, x in known]
    assert max(map(len, pieces)) > (3 if far == 1.0 else 1)
    middles = charts_at(field, np.array([places.mean(axis=0) for places in pieces]))
    wanted = plain.color.astype(float)
    for (y, x), places, chart in zip(known, pieces, middles):
        share = min(4 * float(plain.alpha[y, x]) - 2, 1.0)
        wanted[y, x] += share * looked_up(field, places, [chart] * len(places), level).mean(axis=0)
    # A point on the border of two cells may be found in either, and so may a count.
    away = np.abs(np.maximum(wanted, 0) - shot.color).max(axis=2)
    assert (away > 2e-3).mean() < 0.02
    assert np.abs(shot.color - plain.color).max() > 0.03


def test_a_flat_texture_is_flat_where_the_surface_turns_away():
    field = waving(20.0)
    texture = dataclasses.replace(field.texture, texels=np.full((*SHAPE, 3), 60, np.int8))
    field, bare = (dataclasses.replace(field, texture=each) for each in (texture, None))
    camera = Camera.arc([35.0], distance=4.0, width=64, height=64, focal=70.0)
    shot, plain = field.render(camera, 0), bare.render(camera, 0)
    with np.errstate(invalid="ignore"):
        steep = np.linalg.norm(np.gradient(plain.depth), axis=0) > 2 * 4.0 / 70.0
    solid = (plain.alpha > 0.8) & (plain.color > 0.05).all(axis=2)
    assert (steep & solid).sum() > 30
    found = (shot.color - plain.color)[solid]
    share = np.minimum(4 * plain.alpha[solid] - 2, 1)[:, None]
    assert np.abs(found - share * 60 / 254).max() < 1e-3


def test_cells_take_the_chart_of_most_corners():
    field = textured(shell_field(size=13))
    bricks = build_bricks(field.links, field.density, field.sh)
    out = np.empty(len(bricks.links), np.int32)
    cell_charts(bricks.links, np.append(field.texture.charts, np.uint8(NONE)), out)
    wanted = voted(field.links, field.texture.charts)
    seen = 0
    for bz, by, bx in np.argwhere(bricks.table >= 0):
        cells = out[128 * bricks.table[bz, by, bx]:][:125].reshape(5, 5, 5)[:4, :4, :4]
        here = wanted[4 * bz:4 * bz + 4, 4 * by:4 * by + 4, 4 * bx:4 * bx + 4]
        assert np.array_equal(cells[tuple(slice(n) for n in here.shape)], here)
        seen += here.size
    assert seen > 500


def test_a_level_of_the_pyramid_is_the_one_below_blurred():
    random = np.random.default_rng(3)
    texels = random.integers(-128, 128, (7, 10, 4)).astype(np.int8)
    out = np.zeros((3, 5, 4), np.int8)
    halve(texels, out)
    assert np.array_equal(out[..., :3], halved(texels[..., :3]))
    assert not out[..., 3].any()
    flat = np.full((8, 8, 4), 77, np.int8)
    inner = np.zeros((4, 4, 4), np.int8)
    halve(flat, inner)
    assert (inner[1:-1, 1:-1, :3] == 77).all()


def test_levels_follow_the_distance_of_the_rays():
    texture = textured(shell_field(size=9), pixels=100.0).texture
    levels = [texture.level(footprint) for footprint in (1e-4, 0.01, 0.013, 0.015, 0.04, 10.0)]
    assert levels == [0, 0, 2, 2, 8, 20]
    assert [texture.level(footprint, whole=True) for footprint in (0.013, 0.015, 0.04)] == [0, 4, 8]


def between(texels, x, y):
    """Texels [H, W, 3] at a place, bilinear; the border is repeated."""
    x, y = (np.clip(n, 0, size - 1) for n, size in ((x, texels.shape[1]), (y, texels.shape[0])))
    i, j = min(int(x), texels.shape[1] - 2), min(int(y), texels.shape[0] - 2)
    part = texels[j:j + 2, i:i + 2].astype(float)
    row = part[0] + (y - j) * (part[1] - part[0])
    return row[0] + (x - i) * (row[1] - row[0])


@pytest.mark.parametrize("part", [1, 2, 3])
def test_levels_between_the_octaves_mix_what_both_show(part):
    random = np.random.default_rng(part)
    texels = random.integers(-127, 128, (38, 51, 3)).astype(np.int8)
    texture = dataclasses.replace(textured(shell_field(size=9)).texture, texels=texels)
    octaves = [texels, halved(texels), halved(halved(texels))]
    for octave in (0, 1):
        words = texture.words(octave * STEPS + part)
        found = np.ascontiguousarray(words).view(np.int8).reshape(*words.shape, 4)
        fine, coarse = octaves[octave:octave + 2]
        assert found.shape[:2] == fine.shape[:2] and not found[..., 3].any()
        for y, x in random.integers(0, fine.shape[:2], (60, 2)):
            other = between(coarse, x / 2 - 0.25, y / 2 - 0.25)
            wanted = fine[y, x] + part / STEPS * (other - fine[y, x])
            assert np.abs(found[y, x, :3] - wanted).max() <= 1.01
        assert texture.words(octave * STEPS + part) is words


def test_a_flat_texture_stays_flat_at_every_level():
    texels = np.full((40, 60, 3), -93, np.int8)
    texture = dataclasses.replace(textured(shell_field(size=9)).texture, texels=texels)
    for level in (1, 2, 3):
        words = texture.words(level)
        found = np.ascontiguousarray(words).view(np.int8).reshape(*words.shape, 4)
        # Beyond the border there is no difference: the next octave is blurred with it.
        assert (found[3:-3, 3:-3, :3] == -93).all()


def waving(pixels):
    """A head with waves all over it, in one chart: nothing hangs on where cells have borders."""
    field = textured(head_field(32), charts=1, pixels=pixels)
    x, y = np.meshgrid(np.arange(SHAPE[1]), np.arange(SHAPE[0]))
    waves = 90 * np.sin(0.5 * x[..., None] + 0.3 * y[..., None] + [0, 1, 2])
    texture = dataclasses.replace(field.texture, texels=waves.astype(np.int8),
                                  charts=np.zeros(len(field.density), np.uint8))
    return dataclasses.replace(field, texture=texture)


@pytest.mark.parametrize("turned", [0.0, 20.0])
def test_both_codings_show_the_texture(turned):
    field = waving(40.0)
    plain = dataclasses.replace(field, texture=None)
    for subpixels in ("RGB", "BGR"):
        display = Display(120, 90, views=12, pitch=7.3, slant=math.radians(9), offset=2.1, cone=40,
                          distance=3, subpixels=subpixels, name="small")
        mask = ViewMask.build(display, cache=False)
        images = {}
        for method in ("slices", "direct"):
            config = EncodeConfig(method=method, turn=turned)
            images[method] = encode(field, display, config, mask=mask).astype(float)
            without = encode(plain, display, config, mask=mask).astype(float)
            assert np.sqrt(((images[method] - without) ** 2).mean()) > 10
        away = np.abs(images["slices"] - images["direct"])
        assert np.sqrt((away ** 2).mean()) < 7


def test_a_coded_view_shows_what_a_rendering_shows():
    field = waving(40.0)
    display = Display(96, 96, views=5, pitch=5.0, slant=0.0, cone=30, distance=4, name="square")
    config = EncodeConfig(method="direct", background=1.0)
    coded = render_view(field, display, 2, config).astype(float) / 255
    camera = view_camera(display, None, float(display.eyes()[2]), width=96, height=96)
    shot = np.clip(field.render(camera, background=1.0).color, 0, 1)
    green = np.abs(coded[..., 1] - shot[..., 1])
    plain = np.clip(field.with_sh(field.sh).render(camera).color, 0, 1)
    assert np.abs(shot - plain).mean() > 0.02
    assert green.mean() < 0.015


def test_a_file_keeps_the_texture_and_svox2_finds_what_it_knows(tmp_path):
    field = textured(shell_field(size=12))
    field.save(tmp_path / "a.npz")
    found = VoxelField.load(tmp_path / "a.npz").texture
    for name in ("texels", "projections", "charts", "pixels"):
        assert np.array_equal(getattr(found, name), getattr(field.texture, name))
    save_checkpoint(field, tmp_path / "b.npz")
    assert not [name for name in np.load(tmp_path / "b.npz").files if "texture" in name]
    assert VoxelField.load(tmp_path / "b.npz").texture is None
    field.with_sh(field.sh).save(tmp_path / "c.npz")
    assert VoxelField.load(tmp_path / "c.npz").texture is None


@pytest.mark.parametrize(("name", "value"), [
    ("texture_texels", np.zeros((4, 4, 3), np.uint8)), ("texture_texels", np.zeros(7, np.int8)),
    ("texture_charts", np.zeros(3, np.uint8)), ("texture_charts", np.full(5000, 9, np.uint8)),
    ("texture_projections", np.full((3, 3, 4), np.nan)), ("texture_pixels", np.float64(0)),
    ("texture_pixels", None)])
def test_a_damaged_texture_is_told(tmp_path, name, value):
    field = textured(shell_field(size=12))
    field.save(tmp_path / "a.npz")
    arrays = dict(np.load(tmp_path / "a.npz"))
    if name == "texture_charts" and len(value) > 3:
        value = value[:len(field.density)]
    arrays = {key: array for key, array in {**arrays, name: value}.items() if array is not None}
    np.savez(tmp_path / "b.npz", **arrays)
    with pytest.raises(UserError, match="damaged: its texture is invalid"):
        VoxelField.load(tmp_path / "b.npz")


def test_a_texture_of_another_field_does_not_fit():
    texture = textured(shell_field(size=12)).texture
    with pytest.raises(ValueError, match="does not fit"):
        dataclasses.replace(shell_field(size=9), texture=texture)
    with pytest.raises(ValueError, match="beyond"):
        SurfaceTexture(texture.texels, texture.projections[:1], texture.charts, 30.0)


def test_differences_are_kept_to_half_a_level_and_clipped_at_one_half():
    random = np.random.default_rng(0)
    detail = random.uniform(-0.6, 0.6, (8, 9, 3))
    texture = SurfaceTexture.of(detail, np.zeros((1, 3, 4)), np.zeros(4, np.uint8), 10.0)
    assert np.abs(texture.detail - np.clip(detail, -0.5, 0.5)).max() < 0.5 / 254 + 1e-6
