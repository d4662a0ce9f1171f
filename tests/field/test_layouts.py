"""Fields of one lattice lay it out once, and show what each would show alone."""

from dataclasses import replace

import numpy as np

from lfportrait.capture import Camera
from lfportrait.field.kernels import bricks
from lfportrait.lightfield import render_views
from lfportrait.stylize import StyledField
from tests.fields import shell_field


def painted(field, seed):
    """The field painted in random colors, as a style makes it."""
    random = np.random.default_rng(seed)
    rows = len(field.density)
    return StyledField.of(field, random.random((1, rows, 3), np.float32), ["one"],
                          random.random((rows, 3), np.float32), np.zeros((rows, 1), np.uint8),
                          ["skin"])


def pictures(field):
    """A level view, by slices, and one from above, by casting."""
    cameras = [Camera.arc(np.array([0.0]), distance=4.0, width=40, height=30, focal=50.0,
                          pitch=pitch) for pitch in (0.0, 40.0)]
    return [seen.color.copy() for one in cameras for seen in render_views(field, one)]


def alone(field):
    """The field with layouts of its own: nothing is shared with another."""
    return replace(field, links=field.links.copy(), density=field.density.copy())


def test_a_lattice_is_laid_out_once_for_all_its_colors(monkeypatch):
    counts = {"bricks": 0, "stretches": 0}

    def counted(real, key):
        def count(*arguments):
            counts[key] += 1
            real(*arguments)

        return count

    for module, name, key in ((bricks, "_occupied", "bricks"), (bricks, "_count", "stretches")):
        monkeypatch.setattr(module, name, counted(getattr(module, name), key))
    real = shell_field(shape=(20, 20, 20), basis=9)
    first, second = painted(real, 0), painted(real, 1)
    mixed = second.mix(strength=0.5)
    found = [(field, pictures(field), field.solid_extent)
             for field in (first, second, mixed, real, real.with_sh(real.sh[:, :, :1] * 0.5))]
    assert counts == {"bricks": 1, "stretches": 1}
    for field, seen, extent in found:
        own = alone(field)
        assert all(np.array_equal(*pair) for pair in zip(seen, pictures(own), strict=True))
        assert own.solid_extent == extent
    assert counts == {"bricks": 6, "stretches": 6}
    assert not np.array_equal(found[0][1][0], found[1][1][0]), "colors are each field's own"


def test_other_densities_share_nothing():
    real = shell_field(shape=(20, 20, 20), basis=1)
    before = pictures(real)
    thinner = replace(real, density=real.density * np.float32(0.3))
    assert np.abs(pictures(thinner)[0] - before[0]).max() > 0.05
    assert all(np.array_equal(*pair) for pair in zip(before, pictures(real), strict=True))
