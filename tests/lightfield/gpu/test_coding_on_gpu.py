"""Panels, quilts and views from a GPU equal the CPU's."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from lfportrait.field import SurfaceTexture, VoxelField
from lfportrait.gpu import GpuProcess
from lfportrait.lightfield import (
    Display,
    EncodeConfig,
    encode,
    encode_with_figures,
    quilt_of,
    view_camera,
)
from lfportrait.metrics import psnr
from tests.fields import head_field, shell_field

PANEL = Display(width=160, height=90, views=24, pitch=11.3, slant=0.2, cone=40.0)
EVEN = 50.0
"""PSNR in dB from which pictures count as equal."""


@pytest.fixture(scope="module")
def shared(adapter):
    """A process for several tests."""
    one = GpuProcess(adapter)
    yield one
    one.close()


@pytest.fixture(autouse=True)
def process(adapter, shared, monkeypatch):
    """Where ``device="gpu"`` computes: started again now and then, software does not live long."""
    from lfportrait import device

    one = shared
    shared.calls = getattr(shared, "calls", 0) + 1
    if shared.calls % 30 == 0:
        shared.close()
    monkeypatch.setattr("lfportrait.gpu.gpu_process", lambda _: one)
    monkeypatch.setattr(device, "gpu_adapters", lambda: [adapter])
    device.gpu_adapter.cache_clear()
    yield one
    device.gpu_adapter.cache_clear()


pytestmark = pytest.mark.filterwarnings("ignore:.*is no GPU:UserWarning")


def textured(field, seed=3):
    """The field with a texture of two charts, of random strokes."""
    random = np.random.default_rng(seed)
    detail = (0.4 * random.standard_normal((60, 80, 3))).astype(np.float32)
    projections = np.zeros((2, 3, 4))
    for chart, sign in enumerate((1.0, -1.0)):
        projections[chart, 0] = [19.0 * sign, 0, 0, 20.0 + 40 * chart]
        projections[chart, 1] = [0, -28.0, 0, 30.0]
        projections[chart, 2, 3] = 1.0
    points = field.lattice_points()
    charts = np.where(points[:, 2] > 0, 0, 1).astype(np.uint8)
    charts[::7] = 255
    return replace(field, texture=SurfaceTexture.of(detail, projections, charts, 20.0))


def both(field, display, **config):
    """The picture of the CPU and the GPU."""
    chosen = EncodeConfig(**config)
    cpu = encode(field, display, chosen, device="cpu")
    gpu, figures = encode_with_figures(field, display, chosen, device="gpu")
    assert figures["device"].startswith("gpu: ")
    assert gpu.shape == cpu.shape and gpu.dtype == np.uint8
    assert cpu.std() > 5 or not len(field.density)
    return cpu / 255.0, gpu / 255.0


@pytest.mark.parametrize(("basis", "config"), [
    # All numbers of coefficients with both ways to code; the rest changes what is done before.
    # One of them is the shader test of every run.
    (1, {}), *(pytest.param(*case, marks=pytest.mark.slow) for case in (
        (4, {}), (9, {}), (1, {"method": "direct"}), (4, {"method": "direct"}),
        (9, {"method": "direct"}), (1, {"method": "slices"}),
        (9, {"method": "slices", "draft": True}), (1, {"blend": "filtered"}),
        (9, {"blend": "filtered"}), (1, {"turn": 75.0}), (9, {"turn": 75.0}),
        (9, {"background": 0.4, "ground": "black", "draft": True}), (1, {"ground": "white"}),
        (9, {"depth_scale": 0.6, "focus": 0.2, "shift_x": 0.2})))])
def test_a_panel_is_the_cpus(basis, config):
    cpu, gpu = both(textured(shell_field(basis=basis, density=60)), PANEL, **config)
    assert psnr(gpu, cpu) > EVEN


@pytest.mark.slow  # shaders
@pytest.mark.parametrize("name", Display.names())
def test_every_preset_at_a_reduced_and_odd_size(name):
    panel = Display.preset(name)
    share = 96 / max(panel.width, panel.height)
    panel = panel.scaled(round(panel.width * share) + 1, round(panel.height * share) | 1)
    cpu, gpu = both(head_field(24), panel)
    assert psnr(gpu, cpu) > EVEN


@pytest.mark.slow  # shaders; a plain panel is above
@pytest.mark.parametrize("change", [
    {"subpixels": "BGR"}, {"inverted": True, "offset": 3.7}, {"slant": -0.3, "views": 1},
    {"cells": ((-0.3, 0.2, 0.0, -0.2, 0.3, 0.2), (0.1, 0.1, -0.1, 0.2, 0.0, -0.3)),
     "cell_pattern": "checkerboard"},
    {"width": 17, "height": 33}, {"width": 1, "height": 1}, {"eye_height": 0.8}])
def test_panels_of_all_kinds(change):
    cpu, gpu = both(textured(shell_field(basis=1, density=60)), replace(PANEL, **change))
    assert np.abs(cpu - gpu).max() < 0.03 if cpu.size < 100 else psnr(gpu, cpu) > EVEN


@pytest.mark.slow  # shaders
def test_no_field_at_all():
    empty = VoxelField(np.full((9, 8, 7), -1, np.int32), np.zeros(0, np.float32),
                       np.zeros((0, 3, 1), np.float32))
    cpu, gpu = both(empty, PANEL, background=0.25, compose=False)
    assert psnr(gpu, cpu) > EVEN and np.ptp(gpu) == 0


@pytest.mark.slow  # shaders
def test_a_field_larger_than_a_binding(process):
    from lfportrait.field.gpu import field_parts, keep_texture, upload
    from lfportrait.lightfield.coding import panel_job

    field = shell_field(40, basis=9, density=60)
    config = EncodeConfig(compose=False)
    cpu = encode(field, PANEL, config, device="cpu")
    job = panel_job(field, PANEL, config)
    bricks = field.bricks
    parts = field_parts(bricks, field.lattice)
    page = 64 * 1024  # several pages of bricks, and of rows
    assert bricks.links.nbytes > 3 * page and bricks.rows.nbytes > 10 * page
    name = f"{upload.__module__}:{upload.__name__}"
    process.call(name, "large", parts, len(job.viewpoints), page)
    process.call(f"{keep_texture.__module__}:keep_texture", "none", None)
    gpu, _ = process.call("lfportrait.lightfield.gpu.panel:code_panel", ("large", "none"), job)
    assert psnr(gpu / 255.0, cpu / 255.0) > EVEN


@pytest.mark.slow  # shaders
def test_a_field_that_was_sent_is_not_sent_again_unless_another_took_its_place(process,
                                                                            monkeypatch):
    fields = [shell_field(12, basis=1, seed=seed) for seed in range(5)]
    sent = []
    call = process.call

    def counted(name, *arguments):
        sent.append(name.split(":")[1])
        return call(name, *arguments)

    monkeypatch.setattr(process, "call", counted)
    first = encode(fields[0], PANEL, device="gpu")
    np.testing.assert_array_equal(encode(fields[0], PANEL, device="gpu"), first)
    assert sent.count("upload") == 1
    for field in fields:
        encode(field, PANEL, device="gpu")
    np.testing.assert_array_equal(encode(fields[0], PANEL, device="gpu"), first)
    assert sent.count("upload") == 6


@pytest.mark.slow  # shaders
def test_views_have_the_cpus_color_opacity_and_depth():
    config = EncodeConfig(compose=False)
    for field in (textured(head_field(32)), shell_field(basis=9, density=60)):
        for turn in (0.0, 65.0, 180.0):
            camera = view_camera(PANEL, replace(config, turn=turn), 0.5, width=61, height=43)
            cpu = field.render(camera, 0, background=(0.1, 0.5, 0.9))
            gpu = field.render(camera, 0, background=(0.1, 0.5, 0.9), device="gpu")
            assert psnr(gpu.color, cpu.color) > EVEN
            assert psnr(gpu.alpha, cpu.alpha) > EVEN
            met = np.isfinite(cpu.depth)
            assert np.mean(met == np.isfinite(gpu.depth)) > 0.999
            both_met = met & np.isfinite(gpu.depth)
            assert np.abs(gpu.depth[both_met] - cpu.depth[both_met]).mean() < 1e-3


@pytest.mark.slow  # shaders; by the CPU: test_quilt_layouts.py
@pytest.mark.parametrize("config", [{}, {"ground": "white"}, {"turn": 70.0, "background": 0.3}])
def test_a_quilt_is_the_cpus(config):
    panel = replace(PANEL, quilt=(3, 2), quilt_size=(150, 70))
    field = textured(head_field(32))
    cpu, name = quilt_of(field, panel, EncodeConfig(**config))
    gpu, other = quilt_of(field, panel, EncodeConfig(**config), device="gpu")
    assert name == other and psnr(gpu / 255.0, cpu / 255.0) > EVEN


@pytest.mark.slow  # processes that are lost: tests/test_gpu.py, without shaders
def test_a_lost_gpu_leaves_the_cpus_picture(adapter, monkeypatch):
    process = GpuProcess(adapter)
    monkeypatch.setattr("lfportrait.gpu.gpu_process", lambda _: process)
    process.call("tests.gpu_work:echo")
    process._child.kill()
    process._child._process.wait()
    field = head_field(24)
    # One is started again by itself.
    assert psnr(encode(field, PANEL, device="gpu") / 255, encode(field, PANEL, device="cpu") / 255
                ) > EVEN
    assert process.starts == 2
    process._lost = True
    with pytest.warns(UserWarning, match="lost twice: the CPU computes instead"):
        image, figures = encode_with_figures(field, PANEL, device="gpu")
    assert figures["device"] == "cpu"
    np.testing.assert_array_equal(image, encode(field, PANEL, device="cpu"))


@pytest.mark.slow  # test_live.py has the same of pictures that go on
def test_a_hundred_pictures_take_no_more_memory(adapter):
    code = """
import sys
from lfportrait.gpu import GpuProcess, adapters
from lfportrait.lightfield import Display, EncodeConfig
from lfportrait.lightfield.coding import panel_job
from lfportrait.lightfield.coding import code_on_gpu
from tests.fields import head_field
import psutil_free as memory

own = GpuProcess([one for one in adapters() if one.title == sys.argv[1]][0])
field, panel = head_field(20), Display(width=48, height=32, views=8, pitch=7.0)
job = panel_job(field, panel, EncodeConfig(compose=False))
sizes = []
for number in range(101):
    code_on_gpu(own, field, job, 0.01)
    if number in (20, 100):
        sizes.append(memory.resident(own._child.number))
print(*sizes)
"""
    code = code.replace("import psutil_free as memory\n", """
class memory:
    @staticmethod
    def resident(pid):
        for line in open(f"/proc/{pid}/status"):
            if line.startswith("VmRSS"):
                return int(line.split()[1]) * 1024
""")
    if not sys.platform.startswith("linux"):
        pytest.skip("reads /proc")
    done = subprocess.run([sys.executable, "-c", code, adapter.title], capture_output=True,
                          text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    before, after = map(int, done.stdout.split())
    assert after < before + 16e6
