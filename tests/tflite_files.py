"""Writes TensorFlow Lite files with the flatbuffers package, for tests of their reader."""

from pathlib import Path

import flatbuffers
import numpy as np

TYPES = {np.dtype(np.float32): 0, np.dtype(np.float16): 1, np.dtype(np.int32): 2,
         np.dtype(np.int8): 9}
CODES = {"ADD": 0, "AVERAGE_POOL_2D": 1, "CONCATENATION": 2, "CONV_2D": 3, "DEPTHWISE_CONV_2D": 4,
         "DEPTH_TO_SPACE": 5, "DEQUANTIZE": 6, "FULLY_CONNECTED": 9, "LOGISTIC": 14,
         "MAX_POOL_2D": 17, "MUL": 18, "RELU": 19, "RELU6": 21, "RESHAPE": 22,
         "RESIZE_BILINEAR": 23, "SOFTMAX": 25, "SPACE_TO_DEPTH": 26, "TANH": 28, "PAD": 34,
         "TRANSPOSE": 39, "MEAN": 40, "SUB": 41, "DIV": 42, "SQUEEZE": 43, "STRIDED_SLICE": 45,
         "SPLIT": 49, "PRELU": 54, "MAXIMUM": 55, "TRANSPOSE_CONV": 67, "EXPAND_DIMS": 70,
         "SUM": 74, "REDUCE_MAX": 82, "RESIZE_NEAREST_NEIGHBOR": 97, "LEAKY_RELU": 98,
         "MIRROR_PAD": 100, "HARD_SWISH": 117, "GELU": 150}


class TfliteFile:
    """Tensors and operations that become a file; options are (slot, kind, value) of the schema."""

    def __init__(self):
        self.tensors, self.steps = [], []

    def tensor(self, *shape):
        """A tensor that is computed; its number."""
        self.tensors.append((shape, 0, None, None))
        return len(self.tensors) - 1

    def constant(self, values, scale=None, zero=0):
        """A constant tensor, quantised where it has a scale; its number."""
        values = np.asarray(values)
        self.tensors.append((values.shape, TYPES[values.dtype], values.tobytes(),
                             None if scale is None else (np.atleast_1d(np.float32(scale)), zero)))
        return len(self.tensors) - 1

    def step(self, name, inputs, outputs, *options, custom=None):
        """An operation; ``outputs`` is a number or several."""
        outputs = [outputs] if isinstance(outputs, int) else outputs
        self.steps.append((name, inputs, outputs, options, custom))

    def content(self, inputs, outputs):
        """The file's bytes."""
        b = flatbuffers.Builder(1 << 16)

        def table(count, *fields):
            b.StartObject(count)
            for slot, kind, value in fields:
                default = False if kind == "Bool" else 0
                getattr(b, f"Prepend{kind}Slot")(slot, value, default)
            return b.EndObject()

        def vector(offsets):
            b.StartVector(4, len(offsets), 4)
            for offset in reversed(offsets):
                b.PrependUOffsetTRelative(offset)
            return b.EndVector()

        def numbers(values, kind=np.int32):
            return b.CreateNumpyVector(np.asarray(values, kind))

        link = "UOffsetTRelative"
        buffers, tensors = [table(3)], []
        for shape, kind, content, quantised in self.tensors:
            fields = [(0, link, numbers(shape)), (1, "Int8", kind)]
            if content is not None:
                buffers.append(table(3, (0, link, b.CreateByteVector(content))))
                fields.append((2, "Uint32", len(buffers) - 1))
            if quantised is not None:
                scales = numbers(quantised[0], np.float32)
                zeros = numbers(np.full(len(quantised[0]), quantised[1]), np.int64)
                fields.append((4, link, table(7, (2, link, scales), (3, link, zeros))))
            tensors.append(table(8, *fields))
        names = list(dict.fromkeys(step[0] for step in self.steps))
        codes = []
        for name in names:
            if name in CODES:
                code = CODES[name]
                codes.append(table(4, (0, "Int8", min(code, 127)), (3, "Int32", code)))
            else:
                text = b.CreateString(name)
                codes.append(table(4, (0, "Int8", 32), (1, link, text), (3, "Int32", 32)))
        steps = []
        for name, into, out, options, custom in self.steps:
            fields = [(0, "Uint32", names.index(name)), (1, link, numbers(into)),
                      (2, link, numbers(out))]
            if custom is not None:
                fields.append((5, link, b.CreateByteVector(custom)))
            elif options:
                options = [(slot, link, numbers(value)) if kind == "Numbers" else
                           (slot, kind, value) for slot, kind, value in options]
                fields += [(3, "Uint8", 1), (4, link, table(8, *options))]
            steps.append(table(9, *fields))
        graph = table(5, (0, link, vector(tensors)), (1, link, numbers(inputs)),
                      (2, link, numbers(outputs)), (3, link, vector(steps)))
        model = table(8, (0, "Uint32", 3), (1, link, vector(codes)), (2, link, vector([graph])),
                      (4, link, vector(buffers)))
        b.Finish(model, file_identifier=b"TFL3")
        return bytes(b.Output())

    def write(self, path: Path, inputs, outputs):
        """Write the file."""
        path.write_bytes(self.content(inputs, outputs))
        return path


def convolution(file, x, filters, bias, out, stride=1, padding=0, activation=0, dilation=1):
    """Append a convolution (filters [out, h, w, in], or depthwise [1, h, w, out] by its name)."""
    options = [(0, "Int8", padding), (1, "Int32", stride), (2, "Int32", stride)]
    shift = 0 if filters.shape[0] == len(bias) else 1  # the depth multiplier stands between
    name = "DEPTHWISE_CONV_2D" if shift else "CONV_2D"
    options += [(3 + shift, "Int8", activation)]
    if dilation != 1:  # 1 is the default and left out
        options += [(4 + shift, "Int32", dilation), (5 + shift, "Int32", dilation)]
    file.step(name, [x, file.constant(filters), file.constant(bias)], out, *options)
