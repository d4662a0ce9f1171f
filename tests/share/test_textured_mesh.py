"""Meshes with a picture: what independent readers see is what the field shows."""

import io
import re
import zipfile

import numpy as np
import pytest
from PIL import Image

from lfportrait.cli import main
from lfportrait.errors import UserError
from lfportrait.field import SurfaceTexture, VoxelField, field_mesh
from lfportrait.share import ExportConfig, export_field, orbit_cameras
from lfportrait.share.mesh import bake_texture, plain_stem
from tests.fields import head_field
from tests.reference.triangles import draw
from tests.share.test_splats import one_voxel

TEXTURED = ExportConfig(texture="yes")
METRES = 0.1
"""Of a unit of the portrait frame."""


@pytest.fixture(scope="module")
def field():
    return head_field(64)


def read_with_trimesh(path):
    """Corners in metres, faces, places (y down) and picture, by trimesh."""
    trimesh = pytest.importorskip("trimesh")
    scene = trimesh.load(path, process=False, maintain_order=True)
    mesh = next(iter(scene.geometry.values())) if hasattr(scene, "geometry") else scene
    material = mesh.visual.material
    picture = getattr(material, "baseColorTexture", None) or material.image
    places = np.array(mesh.visual.uv)
    places[:, 1] = 1 - places[:, 1]
    return np.array(mesh.vertices), np.array(mesh.faces), places, np.asarray(picture.convert("RGB"))


def read_with_usd(path):
    """The same by Pixar's USD."""
    Usd = pytest.importorskip("pxr.Usd")
    from pxr import UsdGeom, UsdShade

    stage = Usd.Stage.Open(str(path))
    assert stage.GetDefaultPrim().GetName() == "Portrait"
    assert UsdGeom.GetStageUpAxis(stage) == "Y"
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/Portrait/Head"))
    assert set(mesh.GetFaceVertexCountsAttr().Get()) == {3}
    faces = np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)
    places = np.array(UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st").Get(), np.float64)
    places[:, 1] = 1 - places[:, 1]
    points = np.array(mesh.GetPointsAttr().Get())
    extent = np.array(mesh.GetExtentAttr().Get())
    assert np.allclose(extent, [points.min(0), points.max(0)], atol=1e-4)
    material, _ = UsdShade.MaterialBindingAPI(mesh).ComputeBoundMaterial()
    surface = material.ComputeSurfaceSource()[0]
    source = surface.GetInput("emissiveColor").GetConnectedSource()[0]
    file = UsdShade.Shader(source.GetPrim()).GetInput("file").Get()
    with zipfile.ZipFile(path) as archive:
        picture = Image.open(io.BytesIO(archive.read(file.path)))
        points = points * UsdGeom.GetStageMetersPerUnit(stage)
        return points, faces, places, np.asarray(picture.convert("RGB"))


READERS = {".glb": read_with_trimesh, ".obj": read_with_trimesh, ".usdz": read_with_usd}


@pytest.mark.parametrize("suffix", [
    pytest.param(suffix, marks=() if suffix == ".obj" else pytest.mark.slow) for suffix in READERS])
def test_what_others_read_looks_like_the_field(tmp_path, field, suffix):
    figures = export_field(field, tmp_path / f"head{suffix}", TEXTURED)
    vertices, faces, places, picture = READERS[suffix](tmp_path / f"head{suffix}")
    assert figures["faces"] == len(faces)
    assert figures["texels"] == picture.shape[0] * picture.shape[1]
    assert ((places >= 0) & (places <= 1)).all()
    cameras = orbit_cameras(3, 200, field)
    for view in range(3):
        shot = field.render(cameras, view)
        image, depth = draw(cameras, view, vertices / METRES, faces, places=places,
                            picture=picture)
        solid = np.isfinite(depth)
        # Half a voxel along the outline is 3 % of the picture.
        assert np.mean(solid != (shot.alpha > 0.5)) < 0.03
        both = solid & (shot.alpha > 0.99)
        # Most at the hair's edge, which a voxel of the mesh moves.
        assert np.sqrt(((image - shot.color)[both] ** 2).mean()) < 0.06
        assert np.median(np.abs(image - shot.color)[both]) < 0.01
        near = np.isfinite(shot.depth) & both
        assert np.median(np.abs(depth[near] - shot.depth[near])) < 1.5 * field.spacing.max()


def test_a_usdz_is_stored_plainly_and_aligned(tmp_path, field):
    export_field(field, tmp_path / "h.usdz")
    content = (tmp_path / "h.usdz").read_bytes()
    with zipfile.ZipFile(tmp_path / "h.usdz") as archive:
        names = archive.namelist()
        assert names[0].endswith(".usda")
        assert archive.testzip() is None
        for member in archive.infolist():
            assert member.compress_type == zipfile.ZIP_STORED
            name, extra = (int.from_bytes(content[member.header_offset + at:][:2], "little")
                           for at in (26, 28))
            assert (member.header_offset + 30 + name + extra) % 64 == 0


def test_a_glb_has_one_unlit_material_with_a_picture(tmp_path, field):
    pygltflib = pytest.importorskip("pygltflib")
    export_field(field, tmp_path / "h.glb", TEXTURED)
    scene = pygltflib.GLTF2().load(str(tmp_path / "h.glb"))
    assert scene.extensionsUsed == ["KHR_materials_unlit"]
    assert scene.materials[0].pbrMetallicRoughness.baseColorTexture.index == 0
    assert scene.meshes[0].primitives[0].attributes.COLOR_0 is None
    for view in scene.bufferViews:
        assert view.byteOffset % 4 == 0


def test_each_face_keeps_its_corners_and_lies_in_one_chart(field):
    mesh = field_mesh(field, 0.15, smooth=0.8)
    textured = bake_texture(field, mesh)
    assert np.array_equal(textured.vertices[textured.faces], mesh.vertices[mesh.faces])
    assert np.array_equal(textured.normals[textured.faces], mesh.normals[mesh.faces])
    size = np.array(textured.picture.shape[1::-1])
    edges = np.ptp(textured.places[textured.faces] * size, axis=1)
    # A face that reached into another chart would be as long as the charts are apart.
    assert edges.max() < 16


def test_colors_do_not_bleed_at_the_borders_of_charts(field):
    """Also where a reader takes a coarser level of the picture, nothing of between the charts."""
    textured = bake_texture(field, field_mesh(field, 0.15, smooth=0.8))
    height, width, _ = textured.picture.shape
    coarse = np.asarray(Image.fromarray(textured.picture).resize((width // 2, height // 2),
                                                                Image.Resampling.BOX))
    cameras = orbit_cameras(4, 160, field)
    for view in range(4):
        fine, depth = draw(cameras, view, textured.vertices, textured.faces,
                           places=textured.places, picture=textured.picture)
        rough, _ = draw(cameras, view, textured.vertices, textured.faces, places=textured.places,
                        picture=coarse)
        there = np.isfinite(depth)
        assert np.quantile(np.abs(fine - rough).max(axis=2)[there], 0.99) < 0.12


@pytest.mark.slow  # a mesh of its own
def test_a_painted_field_keeps_detail_that_the_lattice_can_not_hold(tmp_path):
    plain = head_field(64)
    atlas_pixels = 120.0
    # Stripes finer than the lattice, from the front.
    rows = np.mgrid[:400, :400][0]
    detail = np.where(rows // 4 % 2, 0.2, -0.2)[..., None].repeat(3, axis=2)
    projection = np.array([[[atlas_pixels, 0, 0, 200], [0, -atlas_pixels, 0, 200], [0, 0, 0, 1.0]]])
    field = VoxelField(plain.links, plain.density, plain.sh, texture=SurfaceTexture.of(
        detail, projection, np.zeros(len(plain.density), np.uint8), atlas_pixels))
    export_field(field, tmp_path / "h.glb")
    vertices, faces, places, picture = read_with_trimesh(tmp_path / "h.glb")
    cameras = orbit_cameras(1, 300, field)
    expected = field.render(cameras, 0)
    image, depth = draw(cameras, 0, vertices / METRES, faces, places=places, picture=picture)
    face = np.isfinite(depth) & (expected.alpha > 0.99)
    face[:100] = face[200:] = False
    assert expected.color[face].std() > 0.08
    assert np.corrcoef(image[face].ravel(), expected.color[face].ravel())[0, 1] > 0.8


def test_an_obj_names_its_own_files_and_leaves_others_alone(tmp_path, field):
    (tmp_path / "head.png").write_bytes(b"a photo")
    figures = export_field(field, tmp_path / "head.obj", TEXTURED)
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["head.mtl", "head.obj", "head.png", "head_texture.png"]
    assert (tmp_path / "head.png").read_bytes() == b"a photo"
    assert figures["bytes"] == sum((tmp_path / name).stat().st_size for name in names
                                   if name != "head.png")


# Letters beyond ASCII lose the most.
@pytest.mark.parametrize("stem", [
    "頭", *(pytest.param(stem, marks=pytest.mark.slow) for stem in (
        "-Kd 1", "a'b\"c", "my head", "Zoë", "a#b", "Кирилл", " ", "x" * 70 + " y"))])
def test_the_names_inside_an_obj_are_plain_letters(tmp_path, field, stem):
    export_field(field, tmp_path / f"{stem}.obj", TEXTURED)
    named = {}
    for path, words in ((tmp_path / f"{stem}.obj", ["mtllib"]),
                        (*tmp_path.glob("*.mtl"), ["map_Ka", "map_Kd"])):
        for line in path.read_bytes().decode("ascii").splitlines():
            word, _, name = line.partition(" ")
            if word in words:
                assert re.fullmatch(r"\w[\w.-]*", name, re.ASCII)
                assert (tmp_path / name).is_file()
                named[word] = name
    assert named["map_Ka"] == named["map_Kd"]
    assert {path.name for path in tmp_path.iterdir()} == {f"{stem}.obj", *named.values()}
    # The mesh is read with its picture, not grey.
    assert read_with_trimesh(tmp_path / f"{stem}.obj")[3].size > 100


@pytest.mark.slow  # names of materials: above
def test_objs_in_one_folder_have_materials_of_their_own(tmp_path, field):
    stems = ("a b", "a_b", "a  b", "a#b", "ä b", "a-b")
    for stem in (*stems, *stems[:2]):  # the same name again gives the same files
        export_field(field, tmp_path / f"{stem}.obj", TEXTURED)
    assert len([*tmp_path.iterdir()]) == 3 * len(stems)
    assert (tmp_path / "a_b.mtl").is_file()


def test_letters_and_their_accents_may_lie_apart():
    """As on a Mac's older disks: the same name gives the same files."""
    assert plain_stem("Zo\u00eb") == plain_stem("Zoe\u0308") != plain_stem("Zoe")


def test_fields_without_a_painting_keep_colors_at_the_corners(tmp_path, field):
    pygltflib = pytest.importorskip("pygltflib")
    export_field(field, tmp_path / "h.glb")
    scene = pygltflib.GLTF2().load(str(tmp_path / "h.glb"))
    assert scene.meshes[0].primitives[0].attributes.COLOR_0 is not None
    assert not scene.images


def test_meshes_in_the_sources_coordinates(tmp_path):
    field = head_field(24)
    field.frame = np.array([[0, 0, 2.0, 1], [2, 0, 0, 2], [0, 2, 0, 3], [0, 0, 0, 1]])
    for name in ("portrait.glb", "source.glb", "source.usdz"):
        export_field(field, tmp_path / name, ExportConfig(world=name.split(".")[0], texture="yes"))
    here, there, sized = (READERS[path.suffix](path)[0] for path in (
        tmp_path / "portrait.glb", tmp_path / "source.glb", tmp_path / "source.usdz"))
    assert np.allclose(there @ field.frame[:3, :3].T + field.frame[:3, 3], here / METRES, atol=1e-3)
    # A USDZ says how long its unit is: the head keeps its size.
    assert np.allclose(sized, 2 * METRES * there, atol=1e-4)


@pytest.mark.slow  # reads all kinds once more
def test_a_head_is_as_large_in_every_file(tmp_path, field):
    heights = {}
    for suffix, read in READERS.items():
        export_field(field, tmp_path / f"h{suffix}", TEXTURED)
        heights[suffix] = np.ptp(read(tmp_path / f"h{suffix}")[0][:, 1])
    assert 0.1 < heights[".usdz"] < 0.25
    assert np.allclose([*heights.values()], heights[".usdz"], rtol=1e-3)


@pytest.mark.parametrize("suffix", READERS)
def test_a_field_of_one_voxel_is_a_mesh_or_says_why_not(tmp_path, suffix):
    export_field(one_voxel(), tmp_path / f"h{suffix}",
                 ExportConfig(texture="yes", smooth=0.0, level=0.2))
    assert len(READERS[suffix](tmp_path / f"h{suffix}")[1]) >= 8


@pytest.mark.parametrize(("name", "config", "message"), [
    ("x.usdz", ExportConfig(texture="no"), "--texture no"),
    ("x.ply", ExportConfig(kind="mesh", texture="yes"), "--texture yes"),
    ("x.usdz", ExportConfig(kind="points"), "points are written as .ply")])
def test_what_makes_no_sense_is_told_and_nothing_is_written(tmp_path, field, name, config, message):
    with pytest.raises(UserError, match=message):
        export_field(field, tmp_path / name, config)
    assert not list(tmp_path.iterdir())


def test_an_empty_field_is_one_line(tmp_path, capsys):
    one_voxel(density=0.0).save(tmp_path / "f.npz")
    for name in ("h.usdz", "h.spz", "splats.glb"):
        assert main(["export", str(tmp_path / "f.npz"), "--out", str(tmp_path / name),
                     "--quiet"]) == 2
        assert len(capsys.readouterr().err.strip().splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["f.npz"]
