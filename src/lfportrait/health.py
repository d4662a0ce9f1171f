"""The installation check of ``lfportrait doctor``: what was found, and commands that fix problems.

Libraries that take seconds to import are looked up, not imported.
"""

from __future__ import annotations

import os
import platform
import sys
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from . import models
from .device import device_name, gpu_adapter
from .graphics import gpu_in_sight, lacking, loads
from .measure import free_disk_bytes, free_memory_bytes, machine
from .version import __version__

if TYPE_CHECKING:
    from .simd.host import KernelCache

MEMORY = 4_000_000_000
"""Bytes that a job takes at its peak: the demo, measured; ``demo --quick`` takes half."""
DISK = 1_000_000_000  # Bytes that its folder takes: the demo's 0.2 GB, and larger photos.

State = Literal["good", "optional", "bad"]


class Fact(NamedTuple):
    """One result of the check."""

    # group, name: Under which heading, and what.
    group: str
    name: str
    text: str  # What was found, in words.
    # ``"good"``; ``"optional"``: not there, and jobs run without it; ``"bad"``: to be fixed.
    state: State = "good"
    remedy: str = ""  # The command that fixes it, or empty.
    value: Any = None  # What was found, for programs.


def examine(folder: str | os.PathLike[str] = ".") -> list[Fact]:
    """Check this machine, the installation, and the folder that results would be written to."""
    return [*_versions(), *_computing(), _memory(free_memory_bytes()), *_disks(Path(folder)),
            *(_library(*row) for row in _LIBRARIES), *_screen(), *_networks()]


def _versions() -> list[Fact]:
    python = platform.python_version()
    return [Fact("program", "lfportrait", f"{__version__} in {Path(__file__).parent}",
                 value=__version__),
            Fact("program", "Python", f"{python} on {platform.system()} {platform.machine()}",
                 value=python)]


def _computing() -> list[Fact]:
    from .simd import host

    facts = machine()
    unit, width = host.vector_unit()
    threads = host.thread_count()
    return [
        Fact("machine", "processor", f"{facts['processor']}, {facts['cores']} cores",
             value={"name": facts["processor"], "cores": facts["cores"]}),
        Fact("machine", "vectors", f"{unit}: {width} floats per vector",
             value={"unit": unit, "width": width}),
        *_graphics(),
        Fact("machine", "threads", str(threads), value=threads),
        _kernels(host.kernel_cache())]


def _graphics() -> list[Fact]:
    """The GPU for light fields, and torch's build for networks; torch itself is not asked."""
    adapter, lacks = gpu_adapter(), lacking()
    name = device_name(adapter)
    if adapter is not None:
        gpu = Fact("machine", "GPU", name.removeprefix("gpu: "), value=name)
    elif not gpu_in_sight():
        gpu = Fact("machine", "GPU", "none in sight: all is computed on the CPU", value=name)
    elif lacks:
        gpu = Fact("machine", "GPU", f"not used: {lacks[0].what}", "optional", lacks[0].remedy,
                   name)
    else:
        gpu = Fact("machine", "GPU", "none that can be used: see `lfportrait devices`",
                   "optional", "lfportrait devices", name)
    build = next((lack for lack in lacks if lack.what.startswith("torch")), None)
    return [gpu] if build is None else [gpu, Fact("machine", "GPU of networks", build.what,
                                                  "optional", build.remedy)]


def _kernels(cache: KernelCache) -> Fact:
    if cache.folder is None:
        return Fact("machine", "kernels", "no folder to keep them: each run compiles them, minutes",
                    "bad", "export NUMBA_CACHE_DIR=FOLDER", {"folder": None, "functions": 0})
    found = (f"{cache.functions} compiled, {models.megabytes(cache.bytes)}" if cache.functions
             else "none compiled yet: the first run takes minutes longer, its kernels are kept")
    return Fact("machine", "kernels", f"{found} in {cache.folder}",
                value={"folder": str(cache.folder), "functions": cache.functions,
                       "bytes": cache.bytes})


def _memory(free: int | None) -> Fact:
    if free is None:
        return Fact("machine", "memory", "free memory is unknown on this system")
    text = f"{free / 1e9:.1f} GB free"
    if free >= MEMORY:
        return Fact("machine", "memory", text, value=free)
    return Fact("machine", "memory", f"{text}, but a job takes {MEMORY / 1e9:.0f} GB", "bad",
                "lfportrait demo --quick, which takes half", free)


def _disks(folder: Path) -> list[Fact]:
    return [_disk("disk here", folder.absolute(), "a job takes", "use another disk: --out FOLDER"),
            _disk("disk of cache", models.cache_folder(), "all networks take",
                  "export LFPORTRAIT_MODELS=FOLDER")]


def _disk(name: str, folder: Path, need: str, remedy: str) -> Fact:
    free = free_disk_bytes(folder)
    text = f"{free / 1e9:.1f} GB free in {folder}"
    if free >= DISK:
        return Fact("machine", name, text, value=free)
    return Fact("machine", name, f"{text}, but {need} {DISK / 1e9:.0f} GB", "bad", remedy, free)


_LIBRARIES = (
    ("ffmpeg", "av", "av", "videos in and out", ()),
    ("COLMAP", "pycolmap", "pycolmap", "cameras from photos", ()),
    ("torch", "torch", "torch", "networks, the style's losses", ()),
    ("OpenCV", "cv2", "opencv-contrib-python", "mattes, motion",
     (("libGL.so.1", "libgl1"), ("libgthread-2.0.so.0", "libglib2.0-0"))),
    ("MediaPipe", "mediapipe", "mediapipe", "faces in photos",
     (("libEGL.so.1", "libegl1"), ("libGLESv2.so.2", "libgles2"))))
"""Name, module, package, what for, and which of the system's libraries it takes on Linux."""


def _library(name: str, module: str, package: str, purpose: str,
             system: tuple[tuple[str, str], ...]) -> Fact:
    version = _version(module, package)
    if version is None:
        return Fact("libraries", name, f"{package} is not installed; it is for {purpose}", "bad",
                    f"pip install {package}")
    lost = [pair for pair in system if sys.platform == "linux" and not loads(pair[0])]
    if lost:
        return Fact("libraries", name, f"{package} {version} can't find "
                    f"{', '.join(library for library, _ in lost)}; it is for {purpose}", "bad",
                    f"apt install {' '.join(debian for _, debian in lost)}", version)
    return Fact("libraries", name, f"{package} {version}: {purpose}", value=version)


def _version(module: str, package: str) -> str | None:
    """The version of an installed package, None where there is none."""
    if find_spec(module) is None:
        return None
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:  # the module comes from another package
        return "(of unknown version)"


def _screen() -> list[Fact]:
    version = _version("pygame", "pygame-ce")
    window = (f"pygame-ce {version}: `lfportrait show`" if version
              else "pygame is not installed; it is for `lfportrait show`")
    server = _window_system()
    return [Fact("libraries", "pygame", window, "good" if version else "optional",
                 "" if version else "pip install 'lfportrait[show]'", version),
            Fact("machine", "screen", server or "none: not a desktop session, so "
                 "`lfportrait show` does not work", "good" if server else "optional", value=server)]


def _window_system() -> str | None:
    """What draws windows here, None where nothing does."""
    if sys.platform in ("win32", "darwin"):
        return "Windows" if sys.platform == "win32" else "macOS"
    if os.environ.get("WAYLAND_DISPLAY"):
        return "Wayland"
    return "X11" if os.environ.get("DISPLAY") else None


def _networks() -> list[Fact]:
    """Those of the main job first."""
    first = models.GROUPS["portrait"]
    names = sorted(models.REGISTRY, key=lambda name: name not in first)
    needed = models.missing(first)
    return [_network(name, name in needed, name in models.missing([name])) for name in names]


def _network(name: str, needed: bool, missing: bool) -> Fact:
    purpose = models.PURPOSES.get(name, "")
    if not missing:
        return Fact("networks", name, purpose, value=True)
    group = next((group for group, members in models.GROUPS.items() if name in members), name)
    remedy = (f"lfportrait models fetch {group}" if models.fetchable(name)
            else f"lfportrait models add {models.REGISTRY[name][0].file}")
    return Fact("networks", name, f"missing: {purpose}", "bad" if needed else "optional", remedy,
                False)
