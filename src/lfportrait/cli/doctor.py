"""What is here: the installation (``doctor``), networks (``models``), GPUs (``devices``), files.

``inspect`` says what files and folders are, and how they will be read.
"""

from __future__ import annotations

import os
import sys
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro

from ..device import device_name, gpu_adapter, gpu_adapters, too_small, torch_device, torch_devices
from ..errors import UserError
from ..graphics import lacking
from ..health import Fact, examine
from .common import Common

if TYPE_CHECKING:
    from ..gpu import Adapter


_MARKS = {"good": ("✓", "+", "32"), "optional": ("·", "-", "33"), "bad": ("✗", "!", "31;1")}
"""Mark of each state, the same in ASCII, and its color in a terminal."""


@dataclass
class Doctor(Common):
    """Check the installation and suggest fixes."""

    def run(self) -> dict[str, Any]:
        facts = examine()
        bad = sum(fact.state == "bad" for fact in facts)
        unicode = (sys.stdout.encoding or "").lower().replace("-", "") == "utf8"
        if not self.quiet:
            print("\n".join(_lines(facts, _colored(), unicode)))
            print("\n" + ("No problems found." if not bad else
                          f"{bad} {'problems' if bad > 1 else 'problem'} found."))
        return {"facts": [fact._asdict() for fact in facts], "problems": bad}


@dataclass
class Models(Common):
    """List the pretrained networks: which are there, what each is for.

    `lfportrait models fetch` downloads some, `lfportrait models add` takes files.
    """

    def run(self) -> dict[str, Any]:
        from .. import models

        print("\n".join(models.listing()))
        return _at_hand()


@dataclass
class ModelsFetch(Common):
    """Download pretrained networks."""

    names: tyro.conf.Positional[tuple[str, ...]] = ()
    """Networks or groups; by default portrait, those of the main job."""

    def run(self) -> dict[str, Any]:
        from .. import models

        for name in models.expand(self.names or ("portrait",)):
            print(f"{name}: {models.fetch(name, quiet=self.quiet)}")
        return _at_hand()


@dataclass
class ModelsAdd(Common):
    """Take files of pretrained networks that you downloaded yourself."""

    files: tyro.conf.Positional[tuple[Path, ...]]
    """The files."""

    def run(self) -> dict[str, Any]:
        from .. import models

        if not self.files:
            raise UserError("name the file to add: lfportrait models add FILE")
        for file in self.files:
            print(f"{file}: {models.add(file)}")
        return _at_hand()


def _at_hand() -> dict[str, Any]:
    from .. import models

    return {"models": {name: models.available(name) for name in models.REGISTRY}}


def _colored() -> bool:
    return sys.stdout.isatty() and "NO_COLOR" not in os.environ


def _lines(facts: list[Fact], colored: bool, unicode: bool) -> list[str]:
    """One line a fact, under the headings of their groups."""
    def dyed(text: str, code: str) -> str:
        return f"\033[{code}m{text}\033[0m" if colored else text

    width = max(len(fact.name) for fact in facts)
    lines: list[str] = []
    for group in dict.fromkeys(fact.group for fact in facts):
        lines += ([""] if lines else []) + [dyed(group, "1")]
        members = [fact for fact in facts if fact.group == group]
        text_width = max((len(fact.text) for fact in members if fact.remedy), default=0)
        for fact in members:
            mark, plain, code = _MARKS[fact.state]
            remedy = f"{fact.text:<{text_width}}  {dyed(fact.remedy, '36')}"
            lines.append(f"  {dyed(mark if unicode else plain, code)} {fact.name:<{width}}  "
                         f"{remedy if fact.remedy else fact.text}")
    return lines


_LIMITS = {"max-storage-buffer-binding-size": "largest binding",
           "max-buffer-size": "largest buffer",
           "max-compute-workgroup-storage-size": "memory of a workgroup",
           "max-storage-buffers-per-shader-stage": "storage buffers of a stage"}
"""Limits of an adapter that matter here, in words."""


@dataclass
class Devices(Common):
    """List the GPUs that --device can name, what auto takes, and what is missing.

    Light fields are computed through WebGPU (any maker's GPU), networks by torch.
    """

    def run(self) -> dict[str, Any]:
        adapters, gpus, lacks = gpu_adapters(), torch_devices(), lacking()
        used = {"light fields": device_name(gpu_adapter("auto")),
                "networks": device_name(torch_device("auto"))}
        try:
            torch = metadata.version("torch")
        except metadata.PackageNotFoundError:
            torch = ""
        print("WebGPU")
        for one in adapters:
            print(f"  {one.name}  ({_words(one)})")
            limits = (f"{_LIMITS[name]} {value if 'buffers' in name else _size(value)}"
                      for name, value in _limits(one).items())
            print(f"    {', '.join(limits)}")
        if not adapters:
            print("  none")
        print(f"torch {torch}")
        for gpu in gpus:
            memory = f", {_size(gpu.memory)}" if gpu.memory else ""
            print(f"  {gpu.name}  ({gpu.backend}, {gpu.place}{memory})")
        if not gpus:
            print("  none")
        print("--device auto")
        for what, name in used.items():
            print(f"  {what}: {name}")
        if lacks:
            print("missing")
        for lack in lacks:
            print(f"  {lack.what}: {lack.remedy}")
        return {"adapters": [_figures(one) for one in adapters],
                "torch": {"version": torch, "devices": [asdict(gpu) for gpu in gpus]},
                "auto": used, "missing": [lack._asdict() for lack in lacks]}


def _limits(adapter: Adapter) -> dict[str, int]:
    return {name: adapter.limits[name] for name in _LIMITS if name in adapter.limits}


def _words(adapter: Adapter) -> str:
    """Kind, interface, driver and memory."""
    parts = [adapter.kind, adapter.backend, adapter.driver,
             _size(adapter.memory) if adapter.memory else "",
             "too small: less than WebGPU's default limits" if too_small(adapter) else ""]
    return ", ".join(part for part in parts if part)


def _size(size: int) -> str:
    """A number of bytes in the units that limits are given in."""
    for unit, words in ((1 << 30, "GiB"), (1 << 20, "MiB"), (1 << 10, "KiB")):
        if size >= unit:
            return f"{size / unit:.4g} {words}"
    return f"{size} bytes"


def _figures(adapter: Adapter) -> dict[str, Any]:
    return {"name": adapter.name, "kind": adapter.kind, "backend": adapter.backend,
            "vendor": adapter.vendor, "driver": adapter.driver, "memory": adapter.memory,
            "too_small": too_small(adapter), "limits": _limits(adapter)}


@dataclass
class Inspect(Common):
    """Tell what files and folders are and how they will be read; nothing is computed.

    Size, orientation, colors, lens, depth, cameras, masks, a quilt's layout; and what is left out.
    """

    paths: tyro.conf.Positional[tuple[Path, ...]] = ()
    """Photos, videos, quilts, folders, data sets."""

    def run(self) -> dict[str, Any]:
        from ..job import inspect, inspection_lines

        if not self.paths:
            raise UserError("name what to look at: lfportrait inspect FILE-OR-FOLDER ...")
        missing = [path for path in self.paths if not path.exists()]
        if missing:
            raise UserError(f"there is no file or folder {missing[0]}; check the name")
        found = []
        for number, path in enumerate(self.paths):
            found.append(inspect(path))
            if not self.quiet:
                print("\n".join([""] * bool(number) + inspection_lines(found[-1])))
        return {"inspected": [one.figures() for one in found]}
