"""A small scene to train on, and what runs in the device's process for these tests alone."""

import numpy as np
from scipy import ndimage

from lfportrait.capture import Camera
from lfportrait.field.config import ReconstructConfig
from lfportrait.field.gpu.training.steps import Steps
from lfportrait.field.training.lattice import Lattice
from lfportrait.field.training.pixels import TrainingPixels
from tests.fields import shell_field


def random_lattice(basis=9, shape=(20, 24, 22), density=25.0, seed=0):
    """An uneven shell of random colors with states of the descent, and thin haze about it."""
    random = np.random.default_rng(seed)
    field = shell_field(basis=basis, shape=shape, box=(1.0, 0.9, 0.8), center=(0.1, -0.05, 0.0),
                        density=density, seed=seed)
    count = len(field.density)
    width = 32 if basis == 9 else 16
    rows = np.zeros((count + 1, width), np.float32)
    rows[:count, :3 * basis] = field.sh.reshape(count, -1)
    rows[:count, -2] = random.random(count)
    rows[:count, -1] = 1e-8 * random.random(count)
    values = np.append(field.density, np.float32(0)).astype(np.float32)
    return Lattice(field.links, values, rows, field.center, field.radius)


class Views:
    """Random photos with soft mattes, as a capture has them, for `TrainingPixels`."""

    def __init__(self, count=5, size=(30, 26), seed=0):
        random = np.random.default_rng(seed)
        width, height = size
        self.cameras = Camera.arc(np.linspace(-70, 60, count), distance=3.4, width=width,
                                  height=height, focal=1.5 * width)
        self.images = [random.integers(0, 256, (height, width, 3), dtype=np.uint8)
                       for _ in range(count)]
        soft = [ndimage.gaussian_filter(random.random((height, width)), 3) for _ in range(count)]
        self.alphas = [np.clip(255 * (20 * (s - 0.5) + 0.5), 0, 255).astype(np.uint8)
                       for s in soft]
        self.pixels = TrainingPixels(self, np.arange(count))


def config(**values):
    """Parameters of a training with mattes."""
    return ReconstructConfig(resolutions=(24,), rays=(1.0,), **values).resolved(False, 3.4, 0.1)


def gradients(device, given, steps, inputs):
    """Records of one step before they are taken up: rows, orders, values [R, 5]; and errors."""
    own = Steps(device, given)
    device.write(own.buffers["inputs"], inputs)
    entries = own._dispatches(0)
    from lfportrait.field.gpu.training.steps import _filled

    device.write(own.uniform, _filled(steps, own.lattice, own.shape, own.notes))
    own.notes.clear(device)
    device.run(*entries[:6])
    header = own.notes.header(device)
    assert not header["failed"]
    count = header["records"]
    records = device.read(own.notes.buffers["records"], np.uint32, (count, 4))
    values = device.read(own.notes.buffers["values"], np.float32, (count, 8))[:, :5]
    errors = device.read(own.buffers["errors"], np.float32, own.tiles)
    return records, values, errors
