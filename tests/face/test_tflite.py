"""TensorFlow Lite files: what the reader and the player make of them, against plain NumPy."""

import struct

import numpy as np
import pytest
import torch

from lfportrait.errors import UserError
from lfportrait.face.player import Player
from lfportrait.face.tflite import read_tflite
from tests.tflite_files import TfliteFile, convolution

RANDOM = np.random.default_rng(0)


def normal(*shape):
    return RANDOM.standard_normal(shape).astype(np.float32)


def same(x, kernel, stride, value=0.0):
    """TensorFlow's SAME padding of [N, H, W, C], written out."""
    pads = [(0, 0)]
    for size in x.shape[1:3]:
        total = max((int(np.ceil(size / stride)) - 1) * stride + kernel - size, 0)
        pads.append((total // 2, total - total // 2))
    return np.pad(x, [*pads, (0, 0)], constant_values=value)


def windows(x, kernel, stride, dilation=1):
    """[N, h, w, kernel, kernel, C] of a padded picture."""
    reach = (kernel - 1) * dilation + 1
    rows = range(0, x.shape[1] - reach + 1, stride)
    columns = range(0, x.shape[2] - reach + 1, stride)
    return np.stack([np.stack([x[:, r:r + reach:dilation, c:c + reach:dilation]
                               for c in columns], 1) for r in rows], 1)


def plain_convolution(x, filters, bias, stride=1, padding=0, dilation=1):
    kernel = filters.shape[1]
    if padding == 0:
        x = same(x, (kernel - 1) * dilation + 1, stride)
    return np.einsum("nhwklc,oklc->nhwo", windows(x, kernel, stride, dilation), filters) + bias


def plain_depthwise(x, filters, bias, stride=1, padding=0):
    if padding == 0:
        x = same(x, filters.shape[1], stride)
    several = filters.shape[3] // x.shape[3]
    found = windows(np.repeat(x, several, axis=3), filters.shape[1], stride)
    return np.einsum("nhwklc,klc->nhwc", found, filters[0]) + bias


def plain_bilinear(x, size, align=False, half=False):
    for axis, count in zip((1, 2), size):
        have = x.shape[axis]
        if align:
            place = np.linspace(0, have - 1, count)
        elif half:
            place = np.clip((np.arange(count) + 0.5) * have / count - 0.5, 0, None)
        else:
            place = np.arange(count) * have / count
        low = place.astype(int)
        high = np.minimum(low + 1, have - 1)
        weight = (place - low).reshape([-1 if a == axis else 1 for a in range(4)])
        x = x.take(low, axis) * (1 - weight) + x.take(high, axis) * weight
    return x


def play(tmp_path, build, *pictures):
    """The outputs of a network: ``build(file, *inputs)`` returns the numbers of its outputs."""
    file = TfliteFile()
    inputs = [file.tensor(*picture.shape) for picture in pictures]
    outputs = build(file, *inputs)
    outputs = [outputs] if isinstance(outputs, int) else outputs
    path = file.write(tmp_path / "net.tflite", inputs, outputs)
    results = Player(read_tflite(path))(*(torch.from_numpy(picture) for picture in pictures))
    return [result.numpy() for result in results]


def one(name, *options, more=(), custom=None, outputs=1):
    """A network of a single operation; ``more`` are constants behind the input."""
    def build(file, x):
        out = [file.tensor() for _ in range(outputs)]
        file.step(name, [x, *(file.constant(value) for value in more)], out, *options,
                  custom=custom)
        return out
    return build


@pytest.mark.parametrize("padding", [0, 1])
@pytest.mark.parametrize(("kernel", "stride", "dilation"),
                         [(3, 1, 1), (3, 2, 1), (2, 2, 1), (1, 1, 1), (5, 2, 1), (3, 1, 2)])
def test_convolutions(tmp_path, kernel, stride, dilation, padding):
    x, filters, bias = normal(1, 9, 12, 3), normal(4, kernel, kernel, 3), normal(4)

    def build(file, number):
        out = file.tensor()
        convolution(file, number, filters, bias, out, stride, padding, dilation=dilation)
        return out
    expected = plain_convolution(x, filters, bias, stride, padding, dilation)
    found, = play(tmp_path, build, x)
    assert found.shape == expected.shape
    assert found == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize(("several", "stride", "padding"), [(1, 1, 0), (1, 2, 0), (2, 2, 1)])
def test_depthwise_convolutions(tmp_path, several, stride, padding):
    x, filters, bias = normal(1, 8, 11, 3), normal(1, 3, 3, 3 * several), normal(3 * several)

    def build(file, number):
        out = file.tensor()
        convolution(file, number, filters, bias, out, stride, padding)
        return out
    assert play(tmp_path, build, x)[0] == pytest.approx(
        plain_depthwise(x, filters, bias, stride, padding), abs=1e-4)


def test_a_small_network_with_branches(tmp_path):
    """Strided convolution, squeeze and excite, a resized branch, a sum and a concatenation."""
    x = normal(1, 16, 16, 3)
    first, second, gate = normal(8, 3, 3, 3), normal(1, 3, 3, 8), normal(8, 1, 1, 8)
    bias = normal(8)

    def build(file, number):
        down, deep, mean, share, scaled, up, total, both = (file.tensor() for _ in range(8))
        convolution(file, number, first, bias, down, stride=2, activation=1)
        convolution(file, down, second, bias, deep, stride=2, activation=3)
        file.step("MEAN", [deep, file.constant(np.int32([1, 2]))], mean, (0, "Bool", True))
        convolution(file, mean, gate, bias, share)
        file.step("LOGISTIC", [share], gated := file.tensor())
        file.step("MUL", [deep, gated], scaled)
        file.step("RESIZE_BILINEAR", [scaled, file.constant(np.int32([8, 8]))], up,
                  (3, "Bool", True))
        file.step("ADD", [up, down], total, (0, "Int8", 1))
        file.step("CONCATENATION", [total, down], both, (0, "Int32", -1))
        return both

    down = np.maximum(plain_convolution(x, first, bias, 2), 0)
    deep = np.clip(plain_depthwise(down, second, bias, 2), 0, 6)
    share = plain_convolution(deep.mean((1, 2), keepdims=True), gate, bias)
    up = plain_bilinear(deep / (1 + np.exp(-share)), (8, 8), half=True)
    expected = np.concatenate([np.maximum(up + down, 0), down], axis=-1)
    assert play(tmp_path, build, x)[0] == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize(("align", "half"), [(False, False), (True, False), (False, True)])
@pytest.mark.parametrize("size", [(10, 14), (3, 4), (5, 7)])
def test_bilinear_resizing(tmp_path, align, half, size):
    x = normal(1, 5, 7, 2)
    found, = play(tmp_path, one("RESIZE_BILINEAR", (2, "Bool", align), (3, "Bool", half),
                                more=[np.int32(size)]), x)
    assert found == pytest.approx(plain_bilinear(x, size, align, half), abs=1e-5)


@pytest.mark.parametrize("half", [False, True])
def test_nearest_resizing(tmp_path, half):
    x = normal(1, 4, 6, 2)
    found, = play(tmp_path, one("RESIZE_NEAREST_NEIGHBOR", (1, "Bool", half),
                                more=[np.int32([8, 9])]), x)
    offset = 0.5 if half else 0.0
    rows = ((np.arange(8) + offset) * 4 / 8).astype(int)
    columns = ((np.arange(9) + offset) * 6 / 9).astype(int)
    assert np.array_equal(found, x[:, rows][:, :, columns])


@pytest.mark.parametrize("padding", [0, 1])
@pytest.mark.parametrize("kernel", [2, 3])
def test_pooling_does_not_count_padding(tmp_path, padding, kernel):
    x = normal(1, 7, 9, 3)
    options = [(0, "Int8", padding), (1, "Int32", 2), (2, "Int32", 2), (3, "Int32", kernel),
               (4, "Int32", kernel)]
    blank = same(x, kernel, 2, np.nan) if padding == 0 else x
    found = windows(blank, kernel, 2)
    assert play(tmp_path, one("AVERAGE_POOL_2D", *options), x)[0] == pytest.approx(
        np.nanmean(found, axis=(3, 4)), abs=1e-5)
    assert play(tmp_path, one("MAX_POOL_2D", *options), x)[0] == pytest.approx(
        np.nanmax(found, axis=(3, 4)), abs=1e-5)


def plain_transposed(x, filters, stride, size, offset):
    kernel = filters.shape[1]
    full = np.zeros((1, 64, 64, filters.shape[0]))
    for row in range(x.shape[1]):
        for column in range(x.shape[2]):
            full[0, row * stride:row * stride + kernel, column * stride:column * stride + kernel] \
                += np.einsum("c,oklc->klo", x[0, row, column], filters)
    return full[:, offset:offset + size[0], offset:offset + size[1]]


@pytest.mark.parametrize(("kernel", "stride", "offset"), [(2, 2, 0), (3, 2, 0), (4, 2, 1),
                                                          (3, 1, 1), (2, 3, 0)])
def test_transposed_convolutions(tmp_path, kernel, stride, offset):
    """SAME: what hangs over is cut off, half of it at the beginning."""
    x, filters, bias = normal(1, 4, 5, 3), normal(2, kernel, kernel, 3), normal(2)
    size = 4 * stride, 5 * stride
    expected = plain_transposed(x, filters, stride, size, offset) + bias

    def official(file, number):
        out = file.tensor()
        file.step("TRANSPOSE_CONV", [file.constant(np.int32([1, *size, 2])), file.constant(filters),
                                     number, file.constant(bias)], out,
                  (1, "Int32", stride), (2, "Int32", stride))
        return out
    mediapipe = one("Convolution2DTransposeBias", more=[filters, bias],
                    custom=struct.pack("<3i", 1, stride, stride))
    for build in (official, mediapipe):
        assert play(tmp_path, build, x)[0] == pytest.approx(expected, abs=1e-4)


def test_unpooling_puts_values_back_where_the_maxima_were(tmp_path):
    x = normal(1, 6, 8, 3)
    parameters = struct.pack("<6i", 2, 2, 2, 2, 2, 0)

    def build(file, number):
        best, place, back = (file.tensor() for _ in range(3))
        file.step("MaxPoolingWithArgmax2D", [number], [best, place], custom=parameters)
        file.step("MaxUnpooling2D", [best, place], back, custom=parameters)
        return [best, back]
    best, back = play(tmp_path, build, x)
    found = windows(x, 2, 2).max(axis=(3, 4))
    assert np.array_equal(best, found)
    largest = found.repeat(2, axis=1).repeat(2, axis=2)
    assert np.array_equal(back, np.where(x == largest, x, 0))


def test_activations(tmp_path):
    x = 4 * normal(1, 3, 4, 5)
    slope = np.abs(normal(1, 1, 5))
    cases = {
        "RELU": (one("RELU"), np.maximum(x, 0)),
        "RELU6": (one("RELU6"), np.clip(x, 0, 6)),
        "HARD_SWISH": (one("HARD_SWISH"), x * np.clip(x + 3, 0, 6) / 6),
        "LOGISTIC": (one("LOGISTIC"), 1 / (1 + np.exp(-x))),
        "TANH": (one("TANH"), np.tanh(x)),
        "LEAKY_RELU": (one("LEAKY_RELU", (0, "Float32", 0.1)), np.where(x > 0, x, 0.1 * x)),
        "PRELU": (one("PRELU", more=[slope]), np.where(x > 0, x, slope * x)),
        "SOFTMAX": (one("SOFTMAX", (0, "Float32", 1.0)),
                    np.exp(x) / np.exp(x).sum(-1, keepdims=True)),
        "SUB": (one("SUB", more=[np.float32([1, 2, 3, 4, 5])]), x - np.arange(1, 6)),
        "DIV": (one("DIV", (0, "Int8", 1), more=[np.float32(2)]), np.maximum(x / 2, 0)),
        "MAXIMUM": (one("MAXIMUM", more=[np.float32(0.5)]), np.maximum(x, 0.5)),
        "GELU": (one("GELU", (0, "Bool", True)), 0.5 * x * (1 + np.tanh(
            np.sqrt(2 / np.pi) * (x + 0.044715 * x ** 3)))),
    }
    for name, (build, expected) in cases.items():
        assert play(tmp_path, build, x)[0] == pytest.approx(expected, abs=1e-5), name


def test_shapes_change_in_tensorflows_order_of_axes(tmp_path):
    x = normal(1, 4, 6, 8)
    shaped = np.transpose(x.reshape(1, 2, 2, 3, 2, 8), (0, 1, 3, 2, 4, 5)).reshape(1, 2, 3, 32)
    grown = np.transpose(x.reshape(1, 4, 6, 2, 2, 2), (0, 1, 3, 2, 4, 5)).reshape(1, 8, 12, 2)
    pads = np.int32([[0, 0], [1, 2], [0, 3], [0, 1]])
    cases = {
        "RESHAPE": (one("RESHAPE", (0, "Numbers", [1, -1, 8])), x.reshape(1, -1, 8)),
        "RESHAPE by a tensor": (one("RESHAPE", more=[np.int32([1, 24, 8])]), x.reshape(1, 24, 8)),
        "SQUEEZE": (one("SQUEEZE", (0, "Numbers", [0])), x[0]),
        "EXPAND_DIMS": (one("EXPAND_DIMS", more=[np.int32(1)]), x[:, None]),
        "TRANSPOSE": (one("TRANSPOSE", more=[np.int32([0, 3, 1, 2])]), x.transpose(0, 3, 1, 2)),
        "PAD": (one("PAD", more=[pads]), np.pad(x, pads)),
        "mirrored": (one("MIRROR_PAD", more=[pads]), np.pad(x, pads, mode="reflect")),
        "symmetric": (one("MIRROR_PAD", (0, "Int8", 1), more=[pads]),
                      np.pad(x, pads, mode="symmetric")),
        "SPACE_TO_DEPTH": (one("SPACE_TO_DEPTH", (0, "Int32", 2)), shaped),
        "DEPTH_TO_SPACE": (one("DEPTH_TO_SPACE", (0, "Int32", 2)), grown),
        "MEAN": (one("MEAN", more=[np.int32([1, 2])]), x.mean((1, 2))),
        "SUM": (one("SUM", (0, "Bool", True), more=[np.int32([3])]), x.sum(3, keepdims=True)),
        "REDUCE_MAX": (one("REDUCE_MAX", more=[np.int32([3])]), x.max(3)),
        "FULLY_CONNECTED": (one("FULLY_CONNECTED", more=[w := normal(3, 8), b := normal(3)]),
                            x.reshape(-1, 8) @ w.T + b),
    }
    for name, (build, expected) in cases.items():
        found, = play(tmp_path, build, x)
        assert found.shape == expected.shape, name
        assert found == pytest.approx(expected, abs=1e-5), name


def test_a_tensor_is_split(tmp_path):
    x = normal(1, 2, 3, 6)

    def build(file, number):
        outputs = [file.tensor(), file.tensor()]
        file.step("SPLIT", [file.constant(np.int32(3)), number], outputs, (0, "Int32", 2))
        return outputs
    first, second = play(tmp_path, build, x)
    assert np.array_equal(first, x[..., :3]) and np.array_equal(second, x[..., 3:])


def test_small_constants_become_real_numbers(tmp_path):
    """Half floats by way of DEQUANTIZE, and bytes with a scale, as converters write them."""
    x = normal(1, 2, 2, 3)

    def build(file, number):
        half = file.constant(np.float16([0.5, 1, 2]))
        coarse = file.constant(np.int8([10, 20, 30]), scale=0.1, zero=10)
        wide, product, total = (file.tensor() for _ in range(3))
        file.step("DEQUANTIZE", [half], wide)
        file.step("MUL", [number, wide], product)
        file.step("ADD", [product, coarse], total)
        return total
    assert play(tmp_path, build, x)[0] == pytest.approx(
        x * [0.5, 1, 2] + np.array([0, 1, 2]), abs=1e-6)


def test_each_channel_has_a_scale_of_its_own(tmp_path):
    file = TfliteFile()
    x = file.tensor(2, 3)
    filters = file.constant(np.int8([[1, 2, 3], [4, 5, 6]]), scale=[0.5, 2.0])
    out = file.tensor()
    file.step("FULLY_CONNECTED", [x, filters], out)
    graph = read_tflite(file.write(tmp_path / "net.tflite", [x], [out]))
    assert np.array_equal(graph.constants[filters], [[0.5, 1, 1.5], [8, 10, 12]])


def test_a_bias_may_be_left_out(tmp_path):
    x, filters = normal(1, 4, 4, 2), normal(3, 1, 1, 2)

    def build(file, number):
        out = file.tensor()
        file.step("CONV_2D", [number, file.constant(filters), -1], out,
                  (1, "Int32", 1), (2, "Int32", 1))
        return out
    assert play(tmp_path, build, x)[0] == pytest.approx(
        plain_convolution(x, filters, 0), abs=1e-5)


def test_an_unknown_operation_is_named_before_anything_runs(tmp_path):
    with pytest.raises(UserError, match=r"operations that are not known: Funny, number 45"):
        play(tmp_path, lambda file, x: (file.step("Funny", [x], y := file.tensor(), custom=b""),
                                        file.step("STRIDED_SLICE", [y], z := file.tensor()), z)[2],
             normal(1, 2, 2, 1))


def tiny():
    file = TfliteFile()
    x, y = file.tensor(1, 4, 4, 1), file.tensor(1, 4, 4, 2)
    convolution(file, x, normal(2, 3, 3, 1), normal(2), y)
    return file.content([x], [y])


def test_what_is_no_network_is_told(tmp_path):
    path = tmp_path / "net.tflite"
    for content in (b"", b"TFL", b"<html>not found</html>", b"\0\0\0\0TFL3", b"\xff" * 64):
        path.write_bytes(content)
        with pytest.raises(UserError, match=r"net\.tflite is no TensorFlow Lite network"):
            read_tflite(path)
    with pytest.raises(UserError, match="can't read"):
        read_tflite(tmp_path / "nothing.tflite")


def test_a_cut_file_is_an_error_wherever_it_is_cut(tmp_path):
    content, path = tiny(), tmp_path / "net.tflite"
    for length in range(0, len(content) - 4, 3):
        path.write_bytes(content[:length])
        with pytest.raises(UserError, match="no TensorFlow Lite network, or damaged"):
            read_tflite(path)


def test_damaged_bytes_give_an_error_of_one_line_or_none(tmp_path):
    content, path = tiny(), tmp_path / "net.tflite"
    refused = 0
    for place in range(len(content)):
        for value in (0x00, 0xff):
            path.write_bytes(content[:place] + bytes([value]) + content[place + 1:])
            try:
                read_tflite(path)
            except UserError as error:
                refused += 1
                assert "\n" not in str(error)
    assert refused > 100
