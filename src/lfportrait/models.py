"""The registry of pretrained networks: where each comes from and how to get it.

A network may come in several files that serve the same purpose (the official download, or a
repacked one). A file is looked for in the folder that ``LFPORTRAIT_MODELS`` names, then in the
user's cache, and is then downloaded from its official address, checked by its SHA-256. Nothing is
downloaded that is there already, and nothing is trusted that does not match.
"""

from __future__ import annotations

import functools
import hashlib
import os
import shutil
from dataclasses import dataclass
from pathlib import Path

from .errors import UserError
from .files import atomic_path

__all__ = ["ModelFile", "add", "available", "cache_folder", "fetch", "listing", "registry"]


@dataclass(frozen=True)
class ModelFile:
    """One file that holds a network's weights.

    Attributes
    ----------
    file
        File name.
    sha256
        Full hash in hex, or its first digits where the publisher states only those.
    source
        Who publishes it.
    licence
        Licence of the weights.
    url
        Official address, or empty: the file must be put in place by hand.
    needs
        Files that must lie beside it, e.g. a network's list of operations.
    """

    file: str
    sha256: str
    source: str
    licence: str
    url: str = ""
    needs: tuple[ModelFile, ...] = ()


_TORCH = "https://download.pytorch.org/models/"
_MEDIAPIPE = "https://storage.googleapis.com/mediapipe-models/"

_REGISTRY: dict[str, tuple[ModelFile, ...]] = {
    "vgg16": (
        ModelFile("vgg16_relu3_3.safetensors",
                  "0e0974329acaf0812b04fe4298a3df9a67b432a8efaea36f5212aeaf2a5c780a",
                  "Oxford VGG-16 (Caffe), conv1_1 to conv3_3, repacked", "CC BY 4.0"),
        # A second packing in use; it gives the reference activations of all seven layers.
        ModelFile("vgg16_relu3_3.safetensors",
                  "a6dc38d988541f6baecae52162af4691c6fa1c2b99a585a51c2a991a623ceb4e",
                  "Oxford VGG-16 (Caffe), conv1_1 to conv3_3, repacked", "CC BY 4.0"),
        ModelFile("vgg16-397923af.pth", "397923af", "torchvision VGG-16, ImageNet", "BSD-3-Clause",
                  _TORCH + "vgg16-397923af.pth")),
    "resnet50": (
        ModelFile("resnet50_v1_folded_to_layer3.safetensors",
                  "5dadf1896cc4174ebe5beaa04316528002cd3cc468a03e60219be848e2827582",
                  "ResNet-50 v1, stem to layer3, batch norm folded, repacked", "MIT"),
        ModelFile("resnet50-0676ba61.pth", "0676ba61", "torchvision ResNet-50, ImageNet",
                  "BSD-3-Clause", _TORCH + "resnet50-0676ba61.pth")),
    "vgg19-se": (
        ModelFile("vgg19_se16x_relu5_1.safetensors",
                  "62c16cf6c53f9ef13e66ca4bcc3528434f8c1cf12f92bb4f04521fef831d0a0a",
                  "Collaborative-Distillation, 16x smaller VGG-19, repacked", "MIT"),),
    "face-landmarker": (
        ModelFile("face_landmarker.task",
                  "64184e229b263107bc2b804c6625db1341ff2bb731874b0bcc2fe6544e0bc9ff",
                  "MediaPipe FaceLandmarker, 478 points", "Apache-2.0",
                  _MEDIAPIPE + "face_landmarker/face_landmarker/float16/1/face_landmarker.task"),),
    "face-landmarks-68": (
        ModelFile("faceapi_landmark68.safetensors",
                  "e6853f4a5d12cdb5de80dcb3f3691a690281cfa88bad0a674067345a92f7be3e",
                  "face-api.js 68-point landmarks, repacked", "MIT"),),
    "face-detector": (
        ModelFile("faceapi_tiny_face_detector.safetensors",
                  "30d5cb835996d667cc6e652957cb228331c23751d62768e24e001429f10e4262",
                  "face-api.js tiny face detector, repacked", "MIT"),),
    "person-segmentation": (
        ModelFile("selfie_segmentation.safetensors",
                  "b50ad7c5af0f7185535e1f5590ca4aea857c4f0229982347d623668e286c77dc",
                  "MediaPipe selfie segmentation, repacked", "Apache-2.0", needs=(ModelFile(
                      "selfie_segmentation.graph.json",
                      "08f9a32124df70d6bca14ba7c3519e5087002ef31e8242714a9de2388377abe7",
                      "operations of MediaPipe selfie segmentation", "Apache-2.0"),)),),
    "hair-segmentation": (
        ModelFile("hair_segmentation.safetensors",
                  "ba4e34c20894c448a59acdb5628f5d97c82b733b11db2058ac94be17b2e4933f",
                  "MediaPipe hair segmentation, repacked", "Apache-2.0", needs=(ModelFile(
                      "hair_segmentation.graph.json",
                      "153f68c287f0279c6d1db1fea0a96d92f03bd50bb7d0fc79c4661a04aa19ed5a",
                      "operations of MediaPipe hair segmentation", "Apache-2.0"),)),),
    "inception": (
        ModelFile("inception_v3_tf2015_to_mixed7a.safetensors",
                  "43d4d5f9f32b410d67bf21aadafdbc4009c4a0143c04c1f8b7431c3269aa710a",
                  "Inception-v3 of 2015-12-05 (FID), to Mixed_7a, repacked", "Apache-2.0"),),
}


def registry() -> dict[str, tuple[ModelFile, ...]]:
    """All networks by name; the files of one name serve the same purpose, first choice first."""
    return dict(_REGISTRY)


def cache_folder() -> Path:
    """The user's folder for downloaded and added weights."""
    import pooch

    return Path(pooch.os_cache("lfportrait")) / "models"


def _folders() -> list[Path]:
    named = os.environ.get("LFPORTRAIT_MODELS")
    return ([Path(named)] if named else []) + [cache_folder()]


def _entries(name: str) -> tuple[ModelFile, ...]:
    try:
        return _REGISTRY[name]
    except KeyError:
        raise UserError(f"there is no network {name!r}; the registry has "
                        f"{', '.join(_REGISTRY)}") from None


def _local(name: str) -> tuple[Path, ModelFile] | None:
    for entry in _entries(name):
        for folder in _folders():
            if all((folder / part.file).is_file() for part in (entry, *entry.needs)):
                return folder / entry.file, entry
    return None


def available(name: str) -> bool:
    """Whether a network's weights are on this machine (nothing is downloaded)."""
    return _local(name) is not None


def _matches(path: Path, entry: ModelFile) -> bool:
    state = path.stat()
    return _digest(str(path), state.st_size, state.st_mtime_ns).startswith(entry.sha256)


@functools.lru_cache(maxsize=64)
def _digest(path: str, size: int, changed: int) -> str:
    """SHA-256 of a file, computed once for as long as its size and time stay the same."""
    with open(path, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def fetch(name: str) -> Path:
    """A file with the weights of a network, downloaded if it is nowhere on this machine.

    Raises
    ------
    UserError
        If the name is unknown, a file's SHA-256 is wrong, or it is not there and can't be
        downloaded: the message says what it is, where it comes from, its licence and where to put
        it.
    """
    found = _local(name)
    if found is not None:
        path, entry = found
        _check(path, *(other for other in _entries(name) if other.file == entry.file))
        for part in entry.needs:
            _check(path.with_name(part.file), part)
        return path
    import pooch

    for entry in _entries(name):
        if not entry.url:
            continue
        target = cache_folder() / entry.file
        with atomic_path(target) as temporary:
            try:
                pooch.HTTPDownloader(timeout=30)(entry.url, str(temporary), None)
            except Exception as error:  # whatever the network throws, one line tells what to do
                failure = f"the download from {entry.url} failed ({type(error).__name__})"
                raise UserError(_how_to_get(name, failure)) from error
            if not _matches(temporary, entry):
                raise UserError(f"the download of {entry.file} is damaged: its SHA-256 is not "
                                f"{entry.sha256}...; try again")
        return target
    raise UserError(_how_to_get(name, "it can't be downloaded automatically"))


def _check(path: Path, *entries: ModelFile) -> None:
    """Refuse a file that has the hash of none of the entries."""
    try:
        good = any(_matches(path, entry) for entry in entries)
    except OSError as error:
        raise UserError(f"can't read {path}: {error.strerror}") from error
    if not good:
        raise UserError(f"{path} is damaged or another file: its SHA-256 does not begin with "
                        f"{entries[0].sha256[:16]}; remove it, or put the right one in its place")


def _how_to_get(name: str, reason: str) -> str:
    entry = next((entry for entry in _entries(name) if entry.url), _entries(name)[0])
    files = " and ".join(part.file for part in (entry, *entry.needs))
    return (f"the network {name!r} is missing: {files} ({entry.source}; licence "
            f"{entry.licence}); {reason}; put it into {cache_folder()} or into the folder "
            "that LFPORTRAIT_MODELS names, or run `lfportrait models add FILE`")


def add(path: str | Path) -> Path:
    """Copy a file of weights into the user's cache, if its SHA-256 is one of the registry's.

    Returns
    -------
    target
        Where it was put.

    Raises
    ------
    UserError
        If the file is missing or matches no entry.
    """
    path = Path(path)
    if not path.is_file():
        raise UserError(f"no such file: {path}")
    for entries in _REGISTRY.values():
        for entry in (part for whole in entries for part in (whole, *whole.needs)):
            if _matches(path, entry):
                target = cache_folder() / entry.file
                with atomic_path(target) as temporary:
                    shutil.copyfile(path, temporary)
                return target
    raise UserError(f"{path} is none of the networks that lfportrait uses (its SHA-256 matches no "
                    "entry of `lfportrait models list`)")


def listing() -> list[str]:
    """One line for each network: name, whether it is here, source and licence."""
    rows = []
    for name, entries in _REGISTRY.items():
        state = "here   " if available(name) else "missing"
        entry = entries[0]
        way = "download" if any(e.url for e in entries) else "by hand"
        rows.append(f"{name:<20} {state}  {way:<8}  {entry.source} ({entry.licence})")
    return rows
