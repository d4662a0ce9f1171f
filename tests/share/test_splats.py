"""Gaussian splats: the renderer against plain NumPy, the fit, and the files as others read them."""

import gzip
import io
import json
import struct
import zipfile
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from PIL import Image

from lfportrait.capture import Camera
from lfportrait.cli import main
from lfportrait.errors import UserError
from lfportrait.field import C0, VoxelField
from lfportrait.share import ExportConfig, export_field
from lfportrait.share.kinds import SplatConfig
from lfportrait.share.splats.cloud import Splats, framed, half_turned, render_splats, splat_view
from lfportrait.share.splats.fitting import Ball, field_splats, place_splats, splat_psnr
from tests.fields import head_field, shell_field
from tests.reference import splats as reference

QUICK = SplatConfig(count=3000, steps=6)
FIELDS = {1: head_field(32), 9: shell_field(size=20, basis=9)}
"""Fields whose splats are written, by the coefficients of their colors."""


@cache
def fitted(basis):
    """Splats of such a field, and how near they are to it."""
    return field_splats(FIELDS[basis], QUICK)


@pytest.fixture(autouse=True)
def small_comparison(monkeypatch):
    """What fits are compared by for their figures: small pictures, as most fits here are coarse."""
    monkeypatch.setattr("lfportrait.share.splats.fitting.splat_psnr",
                        lambda field, splats: splat_psnr(field, splats, 64))


@pytest.fixture
def fitted_once(monkeypatch):
    """Exports write splats that were fitted for the first of them."""
    def found(field, config, *_):
        basis = next(basis for basis, one in FIELDS.items() if one is field)
        assert replace(config, up="auto") == QUICK
        return fitted(basis)

    monkeypatch.setattr("lfportrait.share.writers.field_splats", found)


def some_splats(count=40, basis=9, seed=0, colors=1.2):
    random = np.random.default_rng(seed)
    turns = random.standard_normal((count, 4))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    return Splats(
        random.uniform(-0.6, 0.6, (count, 3)).astype(np.float32),
        np.exp(random.uniform(-3.5, -1.5, (count, 3))).astype(np.float32),
        turns.astype(np.float32), random.uniform(0.05, 0.95, count).astype(np.float32),
        (colors * random.standard_normal((count, 3, basis))).astype(np.float32))


def camera(size=40):
    return Camera.arc(np.array([25.0]), distance=3.0, width=size, height=size - 6,
                      focal=1.3 * size, pitch=10.0)


@pytest.mark.parametrize("basis", [1, 4, 9])
def test_pictures_equal_the_formulas_of_the_paper(basis):
    splats = some_splats(basis=basis)
    shown = render_splats(splats, camera(), background=0.5)
    expected = reference.picture(splats, camera(), 0, 0.5)
    assert np.ptp(expected) > 0.5
    assert np.abs(shown - expected).max() < 2e-4


def test_slopes_equal_finite_differences():
    splats = some_splats(12, basis=1, seed=3, colors=0.4)
    weight = np.random.default_rng(1).standard_normal((34, 40, 4)).astype(np.float32)

    def loss(**changed):
        values = {name: getattr(splats, name) for name in (
            "positions", "scales", "turns", "opacity", "sh")} | changed
        return reference.loss(Splats(**values), camera(), 0, weight)

    slopes = splat_view(splats, camera()).slopes(weight)
    step = 1e-4
    for n in range(0, 12, 4):
        for name, found, factor in (("opacity", slopes.opacity[n:n + 1], 1.0),
                                    ("sh", slopes.colors[n] * C0, 1.0),
                                    ("scales", slopes.scales[n], splats.scales[n])):
            for k in range(len(found)):
                values = [getattr(splats, name).astype(np.float64) for _ in range(2)]
                size = step * (np.broadcast_to(factor, len(found))[k])
                for sign, value in zip((1, -1), values):
                    value.reshape(12, -1)[n, k] += sign * size
                rise = (loss(**{name: values[0]}) - loss(**{name: values[1]})) / (2 * step)
                # Where a splat's edge crosses a pixel the picture jumps by up to 1/255.
                assert abs(rise - found[k]) < 0.02 * np.abs(found).max() + 0.35, (n, name, k)


def test_splats_lie_on_the_surface_and_face_outwards():
    field = head_field(40)
    splats = place_splats(field, 2500)
    assert 1500 < len(splats) <= 2500
    # The ball of the head; its neck and shoulders lie lower.
    upper = splats.positions[:, 1] > 0.1
    away = np.linalg.norm(splats.positions[upper], axis=1)
    assert np.abs(away - 0.6).max() < 0.1
    outwards = splats.positions[upper] / away[:, None]
    assert np.quantile((splats.normals[upper] * outwards).sum(1), 0.05) > 0.8
    assert (splats.scales[:, 2] < 0.5 * splats.scales[:, 0]).all()


@pytest.mark.slow  # slopes and colors that are fitted: below
def test_a_fit_comes_closer_to_views_it_has_not_seen():
    field = head_field(48)
    before = place_splats(field, 12_000)
    splats, psnr = field_splats(field, SplatConfig(count=12_000, steps=60))
    assert psnr == splat_psnr(field, splats, 64)
    # Pictures as fine as the splats, and larger ones.
    assert splat_psnr(field, splats, 96) > 30
    for size in (96, 192):
        assert splat_psnr(field, splats, size) > splat_psnr(field, before, size) + 0.5


def test_the_same_seed_gives_the_same_splats():
    field = head_field(24)
    one, other = (field_splats(field, QUICK)[0] for _ in range(2))
    for name in ("positions", "scales", "turns", "opacity", "sh"):
        assert np.array_equal(getattr(one, name), getattr(other, name)), name


def test_colors_that_depend_on_the_direction_are_fitted_and_turn_with_the_splats():
    field = shell_field(size=20, basis=4)
    splats, _ = field_splats(field, SplatConfig(count=2000, steps=12))
    assert splats.degree == 1
    assert np.abs(splats.sh[:, :, 1:]).max() > 0.01
    turn = np.array([[0, 0, 2.0, 1], [2, 0, 0, 2], [0, 2, 0, 3], [0, 0, 0, 1]])
    moved = splats.moved(turn)
    eye = np.array([0.3, 0.2, 3.0])
    assert np.allclose(moved.colors(turn[:3, :3] @ eye + turn[:3, 3]), splats.colors(eye),
                       atol=1e-4)
    assert field_splats(field, SplatConfig(count=500, steps=1, degree=0))[0].degree == 0


def read_ply(path):
    """Splats of a PLY file, by its columns' names."""
    plyfile = pytest.importorskip("plyfile")
    rows = plyfile.PlyData.read(path)["vertex"]

    def columns(*names):
        return np.stack([np.asarray(rows[name]) for name in names], axis=1)

    rest = [prop.name for prop in rows.properties if prop.name.startswith("f_rest_")]
    sh = columns("f_dc_0", "f_dc_1", "f_dc_2")[:, :, None]
    if rest:
        sh = np.concatenate([sh, columns(*rest).reshape(len(sh), 3, -1)], axis=2)
    return Splats(columns("x", "y", "z"),
                  np.exp(columns("scale_0", "scale_1", "scale_2")),
                  columns("rot_0", "rot_1", "rot_2", "rot_3"),
                  1 / (1 + np.exp(-np.asarray(rows["opacity"]))), np.ascontiguousarray(sh))


def read_glb(path):
    """Splats of a glTF, by the extension's names."""
    pygltflib = pytest.importorskip("pygltflib")
    scene = pygltflib.GLTF2().load(str(path))
    part = scene.meshes[0].primitives[0]
    assert part.mode == pygltflib.POINTS
    known = part.extensions["KHR_gaussian_splatting"]
    assert known["kernel"] == "ellipse"
    assert known["colorSpace"] == "srgb_rec709_display"
    assert "KHR_gaussian_splatting" in scene.extensionsUsed
    blob = scene.binary_blob()

    def array(name):
        accessor = scene.accessors[getattr(part.attributes, name)]
        view = scene.bufferViews[accessor.bufferView]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor.type]
        kind = {pygltflib.FLOAT: np.float32, pygltflib.UNSIGNED_BYTE: np.uint8}[
            accessor.componentType]
        values = np.frombuffer(blob, kind, accessor.count * width, view.byteOffset)
        assert values.nbytes == view.byteLength
        return values.reshape(accessor.count, width)

    prefix = "KHR_gaussian_splatting:"
    names = [name for name in vars(part.attributes) if name.startswith(prefix + "SH_")]
    names.sort(key=lambda name: (int(name.split("_")[-3]), int(name.split("_")[-1])))
    place = array("POSITION")
    accessor = scene.accessors[part.attributes.POSITION]
    assert np.allclose(accessor.min, place.min(0))
    assert np.allclose(accessor.max, place.max(0))
    points = array("COLOR_0")
    assert points.shape == (len(place), 4)
    return Splats(place, array(prefix + "SCALE"), np.roll(array(prefix + "ROTATION"), 1, axis=1),
                  array(prefix + "OPACITY")[:, 0],
                  np.stack([array(name) for name in names], axis=2))


def read_spz(path):
    """Splats of an SPZ file, version 3, by Niantic's description."""
    data = gzip.decompress(path.read_bytes())
    magic, version, count, degree, bits, flags, _ = struct.unpack("<4sIIBBBB", data[:16])
    assert (magic, version, flags) == (b"NGSP", 3, 0)
    at = 16

    def take(width):
        nonlocal at
        part = np.frombuffer(data, np.uint8, count * width, at).reshape(count, width)
        at += count * width
        return part.astype(np.int64)

    triple = take(9).reshape(count, 3, 3)
    fixed = triple[..., 0] + (triple[..., 1] << 8) + (triple[..., 2] << 16)
    fixed = np.where(fixed >= 1 << 23, fixed - (1 << 24), fixed)
    opacity = take(1)[:, 0] / 255
    color = (take(3) / 255 - 0.5) / 0.15
    scales = np.exp(take(3) / 16 - 10)
    words = (take(4) << np.array([0, 8, 16, 24])).sum(axis=1)
    turns = np.zeros((count, 4))  # x, y, z, w
    largest = words >> 30
    for row, word in enumerate(words):
        for axis in (3, 2, 1, 0):
            if axis == largest[row]:
                continue
            size = (word & 511) / 511 / np.sqrt(2)
            turns[row, axis] = -size if word >> 9 & 1 else size
            word >>= 10
        turns[row, largest[row]] = np.sqrt(max(1 - (turns[row] ** 2).sum(), 0))
    rest = (degree + 1) ** 2 - 1
    more = (take(3 * rest) - 128).reshape(count, rest, 3) / 128
    assert at == len(data)
    sh = np.concatenate([color[:, :, None], np.moveaxis(more, 1, 2)], axis=2)
    return Splats(*(np.ascontiguousarray(values, np.float32) for values in (
        fixed / 2.0 ** bits, scales, np.roll(turns, 1, axis=1), opacity, sh)))


def read_sog(path):
    """Splats of a SOG file, version 2, by PlayCanvas' description."""
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
        meta = json.loads(archive.read("meta.json"))

        def pixels(name):
            picture = Image.open(io.BytesIO(archive.read(name)))
            assert picture.format == "WEBP"
            return np.asarray(picture).astype(np.int64)

        def rows(name):
            values = pixels(name)
            return values.reshape(-1, values.shape[2])[:meta["count"]]

        assert meta["version"] == 2
        low, high = rows(meta["means"]["files"][0]), rows(meta["means"]["files"][1])
        mins, maxs = np.array(meta["means"]["mins"]), np.array(meta["means"]["maxs"])
        log = mins + (low[:, :3] + (high[:, :3] << 8)) / 65535 * (maxs - mins)
        place = np.sign(log) * (np.exp(np.abs(log)) - 1)
        scales = np.exp(np.array(meta["scales"]["codebook"])[rows("scales.webp")[:, :3]])
        packed = rows("quats.webp")
        assert packed[:, 3].min() >= 252
        others = (packed[:, :3] / 255 - 0.5) * np.sqrt(2)
        turns = np.zeros((len(place), 4))
        for mode in range(4):
            here = packed[:, 3] - 252 == mode
            turns[np.ix_(here, [k for k in range(4) if k != mode])] = others[here]
            turns[here, mode] = np.sqrt(np.maximum(1 - (others[here] ** 2).sum(axis=1), 0))
        color = rows("sh0.webp")
        sh = np.array(meta["sh0"]["codebook"])[color[:, :3]][:, :, None]
        if "shN" in meta:
            count = {1: 3, 2: 8}[meta["shN"]["bands"]]
            labels = rows("shN_labels.webp")
            label = labels[:, 0] + (labels[:, 1] << 8)
            assert label.max() < meta["shN"]["count"]
            palette = pixels("shN_centroids.webp")
            assert palette.shape[1] == 64 * count
            sets = palette[..., :3].reshape(-1, count, 3)[label]
            rest = np.array(meta["shN"]["codebook"])[sets]
            sh = np.concatenate([sh, np.moveaxis(rest, 1, 2)], axis=2)
        return Splats(*(np.ascontiguousarray(values, np.float32) for values in (
            place, scales, turns, color[:, 3] / 255, sh)))


READERS = {".ply": read_ply, ".glb": read_glb, ".spz": read_spz, ".sog": read_sog}
DOWN = np.diag([-1.0, -1.0, 1.0, 1.0])
SHOWN = {".ply": DOWN, ".sog": DOWN, ".spz": np.eye(4), ".glb": np.diag([10.0, 10.0, 10.0, 1.0])}
"""How programs place what such a file holds: SuperSplat turns it; a glTF is in metres."""


@pytest.mark.parametrize("suffix", READERS)
@pytest.mark.parametrize("basis", [1, 9])
def test_other_readers_show_the_same_picture(tmp_path, fitted_once, suffix, basis):
    field = FIELDS[basis]
    config = ExportConfig(kind="splats", splats=QUICK)
    figures = export_field(field, tmp_path / f"s{suffix}", config)
    read = READERS[suffix](tmp_path / f"s{suffix}").moved(SHOWN[suffix])
    splats, psnr = fitted(basis)
    assert {name: figures[name] for name in ("splats", "psnr", "bytes")} == {
        "splats": len(read), "psnr": psnr, "bytes": (tmp_path / f"s{suffix}").stat().st_size}
    assert read.sh.shape == splats.sh.shape
    assert np.allclose(np.linalg.norm(read.turns, axis=1), 1, atol=1e-5)
    exact = suffix in (".ply", ".glb")
    if exact:
        for name in ("positions", "scales", "opacity", "sh"):
            assert np.allclose(getattr(read, name), getattr(splats, name), rtol=1e-5, atol=2e-6)
        assert np.allclose(read.axes, splats.axes, atol=1e-5)
    seen = Ball.around(field).seen(30.0, 10.0, 160)
    error = render_splats(read, seen) - render_splats(splats, seen)
    # Random coefficients are the worst case for palettes; no field has them.
    allowed = 1e-4 if exact else 0.006 if basis == 1 else 0.06
    assert np.sqrt((error ** 2).mean()) < allowed


@pytest.mark.parametrize("suffix", [".ply", ".spz", ".sog"])
@pytest.mark.parametrize("up", ["y-up", "y-down"])
def test_which_way_is_up_may_be_chosen(tmp_path, fitted_once, suffix, up):
    config = ExportConfig(kind="splats", splats=replace(QUICK, up=up))
    export_field(FIELDS[1], tmp_path / f"s{suffix}", config)
    read = READERS[suffix](tmp_path / f"s{suffix}")
    seen = Ball.around(FIELDS[1]).seen(30.0, 10.0, 160)
    expected = render_splats(fitted(1)[0], seen)
    shown = {"y-up": read, "y-down": read.moved(DOWN)}
    assert np.sqrt(((render_splats(shown[up], seen) - expected) ** 2).mean()) < 0.006
    other, = {*shown} - {up}
    assert np.sqrt(((render_splats(shown[other], seen) - expected) ** 2).mean()) > 0.1


@pytest.mark.parametrize("basis", [1, 4, 9])
def test_half_a_turn_moves_places_shapes_and_colors_alike(basis):
    splats = some_splats(basis=basis)
    turned, expected = half_turned(splats), splats.moved(DOWN)
    for name in ("positions", "scales", "axes", "opacity", "sh"):
        assert np.allclose(getattr(turned, name), getattr(expected, name), atol=2e-5), name
    seen = camera()
    below = Camera(DOWN @ seen.pose, seen.focal, seen.center, seen.width, seen.height)
    shown = reference.picture(turned, below, 0, 0.5)
    assert np.abs(shown - reference.picture(splats, seen, 0, 0.5)).max() < 1e-6
    back = half_turned(turned)
    for name in ("positions", "axes", "sh"):
        assert np.array_equal(getattr(back, name), getattr(splats, name))


def test_a_gltf_is_in_metres():
    splats = some_splats()
    small = framed(splats, ".glb")
    assert np.allclose(small.positions, 0.1 * splats.positions)
    assert np.allclose(small.scales, 0.1 * splats.scales)
    assert np.array_equal(small.sh, splats.sh)


def test_names_say_what_is_written(tmp_path, fitted_once):
    field = FIELDS[1]
    config = ExportConfig(splats=QUICK)
    assert "splats" in export_field(field, tmp_path / "my_splats.ply", config)
    assert "splats" in export_field(field, tmp_path / "Splat.glb", config)
    assert "points" in export_field(field, tmp_path / "head.ply", config)
    assert "faces" in export_field(field, tmp_path / "head.glb", config)


@pytest.mark.slow  # fits once more; ways up: above
def test_splats_in_the_sources_coordinates(tmp_path):
    field = head_field(24)
    field.frame = np.array([[0, 0, 2.0, 1], [2, 0, 0, 2], [0, 2, 0, 3], [0, 0, 0, 1]])
    up = replace(QUICK, up="y-up")
    for world, config in (("portrait", up), ("source", QUICK)):
        export_field(field, tmp_path / f"{world}.ply",
                     ExportConfig(kind="splats", world=world, splats=config))
    here, there = read_ply(tmp_path / "portrait.ply"), read_ply(tmp_path / "source.ply")
    back = there.positions @ field.frame[:3, :3].T + field.frame[:3, 3]
    assert np.allclose(back, here.positions, atol=1e-5)
    assert np.allclose(2 * there.scales, here.scales, rtol=1e-4)
    assert np.allclose(np.abs((field.frame[:3, :3] / 2) @ there.axes), np.abs(here.axes), atol=1e-4)


def one_voxel(density=400.0):
    links = np.full((5, 5, 5), -1, np.int32)
    links[2, 2, 2] = 0
    return VoxelField(links, np.array([density], np.float32), np.ones((1, 3, 1), np.float32))


@pytest.mark.parametrize("suffix", READERS)
def test_a_field_of_one_voxel_becomes_splats(tmp_path, suffix):
    quick = SplatConfig(count=100, steps=2)
    export_field(one_voxel(), tmp_path / f"s{suffix}", ExportConfig(kind="splats", splats=quick))
    read = READERS[suffix](tmp_path / f"s{suffix}")
    assert np.abs(read.positions).max() < 0.5
    assert np.isfinite(read.scales).all()


def test_a_single_splat(tmp_path):
    config = ExportConfig(splats=SplatConfig(count=1, steps=2))
    assert export_field(head_field(24), tmp_path / "s.sog", config)["splats"] == 1


@pytest.mark.parametrize(("name", "config", "message"), [
    ("x.obj", ExportConfig(kind="splats"), "splats are written as .ply or .spz or .sog or .glb"),
    ("x.spz", ExportConfig(kind="mesh"), "mesh is written as"),
    ("x.sog", ExportConfig(splats=SplatConfig(count=0)), "--splats.count"),
    ("splat.glb", ExportConfig(splats=SplatConfig(up="y-down")), "--splats.up"),
    ("x.spz", ExportConfig(world="source", splats=SplatConfig(up="y-up")), "--world source"),
    ("x.spz", ExportConfig(splats=SplatConfig(steps=-1)), "--splats.steps")])
def test_what_makes_no_sense_is_told_and_nothing_is_written(tmp_path, name, config, message):
    with pytest.raises(UserError, match=message):
        export_field(head_field(24), tmp_path / name, config)
    assert not list(tmp_path.iterdir())


def test_an_empty_field_is_told(tmp_path):
    empty = VoxelField(np.full((4, 4, 4), -1, np.int32), np.zeros(0, np.float32),
                       np.zeros((0, 3, 1), np.float32))
    for field in (empty, one_voxel(density=1e-3)):
        with pytest.raises(UserError, match="reconstruct it again"):
            export_field(field, tmp_path / "x.spz", ExportConfig(splats=QUICK))
    assert not list(tmp_path.iterdir())


def test_the_command_says_how_near_the_splats_are(tmp_path, capsys):
    head_field(24).save(tmp_path / "f.npz")
    assert main(["export", str(tmp_path / "f.npz"), "--out", str(tmp_path / "f.spz"),
                 "--splats.count", "800", "--splats.steps", "3"]) == 0
    assert "dB to the field" in capsys.readouterr().out
