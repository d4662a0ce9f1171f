"""What the doctor finds: on this machine, and on others that lack something."""

import sys

import pytest

from lfportrait import health, models
from lfportrait.gpu import Adapter
from lfportrait.graphics import Lack
from lfportrait.health import Fact, examine
from lfportrait.simd import host


@pytest.fixture
def no_networks(tmp_path, monkeypatch):
    """A machine without any pretrained network."""
    monkeypatch.setenv("LFPORTRAIT_MODELS", str(tmp_path / "named"))
    monkeypatch.setattr(models, "cache_folder", lambda: tmp_path / "cache")
    return tmp_path / "named"


def find(facts: list[Fact], name: str) -> Fact:
    return next(fact for fact in facts if fact.name == name)


def test_each_thing_is_looked_at_once(tmp_path):
    facts = examine(tmp_path)
    names = [fact.name for fact in facts]
    assert len(set(names)) == len(names)
    assert {"Python", "processor", "vectors", "GPU", "threads", "kernels", "memory", "screen",
            "pygame", "ffmpeg", "COLMAP", *models.REGISTRY} <= set(names)
    assert all(fact.text and "\n" not in fact.text for fact in facts)


def test_what_is_bad_has_a_mend_and_what_is_good_has_none(no_networks, tmp_path):
    for fact in examine(tmp_path):
        assert (fact.state == "good") == (not fact.remedy) or fact.name == "screen", fact


def test_nothing_slow_is_imported():
    import subprocess

    code = ("import sys; from lfportrait.health import examine; examine(); "
            "print([m for m in ('torch', 'mediapipe', 'cv2', 'pycolmap', 'av') "
            "if m in sys.modules])")
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"


def test_networks_tell_what_they_are_for_and_how_to_get_them(no_networks, monkeypatch):
    monkeypatch.delenv("LFPORTRAIT_MIRROR", raising=False)
    facts = health._networks()
    assert [fact.name for fact in facts[:3]] == list(models.GROUPS["portrait"])
    assert [fact.state for fact in facts] == ["bad"] * 3 + ["optional"] * (len(facts) - 3)
    assert find(facts, "face-landmarker").remedy == "lfportrait models fetch portrait"
    assert find(facts, "vgg16").remedy == "lfportrait models fetch paper"
    assert find(facts, "face-detector").remedy.startswith("lfportrait models add faceapi_")
    no_networks.mkdir()
    (no_networks / "selfie_multiclass_256x256.tflite").write_bytes(b"here")
    facts = health._networks()
    # The network of six parts stands in for two.
    assert [fact.state for fact in facts[:3]] == ["bad", "good", "good"]


def test_every_network_has_a_purpose():
    assert set(models.PURPOSES) == set(models.REGISTRY)


def test_little_memory_and_disk_are_told(tmp_path, monkeypatch):
    assert health._memory(8_000_000_000).state == "good"
    few = health._memory(1_500_000_000)
    assert (few.state, few.text) == ("bad", "1.5 GB free, but a job takes 4 GB")
    assert "--quick" in few.remedy
    assert health._memory(None).state == "good"
    monkeypatch.setattr(health, "free_disk_bytes", lambda folder: 20_000_000)
    here, cache = health._disks(tmp_path)
    assert here.state == cache.state == "bad"
    assert "--out" in here.remedy
    assert "LFPORTRAIT_MODELS" in cache.remedy


def test_libraries_that_lack_something(monkeypatch):
    assert health._library("none", "no_such_module", "no-such", "tests", ()) == Fact(
        "libraries", "none", "no-such is not installed; it is for tests", "bad",
        "pip install no-such")
    monkeypatch.setattr(sys, "platform", "linux")
    lost = health._library("NumPy", "numpy", "numpy", "tests", (("libnosuch.so.7", "libnosuch7"),))
    assert lost.state == "bad"
    assert lost.remedy == "apt install libnosuch7"
    assert "libnosuch.so.7" in lost.text


def test_kernels_that_cannot_be_kept_are_told():
    fact = health._kernels(host.KernelCache(None, 0, 0))
    assert fact.state == "bad"
    assert "NUMBA_CACHE_DIR" in fact.remedy


@pytest.mark.parametrize("settings, server", [
    ({}, None), ({"DISPLAY": ":0"}, "X11"), ({"WAYLAND_DISPLAY": "wayland-0"}, "Wayland")])
def test_the_window_system(monkeypatch, settings, server):
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    for name, value in settings.items():
        monkeypatch.setenv(name, value)
    assert health._window_system() == server


@pytest.mark.parametrize("used, seen, lacks, state, text, remedy", [
    (Adapter("Radeon", "discrete", "Vulkan"), True, [], "good", "Radeon (Vulkan)", ""),
    (None, False, [Lack("wgpu is not installed", "pip")], "good", "none in sight", ""),
    (None, True, [Lack("wgpu is not installed", "pip install it")], "optional",
     "not used: wgpu is not installed", "pip install it"),
    (None, True, [], "optional", "none that can be used", "lfportrait devices")])
def test_the_gpu_that_is_used_or_why_none_is(monkeypatch, used, seen, lacks, state, text, remedy):
    monkeypatch.setattr(health, "gpu_adapter", lambda: used)
    monkeypatch.setattr(health, "gpu_in_sight", lambda: seen)
    monkeypatch.setattr(health, "lacking", lambda: lacks)
    fact, = health._graphics()
    assert (fact.name, fact.state, fact.remedy) == ("GPU", state, remedy)
    assert text in fact.text
    assert fact.value == ("cpu" if used is None else "gpu: Radeon (Vulkan)")


def test_a_torch_without_gpus_is_told_beside_a_gpu(monkeypatch):
    monkeypatch.setattr(health, "gpu_adapter", lambda: Adapter("RTX", "discrete", "Vulkan"))
    monkeypatch.setattr(health, "lacking", lambda: [Lack("torch 2+cpu is a build for the CPU",
                                                         "install another")])
    assert [fact.state for fact in health._graphics()] == ["good", "optional"]
