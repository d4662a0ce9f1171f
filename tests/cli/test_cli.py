"""The command line: exit codes, one clear line for each mistake, nothing half-written."""

import json
import os
import platform
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from lfportrait.cli import COMMANDS, main
from lfportrait.demo import demo_exemplar
from lfportrait.files import write_image


def run(*words: str) -> int:
    return main([str(word) for word in words])


def left_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.rglob("*") if path.is_file())


def one_line(capsys: pytest.CaptureFixture[str]) -> str:
    lines = [line for line in capsys.readouterr().err.splitlines()
             if line.startswith("lfportrait:")]
    assert len(lines) == 1, lines
    return lines[0]


def test_usage_names_every_command(capsys):
    assert run() == 0
    text = capsys.readouterr().out
    assert all(f"  {name}" in text for name, (_, _, words) in COMMANDS.items()
               if words != "the same")


def test_every_command_explains_its_options(capsys):
    for name in COMMANDS:
        with pytest.raises(SystemExit) as stop:
            run(name, "--help-all")
        assert stop.value.code == 0
        assert "--json" in capsys.readouterr().out


def test_unknown_command(capsys):
    assert run("stylise") == 2
    assert "unknown command 'stylise'" in one_line(capsys)


def test_unknown_option_is_the_users_mistake():
    with pytest.raises(SystemExit) as stop:
        run("encode", "field.npz", "--diplay", "generic-4k")
    assert stop.value.code == 2


@pytest.fixture(scope="module")
def style(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An exemplar with landmarks, good enough to pass the look at the inputs; painted once."""
    path = tmp_path_factory.mktemp("style") / "style.png"
    exemplar = demo_exemplar(width=288, height=384)
    write_image(path, exemplar.image)
    path.with_suffix(".landmarks.txt").write_text(
        "\n".join(f"{x} {y}" for x, y in exemplar.landmarks))
    return path


@pytest.fixture
def networks_at_hand(monkeypatch):
    """A machine that has the networks of a job (where none of them is asked in the end)."""
    monkeypatch.setattr("lfportrait.job.pipeline.get_networks", lambda *_, **__: None)


@pytest.fixture
def no_networks(monkeypatch, tmp_path):
    """A machine without networks, and with none to get any from."""
    monkeypatch.delenv("LFPORTRAIT_MODELS", raising=False)
    monkeypatch.setenv("LFPORTRAIT_MIRROR", "http://127.0.0.1:9")
    monkeypatch.setattr("lfportrait.models.cache_folder", lambda: tmp_path / "cache")
    monkeypatch.setattr("lfportrait.models.PAUSE", 0.0)


def test_missing_folder(tmp_path, style, capsys):
    out = tmp_path / "out"
    assert run("make", tmp_path / "nowhere", "--style", style, "--out", out) == 2
    assert "nowhere" in one_line(capsys)
    assert not out.exists()


def test_empty_folder(tmp_path, style, capsys):
    (tmp_path / "photos").mkdir()
    assert run("make", tmp_path / "photos", "--style", style, "--out", tmp_path / "out",
               "--quiet") == 2
    assert "photos" in one_line(capsys)
    assert not left_in(tmp_path / "out")


def test_two_photos(tmp_path, style, capsys, no_networks):
    noise = np.random.default_rng(0).integers(0, 256, (2, 60, 80, 3), dtype=np.uint8)
    for number, image in enumerate(noise):
        write_image(tmp_path / "photos" / f"{number}.jpg", image)
    assert run("make", tmp_path / "photos", "--style", style, "--out", tmp_path / "out",
               "--quiet") == 2
    assert "2" in one_line(capsys)
    assert not left_in(tmp_path / "out")


@pytest.mark.slow  # the same error: tests/capture/test_calibrate.py
def test_photos_that_do_not_overlap(tmp_path, style, capsys, networks_at_hand):
    generator = np.random.default_rng(0)
    for number in range(4):
        write_image(tmp_path / "photos" / f"{number}.png",
                    generator.integers(0, 256, (120, 160, 3), dtype=np.uint8))
    assert run("make", tmp_path / "photos", "--style", style, "--out", tmp_path / "out",
               "--quiet") == 2
    assert "overlap" in one_line(capsys)
    assert not left_in(tmp_path / "out")


def test_style_without_landmarks_and_nothing_to_detect_them_with(tmp_path, capsys, no_networks):
    write_image(tmp_path / "flat.png", np.full((64, 48, 3), 0.5))
    for number in range(3):
        write_image(tmp_path / "photos" / f"{number}.jpg",
                    np.full((60, 80, 3), 0.5 + 0.1 * number))
    assert run("make", tmp_path / "photos", "--style", tmp_path / "flat.png",
               "--out", tmp_path / "out") == 2
    assert "flat.png" in one_line(capsys)
    assert not (tmp_path / "out").exists()


def test_unknown_style_and_display(tmp_path, style, capsys):
    (tmp_path / "photos").mkdir()
    assert run("make", tmp_path / "photos", "--style", "nosuchstyle", "--out",
               tmp_path / "out") == 2
    assert "nosuchstyle" in one_line(capsys)
    assert run("make", tmp_path / "photos", "--style", style, "--display", "holodeck", "--out",
               tmp_path / "out") == 2
    assert "holodeck" in one_line(capsys)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 torn", b"\x93NUMPY"])
def test_a_file_that_is_no_field(tmp_path, capsys, content):
    (tmp_path / "field.npz").write_bytes(content)
    assert run("encode", tmp_path / "field.npz", "--out", tmp_path / "out.png", "--quiet") == 2
    assert "field.npz" in one_line(capsys)
    assert not (tmp_path / "out.png").exists()


def test_an_output_that_cannot_be_written(tmp_path, style, capsys):
    (tmp_path / "file").write_text("in the way")
    assert run("make", tmp_path, "--style", style, "--out", tmp_path / "file" / "out") == 2
    assert "can't write" in one_line(capsys)


def test_json_holds_what_every_run_has(tmp_path):
    assert run("display", "list", "--json", tmp_path / "run.json") == 0
    figures = json.loads((tmp_path / "run.json").read_text())
    assert {"seconds", "peak_memory_bytes", "device", "version"} <= set(figures)
    assert figures["seconds"]["wall"] >= 0


def test_the_installed_program_runs():
    result = subprocess.run([sys.executable, "-m", "lfportrait", "--version"],
                            capture_output=True, text=True, check=False)
    assert result.returncode == 0
    assert result.stdout.strip()


FAULTS = """
import resource, numpy as np
from lfportrait.cli import dispatch
dispatch._set_up()
np.ones(4 << 20, np.float32)
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(20):
    np.ones(4 << 20, np.float32)
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


@pytest.mark.slow  # a process of its own
@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="another C library's memory")
def test_memory_that_was_freed_is_used_again():
    """Twenty arrays of 16 MiB, one after the other; what the user's environment says, holds."""
    def faults(**environment):
        result = subprocess.run(
            [sys.executable, "-c", FAULTS], capture_output=True, text=True, check=True,
            env={**os.environ, "NUMPY_MADVISE_HUGEPAGE": "0", **environment})
        return int(result.stdout)

    assert faults() < 2000 < 20_000 < faults(MALLOC_MMAP_THRESHOLD_="100000")


def test_a_gpu_of_an_unknown_name(tmp_path, capsys):
    assert run("encode", tmp_path / "field.npz", "--device", "gpu:voodoo 5") == 2
    assert "there is no GPU" in one_line(capsys)


def test_a_device_that_there_is_not(tmp_path, capsys):
    for choice in ("tpu", "gpu:", "GPU", ""):
        assert run("encode", tmp_path / "field.npz", "--device", choice) == 2
        assert "auto, cpu, gpu or gpu:NAME" in one_line(capsys)


def test_a_gpu_with_too_little_memory_is_one_line(monkeypatch, capsys):
    import torch

    from lfportrait.cli.presets import DisplayList

    def full(self):
        raise torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 20 GiB")

    monkeypatch.setattr(DisplayList, "run", full)
    assert run("display", "list") == 2
    assert "use --device cpu" in one_line(capsys)


def test_figures_tell_the_device(tmp_path):
    for choice in ("auto", "cpu"):
        assert run("display", "list", "--device", choice, "--json", tmp_path / "run.json") == 0
        assert json.loads((tmp_path / "run.json").read_text())["device"] == "cpu"


@pytest.mark.parametrize("quick", [False, True])
def test_the_demo_is_large_or_quick(tmp_path, monkeypatch, quick):
    from lfportrait import demo
    from lfportrait.cli import make

    asked = {}

    def job(capture, style, out, display, config, **_):
        asked.update(views=capture, style=style, display=display, config=config)
        return {"seconds": {"total": 0}}

    monkeypatch.setattr(make, "make", job)
    monkeypatch.setattr(demo, "demo_capture", lambda size, views: (size, views))
    monkeypatch.setattr(demo, "demo_exemplar", lambda width, height: (width, height))
    options = ["--quick"] if quick else []
    assert run("demo", "--out", tmp_path, "--quiet", *options) == 0
    assert asked["views"] == ((256, 32) if quick else (384, 60))
    assert asked["style"] == ((576, 768) if quick else (768, 1024))
    assert asked["display"] == ("generic-1080p" if quick else "generic-4k")
    networks = asked["config"].stylize
    assert {networks.content_network, networks.style_network} == {"embedded"}, "what ships with us"
    assert run("demo", "--out", tmp_path, "--quiet", *options, "--views", 12, "--size", 99,
               "--display", "generic-8k", "--style", "charcoal") == 0
    assert asked["views"] == (99, 12)
    assert (asked["display"], asked["style"]) == ("generic-8k", "charcoal")


def test_a_damaged_photo_among_good_ones_is_skipped_with_a_warning(tmp_path, style, capsys,
                                                                     networks_at_hand):
    generator = np.random.default_rng(0)
    for number in range(2):
        write_image(tmp_path / "photos" / f"{number}.png",
                    generator.integers(0, 256, (60, 80, 3), dtype=np.uint8))
    (tmp_path / "photos" / "torn.jpg").write_bytes(b"\xff\xd8\xff\xe0 torn")
    assert run("make", tmp_path / "photos", "--style", style, "--out", tmp_path / "out",
               "--quiet") == 2
    errors = capsys.readouterr().err
    assert "warning:" in errors
    assert "torn.jpg" in errors


def test_sub_actions_are_commands_with_their_own_options(capsys):
    for name, own in (("styles check", "--out"), ("display show", "--focus"),
                      ("display pattern", "--kind"), ("study results", "--study")):
        with pytest.raises(SystemExit):
            run(*name.split(), "--help-all")
        assert own in capsys.readouterr().out
    assert run("display", "list") == 0
    first = capsys.readouterr().out
    assert run("display") == 0 and capsys.readouterr().out == first
