"""Small TensorFlow Lite networks, written with the schema that MediaPipe brings.

That comes with all of MediaPipe and with Matplotlib: this is imported where a network is written.
"""

import flatbuffers
import numpy as np
from mediapipe.tasks.metadata import schema_py_generated as schema


def table(kind, **fields):
    """A table of the schema with these fields; older versions of it take none when it is made."""
    made = getattr(schema, f"{kind}T")()
    vars(made).update(fields)
    return made


class TfliteFile:
    """Tensors and operations that become a file."""

    def __init__(self):
        self.graph = table("SubGraph", tensors=[], operators=[])
        self.model = table("Model", version=3, operatorCodes=[], subgraphs=[self.graph],
                           buffers=[schema.BufferT()])

    def tensor(self, *shape, kind=schema.TensorType.FLOAT32, buffer=0):
        """A tensor that is computed; its number."""
        number = len(self.graph.tensors)
        self.graph.tensors.append(table("Tensor", shape=list(shape), type=kind, buffer=buffer,
                                        name=f"t{number}"))
        return number

    def constant(self, values):
        """A constant tensor, float32 or int32; its number."""
        values = np.asarray(values)
        self.model.buffers.append(table("Buffer", data=np.frombuffer(values.tobytes(), np.uint8)))
        kind = {"f": schema.TensorType.FLOAT32, "i": schema.TensorType.INT32}[values.dtype.kind]
        return self.tensor(*values.shape, kind=kind, buffer=len(self.model.buffers) - 1)

    def step(self, name, inputs, output, options, **settings):
        """An operation by its name, and the name and the fields of its options."""
        code = getattr(schema.BuiltinOperator, name)
        self.model.operatorCodes.append(table(
            "OperatorCode", deprecatedBuiltinCode=code, builtinCode=code, version=1))
        self.graph.operators.append(table(
            "Operator", opcodeIndex=len(self.model.operatorCodes) - 1, inputs=inputs,
            outputs=[output], builtinOptionsType=getattr(schema.BuiltinOptions, options),
            builtinOptions=table(options, **settings)))

    def content(self, inputs, outputs):
        """The file's bytes."""
        self.graph.inputs, self.graph.outputs = inputs, outputs
        builder = flatbuffers.Builder()
        builder.Finish(self.model.Pack(builder), b"TFL3")
        return bytes(builder.Output())


def convolution(file, x, filters, bias, out):
    """Append a convolution, filters [out, h, w, in]."""
    file.step("CONV_2D", [x, file.constant(filters), file.constant(bias)], out, "Conv2DOptions",
              strideW=1, strideH=1)
