"""Colors beyond the photos' directions go on as they are in them."""

import numpy as np
import pytest

from lfportrait.capture import Camera
from lfportrait.field.closing.colors import as_photographed, with_steady_colors
from lfportrait.field.kernels.march import C0, real_harmonics, sh_basis
from tests.fields import head_field

NOWHERE = np.zeros(3)


def directions(degrees):
    """Of rays of cameras at these angles from the front, towards the middle, [N, 3]."""
    turn = np.radians(np.atleast_1d(degrees))
    return np.stack([-np.sin(turn), 0 * turn, -np.cos(turn)], axis=1)


def arc(reach):
    return Camera.arc(np.linspace(-reach, reach, 15), distance=5.0, width=64, height=64,
                      focal=100.0)


def grayed(color, reach=0.0):
    """A head whose coefficients give a color [3] from the front, spread as by a training."""
    field = head_field(32)
    basis = real_harmonics(directions(reach), 9)[0]
    sh = (np.asarray(color)[:, None] - 0.5) * basis / (basis @ basis)
    return field.with_sh(np.broadcast_to(sh, (len(field.density), 3, 9)))


def colors(field, degrees):
    return 0.5 + field.sh @ real_harmonics(directions(degrees), field.basis)[0].astype(np.float32)


@pytest.mark.parametrize("count", [1, 4, 9])
def test_harmonics_are_those_of_the_kernels(count):
    away = np.random.default_rng(count).normal(size=(20, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    out = np.empty(count, np.float32)
    for direction, expected in zip(away, real_harmonics(away, count), strict=True):
        sh_basis(*direction.astype(np.float32), out, 0, count)
        assert np.allclose(out, expected, atol=1e-6)


def test_what_photos_of_an_arc_show_is_seen_from_the_side_too():
    color = np.array([0.9, 0.6, 0.2])
    field = grayed(color)
    assert np.abs(colors(field, 60) - color).max() > 0.15
    steady = with_steady_colors(field, arc(14), NOWHERE)
    for degrees in (0, 12):
        assert np.abs(colors(steady, degrees) - colors(field, degrees)).max() < 0.02
    # A higher price takes more of what photos don't tell.
    off = [[np.abs(seen - color).max() for seen in (colors(one, 60), 0.5 + C0 * one.sh[:, :, 0])]
           for one in (steady, with_steady_colors(field, arc(14), NOWHERE, price=0.03))]
    assert max(off[0]) < 0.1 and max(off[1]) < 0.05
    assert np.abs(0.5 + C0 * field.sh[:, :, 0] - color).max() > 0.25


def test_what_photos_from_all_sides_show_stays():
    rng = np.random.default_rng(0)
    field = head_field(32)
    field = field.with_sh(rng.normal(0, 0.2, (len(field.density), 3, 9)))
    around = Camera.concatenate([
        Camera.arc(np.linspace(-180, 150, 12), distance=5.0, width=64, height=64, focal=100.0,
                   pitch=pitch) for pitch in (-50, 0, 50)])
    steady = with_steady_colors(field, around, NOWHERE, price=1e-4)
    assert np.abs(colors(steady, 40) - colors(field, 40)).mean() < 0.02


def test_colors_that_are_the_same_from_all_sides_stay_to_the_bit():
    field = head_field(32)
    assert field.basis == 1
    assert with_steady_colors(field, arc(14), NOWHERE) is field


def test_what_a_training_says_of_photos_fades_beyond_their_arc():
    field = head_field(32)
    even = field.with_sh(np.zeros((len(field.density), 3, 9), np.float32))
    trained = grayed(np.full(3, 0.8))
    found = as_photographed(even, trained.sh, arc(14), NOWHERE)
    # How far a side goes over into what it was trained to.
    side = field.lattice_points()[:, 0] > 0.4
    within, beyond = ([((colors(found, turn) - 0.5) / 0.3)[side].mean() for turn in turns]
                      for turns in ((-12, 0, 12), (40, 60)))
    assert min(within) > 0.45 and np.mean(within) > 0.7 and np.abs(beyond).max() < 0.15
    assert (found.density == field.density).all()
    assert as_photographed(field, field.sh, arc(14), NOWHERE) is field
