"""TensorFlow Lite files as a list of operations and their constant tensors.

A ``.tflite`` file is a flatbuffer: tables that refer to each other by offsets. A table begins with
the way to its vtable, which says where each field lies; a field that is left out has its default.
Fields are numbered in the order of TensorFlow's ``schema.fbs``, and those numbers are all of the
schema that is needed here. Nothing is computed: `lfportrait.face.player` plays the list.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import UserError

__all__ = ["Graph", "Operation", "read_tflite"]

SAME, VALID = 0, 1
"""Paddings of TensorFlow Lite's convolutions and poolings."""

# Numbers of TensorFlow Lite's built-in operations.
_NAMES = {
    0: "ADD", 1: "AVERAGE_POOL_2D", 2: "CONCATENATION", 3: "CONV_2D", 4: "DEPTHWISE_CONV_2D",
    5: "DEPTH_TO_SPACE", 6: "DEQUANTIZE", 9: "FULLY_CONNECTED", 14: "LOGISTIC", 17: "MAX_POOL_2D",
    18: "MUL", 19: "RELU", 20: "RELU_N1_TO_1", 21: "RELU6", 22: "RESHAPE", 23: "RESIZE_BILINEAR",
    25: "SOFTMAX", 26: "SPACE_TO_DEPTH", 28: "TANH", 34: "PAD", 39: "TRANSPOSE", 40: "MEAN",
    41: "SUB", 42: "DIV", 43: "SQUEEZE", 47: "EXP", 49: "SPLIT", 54: "PRELU", 55: "MAXIMUM",
    57: "MINIMUM", 59: "NEG", 60: "PADV2", 67: "TRANSPOSE_CONV", 70: "EXPAND_DIMS", 74: "SUM",
    75: "SQRT", 76: "RSQRT", 82: "REDUCE_MAX", 92: "SQUARE", 97: "RESIZE_NEAREST_NEIGHBOR",
    98: "LEAKY_RELU", 99: "SQUARED_DIFFERENCE", 100: "MIRROR_PAD", 101: "ABS", 111: "ELU",
    117: "HARD_SWISH", 150: "GELU"}
_CUSTOM = 32

# Options of an operation: name -> (number of the field, format of `struct`, default).
_FUSED = {"activation": (0, "b", 0)}
_POOL = {"padding": (0, "b", 0), "stride_x": (1, "i", 0), "stride_y": (2, "i", 0),
         "kernel_x": (3, "i", 0), "kernel_y": (4, "i", 0), "activation": (5, "b", 0)}
_KEEP = {"keep": (0, "?", False)}
_OPTIONS: dict[str, dict[str, tuple[int, str, Any]]] = {
    "CONV_2D": {"padding": (0, "b", 0), "stride_x": (1, "i", 0), "stride_y": (2, "i", 0),
                "activation": (3, "b", 0), "dilation_x": (4, "i", 1), "dilation_y": (5, "i", 1)},
    "DEPTHWISE_CONV_2D": {
        "padding": (0, "b", 0), "stride_x": (1, "i", 0), "stride_y": (2, "i", 0),
        "activation": (4, "b", 0), "dilation_x": (5, "i", 1), "dilation_y": (6, "i", 1)},
    "TRANSPOSE_CONV": {"padding": (0, "b", 0), "stride_x": (1, "i", 0), "stride_y": (2, "i", 0),
                       "activation": (3, "b", 0)},
    "AVERAGE_POOL_2D": _POOL, "MAX_POOL_2D": _POOL,
    "ADD": _FUSED, "SUB": _FUSED, "MUL": _FUSED, "DIV": _FUSED,
    "CONCATENATION": {"axis": (0, "i", 0), "activation": (1, "b", 0)},
    "FULLY_CONNECTED": {"activation": (0, "b", 0), "keep": (2, "?", False)},
    "RESIZE_BILINEAR": {"align_corners": (2, "?", False), "half_pixel_centers": (3, "?", False)},
    "RESIZE_NEAREST_NEIGHBOR": {"align_corners": (0, "?", False),
                                "half_pixel_centers": (1, "?", False)},
    "SOFTMAX": {"beta": (0, "f", 0.0)}, "LEAKY_RELU": {"alpha": (0, "f", 0.0)},
    "MEAN": _KEEP, "SUM": _KEEP, "REDUCE_MAX": _KEEP,
    "SPACE_TO_DEPTH": {"block": (0, "i", 0)}, "DEPTH_TO_SPACE": {"block": (0, "i", 0)},
    "SPLIT": {"count": (0, "i", 0)}, "MIRROR_PAD": {"mode": (0, "b", 0)},
    "GELU": {"approximate": (0, "?", False)}}
# Fields of the options that are lists of integers.
_LISTS = {"RESHAPE": {"shape": 0}, "SQUEEZE": {"axes": 0}}

# MediaPipe's own operations carry the C structures of TensorFlow Lite's parameters.
_PARAMETERS = ("padding", "stride_x", "stride_y", "kernel_x", "kernel_y")
_CUSTOM_OPTIONS = {"MaxPoolingWithArgmax2D": _PARAMETERS, "MaxUnpooling2D": _PARAMETERS,
                   "Convolution2DTransposeBias": _PARAMETERS[:3]}
_C_PADDINGS = {1: SAME, 2: VALID}

_TYPES = {0: np.float32, 1: np.float16, 2: np.int32, 3: np.uint8, 4: np.int64, 6: np.bool_,
          7: np.int16, 9: np.int8}


@dataclass(frozen=True)
class Operation:
    """One step of a network.

    Attributes
    ----------
    name
        TensorFlow Lite's name (``CONV_2D``), or that of a custom operation.
    inputs, outputs
        Numbers of its tensors; -1 for an input that is left out.
    options
        Its options by name: ``padding`` (0 same, 1 valid), ``stride_x``, ``activation``, ...
    """

    name: str
    inputs: tuple[int, ...]
    outputs: tuple[int, ...]
    options: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Graph:
    """A network: its operations in the order of computation.

    Attributes
    ----------
    inputs, outputs
        Numbers of the tensors that go in and come out.
    operations
        The steps.
    constants
        Constant tensors by number, in the file's layout (pictures [N, H, W, C]); real ones are
        float32, also where the file has them as float16 or quantised with a scale.
    shapes
        Shapes of all tensors, by number.
    """

    inputs: tuple[int, ...]
    outputs: tuple[int, ...]
    operations: tuple[Operation, ...]
    constants: dict[int, NDArray[Any]]
    shapes: tuple[tuple[int, ...], ...]


class _Damaged(ValueError):
    """The bytes are no flatbuffer of the expected kind."""


class _Table:
    """One table of a flatbuffer; its fields are asked by their number in the schema."""

    def __init__(self, data: bytes, position: int) -> None:
        self.data, self.position = data, position
        vtable = position - self._unpack("i", position)
        if vtable < 0:
            raise _Damaged("a table without its vtable")
        count = self._unpack("H", vtable) // 2 - 2
        self.fields = [self._unpack("H", vtable + 4 + 2 * index) for index in range(count)]

    def _unpack(self, code: str, position: int) -> Any:
        if not 0 <= position <= len(self.data) - struct.calcsize("<" + code):
            raise _Damaged("an offset leads out of the file")
        return struct.unpack_from("<" + code, self.data, position)[0]

    def _place(self, number: int) -> int:
        """Where a field lies, 0 if it is left out."""
        offset = self.fields[number] if number < len(self.fields) else 0
        return self.position + offset if offset else 0

    def _target(self, place: int) -> int:
        return place + int(self._unpack("I", place))

    def value(self, number: int, code: str, default: Any) -> Any:
        """A number, of a format of `struct`."""
        place = self._place(number)
        return self._unpack(code, place) if place else default

    def values(self, number: int, kind: Any) -> NDArray[Any]:
        """A list of numbers, empty if it is left out."""
        place = self._place(number)
        if not place:
            return np.empty(0, kind)
        start = self._target(place)
        count = self._unpack("I", start)
        if start + 4 + count * np.dtype(kind).itemsize > len(self.data):
            raise _Damaged("a list leads out of the file")
        return np.frombuffer(self.data, np.dtype(kind).newbyteorder("<"), count, start + 4)

    def table(self, number: int) -> _Table | None:
        """Another table, None if it is left out."""
        place = self._place(number)
        return _Table(self.data, self._target(place)) if place else None

    def tables(self, number: int) -> list[_Table]:
        """A list of tables."""
        count = len(self.values(number, np.uint32))
        start = self._target(self._place(number)) + 4 if count else 0
        return [_Table(self.data, self._target(start + 4 * index)) for index in range(count)]


def read_tflite(path: str | Path) -> Graph:
    """Read a network from a TensorFlow Lite file.

    Parameters
    ----------
    path
        The ``.tflite`` file; its first subgraph is read.

    Raises
    ------
    UserError
        If the file is missing, no TensorFlow Lite file, damaged, or of operations or types of
        tensors that are not known here.
    """
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise UserError(f"can't read {path}: {error.strerror}") from error
    try:
        if data[4:8] != b"TFL3":
            raise _Damaged("it does not begin like one")
        return _graph(_Table(data, struct.unpack_from("<I", data)[0]))
    except (ValueError, IndexError, struct.error) as error:
        raise UserError(f"{path} is no TensorFlow Lite network, or damaged ({error}); get it "
                        "again") from error


def _graph(model: _Table) -> Graph:
    codes = [_code(row) for row in model.tables(1)]
    buffers = [row.values(0, np.uint8) for row in model.tables(4)]
    graphs = model.tables(2)
    if not graphs:
        raise _Damaged("it has no graph")
    graph = graphs[0]
    tensors = graph.tables(0)
    shapes = tuple(_numbers(row, 0) for row in tensors)
    constants = {}
    for number, (row, shape) in enumerate(zip(tensors, shapes)):
        content = buffers[row.value(2, "I", 0)]
        if content.size:
            constants[number] = _constant(row, shape, content)
    inputs, outputs = _numbers(graph, 1), _numbers(graph, 2)
    operations = tuple(_operation(row, codes) for row in graph.tables(3))
    known = {*inputs, *constants, -1}
    for step in operations:
        if not known.issuperset(step.inputs):
            raise _Damaged(f"an input of {step.name} is computed by no step before it")
        known.update(step.outputs)
    if not inputs or not outputs or not known.issuperset(outputs) or max(known) >= len(tensors):
        raise _Damaged("its inputs and outputs are none of its tensors")
    return Graph(inputs, outputs, operations, constants, shapes)


def _numbers(table: _Table, number: int) -> tuple[int, ...]:
    return tuple(int(value) for value in table.values(number, np.int32))


def _code(row: _Table) -> str:
    """The name of a kind of operation."""
    # Numbers up to 127 stood in a byte once; old files have only that.
    number = max(row.value(0, "b", 0), row.value(3, "i", 0))
    if number == _CUSTOM:
        return row.values(1, np.uint8).tobytes().decode()
    return _NAMES.get(number, f"number {number}")


def _constant(row: _Table, shape: tuple[int, ...], content: NDArray[np.uint8]) -> NDArray[Any]:
    """A tensor's content: float16 and quantised ones as float32."""
    kind = row.value(1, "b", 0)
    if kind not in _TYPES:
        raise _Damaged(f"a constant of the type {kind}, which is not known")
    values: NDArray[Any] = np.frombuffer(content.tobytes(), _TYPES[kind])
    if min(shape, default=1) < 0 or values.size != np.prod(shape, dtype=np.int64):
        raise _Damaged("a constant's size is not that of its shape")
    values = values.reshape(shape)
    if values.dtype == np.float16:
        return values.astype(np.float32)
    quantised = row.table(4)
    scales = quantised.values(2, np.float32) if quantised is not None else np.empty(0)
    if quantised is None or not scales.size or values.dtype == np.float32:
        return values
    zeros = quantised.values(3, np.int64) if len(quantised.values(3, np.int64)) else np.zeros(1)
    if len(scales) > 1:  # one for each channel
        around = [1] * len(shape)
        around[quantised.value(6, "i", 0)] = -1
        scales, zeros = scales.reshape(around), np.broadcast_to(zeros, len(scales)).reshape(around)
    return np.asarray((values - zeros) * scales, np.float32)


def _operation(row: _Table, codes: list[str]) -> Operation:
    name = codes[row.value(0, "I", 0)]
    options: dict[str, Any] = {}
    if name in _CUSTOM_OPTIONS:
        packed = row.values(5, np.uint8).tobytes()
        names = _CUSTOM_OPTIONS[name]
        options = dict(zip(names, struct.unpack_from(f"<{len(names)}i", packed)))
        options["padding"] = _C_PADDINGS.get(options["padding"], SAME)
    elif (table := row.table(4)) is not None:
        options = {key: table.value(*place) for key, place in _OPTIONS.get(name, {}).items()}
        options |= {key: _numbers(table, place) for key, place in _LISTS.get(name, {}).items()}
    else:
        options = {key: default for key, (_, _, default) in _OPTIONS.get(name, {}).items()}
        options |= dict.fromkeys(_LISTS.get(name, {}), ())
    return Operation(name, _numbers(row, 1), _numbers(row, 2), options)
