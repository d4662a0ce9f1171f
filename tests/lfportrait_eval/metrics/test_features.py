"""Official files of the networks that measure: batch norm folded, LPIPS by its formula."""

import hashlib

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from lfportrait import models
from lfportrait.errors import UserError
from lfportrait.models import ModelFile
from lfportrait_eval.metrics import feature_distance, features, inception_features, lpips


@pytest.fixture
def shelf(tmp_path, monkeypatch):
    """A folder of models, and a function that enters a file of it into the registry."""
    monkeypatch.setattr(models, "cache_folder", lambda: tmp_path / "cache")
    monkeypatch.setenv("LFPORTRAIT_MODELS", str(tmp_path))

    def enter(name, path):
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        monkeypatch.setitem(models.REGISTRY, name, (ModelFile(path.name, digest, "", ""),))
    return tmp_path, enter


def narrow_inception():
    """All convolutions of the network to Mixed_6e, 4 channels each: (name, in, rows, columns)."""
    yield from (("Conv2d_1a_3x3", 3, 3, 3), ("Conv2d_2a_3x3", 4, 3, 3), ("Conv2d_2b_3x3", 4, 3, 3),
                ("Conv2d_3b_1x1", 4, 1, 1), ("Conv2d_4a_3x3", 4, 3, 3))
    for block, width in (("Mixed_5b", 4), ("Mixed_5c", 16), ("Mixed_5d", 16)):
        yield from ((f"{block}.branch1x1", width, 1, 1), (f"{block}.branch_pool", width, 1, 1),
                    (f"{block}.branch5x5_1", width, 1, 1), (f"{block}.branch5x5_2", 4, 5, 5),
                    (f"{block}.branch3x3dbl_1", width, 1, 1),
                    (f"{block}.branch3x3dbl_2", 4, 3, 3), (f"{block}.branch3x3dbl_3", 4, 3, 3))
    yield from (("Mixed_6a.branch3x3", 16, 3, 3), ("Mixed_6a.branch3x3dbl_1", 16, 1, 1),
                ("Mixed_6a.branch3x3dbl_2", 4, 3, 3), ("Mixed_6a.branch3x3dbl_3", 4, 3, 3))
    for block, width in (("Mixed_6b", 24), ("Mixed_6c", 16), ("Mixed_6d", 16), ("Mixed_6e", 16)):
        yield from ((f"{block}.branch1x1", width, 1, 1), (f"{block}.branch_pool", width, 1, 1),
                    (f"{block}.branch7x7_1", width, 1, 1), (f"{block}.branch7x7_2", 4, 1, 7),
                    (f"{block}.branch7x7_3", 4, 7, 1), (f"{block}.branch7x7dbl_1", width, 1, 1))
        yield from ((f"{block}.branch7x7dbl_{n}", 4, *((7, 1) if n % 2 == 0 else (1, 7)))
                    for n in (2, 3, 4, 5))


def official_state(convolutions, seed=0):
    """A state dict as pytorch-fid publishes it, with random values."""
    generator = torch.Generator().manual_seed(seed)
    state = {}
    for name, width, rows, columns in convolutions:
        state[f"{name}.conv.weight"] = torch.randn(4, width, rows, columns, generator=generator) * (
            2 / (width * rows * columns)) ** 0.5
        for part, low, high in (("weight", 0.5, 1.5), ("bias", -0.2, 0.5),
                                ("running_mean", -0.5, 0.5), ("running_var", 1e-3, 2)):
            state[f"{name}.bn.{part}"] = torch.empty(4).uniform_(low, high, generator=generator)
        state[f"{name}.bn.num_batches_tracked"] = torch.tensor(0)
    state["fc.weight"] = torch.zeros(8, 4)
    return state


def test_batch_norm_is_folded_into_convolutions():
    state = official_state([("first", 3, 3, 3), ("Mixed_5b.branch1x1", 5, 1, 1)])
    folded = features._folded(state)
    for name, width in (("first", 3), ("Mixed_5b.branch1x1", 5)):
        x = torch.randn(1, width, 7, 7, generator=torch.Generator().manual_seed(1))
        plain = torch.nn.functional.conv2d(x, state[f"{name}.conv.weight"])
        expected = torch.nn.functional.batch_norm(
            plain, *(state[f"{name}.bn.{part}"] for part in (
                "running_mean", "running_var", "weight", "bias")), eps=1e-3)
        found = torch.nn.functional.conv2d(x, folded[f"{name}.weight"], folded[f"{name}.bias"])
        assert found.numpy() == pytest.approx(expected.numpy(), abs=1e-4)
    assert not any(key.endswith((".conv.weight", ".running_var")) for key in folded)
    packed = {"first.weight": torch.ones(1), "first.bias": torch.ones(1)}
    assert features._folded(packed) == packed


def test_the_official_file_gives_the_features_of_the_folded_one(shelf):
    folder, enter = shelf
    state = official_state(narrow_inception())
    torch.save(state, folder / "official.pth")
    packed = {}
    for name, *_ in narrow_inception():
        scale = state[f"{name}.bn.weight"] / torch.sqrt(state[f"{name}.bn.running_var"] + 1e-3)
        packed[f"{name}.weight"] = state[f"{name}.conv.weight"] * scale.reshape(4, 1, 1, 1)
        packed[f"{name}.bias"] = state[f"{name}.bn.bias"] - scale * state[f"{name}.bn.running_mean"]
    save_file(packed, folder / "packed.safetensors")
    picture = np.random.default_rng(0).integers(0, 256, (299, 299, 3), dtype=np.uint8)
    found = []
    for file in ("official.pth", "packed.safetensors"):
        enter("inception", folder / file)
        found.append(inception_features([picture]))
    for name in ("64", "192", "768"):
        assert found[0][name].std() > 1e-3
        assert found[0][name] == pytest.approx(found[1][name], rel=1e-4, abs=1e-5)


WIDTHS = {0: (3, 64), 2: (64, 64), 5: (64, 128), 7: (128, 128), 10: (128, 256), 12: (256, 256),
          14: (256, 256), 17: (256, 512), 19: (512, 512), 21: (512, 512), 24: (512, 512),
          26: (512, 512), 28: (512, 512)}


def random_lpips(folder):
    """The two files LPIPS needs, of the official names and shapes, with random values."""
    generator = torch.Generator().manual_seed(0)
    vgg = {"classifier.6.bias": torch.zeros(1000)}
    for number, (into, out) in WIDTHS.items():
        vgg[f"features.{number}.weight"] = torch.randn(
            out, into, 3, 3, generator=generator) * (2 / (9 * into)) ** 0.5
        vgg[f"features.{number}.bias"] = 0.1 * torch.randn(out, generator=generator)
    linear = {f"lin{layer}.model.1.weight": torch.rand(1, width, 1, 1, generator=generator)
              for layer, width in enumerate((64, 128, 256, 512, 512))}
    torch.save(vgg, folder / "vgg16.pth")
    torch.save(linear, folder / "linear.pth")
    return vgg, linear


def plain_maps(vgg, image):
    """Unit-length features [H, W, C] of relu1_2, 2_2, 3_3, 4_3 and 5_3 in NumPy."""
    x = 2 * image.astype(np.float64) - 1
    x = (x - [-0.030, -0.088, -0.188]) / [0.458, 0.448, 0.450]
    for number in WIDTHS:
        if number in (5, 10, 17, 24):
            height, width, channels = x.shape
            x = x.reshape(height // 2, 2, width // 2, 2, channels).max((1, 3))
        filters = vgg[f"features.{number}.weight"].numpy()
        around = np.pad(x, ((1, 1), (1, 1), (0, 0)))
        x = sum(around[row:row + x.shape[0], column:column + x.shape[1]]
                @ filters[:, :, row, column].T for row in range(3) for column in range(3))
        x = np.maximum(x + vgg[f"features.{number}.bias"].numpy(), 0)
        if number in (2, 7, 14, 21, 28):
            yield x / np.sqrt((x ** 2).sum(-1, keepdims=True))


def test_lpips_is_its_formula(shelf):
    folder, enter = shelf
    vgg, linear = random_lpips(folder)
    enter("vgg16-torchvision", folder / "vgg16.pth")
    enter("lpips", folder / "linear.pth")
    random = np.random.default_rng(0)
    a, b = (random.random((32, 48, 3)).astype(np.float32) for _ in range(2))
    expected = sum(
        ((x - y) ** 2 @ linear[f"lin{layer}.model.1.weight"].numpy().reshape(-1)).mean()
        for layer, (x, y) in enumerate(zip(plain_maps(vgg, a), plain_maps(vgg, b))))
    assert lpips(a, b) == pytest.approx(expected, rel=1e-4)
    assert lpips(a, a) == 0
    assert lpips(a, b) == pytest.approx(lpips(b, a), rel=1e-6)


@pytest.mark.slow  # tests/stylize computes elsewhere, too
def test_metrics_on_another_device_are_the_same(shelf, other_device):
    folder, enter = shelf
    random_lpips(folder)
    enter("vgg16-torchvision", folder / "vgg16.pth")
    enter("lpips", folder / "linear.pth")
    torch.save(official_state(narrow_inception()), folder / "inception.pth")
    enter("inception", folder / "inception.pth")
    random = np.random.default_rng(1)
    a, b = (random.random((32, 48, 3)).astype(np.float32) for _ in range(2))
    mask = random.random((32, 48)) < 0.7

    def measured(device):
        features = inception_features([(255 * a).astype(np.uint8)], device=device)
        return [lpips(a, b, device=device), lpips(a, b, mask, device=device),
                feature_distance(a, b, mask, network="embedded", device=device),
                *features["768"][0]]

    assert measured(other_device) == pytest.approx(measured("cpu"), rel=1e-5)


def test_lpips_without_its_networks_tells_how_to_get_them(shelf):
    image = np.zeros((32, 32, 3), np.float32)
    with pytest.raises(UserError, match=r"LPIPS needs 2 networks \(553 MB\).*: lpips, "
                                        r"vgg16-torchvision; .*models fetch lpips vgg16-torch"):
        lpips(image, image)


def test_the_packed_part_of_vgg16_is_not_enough_for_lpips(shelf):
    folder, _ = shelf
    (folder / models.REGISTRY["vgg16"][0].file).write_bytes(b"")
    assert models.available("vgg16")
    assert models.missing(features.LPIPS_NETWORKS["vgg"]) == ["lpips", "vgg16-torchvision"]


ALEX = {0: (3, 64, 11, 4, 2), 3: (64, 192, 5, 1, 2), 6: (192, 384, 3, 1, 1),
        8: (384, 256, 3, 1, 1), 10: (256, 256, 3, 1, 1)}
"""AlexNet's convolutions: channels in and out, size, stride, padding."""


def random_alex(folder):
    """The two files that LPIPS with AlexNet needs, with random values."""
    generator = torch.Generator().manual_seed(3)
    alex = {}
    for number, (into, out, size, *_) in ALEX.items():
        alex[f"features.{number}.weight"] = torch.randn(
            out, into, size, size, generator=generator) * (2 / (size * size * into)) ** 0.5
        alex[f"features.{number}.bias"] = 0.1 * torch.randn(out, generator=generator)
    linear = {f"lin{layer}.model.1.weight": torch.rand(1, out, 1, 1, generator=generator)
              for layer, (_, out, *_) in enumerate(ALEX.values())}
    torch.save(alex, folder / "alexnet.pth")
    torch.save(linear, folder / "alex.pth")
    return alex, linear


def plain_alex_maps(alex, image):
    """Unit-length features [H, W, C] of AlexNet's five layers in NumPy, patch by patch."""
    x = (2 * image.astype(np.float64) - 1 - [-0.030, -0.088, -0.188]) / [0.458, 0.448, 0.450]
    for number, (_, _, size, stride, padding) in ALEX.items():
        if number in (3, 6):
            windows = np.lib.stride_tricks.sliding_window_view(x, (3, 3), (0, 1))[::2, ::2]
            x = windows.max((-2, -1))
        around = np.pad(x, ((padding, padding), (padding, padding), (0, 0)))
        windows = np.lib.stride_tricks.sliding_window_view(around, (size, size), (0, 1))
        x = np.einsum("hwcij,ocij->hwo", windows[::stride, ::stride],
                      alex[f"features.{number}.weight"].numpy(), optimize=True)
        x = np.maximum(x + alex[f"features.{number}.bias"].numpy(), 0)
        yield x / np.sqrt((x ** 2).sum(-1, keepdims=True))


@pytest.fixture
def alex(shelf):
    folder, enter = shelf
    weights = random_alex(folder)
    enter("alexnet", folder / "alexnet.pth")
    enter("lpips-alex", folder / "alex.pth")
    return weights


def alex_layers(weights, a, b):
    """Weighted squared differences [H, W] of each layer."""
    backbone, linear = weights
    return [(x - y) ** 2 @ linear[f"lin{layer}.model.1.weight"].numpy().reshape(-1)
            for layer, (x, y) in enumerate(zip(plain_alex_maps(backbone, a),
                                               plain_alex_maps(backbone, b)))]


def test_lpips_with_alexnet_is_its_formula(alex):
    random = np.random.default_rng(0)
    a, b = (random.random((64, 80, 3)).astype(np.float32) for _ in range(2))
    expected = sum(layer.mean() for layer in alex_layers(alex, a, b))
    assert lpips(a, b, network="alex") == pytest.approx(expected, rel=1e-4)
    assert lpips(a, a, network="alex") == 0


def enlarged(layer, shape):
    """Bilinear with pixel centres at +0.5, as torch does it, in NumPy."""
    def weights(small, large):
        at = np.clip((np.arange(large) + 0.5) * small / large - 0.5, 0, small - 1)
        low = np.minimum(np.floor(at).astype(int), small - 1)
        matrix = np.zeros((large, small))
        matrix[np.arange(large), low] += 1 - (at - low)
        matrix[np.arange(large), np.minimum(low + 1, small - 1)] += at - low
        return matrix

    return weights(layer.shape[0], shape[0]) @ layer @ weights(layer.shape[1], shape[1]).T


def test_lpips_over_a_mask_is_the_mean_of_its_map_there(alex):
    random = np.random.default_rng(1)
    a, b = (random.random((64, 80, 3)).astype(np.float32) for _ in range(2))
    mask = np.zeros((64, 80), bool)
    mask[10:50, 20:70] = True
    layers = alex_layers(alex, a * mask[..., None], b * mask[..., None])
    expected = sum(enlarged(layer, mask.shape) for layer in layers)[mask].mean()
    assert lpips(a, b, mask, network="alex") == pytest.approx(expected, rel=1e-4)
    outside = np.where(mask[..., None], a, 1 - a)
    assert lpips(a, outside, mask, network="alex") == 0  # what is outside does not count
    assert np.isnan(lpips(a, b, np.zeros_like(mask), network="alex"))


def last_convolutions():
    """Mixed_7a to Mixed_7c, 4 channels each: (name, in, rows, columns)."""
    for branch, count in (("branch3x3", 2), ("branch7x7x3", 4)):
        sizes = {1: (1, 1), 2: (3, 3) if count == 2 else (1, 7), 3: (7, 1), 4: (3, 3)}
        yield from ((f"Mixed_7a.{branch}_{n}", 16 if n == 1 else 4, *sizes[n])
                    for n in range(1, count + 1))
    for block, width in (("Mixed_7b", 24), ("Mixed_7c", 24)):
        yield from ((f"{block}.{name}", width, 1, 1) for name in (
            "branch1x1", "branch3x3_1", "branch3x3dbl_1", "branch_pool"))
        yield f"{block}.branch3x3dbl_2", 4, 3, 3
        yield from ((f"{block}.{name}{end}", 4, *size) for name in ("branch3x3_2", "branch3x3dbl_3")
                    for end, size in (("a", (1, 3)), ("b", (3, 1))))


class PlainBlocks:
    """The last blocks as pytorch-fid writes them: convolution, batch norm, ReLU, one by one."""

    def __init__(self, state):
        self.state = state

    def unit(self, x, name, stride=1):
        weight = self.state[f"{name}.conv.weight"]
        same = stride == 1
        padding = (weight.shape[2] // 2, weight.shape[3] // 2) if same else 0
        x = torch.nn.functional.conv2d(x, weight, None, stride, padding)
        return torch.relu(torch.nn.functional.batch_norm(x, *(
            self.state[f"{name}.bn.{part}"] for part in (
                "running_mean", "running_var", "weight", "bias")), eps=1e-3))

    def a(self, x):
        three = self.unit(self.unit(x, "Mixed_7a.branch3x3_1"), "Mixed_7a.branch3x3_2", 2)
        seven = x
        for n in (1, 2, 3):
            seven = self.unit(seven, f"Mixed_7a.branch7x7x3_{n}")
        seven = self.unit(seven, "Mixed_7a.branch7x7x3_4", 2)
        return torch.cat([three, seven, torch.max_pool2d(x, 3, 2)], 1)

    def e(self, x, name, pooled):
        one = self.unit(x, f"{name}.branch1x1")
        three = self.unit(x, f"{name}.branch3x3_1")
        three = torch.cat([self.unit(three, f"{name}.branch3x3_2a"),
                           self.unit(three, f"{name}.branch3x3_2b")], 1)
        double = self.unit(self.unit(x, f"{name}.branch3x3dbl_1"), f"{name}.branch3x3dbl_2")
        double = torch.cat([self.unit(double, f"{name}.branch3x3dbl_3a"),
                            self.unit(double, f"{name}.branch3x3dbl_3b")], 1)
        return torch.cat([one, three, double, self.unit(pooled, f"{name}.branch_pool")], 1)


def test_the_last_blocks_are_those_of_pytorch_fid(shelf):
    state = official_state(last_convolutions(), seed=2)
    x = torch.rand(2, 16, 9, 9, generator=torch.Generator().manual_seed(4))
    plain = PlainBlocks(state)
    y = plain.a(x)
    y = plain.e(y, "Mixed_7b", torch.nn.functional.avg_pool2d(
        y, 3, 1, 1, count_include_pad=False))
    expected = plain.e(y, "Mixed_7c", torch.nn.functional.max_pool2d(y, 3, 1, 1))
    found = features._Inception(features._folded(state)).last(x)
    assert found.shape == expected.shape == (2, 24, 4, 4)
    assert found.numpy() == pytest.approx(expected.numpy(), rel=1e-3, abs=1e-4)


def test_the_usual_fid_takes_the_official_file(shelf):
    folder, enter = shelf
    state = official_state(narrow_inception()) | official_state(last_convolutions(), seed=2)
    torch.save(state, folder / "official.pth")
    enter("inception-2048", folder / "official.pth")
    picture = np.random.default_rng(0).integers(0, 256, (299, 299, 3), dtype=np.uint8)
    found = inception_features([picture, picture[::-1]], full=True)
    assert set(found) == {"64", "192", "768", "2048"}
    assert found["2048"].shape == (2, 24) and found["2048"].std() > 0  # of 4 channels a branch
