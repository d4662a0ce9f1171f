"""A small scene to train on, and what runs in the device's process for these tests alone."""

from dataclasses import replace

import numpy as np
from scipy import ndimage

from lfportrait.capture import Camera
from lfportrait.field.background import Background, BackgroundTrainer
from lfportrait.field.config import ReconstructConfig
from lfportrait.field.gpu import training as steps
from lfportrait.field.gpu.training import Notes, Steps
from lfportrait.field.training.gpu_stepping import GpuSteps
from lfportrait.field.training.lattice import Lattice
from lfportrait.field.training.pixels import TrainingPixels
from lfportrait.field.training.stepping import CpuSteps, Plan, StepData
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
    # Rows in the order of their places, as lattices have them in a training.
    links = field.links.copy()
    links[links >= 0] = np.arange(count)
    return Lattice(links, values, rows, field.center, field.radius)


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
    plain = ReconstructConfig(resolutions=(24,), rays=(1.0,)).resolved(False, 3.4, 0.1)
    return replace(plain, **values)


def gradients(device, given, steps, inputs):
    """Records of one step before they are taken up: rows and orders, and values; and errors."""
    own = Steps(device, given)
    device.write(own.buffers["inputs"], inputs)
    device.write(own.uniform, own.notes.filled(steps, own.lattice, own.shape))
    own.notes.clear(device)
    device.run(*own.dispatches(0)[:own.names().index("settle")])
    header = own.notes.header(device)
    assert not header["failed"]
    count = header["records"]
    records = device.read(own.notes.buffers["records"], np.uint32, (count, 4))
    values = device.read(own.notes.buffers["values"], np.float32, (count, 8))[:, :5]
    return records, values, device.read(own.buffers["errors"], np.float32, own.tiles)


def begin_small(device, given):
    """Begin a level with hardly any room for notes, and with several small pages of colors."""
    whole, steps.PAGE = steps.PAGE, 400 * 4 * steps.row_floats(given["basis"])
    try:
        steps.begin(device, given)
    finally:
        steps.PAGE = whole
    own = device.kept["field training"]
    assert len(own.lattice.pages) > 2
    most = own.notes.packet - 100
    own.notes = Notes.of(device, own.tiles, most, 8, 100)


class SmallSteps(GpuSteps):
    """Steps that begin so."""

    def _call(self, name, *arguments):
        if name == "begin":
            return self.process.call("tests.field.gpu.training.scene:begin_small", *arguments)
        return super()._call(name, *arguments)


def step_options(lattice, pace=0.5):
    """Options of the kernels with every loss."""
    return np.array([pace, 2e-3 / (pace * lattice.voxel), 1e-2, 0.3, 0.03, 0.0, 2.8])


def random_spheres(data, lattice, seed=5):
    """What trains random spheres behind a lattice, where the tiles' rays look."""
    random = np.random.default_rng(seed)
    background = Background.seen([data.cube_rays(data.tiles, lattice.center, lattice.radius)],
                                 16, 6, 1.0)
    background.data[:] = random.random(background.data.shape) - 0.2
    trainer = BackgroundTrainer(background, 2, 0.7)
    trainer.mean_square[:] = 1e-7 * random.random(trainer.mean_square.shape)
    return trainer


def taken_steps(make, basis, count=5, tiles=24, room=False, **values):
    """The lattice, errors, averages and so on after some steps that ``make(behind, level)`` takes.

    With a ``room``, spheres are behind the lattice, and ``make`` is given what trains them.
    """
    random, errors = np.random.default_rng(3), []
    own, data, settings = random_lattice(basis), Views().pixels, config(tv_sparsity=0.1, **values)
    options = step_options(own)
    scale = (1 / (255 * random.uniform(0.8, 1.2, (5, 3)))).astype(np.float32)
    behind = random_spheres(data, own) if room else None
    if room:
        data.pixels[:, 3] = 255
        options[3] = 0.0
    steps = make(behind, StepData(
        own, data, settings, 0, basis, 2, options, np.float32(-0.1 / own.voxel), lambda: scale,
        lambda plan, found, total: errors.append((found.copy(), total))))
    for number in range(count):
        if number in (0, 3):
            steps.look_again(options[1])
        if number == 4:
            data.cameras[:, 3] += 0.05
            steps.place()
        chosen = random.permutation(len(data.tiles))[:tiles]
        steps.take(Plan(data.tiles[chosen], chosen, random.random(tiles).astype(np.float32),
                        np.float32(0.5), np.float32(2.5 - 0.2 * number), random.random(),
                        (0.05, 0.5), number % 3 == 1))
    steps.sync()
    steps.close()
    return own, errors, steps.average, steps.table, behind


def on_cpu(behind, level):
    """Steps on the CPU."""
    steps = CpuSteps(level)
    steps.behind = behind
    return steps
