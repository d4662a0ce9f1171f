"""What is narrower than a photo's colors are stretched over: rims, wings, threads of hair."""

from types import SimpleNamespace

import numpy as np
import pytest

from lfportrait.capture import Camera
from lfportrait.face.one_photo.paint import (
    DEEP,
    Relief,
    Shot,
    _broad,
    _Depths,
    _fill,
    _hairy,
    _Mean,
)
from lfportrait.face.one_photo.solid import HAIR, HEAD

SIDE = 64


def plain(step: float = 0.01) -> SimpleNamespace:
    """A face that is a plain, and down its middle a groove whose walls face each other."""
    x, y = (one.ravel() for one in np.meshgrid(*[np.arange(-0.3, 0.3, step)] * 2))
    normals = np.tile([0.0, 0.0, 1.0], (len(x), 1))
    wall = np.abs(x) < 0.012
    normals[wall] = np.stack([-np.sign(x[wall] - 1e-9), 0 * x[wall], 0 * x[wall]], axis=1)
    count = len(x)
    return SimpleNamespace(on=np.stack([x, y, 0 * x], axis=1), normals=normals, wall=wall,
                           face=np.ones(count, bool), light=np.ones(count), voxel=step,
                           owner=np.full(count, HEAD, np.uint8))


@pytest.mark.parametrize("part", ["face", "ear", "neck", "hair"])
def test_walls_of_a_groove_are_as_the_photo_shows_them(part):
    shell = plain()
    if part == "ear":
        shell.light[:] = 0.8
    elif part != "face":
        shell.face[:] = False
        shell.owner[:] = HAIR if part == "hair" else HEAD
    camera = Camera.arc(np.zeros(1), distance=4.0, width=SIDE, height=SIDE, focal=300.0)
    flat = np.full((SIDE, SIDE), 4.0)
    depths = _Depths(flat, flat, flat, flat, np.ones_like(flat), 0.01, 0.0)
    shot = Shot.of(camera, np.full((SIDE, SIDE, 3), 0.5, np.float32), None)
    weights = [shot.look(shell.on, shell.normals, depths, 0.01, shell.owner, broad).weight
               for broad in (None, _broad(shell))]
    assert weights[0][shell.wall].max() < 0.05
    if part in ("face", "hair"):
        assert weights[1][shell.wall].min() > 0.75
    else:
        assert np.array_equal(weights[0], weights[1])


def test_a_slope_as_wide_as_a_cheek_is_not_the_photos():
    shell = plain()
    side = shell.on[:, 0] > 0.1
    shell.normals[:] = 0.0, 0.0, 1.0
    shell.normals[side] = 1.0, 0.0, 0.1
    facing = _broad(shell)[:, 2]
    assert facing[shell.on[:, 0] > 0.22].max() < 0.3 and facing[shell.on[:, 0] < 0].min() > 0.9


@pytest.mark.parametrize("well", [1.0, 0.45])
def test_a_hairline_is_as_light_as_the_hair_beside_it(well):
    # Fair hair of which the front is seen, or only glimpsed; all that is not lies deep.
    shell = plain()
    count = len(shell.on)
    seen = shell.on[:, 0] < 0
    own, other = _Mean(count), _Mean(count)
    own.weights[:] = own.best[:] = own.square[:] = well * seen
    own.total[:] = well * seen[:, None] * [0.5, 0.4, 0.3, 1.0]
    hair, none = np.ones(count), np.zeros(count)
    found = _fill(shell.on, own, other, (hair, none, none, none), none > 0, None,
                  Relief(shell.normals, np.where(seen, 1.0, 0.3)))
    light = found.mean(axis=1)
    beside, far = (shell.on[:, 0] > 0) & (shell.on[:, 0] < 0.02), shell.on[:, 0] > 0.15
    assert light[far].max() < 0.28
    assert well < 0.5 or light[beside].min() > 0.38


@pytest.mark.parametrize("seen", [0.0, 1.0])
def test_hair_and_a_cheek_have_no_specks_of_each_other_where_no_photo_shows_them(seen):
    shell = plain()
    x, y, _ = shell.on.T
    thread = (np.abs(x + 0.15) < 0.004) & (np.abs(y) < 0.2)
    speck = (np.abs(x - 0.15) < 0.006) & (np.abs(y) < 0.006)
    shell.owner[(x > 0.0) & ~speck | thread] = HAIR
    shell.face, shell.scalp = shell.owner == HEAD, np.zeros(len(x), bool)
    shell.away = np.zeros(len(x))
    hair = (shell.owner == HAIR).astype(float)
    own = SimpleNamespace(best=np.full(len(x), seen), share=hair, square=np.zeros(len(x)))
    other = SimpleNamespace(best=np.zeros(len(x)), share=np.zeros(len(x)))
    found = _hairy(shell, own, other)
    assert thread.sum() > 20 and speck.sum() > 0
    if seen:
        assert np.array_equal(found, hair)
    else:
        assert found[thread].max() < 0.3 and found[speck].min() > 0.7
        stays = (np.abs(x) > 0.025) & (np.abs(y) < 0.2) & ~thread & ~speck
        assert np.abs(found - hair)[stays].max() < 0.15, "an edge, but for two points"


@pytest.mark.parametrize("turned, least, most", [(0.0, 0.75, 1.0), (1.0, 0.0, 0.05)])
def test_the_ground_of_a_groove_is_not_what_lies_behind_a_face(turned, least, most):
    # A face that is turned hides its far side: that has not its color.
    shell = plain()
    camera = Camera.arc(np.zeros(1), distance=4.0, width=SIDE, height=SIDE, focal=300.0)
    flat = np.full((SIDE, SIDE), 4.0)
    depths = _Depths(flat, flat, flat, flat - 2 * DEEP, np.ones_like(flat), 0.01, turned)
    shot = Shot.of(camera, np.full((SIDE, SIDE, 3), 0.5, np.float32), None)
    found = shot.look(shell.on, shell.normals, depths, 0.01, shell.owner, _broad(shell))
    weights = found.weight[np.abs(shell.on[:, 0]) < 0.05]
    assert weights.min() >= least and weights.max() <= most


def test_an_edge_beside_a_slope_is_as_steep_as_the_slope_itself():
    # What is steep goes deeper within a pixel: it lies beside no edge, whatever is around it.
    shell = plain()
    asked = []

    class Edges(_Depths):
        def beside_edge(self, at, far, cosine, under):
            asked.append(cosine)
            return super().beside_edge(at, far, cosine, under)
    camera = Camera.arc(np.zeros(1), distance=4.0, width=SIDE, height=SIDE, focal=300.0)
    flat = np.full((SIDE, SIDE), 4.0)
    depths = Edges(flat, flat, flat, flat, np.ones_like(flat), 0.01, 1.0)
    shot = Shot.of(camera, np.full((SIDE, SIDE, 3), 0.5, np.float32), None)
    found = shot.look(shell.on, shell.normals, depths, 0.01, shell.owner, _broad(shell))
    assert asked and np.count_nonzero(np.abs(asked[0]) < 0.1) >= 0.9 * shell.wall.sum()
    assert found.cosine[shell.wall].min() > 0.4
