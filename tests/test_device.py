"""What the choice of a device comes to, on machines with other graphics cards than this one's."""

import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from lfportrait import device
from lfportrait.capture import Camera
from lfportrait.device import TorchDevice, check_device, gpu_adapter, torch_device, torch_devices
from lfportrait.errors import UserError
from lfportrait.gpu import Adapter
from lfportrait.lightfield import Display, encode
from tests.fields import shell_field

SMALL = {"max-storage-buffer-binding-size": 64 << 20}
DISCRETE = Adapter("Radeon RX 7600", "discrete", "Vulkan")
INTEGRATED = Adapter("Iris Xe", "integrated", "Vulkan")
SOFTWARE = Adapter("llvmpipe (LLVM 15)", "software", "Vulkan")
OLD = Adapter("GMA 950", "integrated", "Vulkan", limits=SMALL)
CUDA = TorchDevice("cuda:0", "NVIDIA H100", "CUDA", 80 << 30)
SECOND = TorchDevice("cuda:1", "NVIDIA T4", "CUDA", 16 << 30)


@pytest.fixture(autouse=True)
def forgotten():
    """What other tests have asked is forgotten, and what this one asks."""
    for cached in (gpu_adapter, torch_device, torch_devices):
        cached.cache_clear()
    yield
    for cached in (gpu_adapter, torch_device, torch_devices):
        cached.cache_clear()


@pytest.fixture
def machine(monkeypatch):
    """Makes this machine one with these adapters and torch's GPUs, the best adapter first."""
    def make(*adapters, gpus=()):
        monkeypatch.setattr(device, "gpu_in_sight", lambda: True)
        monkeypatch.setattr(device, "find_spec", lambda name: True)
        monkeypatch.setattr(device, "torch_devices", lambda: tuple(gpus))
        monkeypatch.setattr(sys.modules["lfportrait.gpu"], "adapters",
                            lambda: list(adapters))
        monkeypatch.setattr(device, "gpu_adapters", lambda: list(adapters))
    return make


def test_auto_takes_a_real_gpu_and_never_a_program(machine):
    machine(DISCRETE, INTEGRATED, SOFTWARE)
    assert gpu_adapter("auto") is DISCRETE
    assert device.device_name(gpu_adapter("auto")) == "gpu: Radeon RX 7600 (Vulkan)"
    assert gpu_adapter("cpu") is None
    assert device.device_name(None) == "cpu"


@pytest.mark.parametrize("adapters", [(), (SOFTWARE,), (OLD, SOFTWARE)])
def test_auto_without_a_gpu_of_use_is_the_cpu(machine, adapters):
    machine(*adapters)
    assert gpu_adapter("auto") is None


def test_auto_asks_nobody_where_no_gpu_is_in_sight(machine, monkeypatch):
    machine(DISCRETE)
    monkeypatch.setattr(device, "gpu_in_sight", lambda: False)
    assert gpu_adapter("auto") is None


def test_a_program_is_taken_where_it_is_asked_for_and_a_line_says_so(machine):
    machine(SOFTWARE)
    for choice in ("gpu", "gpu:LLVM"):
        with pytest.warns(UserWarning, match="llvmpipe .* is no GPU"):
            assert gpu_adapter(choice) is SOFTWARE


@pytest.mark.parametrize("choice, wanted", [
    ("gpu", DISCRETE), ("gpu:iris", INTEGRATED), ("gpu: XE ", INTEGRATED), ("gpu:rx", DISCRETE)])
def test_a_part_of_the_name_is_enough(machine, choice, wanted):
    machine(DISCRETE, INTEGRATED, SOFTWARE)
    assert gpu_adapter(choice) is wanted


def test_an_unknown_name_is_answered_by_the_known_ones(machine):
    machine(DISCRETE, INTEGRATED, gpus=[CUDA])
    for look_up in (check_device, torch_device):
        with pytest.raises(UserError, match=r"'voodoo'.*Radeon RX 7600 .*Iris Xe .*NVIDIA H100"):
            look_up("gpu:voodoo")
    with pytest.raises(UserError, match="Radeon RX 7600"):
        gpu_adapter("gpu:voodoo")


def test_a_machine_without_gpu_tells_what_is_missing(machine, monkeypatch):
    machine()
    monkeypatch.setattr(device, "lacking", lambda: [
        SimpleNamespace(what="wgpu is not installed", remedy="pip install it")])
    for look_up in (check_device, torch_device):
        with pytest.raises(UserError, match="no GPU here; wgpu is not installed: pip install it"):
            look_up("gpu")


@pytest.mark.filterwarnings("ignore:.*is no GPU")
def test_an_adapter_of_this_machine_is_found_by_its_name(adapter):
    assert gpu_adapter(f"gpu:{adapter.name}").name == adapter.name
    assert not device.too_small(adapter)


@pytest.mark.parametrize("choice", ["", "gpu:", "CPU", "gpus", "npu"])
def test_other_words_are_answered_by_the_choices(choice):
    for look_up in (check_device, gpu_adapter, torch_device):
        with pytest.raises(UserError, match="auto, cpu, gpu or gpu:NAME"):
            look_up(choice)


def test_stages_do_not_pass_over_the_choice():
    field = shell_field(size=8)
    with pytest.raises(UserError, match="auto, cpu, gpu or gpu:NAME"):
        encode(field, Display(8, 6, views=2, pitch=3.0), device="tpu")
    camera = Camera.arc(np.zeros(1), distance=4.0, width=4, height=4, focal=8.0)
    with pytest.raises(UserError, match="auto, cpu, gpu or gpu:NAME"):
        field.render(camera, 0, device="tpu")


def test_a_job_names_the_gpu_that_a_stage_used():
    figures = {"field": {"seconds": 2.0}, "stylize": {"device": "cpu"}}
    assert device.used_device(figures) == "cpu"
    figures["encode"] = {"device": "gpu: Radeon (Vulkan)"}
    assert device.used_device(figures) == "gpu: Radeon (Vulkan)"


# -- torch ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("choice, place", [
    ("auto", "cuda:0"), ("gpu", "cuda:0"), ("cpu", "cpu"), ("gpu:t4", "cuda:1"),
    ("gpu:cuda", "cuda:0")])
def test_torch_takes_the_chosen_gpu(machine, choice, place):
    machine(DISCRETE, gpus=[CUDA, SECOND])
    assert torch_device(choice).place == place


def test_torch_stays_on_the_cpu_with_a_gpu_that_only_webgpu_can_use(machine):
    machine(DISCRETE)
    assert torch_device("auto").place == "cpu"
    with pytest.warns(UserWarning, match="torch, as installed here, can't use Radeon RX 7600"):
        assert torch_device("gpu:radeon").place == "cpu"


def test_torch_is_asked_for_names_and_memory(monkeypatch):
    import torch

    monkeypatch.setattr(device, "gpu_in_sight", lambda: True)
    names = ["NVIDIA H100", "NVIDIA T4"]
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    monkeypatch.setattr(torch.cuda, "get_device_name", names.__getitem__)
    monkeypatch.setattr(torch.cuda, "get_device_properties",
                        lambda number: SimpleNamespace(total_memory=(80, 16)[number] << 30))
    monkeypatch.setattr(torch.backends.mps, "is_available", lambda: False)
    monkeypatch.setattr(torch.xpu, "is_available", lambda: False)
    monkeypatch.setattr(torch.version, "hip", None)
    assert torch_devices() == (CUDA, SECOND)
    assert device.device_name(CUDA) == "gpu: NVIDIA H100 (CUDA)"
    torch_devices.cache_clear()
    monkeypatch.setattr(torch.version, "hip", "6.4")
    assert torch_devices()[0].backend == "ROCm"


def test_apples_gpu_has_the_name_of_its_processor(monkeypatch):
    import torch

    monkeypatch.setattr(device, "gpu_in_sight", lambda: True)
    monkeypatch.setattr(device, "_apple_name", lambda: "Apple M2")
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    monkeypatch.setattr(torch.xpu, "is_available", lambda: False)
    monkeypatch.setattr(torch.backends.mps, "is_available", lambda: True)
    assert torch_devices() == (TorchDevice("mps", "Apple M2", "Metal"),)
    assert torch_device("gpu:m2").title == "Apple M2 (Metal)"


# -- what it costs --------------------------------------------------------------------------------


def test_nothing_slow_is_imported_before_it_is_needed():
    code = ("import sys; from lfportrait import device; device.gpu_in_sight = lambda: False; "
            "found = device.gpu_adapter('auto'), device.torch_device('auto').place, "
            "device.gpu_adapter('cpu'); "
            "print(found, [m for m in ('torch', 'wgpu', 'numpy') if m in sys.modules])")
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "(None, 'cpu', None) []"
