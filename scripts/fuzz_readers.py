"""Read damaged inputs of every kind: allowed is a result, or one line that says what is wrong.

python scripts/fuzz_readers.py [--seed 0] [--count 3000] [--seconds 0] [--input NUMBER]

Everything else is a finding: another exception, a line that is empty or endless, a dead process,
more than ten seconds of work or more than one GB of memory. The seed and an input's number decide
what is damaged, and how: ``--input`` reads that one again and shows the traceback. Exits with code
1 if there are findings. The inputs are those of ``tests/inputs.py``, the damage that of
``tests/mutations.py``.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import shutil
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SECONDS, MEMORY, LINE = 10.0, 2 ** 30, 2000
# A busy machine takes longer for the same work: what waits for ever is found by the clock.
_PATIENCE = 60.0


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=3000, help="inputs of all readers together")
    parser.add_argument("--seconds", type=float, default=0, help="end after this time (0: never)")
    parser.add_argument("--input", type=int, help="only this one, with its traceback")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        if options.input is not None:
            return _one(Path(folder), options.seed, options.input)
        told = run(Path(folder), options.seed, options.count, options.seconds)
    return _report(told, options.seed)


def run(folder: Path, seed: int, count: int, seconds: float) -> list[tuple[int, str, str, str]]:
    """Number, kind, damage and finding (or nothing) of each input that was read."""
    end = time.monotonic() + seconds if seconds else float("inf")
    told: list[tuple[int, str, str, str]] = []
    while len(told) < count and time.monotonic() < end:
        for row in _child(folder, seed, len(told), count):
            told.append(row)
            if time.monotonic() >= end:
                break
    return told


def _child(folder: Path, seed: int, first: int, count: int) -> Iterator[tuple[int, str, str, str]]:
    """What another process tells, until it is ready or dies of an input."""
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe(duplex=False)
    process = context.Process(target=_work, args=(there, folder, seed, first, count), daemon=True)
    process.start()
    there.close()
    begun: tuple[int, str, str] | None = None
    try:
        while here.poll(_PATIENCE if begun else 600):
            number, kind, damage, *found = here.recv()
            begun = None if found else (number, kind, damage)
            if found:
                yield number, kind, damage, found[0]
        wrong = f"took more than {_PATIENCE:.0f} s"
    except EOFError:
        process.join()
        wrong = f"the process died with code {process.exitcode}" if process.exitcode else ""
    finally:
        process.kill()
        process.join()
    if begun:
        yield *begun, wrong
    elif wrong:
        raise RuntimeError(f"inputs can't be made: {wrong}")


def _work(there: Connection, folder: Path, seed: int, first: int, count: int) -> None:
    """Read inputs one after the other, and tell of each before and after."""
    kinds = _made(folder / "good")
    _bound_memory()
    for number in range(first, count):
        kind = kinds[number % len(kinds)]
        place, damage = _damaged(folder, kind, seed, number)
        there.send((number, kind, damage))
        there.send((number, kind, damage, _finding(kind, place)))
    there.close()


def _bound_memory() -> None:
    """See that nothing here takes the machine's memory away, whatever size a file says."""
    with suppress(ImportError, OSError):  # systems other than Linux don't tell what is in use
        import resource

        pages = int(Path("/proc/self/statm").read_text("ascii").split()[0])
        bound = pages * resource.getpagesize() + 4 * MEMORY
        resource.setrlimit(resource.RLIMIT_AS, (bound, bound))


def _made(good: Path) -> list[str]:
    """The names of all kinds; a valid input of each is written and read."""
    sys.path[:0] = [str(ROOT)]
    from tests.inputs import KINDS

    for name, kind in KINDS.items():
        if not (good / name).exists():
            (good / name).mkdir(parents=True)
            kind.write(good / name)
        copy = _copy(good / name, good.parent / "input")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            for read in kind.read:
                found = read(copy)
                if isinstance(found, list) and any(isinstance(one, Exception) for one in found):
                    raise ValueError(f"the input of {name} is not valid: {found}")
    return list(KINDS)


def _copy(good: Path, place: Path) -> Path:
    shutil.rmtree(place, ignore_errors=True)
    shutil.copytree(good, place, copy_function=shutil.copyfile)
    return place


def _damaged(folder: Path, kind: str, seed: int, number: int) -> tuple[Path, str]:
    """A damaged copy of the valid input, and what was done."""
    import numpy as np
    from tests.mutations import damage

    place = _copy(folder / "good" / kind, folder / "input")
    return place, damage(place, np.random.default_rng([seed, number]))


def _finding(kind: str, place: Path) -> str:
    """What is wrong with how an input is read; nothing if all is well."""
    from lfportrait.measure import give_back_memory

    give_back_memory()  # what is taken from there would not be seen
    began, before = time.process_time(), _peak_memory(reset=True)
    for read in _readers(kind):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                read(place)
        except Exception as error:
            wrong = _wrong(error)
            if wrong:
                return wrong
    if time.process_time() - began > SECONDS:
        return f"took {time.process_time() - began:.0f} s"
    if _peak_memory() - before > MEMORY:
        return f"took {(_peak_memory() - before) / 2 ** 20:.0f} MB"
    return ""


def _readers(kind: str) -> tuple:
    from tests.inputs import KINDS

    return KINDS[kind].read


def _wrong(error: Exception) -> str:
    """What is wrong with an error that a reader raised."""
    from lfportrait.errors import UserError

    line = str(error)
    if not isinstance(error, UserError):
        frames = [frame for frame in traceback.extract_tb(error.__traceback__)
                  if "lfportrait" in frame.filename.replace("\\", "/").split("/src/")[-1]]
        place = f"{Path(frames[-1].filename).name}:{frames[-1].lineno}" if frames else "?"
        return f"{type(error).__name__} at {place}: {line[:200]!r}"
    if not line.strip() or "\n" in line:
        return f"not one line: {line[:200]!r}"
    return f"a line of {len(line)} letters: {line[:200]!r}" if len(line) > LINE else ""


def _peak_memory(reset: bool = False) -> int:
    """The most memory in bytes that this process had since the last reset; 0 if not known."""
    try:
        if reset:
            Path("/proc/self/clear_refs").write_text("5", "ascii")
        rows = Path("/proc/self/status").read_text("ascii").splitlines()
        return next(int(row.split()[1]) * 1024 for row in rows if row.startswith("VmHWM"))
    except (OSError, StopIteration):
        return 0


def _report(told: list[tuple[int, str, str, str]], seed: int) -> int:
    """Print the inputs of each kind and the findings; the exit code."""
    inputs, wrong = Counter(row[1] for row in told), Counter(row[1] for row in told if row[3])
    print("| reader | inputs | findings |\n| --- | ---: | ---: |")
    for kind, number in inputs.items():
        print(f"| {kind} | {number} | {wrong[kind]} |")
    print(f"| all | {inputs.total()} | {wrong.total()} |")
    for number, kind, damage, found in told:
        if found:
            print(f"\n{kind}: {found}\n  {damage}\n  python scripts/fuzz_readers.py --seed {seed} "
                  f"--input {number}")
    return 1 if wrong else 0


def _one(folder: Path, seed: int, number: int) -> int:
    """Read one input again; an exception is shown with its traceback."""
    kinds = _made(folder / "good")
    kind = kinds[number % len(kinds)]
    place, damage = _damaged(folder, kind, seed, number)
    print(f"{kind}: {damage}")
    for read in _readers(kind):
        try:
            read(place)
        except Exception:
            traceback.print_exc()
    found = _finding(kind, place)
    print(found or "nothing found")
    return 1 if found else 0


if __name__ == "__main__":
    os.environ["LFPORTRAIT_OFFLINE"] = "1"
    # What is read here are pictures of a few pixels: more threads would only take memory.
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    sys.exit(main())
