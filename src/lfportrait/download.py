"""Download one file over HTTP and verify it; errors are one line.

A file is written under a temporary name and renamed when its SHA-256 is right: whatever goes wrong
(no network, a slow server, an error page, a connection that breaks off, Ctrl-C) leaves nothing.
"""

from __future__ import annotations

import hashlib
import time
from pathlib import Path
from urllib.parse import urlsplit

from .errors import UserError
from .files import atomic_path
from .progress import Progress

TIMEOUT = 30.0
"""Seconds that a server may take to answer, and between two pieces of a file."""
TRIES = 2
"""How often a file is asked for; a file that the server says it has not, only once."""
PAUSE = 1.0
"""Seconds between two tries."""
SLOWEST = 1024
"""Bytes a second below which a server counts as stalled."""


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


def download(url: str, target: str | Path, sha256: str, size: int = 0, *,
             quiet: bool = False) -> Path:
    """Download a file from an address, http or https, and check it by its SHA-256 in hex.

    ``sha256`` may be the first digits of it; ``size`` in bytes, or 0, is for the progress line and
    error messages. Raises `UserError` if it can't be had: one line with the file, the reason and
    what to do. Nothing is left under the final name then.
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
                _check(temporary, sha256, size)
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


def _check(path: Path, sha256: str, size: int) -> None:
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
