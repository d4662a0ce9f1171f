"""The measurements run on tiny data and report what DESIGN fixes."""

import math
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from lfportrait.capture import Camera, Capture
from lfportrait.demo import demo_exemplar, demo_landmarks, demo_photo
from lfportrait.field import ReconstructConfig
from lfportrait.lightfield import Display
from lfportrait.lightfield.prints import PrintConfig
from lfportrait.media.pictures import read_image
from lfportrait.stylize import StylizeConfig
from lfportrait_eval.baselines.config import NetworkConfig
from lfportrait_eval.bench import (
    METHODS,
    bench,
    bench_encode,
    bench_print,
    bench_reconstruct,
    bench_stylize,
    bench_transfer,
    transfer_table,
)
from lfportrait_eval.bench.run import line_plot, machine_rates, training_floor
from tests.fields import shell_field
from tests.share.test_video import ball


@pytest.fixture
def small_panels(monkeypatch):
    """Presets of the same names, a thirtieth of the size."""
    preset = Display.preset

    def small(name: str) -> Display:
        panel = preset(name)
        return replace(panel, width=panel.width // 30, height=panel.height // 30)

    monkeypatch.setattr(Display, "preset", staticmethod(small))


@pytest.mark.slow  # only the project measures
def test_encode_reports_every_size_and_the_rivals(small_panels):
    figures = bench_encode(shell_field(size=32), repeats=1)
    for size in ("1080p", "4k", "8k", "direct", "view_by_view"):
        row = figures[size]
        assert row["seconds"] > 0 and row["views"] == 96 and row["method"]
    assert figures["8k"]["subpixels"] == 3 * 256 * 144
    for size in ("1080p", "4k", "8k"):
        # Samples a voxel apart come near those half a voxel apart, and are not equal to them.
        assert 25 < figures[size]["psnr"] < 99
        assert 20 < figures[size]["draft_psnr"] < figures[size]["psnr"]
        assert 0 <= figures[size]["memory_bytes"] < 1 << 30
    assert list(figures["views"]) == ["32", "64", "96", "160"]
    assert list(figures["cones"]) == ["20", "40", "60"]
    assert figures["view_by_view"]["times_slower"] > 0
    rows = figures["mask"]
    assert [row["resolution"] for row in rows] == ["1k", "2k", "4k", "8k"]
    for row in rows:
        assert min(row[name] for name in ("build_seconds", "load_seconds", "with_seconds",
                                          "without_seconds")) > 0
    assert rows[3]["bytes"] == 3 * 256 * 144


def test_memory_of_a_call():
    # In a process of its own: here, memory that earlier tests held may be given back meanwhile.
    code = ("import numpy as np; from lfportrait.measure import memory_of; "
            "memory, result = memory_of(lambda: np.ones(1 << 26, np.uint8).sum()); "
            "print(memory, result, memory_of(lambda: 1)[0])")
    printed = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True).stdout
    memory, result, again = map(int, printed.split())
    assert result == 1 << 26
    assert 0.9 * (1 << 26) < memory < 2 * (1 << 26)
    assert again < 1 << 23


def ball_capture(size=40, views=12) -> Capture:
    cameras = Camera.arc(np.linspace(-150, 150, views), distance=4.0, width=size, height=size,
                         focal=1.7 * size)
    field = ball()
    shots = [field.render(cameras, view, background=0.0) for view in range(views)]
    alphas = [np.uint8(255 * shot.alpha + 0.5) for shot in shots]
    images = [np.uint8(255 * np.clip(shot.color / np.maximum(shot.alpha, 1e-3)[..., None], 0, 1))
              for shot in shots]
    return Capture(cameras, images, alphas, [f"{view}.png" for view in range(views)],
                   np.arange(views) % 6 == 3)


@pytest.mark.slow  # only the project measures
def test_reconstruct_reports_speed_and_quality(tmp_path):
    figures = bench_reconstruct(
        ball_capture(), ReconstructConfig(resolutions=(24,), rays=(0.2,), batch=(4096,)),
        render_size=48, repeats=1, plot=tmp_path / "curve.png")
    assert figures["train_rays"] > 150000 and figures["train_rays_per_second"] > 0
    assert figures["render_rays_per_second"] > 0 and figures["seconds"] > 0
    assert math.isfinite(figures["test"]["psnr"]) and figures["test"]["psnr"] > 13
    assert figures["peak_memory_bytes"] > 0
    floor = figures["floor"]
    assert 1 < floor["samples_per_ray"] < 80
    assert 0 < floor["rows_per_ray"] < 8 * floor["samples_per_ray"]
    assert floor["rays_per_second"] == min(floor["memory_rays_per_second"],
                                           floor["compute_rays_per_second"])
    assert figures["curve"][-1]["held_out_psnr"] == figures["test"]["psnr"]
    assert read_image(tmp_path / "curve.png").shape == (600, 960, 3)


@pytest.mark.slow  # test_bench_on_gpu.py measures the same device
def test_reconstruct_reports_the_same_of_a_gpu(adapter):
    figures = bench_reconstruct(
        ball_capture(), ReconstructConfig(resolutions=(16,), rays=(0.01,), batch=(1024,)),
        render_size=16, repeats=1, device=f"gpu:{adapter.name}")
    assert figures["device"].endswith(adapter.title)
    assert figures["train_rays"] == 10240 and figures["kernel_rays_per_second"] > 0
    floor = figures["floor"]
    assert floor["bytes_per_ray"] == pytest.approx(floor["rows_per_ray"] * 3 * 32 * 4)
    assert floor["rows_per_ray"] > 0 and floor["rays_per_second"] > 0
    assert figures["times_above_floor"] == pytest.approx(
        floor["rays_per_second"] / figures["kernel_rays_per_second"])


def test_the_floor_is_counted_by_hand():
    rates = {"random_lines_per_second": 1.2e8, "multiply_adds_per_second": 1e11}
    floor = training_floor(rates, samples=10.0, rows=5.0, width=32)
    # Rows read to be seen, read and written to be changed: three times two lines a row.
    assert floor["lines_per_ray"] == 30.0
    assert floor["memory_rays_per_second"] == pytest.approx(4e6)
    assert floor["multiply_adds_per_ray"] == 10 * (8 * 9 + 60) + 5 * (48 + 96)
    assert floor["rays_per_second"] == floor["memory_rays_per_second"]


@pytest.mark.slow  # only the project measures
def test_the_machine_is_measured():
    rates = machine_rates(megabytes=64)
    assert 1e6 < rates["random_lines_per_second"] < 1e11
    assert 1e8 < rates["multiply_adds_per_second"] < 1e14


def test_a_plot_shows_its_curves_inside_its_axes():
    picture = line_plot({"a": ([0, 1, 2], [10, 20, 30]), "b": ([2, 0], [12, 12])}, across="x",
                        up="y")
    assert picture.shape == (600, 960, 3)
    blue = (picture == (31, 98, 180)).all(-1)
    plot = blue[60:480, 80:930]
    rows, columns = np.nonzero(plot)
    # The first curve rises from the left to the right.
    assert np.corrcoef(columns, rows)[0, 1] < -0.9
    assert not blue[:, :40].any() and (picture[:, :40] < 128).any()  # the axis
    with pytest.raises(ValueError, match="points"):
        line_plot({"a": ([], [])}, across="x", up="y")


@pytest.mark.slow  # only the project measures: what is measured has tests of its own
@pytest.mark.parametrize("methods", [METHODS[:2], METHODS])
def test_transfer_reports_preparation_and_synthesis_apart(monkeypatch, methods):
    monkeypatch.setattr("lfportrait_eval.bench.transfer.ROWS", 1)
    shot, points = demo_photo(96)
    photo = np.ascontiguousarray(shot[..., :3])
    tiny = NetworkConfig(teacher="styleblit", pairs=2, steps=1, size=64, width=4)
    figures = bench_transfer(photo, points, demo_exemplar(width=75, height=100), repeats=1,
                             methods=methods, network=tiny)
    assert figures["size"] == [72, 96]
    for method in methods:
        row = figures[method]
        assert row["precalculation_seconds"] > 0
        assert row["guides_seconds"] + row["synthesis_seconds"] <= row["frame_seconds"]
        assert row["frames_per_second"] == pytest.approx(1 / row["frame_seconds"])
        assert 0 < row["patch_fidelity"] < 40
    if methods == METHODS:
        # Patches of the guided synthesis are the exemplar's own, a network of one step has none.
        assert figures["facestyle"]["patch_fidelity"] < figures["network"]["patch_fidelity"]
        assert figures["network"]["pairs"] == 2 and figures["network"]["steps"] == 1
    published = figures["faceblit"]["published_table_seconds"]
    assert published > figures["faceblit"]["precalculation_seconds"]
    table = transfer_table(figures).splitlines()
    assert [line.split()[0] for line in table[1:-1] if line[0] != " "] == list(methods)


@pytest.mark.slow  # only the project measures
def test_print_reports_both_ways():
    config = PrintConfig(lpi=40, dpi=300, size="50x60mm", bleed=0.0, margin=0.0)
    figures = bench_print(shell_field(size=32, basis=1, density=60.0), config, repeats=1)
    assert figures["pixels"] == round(50 / 25.4 * 300) * round(60 / 25.4 * 300)
    for way in ("rays", "usual"):
        row = figures[way]
        assert row["seconds"] > 0 and row["cpu_seconds"] > 0 and row["memory_bytes"] >= 0
        assert 20 < row["worst"] <= row["psnr"] < 99
    # Columns of finished pictures, resampled, never come nearer than rays.
    assert figures["rays"]["psnr"] > figures["usual"]["psnr"]
    assert figures["usual"]["times_slower"] > 0


@pytest.mark.slow  # only the project measures: what is measured has tests of its own
def test_stylize_reports_its_parts():
    capture = ball_capture()
    head = demo_landmarks() * 0.5
    figures = bench_stylize(ball(), replace(capture, landmarks=head),
                            demo_exemplar(width=96, height=128), by_views=StylizeConfig(
                                method="paper", size=64, views=2, pitches=(8.0,), steps=2),
                            pixels=64.0)
    assert figures["views"]["views"] == 2 and figures["networks"]
    for name in ("skin_seconds", "exemplar_seconds", "preview_seconds", "again_seconds",
                 "paint_seconds", "fit_iteration_seconds", "step_seconds"):
        assert figures[name] > 0
    for name in ("view_seconds", "fit_iteration_seconds", "step_seconds"):
        assert figures["views"][name] > 0


def test_unknown_measurements_are_refused():
    with pytest.raises(ValueError, match="no measurement"):
        bench("everything")
