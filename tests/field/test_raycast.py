"""Rendering, sample weights and training gradients against plain NumPy and finite differences."""

import numpy as np
import pytest
from scipy import ndimage

from lfportrait.capture import Camera
from lfportrait.field import VoxelField
from lfportrait.field.kernels.bricks import brick_table, bright_table, build_bricks, row_width
from lfportrait.field.kernels.descent import descend, smooth, total_variation
from lfportrait.field.kernels.march import sh_basis as kernel_basis
from lfportrait.field.kernels.packet import Records, make_pad
from lfportrait.field.kernels.train import train_kernel
from tests.fields import shell_field
from tests.reference.raycast import cast, sh_basis


@pytest.fixture(scope="module")
def camera():
    return Camera.arc([25.0], distance=3.0, width=20, height=17, focal=22.0, pitch=15.0)


@pytest.mark.parametrize(("basis", "shape", "box"), [
    (9, (24, 24, 24), (1, 1, 1)), (4, (22, 17, 26), (1, 0.7, 1.2)), (1, (9, 24, 13), (1, 1, 1))])
def test_render_equals_the_reference(camera, basis, shape, box):
    field = shell_field(basis=basis, shape=shape, box=box, center=(0.1, -0.05, 0.0))
    rendering = field.render(camera, 0, background=0.3)
    origins, directions = camera.rays(0)
    forward = camera.pose[0, :3, 2]
    scale = np.array(shape[::-1]) / (2 * field.radius)
    for pixel in range(0, 340, 3):
        color, through, surface, _ = cast(field, origins[pixel], directions[pixel])
        row, column = divmod(pixel, 20)
        assert np.abs(rendering.color[row, column] - color - 0.3 * through).max() < 3e-4
        assert abs(rendering.alpha[row, column] - 1 + through) < 3e-4
        along = surface / np.linalg.norm(directions[pixel] * scale)
        depth = along * (directions[pixel] @ forward)
        if np.isfinite(depth):
            # Where the half is reached on the border of two samples either may have it.
            assert abs(rendering.depth[row, column] - depth) < 0.05
        else:
            assert not np.isfinite(rendering.depth[row, column]) or abs(through - 0.5) < 1e-3


def test_depth_finds_the_surface_of_a_sphere():
    size = 64
    z, y, x = np.meshgrid(*[np.linspace(-1, 1, size) * (1 - 1 / size)] * 3, indexing="ij")
    inside = np.sqrt(x * x + y * y + z * z) < 0.6
    links = np.full((size,) * 3, -1, np.int32)
    links[inside] = np.arange(inside.sum())
    field = VoxelField(links, np.full(inside.sum(), 500.0, np.float32),
                       np.zeros((inside.sum(), 3, 1), np.float32))
    camera = Camera.arc([0.0], distance=4.0, width=33, height=33, focal=60.0)
    depth = field.render(camera).depth
    assert abs(depth[16, 16] - 3.4) < 2 / size
    points = field.render(camera).points(camera, 0)
    found = np.isfinite(points[..., 0])
    assert np.abs(np.linalg.norm(points[found], axis=-1) - 0.6).max() < 0.08


def test_rays_that_miss_and_rays_from_inside():
    field = shell_field()
    away = Camera.look_at(np.array([[0.0, 0.0, 5.0]]), np.array([0.0, 0.0, 9.0]), width=8, height=8,
                          focal=8.0)
    rendering = field.render(away, background=0.7)
    assert np.allclose(rendering.color, 0.7)
    assert not rendering.alpha.any()
    assert np.isinf(rendering.depth).all()
    inside = Camera.look_at(np.zeros((1, 3)) + 1e-3, np.array([0.3, 0.2, 1.0]), width=9, height=9,
                            focal=6.0)
    rendering = field.render(inside)
    origins, directions = inside.rays(0)
    for pixel in (0, 40, 80):
        color, through, _, _ = cast(field, origins[pixel], directions[pixel])
        assert np.abs(rendering.color.reshape(-1, 3)[pixel] - color - through).max() < 3e-4


def test_an_empty_field_renders_the_background():
    field = VoxelField(np.full((9, 9, 9), -1, np.int32), np.zeros(0, np.float32),
                       np.zeros((0, 3, 1), np.float32))
    camera = Camera.arc([0.0], distance=4.0, width=8, height=8, focal=10.0)
    assert np.allclose(field.render(camera, background=0.25).color, 0.25)


def test_basis_order_is_that_of_svox2():
    random = np.random.default_rng(3)
    for _ in range(10):
        direction = random.standard_normal(3)
        direction /= np.linalg.norm(direction)
        out = np.zeros(9, np.float32)
        kernel_basis(*direction.astype(np.float32), out, 0, 9)
        assert np.allclose(out, sh_basis(direction, 9), atol=1e-6)


@pytest.mark.parametrize("shape", [(5, 5, 5), (6, 9, 14), (2, 3, 4)])
def test_bricks_hold_every_lattice_point(shape):
    random = np.random.default_rng(1)
    links = np.full(shape, -1, np.int32)
    filled = random.random(shape) < 0.2
    filled.flat[0] = True
    links[filled] = np.arange(filled.sum())
    table, brick_links = brick_table(links, int(filled.sum()))
    for cell in np.ndindex(*(n - 1 for n in shape)):
        brick = table[tuple(c >> 2 for c in cell)]
        corners = [tuple(c + ((i >> s) & 1) for c, s in zip(cell, (2, 1, 0))) for i in range(8)]
        if brick < 0:
            assert all(links[corner] < 0 for corner in corners)
            continue
        for i, corner in enumerate(corners):
            z, y, x = (c & 3 for c in cell)
            slot = 128 * brick + (z + (i >> 2)) * 25 + (y + ((i >> 1) & 1)) * 5 + x + (i & 1)
            wanted = links[corner] if links[corner] >= 0 else filled.sum()
            assert brick_links[slot] == wanted


def test_distances_never_leap_over_matter():
    links = np.full((41, 41, 41), -1, np.int32)
    links[20, 20, 20] = 0
    table, _ = brick_table(links, 1)
    occupied = np.argwhere(table >= 0)
    for place in np.argwhere(table < 0):
        nearest = np.abs(occupied - place).max(axis=1).min()
        assert -table[tuple(place)] <= nearest


def test_sample_weights_are_the_linear_part_of_rendering(camera):
    field = shell_field(basis=1, size=20, density=60.0)
    # The outermost layer is clear, as a pruned field's is: beyond it there are no colors to mix.
    inner = ndimage.binary_erosion(field.links >= 0, np.ones((3, 3, 3)))
    field.density[field.links[(field.links >= 0) & ~inner]] = 0.0
    weights = field.sample_weights(camera, 0)
    colors = 0.28209479177387814 * field.sh[:, :, 0] + 0.5
    positive = field.with_sh(np.maximum(colors, 0.0)[:, :, None] / 0.28209479177387814
                             - 0.5 / 0.28209479177387814)
    rendering = positive.render(camera, 0, background=0.0)
    for pixel in range(340):
        part = slice(weights.indptr[pixel], weights.indptr[pixel + 1])
        color = weights.weights[part] @ np.maximum(colors, 0.0)[weights.rows[part]]
        assert np.abs(color - rendering.color.reshape(-1, 3)[pixel]).max() < 0.02
        assert abs(weights.weights[part].sum() - rendering.alpha.flat[pixel]) < 5e-3


def test_pixels_that_are_not_wanted_get_no_rows(camera, monkeypatch):
    field = shell_field(basis=1, size=20, density=60.0)
    whole = field.sample_weights(camera, 0)
    shape = int(camera.height[0]), int(camera.width[0])
    seen = (field.render(camera, 0).alpha > 4e-3).reshape(shape)
    inside = np.random.default_rng(0).random(shape) < 0.4
    inside[0] = True
    part = field.sample_weights(camera, 0, inside=inside)
    assert part.indptr.shape == whole.indptr.shape and part.alpha.shape == whole.alpha.shape
    for pixel in range(inside.size):
        mine, theirs = (slice(found.indptr[pixel], found.indptr[pixel + 1])
                        for found in (part, whole))
        if not inside.flat[pixel]:
            assert mine.start == mine.stop and part.alpha[pixel] == 0
        elif seen.flat[pixel]:
            assert np.array_equal(part.rows[mine], whole.rows[theirs])
            assert np.array_equal(part.weights[mine], whole.weights[theirs])
            assert part.alpha[pixel] == pytest.approx(whole.alpha[pixel], abs=1e-6)
    # So many pixels at a time that the last are fewer.
    monkeypatch.setattr("lfportrait.field.grid._PIXELS", 13)
    again = field.sample_weights(camera, 0, inside=inside)
    for name in ("indptr", "rows", "weights", "alpha"):
        assert np.array_equal(getattr(again, name), getattr(part, name))
    nothing = field.sample_weights(camera, 0, inside=np.zeros(shape, bool))
    assert not len(nothing.rows) and not nothing.indptr.any() and not nothing.alpha.any()


# -- training -------------------------------------------------------------------------------------


class Training:
    """The training kernel on one small field, as a loss of its parameters."""

    def __init__(self, basis, workers=2):
        self.field = shell_field(basis=basis, size=16, density=12.0)
        self.basis, self.width, self.workers = basis, row_width(basis), workers
        camera = Camera.arc([10.0, 70.0], distance=3.0, width=10, height=9, focal=12.0)
        random = np.random.default_rng(5)
        self.pixels = random.integers(0, 256, (180, 4), dtype=np.uint8)
        self.tiles = np.array([[v, y, x] for v in (0, 1) for y in (0, 4) for x in (0, 4)], np.int32)
        self.background = random.random((len(self.tiles), 3), np.float32)
        self.cameras = np.stack([np.concatenate([camera.pose[v, :3].ravel(), camera.focal[v],
                                                 camera.center[v]]) for v in (0, 1)])
        self.table, self.links = brick_table(self.field.links, len(self.field.density))
        self.lattice = self.field.lattice
        self.rays = [self.rays_of(tile) for tile in range(len(self.tiles))]
        # The middle direction of each tile, for which its colors are.
        means = [directions.mean(axis=0) for _, directions in self.rays]
        self.toward = [mean / np.linalg.norm(mean) for mean in means]

    def run(self, density, sh, distortion=0.0, room=4000):
        """Losses, and gradients of densities and coefficients: the sum of the records."""
        count, workers = len(density), self.workers
        rows = np.zeros((count + 1, self.width), np.float32)
        rows[:count, :3 * self.basis] = sh.reshape(count, -1)
        # What a row remembers is no color.
        rows[:count, -2:] = 1e6
        losses = np.zeros((workers, 3))
        self.records = Records.empty(workers, room)
        self.bases = np.zeros((len(self.tiles), 64), np.float32)
        self.errors = np.zeros(len(self.tiles), np.float32)
        options = np.array([0.5, 1e-9, 1e-7, 0.4, distortion, 0.0, 0.0])
        train_kernel(self.width)(
            self.table, self.links, np.append(density, np.float32(0)), rows.ravel(), self.lattice,
            self.basis, self.cameras, np.array([[10, 9], [10, 9]]), np.array([0, 90]), self.pixels,
            np.full((2, 3), 1 / 255, np.float32), self.tiles,
            np.repeat(self.background, 16, axis=0), options,
            make_pad(workers, self.table, len(self.links) // 128), self.records.arrays, self.bases,
            np.zeros((16 * len(self.tiles), 3), np.float32), np.zeros((workers, 1), np.float32),
            self.errors, losses)
        grad_density, grad_sh = np.zeros(count), np.zeros((count, 3, self.basis))
        self.weights = np.zeros(count)
        for row, tile, red, green, blue, weight, slope in self.listed():
            basis = sh_basis(self.toward[tile], self.basis)
            grad_sh[row] += np.outer((red, green, blue), basis)
            grad_density[row] += slope
            self.weights[row] += weight
        return losses, grad_density, grad_sh

    def listed(self):
        """All records: row, tile, slopes of three colors, weight, slope of the density."""
        for writer, counts in enumerate(self.records.counts):
            for owner, count in enumerate(counts):
                for number in range(min(count, self.records.keys.shape[2])):
                    yield (*self.records.keys[writer, owner, number].tolist(),
                           *self.records.values[writer, owner, number].tolist())

    def rays_of(self, tile):
        """Views' place and the 16 directions of a tile, of length one: [3], [16, 3]."""
        camera = self.cameras[self.tiles[tile][0]]
        pose = camera[:12].reshape(3, 4)
        found = []
        for i in range(16):
            x = min(self.tiles[tile][2] + (i & 3), 9)
            y = min(self.tiles[tile][1] + (i >> 2), 8)
            ray = pose[:, :3] @ np.array([(x + 0.5 - camera[14]) / camera[12],
                                          (y + 0.5 - camera[15]) / camera[13], 1.0])
            found.append(ray / np.linalg.norm(ray))
        return pose[:, 3], np.array(found)

    def loss(self, density, sh, narrow=0.0):
        """The loss in float64 by the reference: color, opacity and distortion."""
        field = VoxelField(self.field.links, density, sh)
        total = 0.0
        for number, (tile, ground) in enumerate(zip(self.tiles, self.background)):
            origin, directions = self.rays[number]
            for i, direction in enumerate(directions):
                x, y = min(tile[2] + (i & 3), 9), min(tile[1] + (i >> 2), 8)
                color, through, _, samples = cast(field, origin, direction, threshold=1e-9,
                                                  stop=1e-7, toward=self.toward[number])
                if narrow and samples:
                    total += narrow * distortion([s[2] for s in samples], [s[4] for s in samples],
                                                 samples[0][3])
                pixel = self.pixels[90 * tile[0] + y * 10 + x] / 255.0
                truth = pixel[:3] * pixel[3] + (1 - pixel[3]) * ground
                total += (((color + through * ground - truth) ** 2).mean()
                          + 0.4 * (1 - through - pixel[3]) ** 2)
        return total / (16 * len(self.tiles))


def distortion(weights, numbers, step):
    """The distortion loss of one ray's samples, pair by pair; step in world units."""
    weights, places = np.array(weights, np.float64), np.array(numbers) * step
    return float((weights[:, None] * weights * abs(places[:, None] - places)).sum()
                 + (weights ** 2).sum() * step / 3)


# Rows of one coefficient have kernels of their own, which take four seconds to compile.
@pytest.mark.parametrize("basis, narrow", [
    (9, 0.7), *(pytest.param(basis, 0.0, marks=pytest.mark.slow) for basis in (1, 9))])
def test_training_gradients_equal_finite_differences(basis, narrow):
    training = Training(basis)
    density, sh = training.field.density.astype(np.float64), training.field.sh.astype(np.float64)
    _, grad_density, grad_sh = training.run(training.field.density, training.field.sh,
                                            distortion=narrow)
    random = np.random.default_rng(2)
    strong = np.argsort(-np.abs(grad_density))[:60]
    for row in random.choice(strong, 2, replace=False):
        changed = [density.copy(), density.copy()]
        step = 1e-4 * max(1.0, density[row])
        changed[0][row] += step
        changed[1][row] -= step
        slope = (training.loss(changed[0], sh, narrow)
                 - training.loss(changed[1], sh, narrow)) / (2 * step)
        assert abs(slope - grad_density[row]) < 2e-3 * abs(slope) + 1e-7
    flat = np.argsort(-np.abs(grad_sh).ravel())[:200]
    for place in random.choice(flat, 2, replace=False):
        changed = [sh.copy(), sh.copy()]
        changed[0].flat[place] += 1e-4
        changed[1].flat[place] -= 1e-4
        slope = (training.loss(density, changed[0]) - training.loss(density, changed[1])) / 2e-4
        assert abs(slope - grad_sh.flat[place]) < 2e-3 * abs(slope) + 1e-7


def test_training_gives_the_same_bytes_again_and_the_same_sums_with_other_workers():
    results = [Training(9, workers).run(Training(9).field.density, Training(9).field.sh)
               for workers in (2, 2, 3)]
    assert np.array_equal(results[0][1], results[1][1])
    assert np.array_equal(results[0][2], results[1][2])
    assert np.allclose(results[0][2], results[2][2], atol=1e-6)
    assert np.isclose(results[0][0].sum(), results[2][0].sum())


def test_each_point_leaves_one_record_a_packet():
    training = Training(9)
    training.run(training.field.density, training.field.sh)
    found = [(row, tile) for row, tile, *_ in training.listed()]
    assert len(found) > 500
    assert len(set(found)) == len(found)
    assert all(row < len(training.field.density) for row, _ in found)
    # A row's records are with one owner, whichever worker found them.
    keys, counts = training.records.keys, training.records.counts
    owned = [{row for writer in (0, 1) for row in keys[writer, owner, :counts[writer, owner], 0]}
             for owner in (0, 1)]
    assert not owned[0] & owned[1]
    assert min(map(len, owned)) > 0.2 * max(map(len, owned))


def test_records_without_room_are_counted_and_given_more():
    training = Training(9)
    training.run(training.field.density, training.field.sh)
    needed, whole = training.records.counts.copy(), list(training.listed())
    training.run(training.field.density, training.field.sh, room=50)
    assert (training.records.counts >= np.minimum(needed, 51)).all()
    grown = training.records.grown()
    while grown is not None:
        training.run(training.field.density, training.field.sh, room=grown.keys.shape[2])
        grown = training.records.grown()
    assert np.array_equal(training.records.counts, needed)
    assert list(training.listed()) == whole


def test_a_color_below_zero_is_black_and_can_rise():
    training = Training(9)
    links, density = training.field.links, training.field.density.copy()
    # The outermost layer is clear: no sample that is seen mixes a color with an empty point's.
    inner = ndimage.binary_erosion(links >= 0, np.ones((3, 3, 3)))
    density[links[(links >= 0) & ~inner]] = 0.0
    dark = np.zeros_like(training.field.sh)
    dark[..., 0] = -5.0
    training.background[:] = 0.0
    training.pixels[:] = (200, 200, 200, 255)
    _, _, grad = training.run(density, dark)
    assert (grad[training.weights > 1e-3, :, 0] < 0).all()
    assert (training.weights > 1e-3).sum() > 20
    # In front of black, black is right.
    training.pixels[:] = (0, 0, 0, 255)
    losses, _, grad = training.run(density, dark)
    assert not losses[:, 0].any()
    assert not grad.any()


@pytest.mark.parametrize("width, basis", [(16, 4), (32, 9)])
def test_descent_equals_numpy(width, basis):
    random = np.random.default_rng(0)
    rows, memory, used = 300, 0.5, 3 * basis
    density = random.random(rows).astype(np.float32)
    values = np.zeros((rows, width), np.float32)
    values[:, :used] = random.standard_normal((rows, used))
    values[:, -2:] = random.random((rows, 2))
    records = Records.empty(2, 50)
    records.counts[:] = [[50, 30], [0, 1]]
    records.values[:] = random.standard_normal(records.values.shape)
    records.values[..., 3] = random.random((2, 2, 50)) * random.choice([0.1, 2.0], (2, 2, 50))
    harmonics = random.standard_normal((3, basis)).astype(np.float32)
    bases = np.zeros((3, 64), np.float32)
    for tile, harmonic in enumerate(harmonics):
        laid = np.zeros((3, 32), np.float32)
        for channel in range(3):
            laid[channel, channel * basis:(channel + 1) * basis] = harmonic
        # Shares of the row's first 16 values in red, green (and blue), and of its rest.
        bases[tile] = (np.concatenate([laid[0, :16], laid[1, :16], laid[1, 16:], laid[2, 16:]])
                       if width == 32 else np.append(laid[:, :16].ravel(), np.zeros(16)))
    gains = np.where(np.arange(width) < used, random.random(width), 0.0).astype(np.float32)
    expected, expected_density = values.astype(float), density.astype(float)
    for owner in (0, 1):
        own = np.flatnonzero((np.arange(rows - 1) >> 6) % 2 == owner)
        records.keys[:, owner, :, 0] = random.choice(own[:20], (2, 50))
        records.keys[:, owner, :, 1] = random.integers(0, 3, (2, 50))
    for owner in (0, 1):
        for writer in (0, 1):
            for number in range(records.counts[writer, owner]):
                row, tile = records.keys[writer, owner, number]
                *color, weight, slope = records.values[writer, owner, number].astype(float)
                known = max(min(expected[row, -2] + weight, memory), weight)
                square = 0.9 * expected[row, -1] + 0.1 * slope ** 2
                change = np.zeros(width)
                change[:used] = np.outer(color, harmonics[tile]).ravel()
                expected[row] -= gains * change / (known + 0.02)
                expected[row, -2:] = known, square
                expected_density[row] = max(
                    expected_density[row] - 0.3 * slope / np.sqrt(square), 0.1)
    descend(density, values.ravel(), width, records.arrays, bases, np.float32(0.3),
            np.float32(0.9), np.float32(0.1), gains, np.float32(memory))
    assert np.allclose(values, expected, rtol=1e-3, atol=1e-4)
    assert np.allclose(density, expected_density, atol=1e-4)


@pytest.mark.parametrize("basis", [pytest.param(1, marks=pytest.mark.slow), 9])
def test_a_row_knows_the_weight_of_the_rays_that_it_colors(basis):
    training = Training(basis)
    training.run(training.field.density, training.field.sh)
    light = np.zeros(len(training.field.density))
    for tile in range(len(training.tiles)):
        origin, directions = training.rays[tile]
        for direction in directions:
            for rows, shares, weight, *_ in cast(training.field, origin, direction, threshold=1e-9,
                                                 stop=1e-7)[3]:
                light[rows[rows >= 0]] += weight * shares[rows >= 0]
    assert np.allclose(training.weights, light, atol=1e-5)
    assert light.sum() > 20


def test_colors_are_right_after_a_few_steps():
    # A matt shell of one color, its density known, seen by 72 pixels.
    basis = 9
    training = Training(basis)
    training.pixels[:] = (51, 153, 230, 255)
    training.background[:] = np.array((51, 153, 230)) / 255.0
    field = training.field
    count, width = len(field.density), training.width
    density = np.append(field.density, np.float32(0))
    values = np.zeros((count + 1, width), np.float32)
    gains = np.zeros(width, np.float32)
    gains[:3 * basis:basis] = 1.5 * 16 * len(training.tiles) * 4 * np.pi
    errors = []
    for _ in range(4):
        losses, _, _ = training.run(density[:-1], values[:-1, :3 * basis].reshape(-1, 3, basis))
        errors.append(losses[:, 0].sum())
        descend(density, values.ravel(), width, training.records.arrays, training.bases,
                np.float32(0.0), np.float32(0.95), np.float32(0.0), gains, np.float32(1.0))
    assert errors[1] < 0.25 * errors[0] and errors[-1] < 0.1 * errors[0]


def test_total_variation_equals_finite_differences():
    random = np.random.default_rng(0)
    shape = (3, 4, 5)
    values = random.standard_normal(60)
    index = np.arange(60).reshape(shape)

    def shifted(axis, step):
        found = index.copy()
        source = [slice(None)] * 3
        target = [slice(None)] * 3
        source[axis] = slice(1, None) if step > 0 else slice(None, -1)
        target[axis] = slice(None, -1) if step > 0 else slice(1, None)
        found[tuple(target)] = index[tuple(source)]
        return found.ravel()

    neighbours = np.stack([shifted(2, 1), shifted(1, 1), shifted(0, 1), shifted(2, -1),
                           shifted(1, -1), shifted(0, -1)], 1).astype(np.int32)

    def loss(v):
        return 0.3 * np.sqrt(sum((1.7 * (v[neighbours[:, a]] - v)) ** 2 for a in range(3))
                             + 1e-9).sum()

    def slopes(v):
        found = np.zeros(60)
        for place in range(60):
            up, down = v.copy(), v.copy()
            up[place] += 1e-5
            down[place] -= 1e-5
            found[place] = (loss(up) - loss(down)) / 2e-5
        return found

    found = np.full(60, np.nan, np.float32)
    total_variation(neighbours, 0, 60, np.append(values, 0).astype(np.float32), 1, 0.3, 1.7, found)
    assert np.abs(slopes(values) - found).max() < 2e-3
    colors = np.zeros((61, 32), np.float32)
    colors[:60, [0, 15, 16, 26]] = random.standard_normal((60, 4))
    found = np.full((60, 32), np.nan, np.float32)
    total_variation(neighbours, 0, 60, colors.ravel(), 32, 0.3, 1.7, found.ravel())
    for column in (0, 15, 16, 26):
        assert np.abs(slopes(colors[:60, column].astype(float)) - found[:60, column]).max() < 2e-3
    assert not found[:, [1, 14, 17, 27, 31]].any()
    part = np.full((10, 32), np.nan, np.float32)
    total_variation(neighbours, 20, 30, colors.ravel(), 32, 0.3, 1.7, part.ravel())
    assert np.array_equal(part, found[20:30])


@pytest.mark.parametrize("width", [16, 32])
def test_smoothing_steps_a_run_of_rows(width):
    random = np.random.default_rng(3)
    density = random.random(9).astype(np.float32)
    values = random.standard_normal((9, width)).astype(np.float32)
    values[:, -2:] = random.random((9, 2))
    gains = np.where(np.arange(width) < 12, 0.5, 0.0).astype(np.float32)
    slopes = random.standard_normal((4, width)).astype(np.float32)
    before = values.copy()
    smooth(density, values.ravel(), width, slopes.ravel(), 3, 7, np.float32(0.3), np.float32(0.9),
           np.float32(0.1), gains)
    expected = before.copy()
    expected[3:7] -= gains * slopes / (before[3:7, -2:-1] + 0.02)
    assert np.allclose(values, expected, atol=1e-5)
    thick = density.copy()
    smooth(density, values.ravel(), width, slopes[:, 0].copy(), 3, 7, np.float32(0.3),
           np.float32(0.9), np.float32(0.1), gains)
    square = 0.9 * before[3:7, -1] + 0.1 * slopes[:, 0] ** 2
    thick[3:7] = np.maximum(thick[3:7] - 0.3 * slopes[:, 0] / np.sqrt(square), 0.1)
    assert np.allclose(density, thick, atol=1e-5)
    assert np.allclose(values[3:7, -1], square, atol=1e-5)


def test_bricks_store_what_they_are_given():
    field = shell_field(basis=4, size=13)
    bricks = build_bricks(field.links, field.density, field.sh)
    rows = bricks.rows[:-32].view(np.float16).reshape(-1, 16)
    assert np.array_equal(rows[:-1, :12], field.sh.reshape(-1, 12).astype(np.float16))
    assert not rows[-1].any()
    assert not rows[:, 12:].any()


def test_bricks_that_became_clear_are_leapt_over():
    random = np.random.default_rng(4)
    links = np.full((30, 22, 41), -1, np.int32)
    filled = random.random(links.shape) < 0.02
    links[filled] = np.arange(filled.sum())
    density = random.random(filled.sum() + 1).astype(np.float32)
    density[-1] = 0.0
    table, brick_links = brick_table(links, filled.sum())
    bright = bright_table(table, brick_links, density, 0.9)
    for place in np.argwhere(table >= 0):
        brick = table[tuple(place)]
        most = density[brick_links[128 * brick:128 * brick + 128]].max()
        assert bright[tuple(place)] == brick if most > 0.9 else bright[tuple(place)] < 0
    kept = np.argwhere(bright >= 0)
    assert 0 < len(kept) < (table >= 0).sum()
    for place in np.argwhere(bright < 0):
        assert -bright[tuple(place)] <= np.abs(kept - place).max(axis=1).min()
    assert (bright_table(table, brick_links, density, 2.0) < 0).all()


def test_depths_without_colors_are_those_of_a_rendering():
    field = shell_field(size=20)
    cameras = Camera.arc([-30.0, 70.0], distance=3.0, width=33, height=26, focal=30.0, pitch=15.0)
    for view in range(2):
        shot = field.render(cameras, view)
        alpha, depth = field.depth(cameras, view)
        assert np.isfinite(depth).any() and not np.isfinite(depth).all()
        assert np.array_equal(alpha, shot.alpha)
        assert np.array_equal(depth, shot.depth)
