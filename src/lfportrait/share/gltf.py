"""Binary glTF 2.0: arrays and pictures in one buffer behind a JSON that describes them."""

import json
import struct
from typing import Any, BinaryIO

import numpy as np

from ..arrays import Array
from ..version import __version__

# Component types: 5121 byte, 5123 short, 5125 int (all unsigned), 5126 float.
_KINDS = {"u1": 5121, "u2": 5123, "u4": 5125, "f4": 5126}
_SHAPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
_VERTICES, _INDICES = 34962, 34963


class Glb:
    """A scene of one node named ``portrait``, filled bit by bit and then written.

    ``scene`` is the JSON, which `add` and `add_jpeg` extend.
    """

    def __init__(self, extensions: list[str]) -> None:
        self._parts: list[bytes] = []
        self._length = 0
        self.scene: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": f"lfportrait {__version__}"},
            "extensionsUsed": extensions,
            "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0, "name": "portrait"}],
            "meshes": [], "buffers": [], "bufferViews": [], "accessors": []}

    def _view(self, content: bytes, **more: int) -> int:
        """The number of a new part of the buffer."""
        self.scene["bufferViews"].append({"buffer": 0, "byteOffset": self._length,
                                          "byteLength": len(content), **more})
        padded = content + bytes(-len(content) % 4)
        self._parts.append(padded)
        self._length += len(padded)
        return len(self.scene["bufferViews"]) - 1

    def add(self, values: Array, *, bounds: bool = False, indices: bool = False,
            normalized: bool = False) -> int:
        """Add an array of K rows, and return the number of its accessor.

        It is uint8, uint16, uint32 or float32, [K] or [K, 2 to 4]: indices of a mesh's corners, or
        whole numbers that stand for 0 to 1 (``normalized``), or others. ``bounds`` states the least
        and the largest values, as positions must.
        """
        values = np.ascontiguousarray(values)
        kind = values.dtype.str[1:]
        width = values.shape[1] if values.ndim > 1 else 1
        accessor: dict[str, Any] = {
            "bufferView": self._view(values.astype(f"<{kind}").tobytes(),
                                     target=_INDICES if indices else _VERTICES),
            "componentType": _KINDS[kind], "count": len(values), "type": _SHAPES[width]}
        if normalized:
            accessor["normalized"] = True
        if bounds:
            accessor["min"] = np.atleast_1d(values.min(axis=0)).tolist()
            accessor["max"] = np.atleast_1d(values.max(axis=0)).tolist()
        self.scene["accessors"].append(accessor)
        return len(self.scene["accessors"]) - 1

    def add_jpeg(self, content: bytes) -> int:
        """Add a picture file, and return its texture's number."""
        for name in ("images", "samplers", "textures"):
            self.scene.setdefault(name, [])
        self.scene["images"].append({"bufferView": self._view(content), "mimeType": "image/jpeg"})
        # Linear, with pyramids where it is seen from far; nothing beyond the border.
        self.scene["samplers"].append({"magFilter": 9729, "minFilter": 9987, "wrapS": 33071,
                                       "wrapT": 33071})
        self.scene["textures"].append({"source": len(self.scene["images"]) - 1,
                                       "sampler": len(self.scene["samplers"]) - 1})
        return len(self.scene["textures"]) - 1

    def write(self, stream: BinaryIO) -> None:
        """Write the file."""
        self.scene["buffers"] = [{"byteLength": self._length}]
        text = json.dumps(self.scene, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        stream.write(struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + self._length))
        stream.write(struct.pack("<I4s", len(text), b"JSON") + text)
        stream.write(struct.pack("<I4s", self._length, b"BIN\0"))
        for part in self._parts:
            stream.write(part)
