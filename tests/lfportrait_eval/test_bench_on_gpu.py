"""Figures of coding on a GPU."""

import pytest

from lfportrait.gpu import gpu_process
from lfportrait.lightfield import Display, EncodeConfig
from lfportrait_eval.bench.encode import device_figures
from tests.fields import shell_field

pytestmark = pytest.mark.slow  # shaders; tests/lightfield/gpu codes a panel by them


def test_the_devices_own_time_and_the_floor(adapter):
    panel = Display(width=64, height=40, views=8, pitch=7.0)
    figures = device_figures(shell_field(12, basis=4), panel, EncodeConfig(), adapter)
    gpu_process(adapter).close()
    assert figures["copy_bytes"] > 3 * 64 * 40
    assert all(figures[name] > 0 for name in ("device_seconds", "shade_seconds", "copy_seconds"))
