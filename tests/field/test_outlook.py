"""What a training says that it will take."""

import re

from lfportrait.field import ReconstructConfig, lattice_points
from lfportrait.field.training.outlook import outlook


def _numbers(text: str) -> list[float]:
    return [float(number) for number in re.findall(r"\d+(?:\.\d+)?", text)]


def test_outlook_of_a_plaster_head() -> None:
    # Measured: 64, 128 and 256 points, the first level 2.35 s; then 3.3 million lattice points,
    # 2.4 GiB at most, 47.6 s.
    config = ReconstructConfig(finest=256).resolved(False, 2.0)
    points, millions, memory, seconds = _numbers(
        outlook(config, 2.35, 77593, True, int(1.0 * 2**30)))
    assert points == 256
    assert 2.2 < millions < 4.4
    assert 1.8 < memory < 3.2
    assert 30 < seconds < 75


def test_outlook_of_a_fine_lattice() -> None:
    # Measured: 96, 192 and 384 points, 6.05 s; 7.7 million, 4.6 GiB, 181 s.
    config = ReconstructConfig(finest=384).resolved(False, 2.0)
    points, millions, memory, seconds = _numbers(
        outlook(config, 6.05, 254837, True, int(1.0 * 2**30)))
    assert points == 384
    assert 5 < millions < 10.5
    assert 3.4 < memory < 6.2
    assert 120 < seconds < 280


def test_a_budget_is_what_it_takes() -> None:
    config = ReconstructConfig(time_budget=90.0).resolved(False, 2.0)
    assert "90 s" in outlook(config, 2.0, 50000, False, 2**30)


def test_a_voxel_is_two_pixels_within_limits() -> None:
    assert lattice_points(1.04 / 320) == 320
    assert lattice_points(0.1) == 256
    assert lattice_points(1e-5) == 512
    assert ReconstructConfig().resolved(False, 2.0, 1.04 / 400).resolutions[-1] == 416
    assert ReconstructConfig(at_most=320).resolved(False, 2.0, 1.04 / 400).resolutions[-1] == 320
    assert ReconstructConfig(at_most=320, finest=384).resolved(False, 2.0).resolutions[-1] == 384
