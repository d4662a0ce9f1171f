"""Local statistics of colors, compared with NumPy window by window."""

import numpy as np
import pytest

from lfportrait.capture.mattes import color_likelihood, guided_filter


def picture(seed, shape):
    random = np.random.default_rng(seed)
    return random.random((*shape, 3)).astype(np.float32), random.random(shape).astype(np.float32)


def plain_gaussians(image, weight, cell):
    """Mean, inverse covariance, log-determinant and weight of the colors near each block."""
    rows, columns = (-(-side // cell) for side in weight.shape)
    blocks = np.zeros((rows, columns, 13))
    for row, column in np.ndindex(rows, columns):
        part = np.s_[row * cell:(row + 1) * cell, column * cell:(column + 1) * cell]
        w, c = weight[part].reshape(-1, 1), image[part].reshape(-1, 3).astype(float)
        products = (w[..., None] * c[:, :, None] * c[:, None]).mean(0)
        blocks[row, column] = np.concatenate([[w.mean()], (w * c).mean(0), products.ravel()])
    around = np.pad(blocks, ((6, 6), (6, 6), (0, 0)), mode="edge")
    out = np.zeros((rows, columns, 14))
    for row, column in np.ndindex(rows, columns):
        near = around[row:row + 13, column:column + 13].mean((0, 1))
        total = max(near[0], 1e-4)
        mean = near[1:4] / total
        covariance = near[4:].reshape(3, 3) / total - np.outer(mean, mean) + 4e-4 * np.eye(3)
        out[row, column] = np.concatenate([mean, np.linalg.inv(covariance).ravel(),
                                           [np.log(np.linalg.det(covariance)), near[0]]])
    return out


def between(values, cell, y, x):
    """A bilinear look-up of blocks at a pixel; beyond the outermost middles they stay."""
    place = [np.clip((at + 0.5) / cell - 0.5, 0, side - 1)
             for at, side in zip((y, x), values.shape)]
    top, left = (int(at) for at in place)
    down, right = (min(at + 1, side - 1) for at, side in zip((top, left), values.shape))
    dy, dx = place[0] - top, place[1] - left
    return ((1 - dy) * ((1 - dx) * values[top, left] + dx * values[top, right])
            + dy * ((1 - dx) * values[down, left] + dx * values[down, right]))


@pytest.mark.parametrize(("shape", "cell"), [((40, 31), 4), ((17, 23), 2), ((9, 1), 3)])
def test_a_color_is_as_likely_as_under_the_gaussian_of_those_near_it(shape, cell):
    image, weight = picture(1, shape)
    weight[weight < 0.3] = 0
    blocks = plain_gaussians(image, weight, cell)
    found, near = color_likelihood(image, weight, cell)
    for y, x in np.ndindex(shape):
        own = between(blocks, cell, y, x)
        off = image[y, x] - own[:3]
        expected = -0.5 * (off @ own[3:12].reshape(3, 3) @ off + own[12])
        assert found[y, x] == pytest.approx(expected, abs=2e-3, rel=2e-3)
        assert near[y, x] == pytest.approx(own[13], abs=1e-5)


def test_what_is_not_asked_changes_nothing_of_what_is():
    image, weight = picture(2, (60, 50))
    asked = np.random.default_rng(0).random((60, 50)) < 0.05
    asked[20:30] = False
    for found, whole in ((color_likelihood(image, weight, 3, asked),
                          color_likelihood(image, weight, 3)),
                         ((guided_filter(image, weight, 3, 1e-3, wanted=asked),),
                          (guided_filter(image, weight, 3, 1e-3),))):
        for some, every in zip(found, whole):
            assert np.allclose(some[asked], every[asked], atol=1e-5)


@pytest.mark.parametrize(("shape", "radius"), [((12, 15), 2), ((5, 4), 3)])
def test_a_window_has_the_nearest_linear_function_of_its_colors(shape, radius):
    """He et al. 2013, Eq. 5 (with colors, 19) and 21, by least squares."""
    image, plane = picture(3, shape)
    epsilon, side = 1e-2, 2 * radius + 1

    def window(values, y, x):
        wide = np.pad(values, [(radius, radius)] * 2 + [(0, 0)] * (values.ndim - 2), mode="edge")
        return wide[y:y + side, x:x + side].reshape(side * side, *values.shape[2:]).astype(float)

    functions = np.zeros((*shape, 4))
    for y, x in np.ndindex(shape):
        colors, values = window(image, y, x), window(plane, y, x)
        off = colors - colors.mean(0)
        slope = np.linalg.solve(off.T @ off / len(off) + epsilon * np.eye(3),
                                off.T @ (values - values.mean()) / len(off))
        functions[y, x] = [*slope, values.mean() - slope @ colors.mean(0)]
    found = guided_filter(image, plane, radius, epsilon)
    for y, x in np.ndindex(shape):
        mean = window(functions, y, x).mean(0)
        assert found[y, x] == pytest.approx(mean[:3] @ image[y, x] + mean[3], abs=1e-4)
