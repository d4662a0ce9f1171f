"""Signs of a GPU and what is missing, on machines that are folders of files here."""

import json
import sys

import pytest

from lfportrait import graphics
from lfportrait.graphics import gpu_in_sight, lacking


@pytest.fixture
def machine(tmp_path, monkeypatch):
    """Makes this machine a Linux one with these files under /dev and these drivers of Vulkan."""
    def make(*devices, drivers=(), wgpu=True, loader=True, torch="2.13.0+cu130"):
        monkeypatch.setattr(sys, "platform", "linux")
        monkeypatch.setattr(graphics, "DEVICES", tmp_path / "dev")
        for name in devices:
            path = tmp_path / "dev" / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.touch()
        folder = tmp_path / "icd.d"
        folder.mkdir(exist_ok=True)
        for name in drivers:
            (folder / f"{name}.so").touch()
            (folder / f"{name}.json").write_text(
                json.dumps({"ICD": {"library_path": f"./{name}.so"}}))
        monkeypatch.setenv("VK_DRIVER_FILES", str(folder))
        monkeypatch.setattr(graphics, "find_spec", lambda name: True if wgpu else None)
        monkeypatch.setattr(graphics, "loads", lambda library: loader)
        monkeypatch.setattr(graphics.metadata, "version", lambda name: torch)
        return folder
    return make


@pytest.mark.parametrize("file, seen", [
    ("dri/renderD128", True), ("nvidia0", True), ("dxg", True), ("kfd", True),
    ("dri/card0", False), ("nvidiactl", False), ("fb0", False)])
def test_a_gpu_is_in_sight_by_its_files(machine, file, seen):
    machine(file)
    assert gpu_in_sight() == seen


def test_other_systems_have_to_be_asked(monkeypatch):
    for system in ("darwin", "win32"):
        monkeypatch.setattr(sys, "platform", system)
        assert gpu_in_sight()


def test_nothing_is_missing_where_all_is_there(machine):
    machine("dri/renderD128", drivers=("radeon_icd", "lvp_icd"))
    assert lacking() == []


def test_the_package_the_loader_and_the_drivers_are_named_with_their_remedies(machine):
    machine(wgpu=False, loader=False)
    assert [(lack.what.split(" (")[0], lack.remedy) for lack in lacking()] == [
        ("wgpu is not installed", "pip install 'lfportrait[gpu]'"),
        ("there is no Vulkan loader", "apt install libvulkan1"),
        ("Vulkan has no driver", "apt install mesa-vulkan-drivers")]


def test_a_container_without_nvidias_graphics_part(machine):
    machine("nvidia0", drivers=("lvp_icd",))
    lack, = lacking()
    assert "NVIDIA's Vulkan driver is missing" in lack.what
    assert "NVIDIA_DRIVER_CAPABILITIES=all" in lack.remedy


def test_a_card_with_a_driver_of_software_alone(machine):
    machine("dri/renderD128", drivers=("lvp_icd",))
    assert [lack.what for lack in lacking()] == ["Vulkan has a driver of software only"]


def test_software_alone_is_all_that_a_machine_without_a_card_needs(machine):
    machine(drivers=("lvp_icd",))
    assert lacking() == []


def test_a_driver_whose_library_is_gone_is_none(machine):
    folder = machine(drivers=("lvp_icd",))
    (folder / "lvp_icd.so").unlink()
    (folder / "torn.json").write_text("{")
    assert [lack.remedy for lack in lacking()] == ["apt install mesa-vulkan-drivers"]


def test_a_card_that_the_user_may_not_open(machine, monkeypatch):
    machine("dri/renderD128", drivers=("radeon_icd",))
    monkeypatch.setattr(graphics.os, "access", lambda path, mode: False)
    lack, = lacking()
    assert "renderD128" in lack.what and "render" in lack.remedy


def test_a_torch_without_gpus_beside_a_card_that_it_knows(machine):
    machine("nvidia0", drivers=("nvidia_icd",), torch="2.13.0+cpu")
    lack, = lacking()
    assert "torch 2.13.0+cpu" in lack.what
