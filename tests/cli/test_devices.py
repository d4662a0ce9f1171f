"""The command that lists GPUs: lines for people, the same as JSON."""

import json

import pytest

from lfportrait import device
from lfportrait.cli import doctor as command
from lfportrait.cli import main
from lfportrait.device import TorchDevice
from lfportrait.gpu import LIMITS, Adapter
from lfportrait.graphics import Lack

CARD = Adapter("Radeon RX 7600", "discrete", "Vulkan", "AMD", "Mesa 25", 8 << 30,
               {**LIMITS, "max-buffer-size": 2 << 30})
OLD = Adapter("GMA 950", "integrated", "Vulkan", limits={**LIMITS, "max-buffer-size": 1 << 20})


@pytest.fixture
def machine(monkeypatch):
    """Makes this machine another one."""
    def make(adapters=(), gpus=(), lacks=()):
        monkeypatch.setattr(command, "gpu_adapters", lambda: list(adapters))
        monkeypatch.setattr(command, "torch_devices", lambda: tuple(gpus))
        monkeypatch.setattr(command, "lacking", lambda: list(lacks))
        monkeypatch.setattr(command, "gpu_adapter",
                            lambda choice: adapters[0] if adapters else None)
        monkeypatch.setattr(command, "torch_device",
                            lambda choice: gpus[0] if gpus else TorchDevice())
    return make


def test_it_lists_adapters_torchs_gpus_and_what_auto_takes(machine, tmp_path, capsys):
    machine([CARD, OLD], [TorchDevice("cuda:0", "Radeon RX 7600", "ROCm", 8 << 30)])
    assert main(["devices", "--json", str(tmp_path / "found.json")]) == 0
    lines = [line.strip() for line in capsys.readouterr().out.splitlines()]
    assert "Radeon RX 7600  (discrete, Vulkan, Mesa 25, 8 GiB)" in lines
    assert ("largest binding 128 MiB, largest buffer 2 GiB, memory of a workgroup 16 KiB, "
            "storage buffers of a stage 8") in lines
    assert "GMA 950  (integrated, Vulkan, too small: less than WebGPU's default limits)" in lines
    assert "Radeon RX 7600  (ROCm, cuda:0, 8 GiB)" in lines
    assert "light fields: gpu: Radeon RX 7600 (Vulkan)" in lines
    assert "networks: gpu: Radeon RX 7600 (ROCm)" in lines
    assert "missing" not in lines
    figures = json.loads((tmp_path / "found.json").read_text())
    assert [one["name"] for one in figures["adapters"]] == ["Radeon RX 7600", "GMA 950"]
    assert [one["too_small"] for one in figures["adapters"]] == [False, True]
    assert figures["adapters"][0]["limits"]["max-buffer-size"] == 2 << 30
    assert figures["torch"]["devices"][0]["place"] == "cuda:0"
    assert figures["auto"]["networks"] == "gpu: Radeon RX 7600 (ROCm)"
    assert figures["missing"] == []
    assert figures["device"] == "cpu"  # of this run, which computed nothing


def test_a_machine_without_any_tells_what_is_missing(machine, tmp_path, capsys):
    machine(lacks=[Lack("there is no Vulkan loader", "apt install libvulkan1")])
    assert main(["devices", "--json", str(tmp_path / "found.json")]) == 0
    lines = [line.strip() for line in capsys.readouterr().out.splitlines()]
    assert lines.count("none") == 2
    assert "there is no Vulkan loader: apt install libvulkan1" in lines
    assert lines[-4:-2] == ["light fields: cpu", "networks: cpu"]
    figures = json.loads((tmp_path / "found.json").read_text())
    assert figures["auto"] == {"light fields": "cpu", "networks": "cpu"}
    assert figures["missing"] == [{"what": "there is no Vulkan loader",
                                   "remedy": "apt install libvulkan1"}]


def test_this_machine_is_listed_as_it_is(capsys):
    assert main(["devices"]) == 0
    text = capsys.readouterr().out
    for one in (*device.gpu_adapters(), *device.torch_devices()):
        assert one.name in text
