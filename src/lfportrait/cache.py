"""What was made from the same inputs is not made again: keys, the user's cache, stages of a job.

Keys are hashes of the producing code and of its inputs: the same key, the same bytes. The code is
the whole package, as one hash of its files: after an update all is made again that is asked for. A
method of another package adds that package's files. What takes seconds to find and is asked for
again and again (what networks say of a painting, where a capture's face is) is kept in the user's
cache.

A stage of a job (`StageFolder`) is done when its outputs lie under their final names and a record
beside them has its key: a hash of the package, the stage's parameters and the keys of the stages it
reads. Outputs are written under temporary names and renamed, and the record is written last: a job
that was killed finds, when it is run again, either a finished stage or none.
"""

import dataclasses
import functools
import hashlib
import json
import os
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from . import files
from .arrays import Array
from .errors import UserError
from .temporary import remove_part, sweep_once

MOST = 100  # Files that are kept of a kind: those that were used last.
_DIGITS = 32  # Of a hash.
_INSTALLATIONS = 8  # States of packages whose hashes are kept.


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: _plain(getattr(value, field.name))
                for field in dataclasses.fields(value)}
    if isinstance(value, dict):
        return {str(name): _plain(item) for name, item in sorted(value.items())}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, np.ndarray):
        return hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Path):
        return str(value)
    return value


def hash_of(*parts: Any) -> str:
    """Hash of parameters (data classes, dictionaries, arrays, numbers, strings), 32 hex digits."""
    text = json.dumps([_plain(part) for part in parts], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:_DIGITS]


def key_of(maker: str, *parts: Any) -> str:
    """Key of a result: hash of the code that makes it and of what it is made from, 32 hex digits.

    ``maker`` is the full name of the module that makes it (``__name__``); ``parts`` are data
    classes, dictionaries, arrays, numbers, strings, keys of other results.
    """
    return hash_of(code_of(maker.partition(".")[0]), maker, *parts)


@functools.cache
def code_of(package: str) -> str:
    """Hash of all files of our package, and of another one, or a single module, that works with it.

    Raises `KeyError` if there is no such package.
    """
    own = Path(__file__).parent
    return hash_of([_tree_hash(place) for place in dict.fromkeys((own, _place(package)))])


def _place(package: str) -> Path:
    """The folder of an installed package, or the file of a module."""
    spec = find_spec(package)
    if spec is None or spec.origin is None:
        raise KeyError(package)
    return Path(spec.origin).parent if spec.submodule_search_locations else Path(spec.origin)


def _code_files(root: Path) -> list[Path]:
    """The files of a package, sorted, without what Python and Numba compile of them."""
    if root.is_file():
        return [root]
    found = []
    for folder, inner, names in os.walk(root):
        inner[:] = [name for name in inner if name != "__pycache__"]
        found += [Path(folder, name) for name in names
                  if not name.startswith((".", "warm-"))
                  and not name.endswith((".pyc", ".nbi", ".nbc"))]
    return sorted(found)


def _tree_hash(root: Path) -> str:
    """Hash of a package's files, read again only where one has another state."""
    code = _code_files(root)
    state = hash_of(root, [(file, files.file_state(file)) for file in code])
    kept = user_cache("code") / f"{state}.txt"
    with suppress(OSError, ValueError):
        found = kept.read_text(encoding="ascii")
        if len(found) == _DIGITS:  # else it is damaged
            return found
    found = hash_of([(file.relative_to(root.parent).as_posix(),
                      hashlib.sha256(file.read_bytes()).hexdigest()) for file in code])
    with suppress(OSError, UserError):
        with files.atomic_write(kept) as stream:
            stream.write(found.encode())
        _drop_oldest(kept.parent, "*.txt", _INSTALLATIONS)
    return found


def _drop_oldest(folder: Path, pattern: str, most: int) -> None:
    """Remove all but so many files, those that were used last."""
    by_age = sorted(folder.glob(pattern), key=lambda path: path.stat().st_mtime)
    for old in by_age[:-most]:
        old.unlink(missing_ok=True)


def user_cache(kind: str) -> Path:
    """The folder of the user's cache for one kind of files.

    Where the user has no home, or none that can be written to (a container), it lies in the
    temporary folder.
    """
    import pooch

    folder = Path(pooch.os_cache("lfportrait"))
    with suppress(OSError):
        if folder.is_absolute():  # it is not where nobody knows a home
            folder.mkdir(parents=True, exist_ok=True)
            if os.access(folder, os.W_OK):
                return folder / kind
    return files.temporary_home() / kind


class _Tries:
    """Files that were written in a try, and those of the try before."""

    def __init__(self) -> None:
        self.running = 0
        self.new: set[Path] = set()
        self.old: set[Path] = set()

    def seen(self, file: Path, *, written: bool) -> None:
        """A file was read or written: in a try it belongs to it, if it does to any."""
        if self.running and (written or file in self.old):
            self.new.add(file)
        elif not self.running:
            self.new.discard(file)
            self.old.discard(file)


_TRIES = _Tries()


@contextmanager
def tried() -> Iterator[None]:
    """Keep what is made in the block only until the end of the next such block.

    For inputs that somebody is changing at this moment, whose results would push out those that are
    asked for again. What is read outside such blocks meanwhile stays: the last try was kept.
    """
    if not _TRIES.running:
        _TRIES.old, _TRIES.new = _TRIES.new, set()
    _TRIES.running += 1
    try:
        yield
    finally:
        _TRIES.running -= 1
        if not _TRIES.running:
            for file in _TRIES.old - _TRIES.new:
                with suppress(OSError):
                    file.unlink(missing_ok=True)
            _TRIES.old = set()


def kept_arrays(kind: str, key: str, make: Callable[[], dict[str, Array]],
                folder: Path | None = None, most: int | None = None) -> dict[str, Array]:
    """Arrays by name that are made once, and read from the user's cache after that.

    ``key`` is a hash of all that they depend on (`key_of`). They lie in the cache's folder of this
    kind, or in ``folder``, where so many files, those that were used last, stay (`MOST` by
    default). If nothing can be written, they are made each time.
    """
    folder = folder or user_cache(kind)
    file = folder / f"{key}.npz"
    with suppress(*files.UNREADABLE_ARRAYS):
        arrays = files.load_arrays(file)
        with suppress(OSError):
            file.touch()
        _TRIES.seen(file, written=False)
        return arrays
    arrays = make()
    with suppress(OSError, UserError):
        with files.atomic_write(file) as stream:
            np.savez(stream, allow_pickle=False, **arrays)
        _TRIES.seen(file, written=True)
        _drop_oldest(folder, "*.npz", most or MOST)
    return arrays


_RECORDS = ".stages"


def fingerprint_files(paths: Iterable[Path]) -> str:
    """Hash of files' names and contents, in the order of their names."""
    digest = hashlib.sha256()
    for path in sorted(paths):
        digest.update(path.name.encode() + b"\0")
        try:
            with open(path, "rb") as stream:
                digest.update(hashlib.file_digest(stream, "sha256").digest())
        except OSError as error:
            raise UserError(f"can't read {path}: {error.strerror}") from error
    return digest.hexdigest()[:32]


def check_writable(folder: Path) -> None:
    """Raise `UserError` where a folder can't be made or written to; nothing is made."""
    above = next(path for path in (folder.absolute(), *folder.absolute().parents) if path.exists())
    if not above.is_dir() or not os.access(above, os.W_OK):
        raise UserError(f"can't write to {folder}: {above} is "
                        f"{'not writable' if above.is_dir() else 'no folder'}; "
                        "choose another folder with --out")


def finished_record(folder: Path, name: str, key: str, outputs: Iterable[str],
                    ) -> dict[str, Any] | None:
    """The figures of a stage that was done from the same inputs; None where it is to be done."""
    try:
        data = json.loads((folder / _RECORDS / f"{name}.json").read_text("utf-8"))
        figures, same = dict(data["figures"]), data["key"] == key
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return figures if same and all((folder / output).exists() for output in outputs) else None


class StageFolder:
    """The folder of one job, made if it does not exist, and the records of its finished stages.

    ``report`` is called with one line of text when a stage is skipped because it is done.
    """

    def __init__(self, folder: Path, report: Callable[[str], None] = lambda line: None) -> None:
        self.folder = Path(folder)
        self.records = self.folder / _RECORDS
        # Of each stage, with ``"seconds"``: of its function, or of the record of an earlier run.
        self.figures: dict[str, dict[str, Any]] = {}
        self.resumed: list[str] = []  # Names of the stages that an earlier run had finished.
        self._report = report
        sweep_once(self.folder)
        sweep_once(self.records)
        try:
            self.records.mkdir(parents=True, exist_ok=True)
            # Without a name of its own: others may begin in the same folder at this moment.
            with tempfile.TemporaryFile(dir=self.records) as probe:
                probe.write(b"x")
        except OSError as error:
            raise UserError(f"can't write to {self.folder}: {error.strerror}; "
                            "choose another folder with --out") from error

    def run(self, name: str, key: str, outputs: Sequence[str],
            function: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        """Do a stage, or nothing if it was done from the same inputs before.

        ``key`` is the hash of everything that the outputs depend on (`key_of`); these are files or
        folders relative to the job's folder, which ``function`` writes; it gives the figures for
        ``--json``.
        """
        record = self.records / f"{name}.json"
        done = finished_record(self.folder, name, key, outputs)
        if done is not None:
            self._report(f"{name}: done before, skipped")
            self.resumed.append(name)
            self.figures[name] = done
            return done
        record.unlink(missing_ok=True)
        start = time.perf_counter()
        figures = dict(function())
        figures["stage_seconds"] = round(time.perf_counter() - start, 3)
        files.write_json(record, {"key": key, "outputs": list(outputs), "figures": figures})
        # Read back so that a resumed run sees exactly what this one does.
        self.figures[name] = files.read_json(record)["figures"]
        return self.figures[name]

    def forget(self, name: str) -> None:
        """Have a stage done again the next time, whatever its record says."""
        (self.records / f"{name}.json").unlink(missing_ok=True)

    def scratch(self, name: str) -> Path:
        """A path inside the record folder for a stage's checkpoints."""
        return self.records / name

    def remove_scratch(self, name: str) -> None:
        """Delete a checkpoint that a finished stage no longer needs."""
        remove_part(self.scratch(name))
