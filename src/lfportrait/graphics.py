"""Signs of a GPU, and what a machine lacks to use one, each with its remedy.

No driver is asked: files, packages and libraries are looked up.
"""

import ctypes
import json
import os
import sys
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

DEVICES = Path("/dev")  # Where the system shows devices as files.
_SIGNS = ("dri/renderD*", "nvidia[0-9]*", "kfd", "dxg", "nvhost-gpu", "mali0")
"""Files there that a GPU's driver makes: any maker's, NVIDIA's, AMD's, that of Windows'
subsystem for Linux, and of boards."""
_SOFTWARE_DRIVERS = ("lvp_icd", "vk_swiftshader")


def gpu_in_sight() -> bool:
    """Whether this machine may have a GPU, by what can be seen without asking any driver."""
    if sys.platform in ("darwin", "win32"):
        return True
    return any(next(DEVICES.glob(sign), None) is not None for sign in _SIGNS)


class Lack(NamedTuple):
    """Something that is missing."""

    what: str  # In words.
    remedy: str  # A command, or what to do.


def lacking() -> list[Lack]:
    """What this machine lacks to use a GPU, the first to be put right first."""
    lacks = []
    if find_spec("wgpu") is None:
        lacks.append(Lack("wgpu is not installed", "pip install 'lfportrait[gpu]'"))
    if not sys.platform.startswith("linux"):
        return [*lacks, *_torch_lacks()]
    if not loads("libvulkan.so.1"):
        lacks.append(Lack("there is no Vulkan loader (libvulkan.so.1)", "apt install libvulkan1"))
    return [*lacks, *_driver_lacks(_drivers()), *_torch_lacks()]


def _driver_lacks(drivers: list[str]) -> list[Lack]:
    """What is wrong with Vulkan's drivers on Linux, by the names of their files."""
    nvidia = next(DEVICES.glob("nvidia[0-9]*"), None) is not None
    if nvidia and not any("nvidia" in name for name in drivers):
        return [Lack("NVIDIA's Vulkan driver is missing",
                     "install the driver's graphics part (libnvidia-gl-NNN); in a container, start "
                     "it with NVIDIA_DRIVER_CAPABILITIES=all")]
    lacks = []
    if not drivers:
        lacks.append(Lack("Vulkan has no driver (no file in /usr/share/vulkan/icd.d)",
                          "apt install mesa-vulkan-drivers"))
    elif gpu_in_sight() and all(name.startswith(_SOFTWARE_DRIVERS) for name in drivers):
        lacks.append(Lack("Vulkan has a driver of software only", "install the driver of the GPU's "
                          "maker; for AMD and Intel: apt install mesa-vulkan-drivers"))
    closed = [path for path in sorted(DEVICES.glob("dri/renderD*"))
              if not os.access(path, os.R_OK | os.W_OK)]
    if closed and not nvidia:
        lacks.append(Lack(f"this user may not open {closed[0]}",
                          "sudo usermod -aG render $USER, then log in again"))
    return lacks


def _torch_lacks() -> list[Lack]:
    """Whether torch is a build without GPUs on a machine that has one torch knows."""
    try:
        version = metadata.version("torch")
    except metadata.PackageNotFoundError:
        return []
    known = any(next(DEVICES.glob(sign), None) is not None for sign in ("nvidia[0-9]*", "kfd"))
    if not (known and version.endswith("+cpu")):
        return []
    return [Lack(f"torch {version} is a build for the CPU: networks will not use the GPU",
                 "install the build for it (https://pytorch.org/get-started/locally)")]


def _drivers() -> list[str]:
    """The names of the files by which Vulkan's loader finds drivers that are there."""
    named = os.environ.get("VK_DRIVER_FILES") or os.environ.get("VK_ICD_FILENAMES")
    if named:
        paths = [Path(name) for name in named.split(os.pathsep)]
        files = [file for path in paths
                 for file in (sorted(path.glob("*.json")) if path.is_dir() else [path])]
    else:
        home = Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local/share")
        data = os.environ.get("XDG_DATA_DIRS") or "/usr/local/share:/usr/share"
        folders = [Path("/etc"), Path("/usr/local/etc"), home,
                   *(Path(folder) for folder in data.split(os.pathsep))]
        files = [file for folder in folders
                 for file in sorted((folder / "vulkan/icd.d").glob("*.json"))]
    return [file.name for file in files if _usable(file)]


def _usable(driver: Path) -> bool:
    """Whether the library that a driver's file names is there."""
    try:
        library = str(json.loads(driver.read_text("utf-8"))["ICD"]["library_path"])
    except (OSError, ValueError, KeyError, TypeError):
        return False
    # A path with a folder is relative to the file, a plain name is the system's to find.
    return (driver.parent / library).exists() if "/" in library else loads(library)


def loads(library: str) -> bool:
    """Whether the system finds a shared library."""
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True
