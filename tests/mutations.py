"""Damage to files, at random: what `test_mutations` and `scripts/fuzz_readers.py` share."""

import copy
import io
import json
import re
import shutil

import numpy as np

STRANGE = [None, True, -1, 0, 1, 7, 1e300, -1e-300, float("nan"), float("inf"), 2 ** 70, "", "x",
           "..", "\u00e9\n", [], [[]], [1, 2], {}, {"a": 1}, [None] * 5, [[1e9] * 4] * 4]
MORE_STRANGE = [*STRANGE, "a\0b", "nan", "1e999", -2 ** 63, 2 ** 31, "/", "x" * 5000, "\ud800"]
NUMBERS = ["nan", "inf", "-inf", "1e308", "-1e400", "-1", "0", "", "x", '""', "1e-320", "[]",
           str(2 ** 31), str(2 ** 63), "9" * 400, "1_0", "\u0663", "1.5", "\0", "-0.0", "0x7f"]
PICTURES = {".png", ".jpg", ".webp", ".tif", ".bmp", ".gif", ".avif", ".heic"}


def places(data, path=()):
    """All places in a nested document."""
    yield path
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(
        data, list) else ()
    for key, value in items:
        yield from places(value, (*path, key))


def changed(data, random, strange=STRANGE):
    """A nested document with one to three places changed."""
    data = json.loads(json.dumps(data))
    for _ in range(random.integers(1, 4)):
        found = [path for path in places(data) if path]
        if not found:
            break
        path = found[random.integers(len(found))]
        holder = data
        for key in path[:-1]:
            holder = holder[key]
        if random.random() < 0.2:
            del holder[path[-1]]
        else:
            holder[path[-1]] = copy.deepcopy(strange[random.integers(len(strange))])
    return data


def bytes_changed(content, random):
    """Bytes with some flipped, cut off, doubled or put in."""
    content = bytearray(content)
    for _ in range(random.integers(1, 6)):
        at = int(random.integers(len(content) + 1)) if content else 0
        kind = random.integers(4)
        if kind == 0 and at < len(content):
            content[at] = random.integers(256)
        elif kind == 1 and random.random() < 0.3:
            del content[at:]
        elif kind == 2:
            content[at:at] = content[at:at + int(random.integers(40))]
        else:
            content[at:at] = random.bytes(int(random.integers(9)))
    return bytes(content)


def strange_array(array, random):
    """An array of another type, shape or with other values."""
    kinds = [
        lambda: np.array("text"), lambda: np.ones(3), lambda: np.zeros(0),
        lambda: array.astype(np.complex64) if array.dtype.kind != "U" else array,
        lambda: array[None], lambda: array.ravel()[:1], lambda: array.ravel(),
        lambda: np.full(array.shape, np.nan), lambda: np.full(array.shape, 1e30),
        lambda: np.full(array.shape, -5), lambda: np.full(array.shape, 2 ** 40),
        lambda: np.datetime64("2020-01-01"), lambda: np.array([True, False])]
    return kinds[random.integers(len(kinds))]()


def _range(content, random):
    """A start and an end; near the file's head, where most of the numbers are, half of the time."""
    reach = min(len(content), 512) if random.random() < 0.5 else len(content)
    start = int(random.integers(reach + 1))
    return start, min(len(content), start + int(random.integers(1, 200)))


def bits(content, random):
    """One to four bits flipped."""
    result = bytearray(content)
    for _ in range(random.integers(1, 5)):
        start = _range(content, random)[0]
        if start < len(result):
            result[start] ^= 1 << int(random.integers(8))
    return bytes(result)


def cut(content, random):
    return content[:_range(content, random)[0]]


def zeroed(content, random):
    start, end = _range(content, random)
    return content[:start] + bytes(end - start) + content[end:]


def repeated(content, random):
    start, end = _range(content, random)
    return content[:end] + content[start:end] * int(random.integers(1, 30)) + content[end:]


def numbers(content, random):
    """Numbers of a text replaced by what is none, or by too large ones."""
    found = list(re.finditer(rb"-?\d+(\.\d+)?(e[+-]?\d+)?", content))
    for one in sorted({int(random.integers(len(found))) for _ in range(random.integers(1, 4))}
                      if found else (), reverse=True):
        other = NUMBERS[random.integers(len(NUMBERS))].encode()
        content = content[:found[one].start()] + other + content[found[one].end():]
    return content


def names(content, random):
    """A word of a text with a null byte, half a letter or a line break in it, or without end."""
    found = list(re.finditer(rb"[A-Za-z_][\w./-]*", content))
    if not found:
        return content
    one = found[random.integers(len(found))]
    other = [b"a\0b", b"\xc3", b"a\nb", b"", b"x" * 5000, b"..", b"\xf0\x9f\x98\x80"]
    return (content[:one.start()] + other[random.integers(len(other))] + content[one.end():])


def document(content, random):
    """A JSON text with places changed."""
    return json.dumps(changed(json.loads(content), random, MORE_STRANGE)).encode()


def deep(content, random):
    """A JSON text with lists in lists in lists at one place."""
    data = json.loads(content)
    found = [path for path in places(data) if path]
    mark, count = "the deep place", int(random.choice([200, 5000, 100000]))
    if found and random.random() < 0.7:
        path = found[random.integers(len(found))]
        holder = data
        for key in path[:-1]:
            holder = holder[key]
        holder[path[-1]] = mark
    else:
        data = mark
    start, end = ("[", "]") if random.random() < 0.5 else ('{"a":', "}")
    return json.dumps(data).replace(f'"{mark}"', start * count + "1" + end * count).encode()


def arrays(content, random):
    """A NumPy file with one or two arrays that are not what they were."""
    stream, result = io.BytesIO(content), io.BytesIO()
    found = np.load(stream)
    if isinstance(found, np.ndarray):
        np.save(result, strange_array(found, random))
        return result.getvalue()
    kept = {name: found[name] for name in found.files}
    for _ in range(random.integers(1, 3)):
        name = sorted(kept)[random.integers(len(kept))]
        if random.random() < 0.2 and len(kept) > 1:
            del kept[name]
        else:
            kept[name] = strange_array(kept[name], random)
    np.savez(result, **kept)
    return result.getvalue()


def _of_content(path):
    """The mutations that fit a file."""
    found = [bits, cut, zeroed, repeated, bytes_changed]
    if path.suffix in (".npz", ".npy"):
        return [*found, *[arrays] * 5]
    content = path.read_bytes()
    try:
        content.decode()
    except UnicodeDecodeError:
        return found
    found += [numbers] * 3 + [names] * 2
    try:
        json.loads(content)
    except (ValueError, RecursionError):
        return found
    return [*found, *[document] * 8, deep]


def _of_files(path, files, random):
    """A file deleted, emptied, put in another's place, or made a folder; what was done."""
    kind = ["deleted", "emptied", "swapped", "a folder"][random.integers(4)]
    if kind == "swapped" and len(files) > 1:
        other = files[random.integers(len(files))]
        content = path.read_bytes()
        shutil.copyfile(other, path) if other != path else None
        other.write_bytes(content)
        return f"swapped with {other.name}"
    path.unlink()
    if kind == "a folder":
        path.mkdir()
    elif kind != "deleted":
        path.write_bytes(b"")
    return kind


def damage(folder, random):
    """Damage one or two files of a folder; what was done, as a text."""
    told = []
    for _ in range(1 + (random.random() < 0.2)):
        files = sorted(path for path in folder.rglob("*") if path.is_file())
        if not files:
            break
        # What says where the cameras are counts more than the pictures that it names.
        weights = np.array([1.0 if path.suffix in PICTURES else 6.0 for path in files])
        path = files[random.choice(len(files), p=weights / weights.sum())]
        kinds = _of_content(path)
        if random.random() < 0.1:
            done = _of_files(path, files, random)
        else:
            kind = kinds[random.integers(len(kinds))]
            try:
                path.write_bytes(kind(path.read_bytes(), random))
                done = kind.__name__
            except Exception:  # what was damaged once may not be a document any more
                path.write_bytes(bytes_changed(path.read_bytes(), random))
                done = bytes_changed.__name__
        told.append(f"{path.relative_to(folder).as_posix()} {done}")
    return ", ".join(told)
