"""Work that tests send to a GPU's process."""

import os
import time

import numpy as np

from lfportrait.gpu import bands

DOUBLE = """
@group(0) @binding(0) var<storage, read_write> values: array<f32>;
@compute @workgroup_size(64) fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x < arrayLength(&values)) { values[id.x] *= 2.0; }
}"""


def double(device, values):
    kernel = device.kernel(DOUBLE, "main")
    buffer = device.buffer(values)
    device.run((kernel, device.bind(kernel, {0: buffer}), (-(-len(values) // 64), 1, 1)))
    return device.read(buffer, values.dtype, values.shape)


def echo(device, *values):
    return values


def limits(device):
    return dict(device.raw.limits)


def wrong(device):
    raise ValueError("no such thing")


def bad_shader(device):
    device.kernel("fn main( {", "main")


def die(device):
    os._exit(3)


def hang(device):
    time.sleep(60)


def lose_memory(device):
    raise MemoryError("the field")


def print_much(device):
    print("drivers print, too")
    return 7


def keep(device, name, value):
    device.kept[name] = value
    return list(device.kept)


def banded(device, total):
    seen = []
    size = bands(total, 2, lambda since, until: seen.append((since, until)), device.wait)
    return size, seen


def texture_back(device, texels):
    texture = device.texture(texels.shape[1::-1], "rgba8unorm")
    device.fill_texture(texture, texels)
    kernel = device.kernel("""
        @group(0) @binding(0) var picture: texture_2d<f32>;
        @group(0) @binding(1) var<storage, read_write> out: array<u32>;
        @compute @workgroup_size(8, 8) fn main(@builtin(global_invocation_id) id: vec3<u32>) {
            let size = textureDimensions(picture);
            if (id.x < size.x && id.y < size.y) {
                out[id.y * size.x + id.x] = pack4x8unorm(textureLoad(picture, id.xy, 0));
            }
        }""", "main")
    out = device.buffer(texels.nbytes)
    height, width = texels.shape[:2]
    device.run((kernel, device.bind(kernel, {0: texture, 1: out}),
                (-(-width // 8), -(-height // 8), 1)))
    return device.read(out, np.uint8, texels.shape)
