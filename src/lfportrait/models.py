"""The registry of pretrained networks: where each comes from and how to get it.

A network may come in several files that serve the same purpose (the official download, or a
repacked one). A file is looked for in the folder that ``LFPORTRAIT_MODELS`` names, then in the
user's cache, and is then downloaded from its official address, or by its name from the server that
``LFPORTRAIT_MIRROR`` names. Nothing is downloaded that is there already, nor by a process that has
``LFPORTRAIT_OFFLINE`` in its environment, and nothing is trusted whose SHA-256 does not match.

A file is written under a temporary name and renamed when its SHA-256 is right: whatever goes wrong
(no network, a slow server, an error page, a connection that breaks off, Ctrl-C) is one line, and
leaves nothing.
"""

import functools
import hashlib
import os
import shutil
import time
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from urllib.parse import quote, urlsplit

from .cache import user_cache
from .errors import UserError
from .files import atomic_path, file_state
from .progress import Progress

OFFLINE = "LFPORTRAIT_OFFLINE"  # Environment variable of processes that download nothing.


@dataclass(frozen=True)
class ModelFile:
    """One file that holds a network's weights."""

    file: str  # File name.
    sha256: str  # Full hash in hex, or its first digits where the publisher states only those.
    source: str  # Who publishes it.
    licence: str  # Licence of the weights.
    url: str = ""  # Official address, or empty: the file must be put in place by hand.
    size: int = 0  # Size in bytes.
    # A collection of its own that the file may lie in, in the folder of networks or beside it.
    folder: str = ""


REGISTRY = {name: tuple(ModelFile(**entry) for entry in entries) for name, entries in tomllib.loads(
    files(__package__).joinpath("models.toml").read_text("utf-8")).items()}
"""All networks by name; the files of one name serve the same purpose, first choice first."""

GROUPS: dict[str, tuple[str, ...]] = {
    "portrait": ("face-landmarker", "person-segmentation", "hair-segmentation"),
    "paper": ("vgg16", "resnet50"),
    "evaluate": ("inception", "inception-2048", "lpips", "vgg16-torchvision", "lpips-alex",
                 "alexnet"),
}
"""Networks that are wanted together: by the main job, by the paper's losses, by `evaluate`."""

PURPOSES: dict[str, str] = {
    "face-landmarker": "finds the face and its landmarks in photos",
    "person-segmentation": "cuts the person out of photos",
    "hair-segmentation": "segments the hair in photos",
    "multiclass-segmentation": "replaces both segmentations, better",
    "vgg16": "the paper's content loss (else our own small network)",
    "resnet50": "the paper's style loss (else our own small network)",
    "inception": "evaluate: FID, the distance to the style",
    "lpips": "evaluate: LPIPS, with vgg16-torchvision",
    "vgg16-torchvision": "evaluate: LPIPS, with lpips",
    "lpips-alex": "evaluate tables: LPIPS with AlexNet, with alexnet",
    "alexnet": "evaluate tables: LPIPS with AlexNet, with lpips-alex",
    "inception-2048": "evaluate tables: the usual FID of 2048 dimensions",
    "vgg19-se": "stylize --style-network vgg19-se",
    "adain": "stylize --method stylized-nerf",
    "face-landmarks-68": "landmarks in paintings, where the first network fails",
    "face-detector": "faces in paintings, where the first network fails",
    "head": "the statistical head: one photo, and the sides of narrow arcs",
}
"""What each network is for."""

# Networks that do the work of others where they are at hand.
_STAND_INS = {"person-segmentation": "multiclass-segmentation",
              "hair-segmentation": "multiclass-segmentation"}


def cache_folder() -> Path:
    """The user's folder for downloaded and added weights."""
    return user_cache("models")


def _folders() -> list[Path]:
    named = os.environ.get("LFPORTRAIT_MODELS")
    return ([Path(named)] if named else []) + [cache_folder()]


def _entries(name: str) -> tuple[ModelFile, ...]:
    try:
        return REGISTRY[name]
    except KeyError:
        raise UserError(f"there is no network or group {name!r}; the registry has "
                        f"{', '.join([*GROUPS, *REGISTRY])}") from None


def _local(name: str) -> tuple[Path, ModelFile] | None:
    for entry in _entries(name):
        for folder in _folders():
            for place in _places(folder, entry):
                if place.is_file():
                    return place, entry
    return None


def _places(folder: Path, entry: ModelFile) -> list[Path]:
    """Where a file may lie: in a folder of networks, or in a collection in it or beside it."""
    collections = [folder / entry.folder, folder.parent / entry.folder] if entry.folder else []
    return [place / entry.file for place in (folder, *collections)]


def available(name: str) -> bool:
    """Whether a network's weights are on this machine (nothing is downloaded)."""
    return _local(name) is not None


def _matches(path: Path, entry: ModelFile) -> bool:
    return _digest(str(path), file_state(path)).startswith(entry.sha256)


@functools.lru_cache(maxsize=64)
def _digest(path: str, state: tuple[int, ...]) -> str:
    """SHA-256 of a file, computed once for as long as its state stays the same."""
    with open(path, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _remote(name: str) -> tuple[str, ModelFile] | None:
    """Address and entry of the file that would be downloaded, None where there is none."""
    mirror = os.environ.get("LFPORTRAIT_MIRROR", "").rstrip("/")
    entries = _entries(name)
    entry = next((entry for entry in entries if entry.url), entries[0] if mirror else None)
    if entry is None:
        return None
    return (f"{mirror}/{quote(entry.file)}" if mirror else entry.url), entry


def fetchable(name: str) -> bool:
    """Whether `fetch` knows an address of a network's weights."""
    return _remote(name) is not None


def fetch(name: str, *, download: bool = True, quiet: bool = False) -> Path:
    """Path of a network's weights, their SHA-256 checked; they are downloaded if missing.

    Without ``download``, and in a process whose environment has ``LFPORTRAIT_OFFLINE``, a missing
    file is an error.
    """
    found = _local(name)
    if found is not None:
        path, entry = found
        _check(path, *(other for other in _entries(name) if other.file == entry.file))
        return path
    remote = _remote(name)
    if not download or remote is None or os.environ.get(OFFLINE):
        raise UserError(f"the network {name!r} is missing: {_how_to_get(name)}")
    url, entry = remote
    return fetch_file(url, cache_folder() / entry.file, entry.sha256, entry.size, quiet=quiet)


def expand(names: Iterable[str]) -> list[str]:
    """Names of networks and groups (`GROUPS`) as names of networks, each once."""
    found: dict[str, None] = {}
    for name in names:
        if name not in GROUPS:
            _entries(name)
        found.update(dict.fromkeys(GROUPS.get(name, (name,))))
    return list(found)


def missing(names: Iterable[str]) -> list[str]:
    """The networks, of the named ones and groups, that are not on this machine.

    A network is not missing where another one that does its work is here.
    """
    return [name for name in expand(names) if not available(_used(name))]


def in_use(names: Iterable[str]) -> list[str]:
    """SHA-256 of the files used for these networks; none for missing ones."""
    found = [_local(_used(name)) for name in expand(names)]
    return [local[1].sha256 for local in found if local is not None]


def _used(name: str) -> str:
    """The network that does the work of this one: itself, or its stand-in where that is here."""
    other = _STAND_INS.get(name)
    return other if other is not None and available(other) else name


def require(names: Iterable[str], *, download: bool, purpose: str = "this job",
            quiet: bool = False) -> None:
    """Ensure that networks or groups (`GROUPS`) are installed and intact, before long work starts.

    ``download``: those that are missing are downloaded, with a progress line for each unless
    ``quiet``. ``purpose`` is the subject of the message.
    """
    names = expand(names)
    wanted = missing(names)
    by_hand = [name for name in wanted if _remote(name) is None]
    if by_hand:
        raise UserError(f"{purpose} needs the network {by_hand[0]!r}, which is missing: "
                        f"{_how_to_get(by_hand[0])}")
    if wanted and not download:
        # A group only where it gets no more than what is wanted.
        command = next((group for group in GROUPS if set(missing([group])) == set(wanted)),
                       " ".join(wanted))
        count = f"{len(wanted)} network" + "s" * (len(wanted) > 1)
        raise UserError(f"{purpose} needs {count} ({megabytes(_size(wanted))}) that "
                        f"{'are' if len(wanted) > 1 else 'is'} not on this machine: "
                        f"{', '.join(wanted)}; get {'them' if len(wanted) > 1 else 'it'} with "
                        f"`lfportrait models fetch {command}`")
    for name in names:  # installed ones, too: a damaged file is reported now, not in an hour
        fetch(_used(name), quiet=quiet)


def _size(names: Iterable[str]) -> int:
    """Bytes to download for these networks."""
    remotes = [remote[1] for name in names if (remote := _remote(name)) is not None]
    return sum({entry.file: entry.size for entry in remotes}.values())


def _check(path: Path, *entries: ModelFile) -> None:
    """Refuse a file that has the hash of none of the entries."""
    try:
        good = any(_matches(path, entry) for entry in entries)
    except OSError as error:
        raise UserError(f"can't read {path}: {error.strerror}") from error
    if not good:
        raise UserError(f"{path} is damaged or another file: its SHA-256 does not begin with "
                        f"{entries[0].sha256[:16]}; remove it, or put the right one in its place")


def _how_to_get(name: str) -> str:
    """What a missing network is and how to get it."""
    remote = _remote(name)
    entry = remote[1] if remote else _entries(name)[0]
    way = (f"get it with `lfportrait models fetch {name}`, or" if remote
           else "it can't be downloaded automatically;")
    return (f"{entry.file} ({entry.source}; licence {entry.licence}); {way} put it into "
            f"{cache_folder()} or into the folder that LFPORTRAIT_MODELS names, or run "
            "`lfportrait models add FILE`")


def add(path: str | Path) -> Path:
    """Copy a file of weights into the user's cache, if its SHA-256 is in the registry."""
    path = Path(path)
    if not path.is_file():
        raise UserError(f"no such file: {path}")
    for entries in REGISTRY.values():
        for entry in entries:
            if _matches(path, entry):
                target = cache_folder() / entry.file
                with atomic_path(target) as temporary:
                    shutil.copyfile(path, temporary)
                return target
    raise UserError(f"{path} is none of the networks that lfportrait uses (its SHA-256 matches no "
                    "entry of `lfportrait models list`)")


def listing() -> list[str]:
    """One line for each network: name, group, size, whether it is here, what it is, its address."""
    rows = []
    for name in REGISTRY:
        found, remote = _local(name), _remote(name)
        entry = found[1] if found else remote[1] if remote else _entries(name)[0]
        group = next((group for group, members in GROUPS.items() if name in members), "-")
        way = remote[0] if remote else "by hand, optional"
        rows.append(f"{name:<24} {group:<9} {megabytes(entry.size):>7}  "
                    f"{'here   ' if found else 'missing'}  {entry.source} ({entry.licence}): {way}")
    return rows


TIMEOUT = 30.0  # Seconds that a server may take to answer, and between two pieces of a file.
TRIES = 2  # How often a file is asked for; a file that the server says it has not, only once.
PAUSE = 1.0  # Seconds between two tries.
SLOWEST = 1024  # Bytes a second below which a server counts as stalled.


class _FailedError(Exception):
    """A try failed: why, what to do, and whether another try may be better."""

    def __init__(self, reason: str, advice: str = "try again", again: bool = True) -> None:
        super().__init__(reason)
        self.advice, self.again = advice, again


def megabytes(size: int) -> str:
    """A size in bytes as people read it, e.g. ``"5 MB"``, ``"0.2 MB"``."""
    share = size / 1e6
    return f"{share:.0f} MB" if share >= 1 else f"{max(share, 0.1):.1f} MB"


class _Meter:
    """What pooch calls a progress bar: draws ours, and stops what takes too long or too much."""

    def __init__(self, path: Path, size: int, progress: Progress) -> None:
        self.path, self.size, self.progress = path, size, progress
        self.total = 0
        self.start = time.monotonic()

    def update(self, _: int) -> None:
        done = self.path.stat().st_size  # pooch counts whole pieces
        self.progress.update(done)
        if self.size and done > 2 * self.size + 1_000_000:
            raise _FailedError(f"another file came, over {done} bytes instead of {self.size}")
        seconds = time.monotonic() - self.start
        if seconds > 2 * TIMEOUT and done < SLOWEST * seconds:
            raise _FailedError(f"the server is too slow, {done} bytes in {seconds:.0f} s",
                               "try again later")

    def reset(self) -> None:
        """Nothing to draw again."""

    def close(self) -> None:
        """Whoever opened the progress line closes it."""


def fetch_file(url: str, target: str | Path, sha256: str, size: int = 0, *,
               quiet: bool = False) -> Path:
    """Download a file from an address, http or https, and check it by its SHA-256 in hex.

    ``sha256`` may be the first digits of it; ``size`` in bytes, or 0, is for the progress line and
    error messages. Nothing is left under the final name then.
    """
    target = Path(target)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"can't make the folder {target.parent}: {error.strerror}; choose another "
                        "cache with XDG_CACHE_HOME") from error
    for attempt in range(1, TRIES + 1):
        try:
            title = f"{target.name} ({megabytes(size)})"
            with Progress(title, size, enabled=not quiet) as progress, \
                    atomic_path(target) as temporary:
                _get(url, temporary, size, progress)
                _check_file(temporary, sha256, size)
            break
        except _FailedError as error:
            if attempt == TRIES or not error.again:
                raise UserError(f"the download of {target.name} from {url} failed: {error}; "
                                f"{error.advice}, or get the file another way and run "
                                "`lfportrait models add FILE`") from error
        time.sleep(PAUSE)
    return target


def _get(url: str, path: Path, size: int, progress: Progress) -> None:
    """One try; requests' errors are OSErrors and must not be taken for those of the disk."""
    import pooch
    import requests

    meter = _Meter(path, size, progress)
    load = pooch.HTTPDownloader(progressbar=meter, chunk_size=16384, timeout=(TIMEOUT, TIMEOUT))
    host = urlsplit(url).hostname or url
    try:
        load(url, str(path), None)
    except requests.HTTPError as error:
        code = error.response.status_code if error.response is not None else 0
        raise _FailedError(f"the server answers {error}".split(" for url")[0], "check the address",
                           again=code >= 500) from error
    except (requests.exceptions.MissingSchema, requests.exceptions.InvalidSchema,
            requests.exceptions.InvalidURL) as error:
        raise _FailedError("this is not a web address", "check the address (http:// or "
                           "https://)", again=False) from error
    except requests.RequestException as error:
        # A server that stalls within a file is a ConnectionError to requests.
        if isinstance(error, requests.Timeout) or "timed out" in str(error):
            raise _FailedError(f"{host} is too slow, nothing came for {TIMEOUT:g} s",
                               "try again later") from error
        if isinstance(error, requests.exceptions.ChunkedEncodingError):
            raise _FailedError("the connection broke off before the end") from error
        if isinstance(error, requests.exceptions.SSLError):
            raise _FailedError(f"{host} has no certificate that this machine trusts",
                               "check the address", again=False) from error
        raise _FailedError(f"{host} can't be reached", "check the network") from error


def _check_file(path: Path, sha256: str, size: int) -> None:
    """Say what is wrong with a file that came."""
    with path.open("rb") as stream:
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
    if digest.startswith(sha256.lower()):
        return
    have = path.stat().st_size
    if size and have < size:
        raise _FailedError(f"it is cut off, {have} of {size} bytes came")
    if size and have > size:
        raise _FailedError(f"another file came, {have} bytes instead of {size}")
    raise _FailedError(f"it is damaged, its SHA-256 does not begin with {sha256[:16]}")
