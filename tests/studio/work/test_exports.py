"""A file is what its card says, whatever it is called, and is whole alone."""

from pathlib import Path
from zipfile import ZipFile

import pytest

pytest.importorskip("starlette")

from lfportrait.studio.exports import checked_options, entries, keep, kind_of, remove, target
from lfportrait.studio.jobs import Order
from lfportrait.studio.projects import Project
from lfportrait.studio.work.jobs import export
from lfportrait.studio.work.pictures import Teller
from tests.share.page.portraits import painted_head


@pytest.fixture(scope="module")
def styled(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("head") / "styled.npz"
    painted_head(32, strokes=True).save(path)
    return path


def exported(project: Project, styled: Path, kind: str, name: str, **options) -> dict:
    """A file as the page orders it; its entry."""
    one = kind_of(kind)
    keep(project, export(Order("export", project.own, display="generic-1080p", more={
        "target": str(target(project, one, name)), "kind": kind, "placement": {},
        "options": checked_options(one, options), "look": {"styled": str(styled)}}),
        Teller(lambda *_: None, project.own)))
    return entries(project)[-1]


@pytest.fixture
def project(tmp_path) -> Project:
    (tmp_path / "anna").mkdir()
    return Project(tmp_path / "anna")


def test_an_obj_that_is_saved_has_its_material_and_its_picture_with_it(project, styled):
    path = Path(exported(project, styled, "obj", "Anna's head")["path"])
    assert path.name == "Anna's head-obj.zip"
    with ZipFile(path) as together:
        names = together.namelist()
        mesh, material = (next(name for name in names if name.endswith(ending))
                          for ending in (".obj", ".mtl"))
        (picture,) = {*names} - {mesh, material}
        # Many programs end these names at a space.
        assert f"mtllib {material}" in together.read(mesh).decode().splitlines()
        assert f"map_Kd {picture}" in together.read(material).decode().splitlines()
        assert not any(" " in name or "'" in name for name in names)
    assert [one.name for one in path.parent.iterdir()] == [path.name]


def test_a_name_does_not_make_splats_of_a_model(project, styled):
    points = Path(exported(project, styled, "ply", "Mr Splatt")["path"]).read_bytes()
    header = points.partition(b"end_header")[0].decode().splitlines()
    assert "property uchar red" in header and not any("f_dc" in line for line in header)


def test_a_quilt_goes_with_what_lies_beside_it(project, styled):
    one = exported(project, styled, "quilt", "Anna")
    folder = Path(one["path"]).parent
    assert len(list(folder.iterdir())) == 2
    remove(project, one["id"])
    assert not list(folder.iterdir()) and not entries(project)
