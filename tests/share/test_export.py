"""Fields in other programs' files: what the files hold, and where the surface lies."""

import json
import struct

import numpy as np
import pytest
from scipy import ndimage

from lfportrait.capture import Camera
from lfportrait.cli import main
from lfportrait.errors import UserError
from lfportrait.field import VoxelField
from lfportrait.field.background import Background
from lfportrait.field.kernels.march import lattice_of_world
from lfportrait.field.kernels.surface import depth_from_outside, seen_colors
from lfportrait.field.surface import field_mesh, field_points
from lfportrait.share import ExportConfig, export_field
from tests.fields import shell_field
from tests.reference.raycast import sh_basis, trilinear
from tests.reference.svox2 import Checkpoint

C0 = 0.28209479177387814
RADIUS = 0.6
METRES = 0.1
"""Of a unit of the portrait frame, in files of points and meshes."""


def ball_field(size=48, hollow=True, floater=False, box=(1.0, 1.1, 0.9), center=(0.05, -0.1, 0.0)):
    """A ball of radius 0.6 about the origin whose color is its normal (degree 0)."""
    shape = (size, size + 2, size + 4)
    center, box = np.array(center), np.array(box)
    n = np.array(shape[::-1])
    x, y, z = (center[i] + box[i] * (2 * (np.arange(n[i]) + 0.5) / n[i] - 1) for i in range(3))
    grid = np.stack(np.meshgrid(z, y, x, indexing="ij")[::-1], -1)
    away = np.linalg.norm(grid, axis=-1)
    voxel = float((2 * box / n).mean())
    # Density rises over two voxels about the ball's surface.
    density = 300 * np.clip(0.5 + (RADIUS - away) / (2 * voxel), 0, 1)
    if hollow:
        density[away < RADIUS - 4 * voxel] = 0
    if floater:
        density[np.linalg.norm(grid - [0.7, 0.7, 0.6], axis=-1) < 0.1] = 300
    # Points about the surface have color, too, as in trained fields.
    filled = ndimage.binary_dilation(density > 0, iterations=2)
    links = np.full(shape, -1, np.int32)
    links[filled] = np.arange(filled.sum())
    sh = np.zeros((int(filled.sum()), 3, 1), np.float32)
    sh[:, :, 0] = 0.45 * (grid / np.maximum(away, 1e-9)[..., None])[filled] / C0
    frame = np.array([[0, 0, 2.0, 1], [2, 0, 0, 2], [0, 2, 0, 3], [0, 0, 0, 1]])
    return VoxelField(links, density[filled].astype(np.float32), sh, center, box, frame)


def volume(mesh):
    """Volume enclosed by a mesh whose faces are counter-clockwise from outside."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]].astype(float) for i in range(3))
    return (np.cross(a, b) * c).sum() / 6


def test_depth_from_outside_equals_sums_along_the_lattice():
    random = np.random.default_rng(0)
    density = random.random((3, 4, 5)).astype(np.float32)
    spacing = np.array([0.3, 0.2, 0.1])
    directions = np.array([step for step in np.ndindex(3, 3, 3) if step != (1, 1, 1)]) - 1
    for chosen in [*directions[:, None], directions]:
        found = depth_from_outside(density, spacing, chosen)
        for place in np.ndindex(density.shape):
            depths = []
            for step in chosen:
                at, own, depth = np.array(place), float(density[place]), 0.0
                length = np.linalg.norm(step * spacing)
                while (at >= 0).all() and (at < density.shape).all():
                    at = at - step
                    inside = (at >= 0).all() and (at < density.shape).all()
                    other = float(density[tuple(at)]) if inside else 0.0
                    depth += 0.5 * length * (own + other)
                    own = other
                depths.append(depth)
            assert np.isclose(found[place], min(depths), atol=1e-5)


@pytest.mark.parametrize("basis", [1, 4, 9])
def test_seen_colors_equal_the_reference(basis):
    field = shell_field(size=12, basis=basis, box=(1.0, 0.8, 1.2), center=(0.1, 0, -0.1))
    random = np.random.default_rng(1)
    directions = random.standard_normal((30, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    origins = 0.6 * random.standard_normal((30, 3))
    scale, offset = lattice_of_world(field.center, field.radius, field.links.shape)
    found = np.empty((30, 4), np.float32)
    seen_colors(field.links, field.density, field.sh, scale, offset, origins, directions, 9, 0.07,
                found)
    met = 0
    for ray in range(30):
        color, through = np.zeros(3), 1.0
        for sample in range(9):
            place = (origins[ray] + (sample + 0.5) * 0.07 * directions[ray]) * scale + offset
            if (place < 0).any() or (place > np.array(field.links.shape[::-1]) - 1).any():
                continue
            corners, weights = trilinear(place, field.links.shape)
            rows = field.links[tuple(corners.T)]
            weights = np.where(rows >= 0, weights, 0.0)
            fade = np.exp(-0.07 * max(weights @ field.density[rows], 0.0))
            shade = np.einsum("n,ncb,b->c", weights, field.sh[rows],
                              sh_basis(directions[ray], basis))
            color += through * (1 - fade) * np.maximum(shade + 0.5, 0)
            through *= fade
        assert np.isclose(found[ray, 3], 1 - through, atol=1e-4)
        if through < 0.9:
            assert np.allclose(found[ray, :3], color / (1 - through), atol=1e-3)
            met += 1
    assert met > 10


@pytest.mark.parametrize("smooth", [0.0, 1.5])
def test_the_mesh_of_a_ball_is_a_ball(smooth):
    field = ball_field()
    voxel = 2 / 48
    mesh = field_mesh(field, smooth=smooth)
    away = np.linalg.norm(mesh.vertices, axis=1)
    # Half of the light is stopped this far into the ramp that begins one voxel outside.
    surface = RADIUS + voxel - np.sqrt(4 * voxel * np.log(2) / 300)
    assert np.abs(away - surface).max() < voxel
    assert np.abs(away - surface).mean() < 0.3 * voxel
    # Closed, nothing within, and the right way out.
    assert np.isclose(volume(mesh), 4 / 3 * np.pi * away.mean() ** 3, rtol=0.02)
    outwards = mesh.vertices / away[:, None]
    assert ((mesh.normals * outwards).sum(1) > (0.97 if smooth else 0.5)).all()
    assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-5)
    assert np.abs(mesh.colors / 255 - (0.5 + 0.45 * outwards)).mean() < 0.02
    edges = np.sort(np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]],
                                    mesh.faces[:, [2, 0]]]), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()


def test_a_room_is_shown_with_inner_walls():
    room = ball_field()
    room.background = Background(np.zeros((4, 2), np.int32), np.zeros((1, 2, 4), np.float32))
    assert volume(field_mesh(room, smooth=0)) < 0.85 * volume(field_mesh(ball_field(), smooth=0))


def test_small_pieces_are_dropped():
    field = ball_field(floater=True)
    assert np.linalg.norm(field_mesh(field).vertices, axis=1).max() < 0.7
    assert np.linalg.norm(field_mesh(field, least=0.0).vertices, axis=1).max() > 0.9


def test_points_have_color_opacity_and_normals():
    field = ball_field()
    cloud = field_points(field, 0.3)
    voxel = float((2 * field.radius / field.links.shape[::-1]).mean())
    taken = 1 - np.exp(-field.density * voxel)
    kept = taken >= 0.3
    assert np.allclose(cloud.opacity, taken[kept])
    assert np.allclose(cloud.positions, field.lattice_points()[kept], atol=1e-6)
    expected = np.clip(C0 * field.sh[kept, :, 0] + 0.5, 0, 1) * 255
    assert np.abs(cloud.colors - expected).max() <= 0.501
    away = np.linalg.norm(cloud.positions, axis=1)
    outer = away > RADIUS - 0.5 * voxel
    cosine = (cloud.normals * cloud.positions).sum(1) / away
    assert cosine[outer].min() > 0.9
    assert np.allclose(np.linalg.norm(cloud.normals, axis=1), 1, atol=1e-5)
    assert np.abs(field_points(field, 0.3, "seen").colors.astype(int) - cloud.colors).max() <= 1


def test_points_seen_from_the_front_have_the_color_of_that_direction():
    field = shell_field(basis=9)
    cloud = field_points(field, 0.2, "seen")
    rows = np.flatnonzero(1 - np.exp(-field.density * 2 / 24) >= 0.2)
    for k in (0, 17, 300):
        gaze = -(cloud.normals[k] * [1, 0.5, 1] + [0, 0, 0.5])
        basis = sh_basis(gaze / np.linalg.norm(gaze), 9)
        expected = np.clip(field.sh[rows[k]] @ basis + 0.5, 0, 1) * 255
        assert np.abs(cloud.colors[k] - expected).max() <= 1


def read_ply(path):
    """Elements of a binary PLY as structured arrays, by its own header."""
    kinds = {"float": "<f4", "uchar": "u1", "int": "<i4"}
    content = path.read_bytes()
    header, body = content.split(b"end_header\n", 1)
    elements, name = {}, ""
    for line in header.decode().splitlines():
        words = line.split()
        if words[0] == "element":
            name, count, columns = words[1], int(words[2]), []
            elements[name] = count, columns
        elif words[0] == "property" and words[1] == "list":
            columns += [("count", kinds[words[2]]), (words[4], kinds[words[3]], 3)]
        elif words[0] == "property":
            columns.append((words[2], kinds[words[1]]))
    assert header.startswith(b"ply\nformat binary_little_endian 1.0\n")
    result, at = {}, 0
    for name, (count, columns) in elements.items():
        result[name] = np.frombuffer(body, columns, count, at)
        at += result[name].nbytes
    assert at == len(body)
    return result


def columns_of(rows, *names):
    return np.stack([rows[name] for name in names], axis=1)


def test_ply_files_hold_points_or_a_mesh(tmp_path):
    field = ball_field()
    figures = export_field(field, tmp_path / "p.ply", ExportConfig(level=0.2))
    rows = read_ply(tmp_path / "p.ply")["vertex"]
    cloud = field_points(field, 0.2)
    assert figures == {"points": len(rows), "bytes": (tmp_path / "p.ply").stat().st_size,
                       "kind": "points", "out": tmp_path / "p.ply"}
    assert np.allclose(columns_of(rows, "x", "y", "z"), METRES * cloud.positions, atol=1e-7)
    assert np.array_equal(columns_of(rows, "nx", "ny", "nz"), cloud.normals)
    assert np.array_equal(columns_of(rows, "red", "green", "blue"), cloud.colors)
    assert np.array_equal(rows["opacity"], cloud.opacity)
    export_field(field, tmp_path / "m.ply", ExportConfig(kind="mesh"))
    parts = read_ply(tmp_path / "m.ply")
    mesh = field_mesh(field)
    assert np.allclose(columns_of(parts["vertex"], "x", "y", "z"), METRES * mesh.vertices,
                       atol=1e-7)
    assert (parts["face"]["count"] == 3).all()
    assert np.array_equal(parts["face"]["vertex_indices"], mesh.faces)


def test_obj_files(tmp_path):
    field = ball_field()
    mesh = field_mesh(field)
    figures = export_field(field, tmp_path / "m.obj")
    lines = [line.split() for line in (tmp_path / "m.obj").read_text().splitlines()]
    v, n = (np.array([line[1:] for line in lines if line[0] == kind], float)
            for kind in ("v", "vn"))
    f = np.array([[int(word.split("//")[0]) for word in line[1:]] for line in lines
                  if line[0] == "f"])
    assert figures["vertices"] == len(v) == len(n)
    assert figures["faces"] == len(f)
    assert np.allclose(v[:, :3], METRES * mesh.vertices, atol=1e-6)
    assert np.allclose(v[:, 3:] * 255, mesh.colors, atol=0.02)
    assert np.allclose(n, mesh.normals, atol=1e-4)
    assert np.array_equal(f - 1, mesh.faces)


def test_glb_files(tmp_path):
    field = ball_field()
    mesh = field_mesh(field)
    export_field(field, tmp_path / "m.glb")
    data = (tmp_path / "m.glb").read_bytes()
    magic, version, length, size, kind = struct.unpack("<4sIII4s", data[:20])
    assert (magic, version, length, kind) == (b"glTF", 2, len(data), b"JSON")
    scene = json.loads(data[20:20 + size])
    binary, kind = struct.unpack("<I4s", data[20 + size:28 + size])
    assert kind == b"BIN\0"
    assert binary == len(data) - 28 - size == scene["buffers"][0]["byteLength"]
    assert size % 4 == binary % 4 == 0
    kinds = {5126: "<f4", 5123: "<u2", 5125: "<u4"}
    widths = {"VEC3": 3, "VEC4": 4, "SCALAR": 1}

    def array(index):
        accessor = scene["accessors"][index]
        view = scene["bufferViews"][accessor["bufferView"]]
        assert view["byteOffset"] % 4 == 0
        values = np.frombuffer(data, kinds[accessor["componentType"]],
                               accessor["count"] * widths[accessor["type"]],
                               28 + size + view["byteOffset"])
        assert values.nbytes == view["byteLength"]
        return values.reshape(accessor["count"], -1)

    part = scene["meshes"][0]["primitives"][0]
    assert np.allclose(array(part["attributes"]["POSITION"]), METRES * mesh.vertices, atol=1e-7)
    assert np.array_equal(array(part["attributes"]["NORMAL"]), mesh.normals)
    assert np.array_equal(array(part["indices"]).reshape(-1, 3), mesh.faces)
    position = scene["accessors"][part["attributes"]["POSITION"]]
    assert np.allclose(position["min"], METRES * mesh.vertices.min(0))
    assert np.allclose(position["max"], METRES * mesh.vertices.max(0))
    light = array(part["attributes"]["COLOR_0"]) / 65535
    # The sRGB curve applied to the stored linear light gives the colors back.
    srgb = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    assert np.abs(srgb[:, :3] * 255 - mesh.colors).max() < 0.1
    assert (light[:, 3] == 1).all()


def test_exports_in_the_sources_coordinates(tmp_path):
    field = ball_field()
    export_field(field, tmp_path / "p.ply", ExportConfig(world="source"))
    rows = read_ply(tmp_path / "p.ply")["vertex"]
    cloud = field_points(field)
    back = columns_of(rows, "x", "y", "z").astype(float) @ field.frame[:3, :3].T
    assert np.allclose(back + field.frame[:3, 3], cloud.positions, atol=1e-5)
    turned = columns_of(rows, "nx", "ny", "nz") @ field.frame[:3, :3].T / 2
    assert np.allclose(turned, cloud.normals, atol=1e-5)
    with pytest.raises(UserError, match="can't be turned"):
        export_field(field, tmp_path / "c.npz", ExportConfig(world="source"))


def room_field():
    """An uneven shell, empty at its border, before spheres with holes in their map."""
    field = shell_field(size=16, basis=9, shape=(15, 16, 18), box=(1.1, 0.9, 1.0),
                        center=(0.1, -0.2, 0.05))
    random = np.random.default_rng(5)
    links = np.full((16, 8), -1, np.int32)
    there = random.random((16, 8)) < 0.8
    links[there] = random.permutation(int(there.sum())).astype(np.int32)
    data = random.standard_normal((int(there.sum()), 5, 4)).astype(np.float32)
    data[..., 3] = np.abs(data[..., 3]) * 2
    field.background = Background(links, data)
    return field


@pytest.mark.parametrize("room", [False, True])
def test_a_checkpoint_shows_in_svox2_what_we_render(tmp_path, room):
    field = room_field()
    if not room:
        field.background = None
    export_field(field, tmp_path / "ckpt.npz")
    theirs = Checkpoint(tmp_path / "ckpt.npz")
    cameras = Camera.look_at(np.array([[1.5, 0.8, 2.5]]), np.zeros(3), width=9, height=7, focal=9.0)
    picture = field.render(cameras, 0, background=0.7, threshold=0.0, stop=0.0).color
    origins, directions = cameras.rays(0)
    expected = np.array([theirs.color(o, d, 0.7) for o, d in zip(origins, directions)])
    assert np.ptp(expected) > 0.3
    # Ours holds the coefficients in half precision and exponentials to a few digits.
    assert np.abs(picture.reshape(-1, 3) - expected).max() < 3e-3


def svox2s_file(path, seed=0):
    """A checkpoint with the keys, types and order of svox2's own ``save``."""
    random = np.random.default_rng(seed)
    links = np.where(random.random((6, 7, 8)) < 0.5, 0, -1).astype(np.int32)
    links[links == 0] = random.permutation(int((links == 0).sum())).astype(np.int32)
    count = int(links.max()) + 1
    background_links = np.where(random.random((8, 4)) < 0.7, 0, -1).astype(np.int32)
    background_links[background_links == 0] = np.arange(int((background_links == 0).sum()))
    arrays = {
        "radius": np.array([1.0, 0.9, 0.8], np.float32),
        "center": np.array([0.1, 0.0, -0.3], np.float32), "links": links,
        "density_data": random.standard_normal((count, 1)).astype(np.float32) * 30,
        "sh_data": random.standard_normal((count, 27)).astype(np.float16),
        "background_links": background_links,
        "background_data": random.standard_normal(
            (int(background_links.max()) + 1, 3, 4)).astype(np.float32),
        "basis_type": 1}
    np.savez(path, **arrays)
    return arrays


def test_a_checkpoint_comes_back_bit_by_bit(tmp_path):
    arrays = svox2s_file(tmp_path / "theirs.npz")
    export_field(VoxelField.load(tmp_path / "theirs.npz"), tmp_path / "ours.npz")
    with np.load(tmp_path / "theirs.npz") as theirs, np.load(tmp_path / "ours.npz") as ours:
        assert ours.files == theirs.files == list(arrays)
        for name in theirs.files:
            assert ours[name].dtype == theirs[name].dtype, name
            assert ours[name].shape == theirs[name].shape, name
            assert ours[name].tobytes() == theirs[name].tobytes(), name


def test_checkpoints_of_other_ages(tmp_path):
    arrays = svox2s_file(tmp_path / "a.npz")
    del arrays["radius"], arrays["center"]
    np.savez_compressed(tmp_path / "b.npz", **arrays)
    field = VoxelField.load(tmp_path / "b.npz")
    assert field.radius.tolist() == [1, 1, 1]
    assert field.center.tolist() == [0, 0, 0]
    del arrays["basis_type"]
    np.savez(tmp_path / "c.npz", **arrays, basis_data=np.zeros((4, 4, 4, 9), np.float32))
    with pytest.raises(UserError, match="other than spherical harmonics"):
        VoxelField.load(tmp_path / "c.npz")


@pytest.mark.parametrize(("name", "config", "message"), [
    ("x.stl", ExportConfig(), r"must end in \.png, .*\.html, .*\.ply, "),
    ("x.obj", ExportConfig(kind="points"), "points are written as .ply"),
    ("x.ply", ExportConfig(level=1.5), "--level"),
    ("x.glb", ExportConfig(level=1.0), "--level"),
    ("x.glb", ExportConfig(level=0.9999999999), "no surface"),
    ("x.obj", ExportConfig(smooth=-1.0), "--smooth")])
def test_what_can_not_be_exported_is_told(tmp_path, name, config, message):
    with pytest.raises(UserError, match=message):
        export_field(ball_field(), tmp_path / name, config)
    assert not list(tmp_path.iterdir())


def test_an_empty_field_has_no_mesh(tmp_path):
    field = VoxelField(np.full((4, 4, 4), -1, np.int32), np.zeros(0, np.float32),
                       np.zeros((0, 3, 1), np.float32))
    for name in ("x.glb", "x.ply"):
        with pytest.raises(UserError):
            export_field(field, tmp_path / name)


def test_the_command(tmp_path, capsys):
    ball_field().save(tmp_path / "f.npz")
    assert main(["export", str(tmp_path / "f.npz"), "--out", str(tmp_path / "f.glb"), "--json",
                 str(tmp_path / "run.json")]) == 0
    figures = json.loads((tmp_path / "run.json").read_text())
    assert figures["faces"] > 1000
    assert "faces" in capsys.readouterr().out
    assert main(["export", str(tmp_path / "f.npz"), "--out", str(tmp_path / "f.xyz")]) == 2
    assert "must end in" in capsys.readouterr().err
