"""What a training says that it will take."""

import re

import pytest

from lfportrait.field import ReconstructConfig, lattice_points
from lfportrait.field.training.meter import outlook


def _numbers(text: str) -> list[float]:
    return [float(number) for number in re.findall(r"\d+(?:\.\d+)?", text)]


@pytest.mark.parametrize("finest, first, count, millions, memory, seconds", [
    (256, 2.35, 77_593, 3.3, 2.4, 47.6), (384, 6.05, 254_837, 7.7, 4.6, 181.0)])
def test_outlook_of_a_plaster_head(finest: int, first: float, count: int, millions: float,
                                   memory: float, seconds: float) -> None:
    """Beside what was measured after a first level of so many seconds and lattice points."""
    config = ReconstructConfig(resolution=finest).resolved(False, 2.0)
    told = _numbers(outlook(config, first, count, True, 2**30))
    assert told[0] == finest
    for number, measured in zip(told[1:], (millions, memory, seconds)):
        assert 0.65 < number / measured < 1.5


def test_a_budget_is_what_it_takes() -> None:
    config = ReconstructConfig(time_budget=90.0).resolved(False, 2.0)
    assert "90 s" in outlook(config, 2.0, 50000, False, 2**30)


def test_a_voxel_is_two_pixels_within_limits() -> None:
    assert lattice_points(1.04 / 320) == 320
    assert lattice_points(0.1) == 256
    assert lattice_points(1e-5) == 512
    assert ReconstructConfig().resolved(False, 2.0, 1.04 / 400).resolutions[-1] == 416
    few = ReconstructConfig(max_resolution=320)
    assert few.resolved(False, 2.0, 1.04 / 400).resolutions[-1] == 320
    asked = ReconstructConfig(max_resolution=320, resolution=384)
    assert asked.resolved(False, 2.0).resolutions[-1] == 384
