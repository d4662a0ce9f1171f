"""A solid on a lattice: a closed shell around what can be seen, and nothing deep inside."""

import numpy as np
import pytest
from scipy import ndimage

from lfportrait.capture import Camera
from lfportrait.face.head_prior import generic_prior
from lfportrait.face.one_photo import lattice
from lfportrait.face.one_photo.collar import Collar
from lfportrait.face.one_photo.lattice import shell_of
from lfportrait.face.one_photo.parts import parts_of
from lfportrait.face.one_photo.piece import METRES
from lfportrait.face.one_photo.samples import MeshSamples
from lfportrait.face.one_photo.solid import HEAD, Solid

SIZE = 100


@pytest.fixture(scope="module")
def solid():
    """The generic head alone."""
    prior = generic_prior()
    points = (prior.mean - prior.mean.mean(axis=0)).astype(float) / METRES
    camera = Camera.look_at(np.array([[0, 0, 5.0]]), np.zeros(3), width=SIZE, height=SIZE,
                            focal=200.0)
    matte = np.ones((SIZE, SIZE), np.float32)
    return Solid(parts_of(camera, matte, np.zeros_like(matte), 5.0),
                 MeshSamples.of(points, prior.outer, prior.rest), None, None,
                 np.array([0, 1.0, 0, -9]), -9.0)


def test_free_space_does_not_reach_what_is_within_the_shell(solid):
    shell = shell_of(solid, 64)
    there = shell.links >= 0
    solid_ = np.zeros(there.shape, bool)
    solid_[there] = shell.away[shell.links[there]] < 0
    outer, _ = ndimage.label(np.pad(~solid_, 1, constant_values=True))
    middle = tuple(one // 2 + 1 for one in there.shape)
    assert not there[tuple(one // 2 for one in there.shape)]
    assert outer[middle] != outer[0, 0, 0]


def test_the_neck_behind_a_jaw_is_none_of_the_face(solid):
    """However high the jaw's corners are: a photo shows their edge before the neck."""
    shell = shell_of(solid, 64)
    rest = solid.head.at_rest(shell.on)
    face = shell.whole_face
    head = shell.owner == HEAD
    beside = head & (rest[:, 2] < 0.0) & (rest[:, 1] > 0.0) & (rest[:, 1] < 0.04)
    assert beside.sum() > 20 and not face[beside].any()
    chin = head & (rest[:, 2] > 0.06) & (rest[:, 1] > 0.0)
    cheeks = head & (rest[:, 2] > 0.03) & (rest[:, 1] > 0.025)
    assert chin.any() and face[chin].all() and cheeks.any() and face[cheeks].all()


@pytest.mark.slow  # many points; a few: here, too
def test_fine_points_lie_between_exact_ones(solid, monkeypatch):
    """Where voxels are finer than what the solid is made of."""
    exact = shell_of(solid, 112)
    assert exact.voxel > lattice.DETAIL
    monkeypatch.setattr(lattice, "DETAIL", 1.0)
    fine = shell_of(solid, 112)
    assert fine.links.shape == exact.links.shape
    both = (fine.links >= 0) & (exact.links >= 0)
    one, two = (each.away[each.links[both]] / each.voxel for each in (exact, fine))
    near = np.abs(one) < 1.5
    assert np.sqrt(np.mean((one - two)[near] ** 2)) < 0.155
    directions = [each.normals[each.links[both]][near] for each in (exact, fine)]
    assert np.median((directions[0] * directions[1]).sum(axis=1)) > 0.999
    owners = [each.owner[each.links[both]] for each in (exact, fine)]
    assert np.array_equal(*owners)


def test_cavities_and_what_lies_deep_are_closed():
    z, y, x = np.mgrid[:41, :41, :41] - 20.0
    away = np.sqrt(z * z + y * y + x * x)
    distance = np.maximum(away - 15, 6 - away).astype(np.float32)  # hollow
    distance[(away > 6) & (away < 9)] = -0.01  # and shallow far inside
    closed, near = lattice._closed(distance)
    assert (closed[away < 15 - 1e-3] < 0).all() and closed[away < 9].max() < -4
    outer = away > 13.5
    assert np.array_equal(closed[outer], distance[outer]) and near[outer].all()
    assert not near[away < 10].any()


def test_what_floats_beside_a_person_goes_and_what_is_worn_stays():
    z, y, x = np.mgrid[:60, :60, :60].astype(np.float32)

    def ball(center: tuple[float, float, float], radius: float) -> np.ndarray:
        return np.sqrt((x - center[0]) ** 2 + (y - center[1]) ** 2 + (z - center[2]) ** 2) - radius

    head, crumb, wire = ball((25, 25, 25), 18), ball((50, 50, 50), 3), ball((50, 8, 8), 3)
    away = np.minimum(np.minimum(head, crumb), wire).astype(np.float32)
    found = lattice._without_crumbs(away, wire < 1, head < 1, 3.0)
    assert (found[crumb < 0] == 3).all() and found[crumb < 1.5].min() > 0
    assert np.array_equal(found[crumb > 6], away[crumb > 6])
    assert lattice._without_crumbs(head, wire < 1, head < 1, 3.0) is head
    # What is thin of a head comes in pieces on a coarse lattice.
    rim = ball((25, 25, 46.5), 1.5)
    both = np.minimum(head, rim)
    assert np.array_equal(lattice._without_crumbs(both, wire < 1, both < 1, 3.0), both)
    assert lattice._without_crumbs(both, wire < 1, head < 1, 3.0)[rim < 0].min() > 0


def test_pieces_apart_are_found_along_the_lattice():
    links = np.full((9, 9, 40), -1, np.int32)
    shell = np.zeros(links.shape, bool)
    shell[:, :, :30] = True  # two blocks with a sheet of free points between them, and a crumb
    shell[4, 4, 36:38] = True
    links[shell] = np.arange(shell.sum(), dtype=np.int32)
    x = np.nonzero(shell)[2]
    inside = x != 12
    found = lattice._apart(links, inside)
    assert np.array_equal(found, x >= 36)
    assert not lattice._apart(links, inside & (x < 30)).any()
    assert not lattice._apart(links, inside & False).any()


def test_no_blade_stands_beside_a_neck():
    z, y, x = np.mgrid[:60, :60, :60].astype(np.float32)
    step, first = 0.02, np.zeros(3)
    block = np.maximum(np.maximum(np.abs(x - 30), np.abs(z - 30)) - 20, y - 30)
    blade = np.maximum(np.maximum(np.abs(x - 45) - 1.5, np.abs(z - 30) - 6), np.abs(y - 30) - 10)
    away = (step * np.minimum(block, blade)).astype(np.float32)
    lock = np.maximum(np.maximum(np.abs(x - 51) - 1.5, np.abs(z - 30) - 3), np.abs(y - 33) - 12)
    away = np.minimum(away, step * lock).astype(np.float32)
    up = np.array([0.0, 1.0, 0.0])
    body, neck = lock > 1, Collar(30 * step * np.ones(3), 0.2, up)
    found = lattice._without_blades(away, body, neck, first, step)
    assert (found[lock < 0] == away[lock < 0]).all(), "what is beside it stays"
    above = (blade < 0) & (y > 34)
    assert above.any() and found[above].min() > 0
    deep = block < -6
    assert np.array_equal(found[deep], away[deep])
    assert np.array_equal(lattice._without_blades(away, body & False, neck, first, step), away)
    elsewhere = neck._replace(middle=neck.middle + up)
    assert np.array_equal(lattice._without_blades(away, body, elsewhere, first, step), away)


def test_points_between_points_are_means():
    coarse = np.random.default_rng(0).normal(size=(4, 5, 3)).astype(np.float32)
    size = [2 * count - 1 for count in coarse.shape]
    places = np.meshgrid(*(np.arange(count) / 2 for count in size), indexing="ij")
    expected = ndimage.map_coordinates(coarse.astype(float), places, order=1)
    np.testing.assert_allclose(lattice._doubled(coarse), expected, atol=1e-6)


@pytest.mark.parametrize("reach", [1, 2])
@pytest.mark.parametrize("beyond", [False, True])
def test_what_grows(reach, beyond):
    values = np.random.default_rng(reach).random((9, 7, 8)) > 0.97
    expected = ndimage.binary_dilation(values, np.ones((3, 3, 3)), reach, border_value=beyond)
    assert np.array_equal(lattice._grown(values, reach, beyond), expected)
