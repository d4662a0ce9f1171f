"""StylizedNeRF: the network in the plane, the warp between views, codes, and a small head."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from lfportrait import models
from lfportrait.errors import UserError
from lfportrait.stylize import FieldTask, StylizeConfig, stylize_with_figures
from lfportrait.stylize.fit import ColorModel
from lfportrait_eval.baselines.config import StylizedNerfConfig
from lfportrait_eval.baselines.field import stylized_nerf
from lfportrait_eval.baselines.field.photo_views import photo_views, seen_from, tensor
from lfportrait_eval.baselines.field.stylized_nerf import (
    DECODER,
    ENCODER,
    AdainNetwork,
    LatentColors,
    PaintingTeacher,
    load_adain,
    normalised_to,
    paint_by_mutual_teaching,
    statistics_of,
)
from tests.other_memory import PLACE

SMALL = StylizedNerfConfig(size=96, views=4, steps=4, rounds=2, fit_iterations=2, latent=1)
WIDTHS = (16, 16, 32, 32, 64, 64, 64, 64, 128)


def random_network(seed=0, place="cpu"):
    """Encoder and decoder of the right shapes with random weights."""
    random = torch.Generator().manual_seed(seed)

    def layer(name, after, before, size):
        scale = (2 / (before * size * size)) ** 0.5
        return {f"{name}.weight": scale * torch.randn(after, before, size, size, generator=random),
                f"{name}.bias": torch.full((after,), 0.01)}

    weights = layer("encoder4.conv0", 3, 3, 1)
    for name, before, after in zip(ENCODER, (3, *WIDTHS), WIDTHS):
        weights |= layer(f"encoder4.conv{name}", after, before, 3)
    for name, before, after in zip(DECODER, WIDTHS[::-1], (*WIDTHS[-2::-1], 3)):
        weights |= layer(f"decoder4.conv{name}", after, before, 3)
    return AdainNetwork(weights, place)


@pytest.fixture(scope="module")
def scene(small_head):
    task = FieldTask(*small_head)
    return task, photo_views(task, 96, 8)


def test_shapes_of_features_and_pictures():
    network = random_network()
    maps = network.encode(torch.rand(1, 3, 32, 48))
    assert [tuple(values.shape[1:]) for values in maps] == [
        (16, 32, 48), (32, 16, 24), (64, 8, 12), (128, 4, 6)]
    assert network.decode(maps[-1]).shape == (1, 3, 32, 48)


def test_normalised_features_have_the_wanted_statistics_inside():
    features = torch.randn(1, 5, 8, 8, generator=torch.Generator().manual_seed(1))
    inside = torch.zeros(8, 8)
    inside[2:7, 1:6] = 1
    wanted = torch.linspace(-1, 1, 5), torch.linspace(0.5, 2, 5)
    mean, spread = statistics_of(normalised_to(features, inside, wanted), inside)
    assert torch.allclose(mean, wanted[0], atol=1e-4)
    assert torch.allclose(spread, wanted[1], atol=1e-3)


@pytest.mark.slow  # only for comparisons; trains a head
def test_a_view_warped_into_its_neighbour_shows_the_same(scene):
    _, views = scene
    near, far = seen_from(views[3], views[4]), seen_from(views[0], views[-1])
    assert near.visible.sum() > 200
    # Cameras at both ends look at different sides.
    assert far.visible.sum() < 0.3 * near.visible.sum()
    shown = near.warped(tensor(views[4].content))[0].permute(1, 2, 0).numpy()
    error = np.abs(shown - views[3].content)[near.visible.numpy()].mean()
    unwarped = np.abs(views[3].content[near.visible.numpy()]
                      - views[3].content[near.visible.numpy()].mean(0)).mean()
    assert error < 0.5 * unwarped


@pytest.mark.slow  # only for comparisons; trains a head
def test_a_view_sees_all_of_itself(scene):
    _, views = scene
    link = seen_from(views[2], views[2])
    known = views[2].inside & np.isfinite(views[2].points).all(-1)
    assert np.array_equal(link.visible.numpy(), known)
    assert np.allclose(link.cosine[known], 1.0, atol=1e-5)
    same = link.warped(tensor(views[2].content))[0].permute(1, 2, 0).numpy()
    assert np.allclose(same[known], views[2].content[known], atol=1e-4)


@pytest.mark.slow  # only for comparisons; trains a head
@pytest.mark.parametrize("numbers", [0, 1])
def test_codes_take_what_views_cannot_agree_on(scene, numbers):
    task, views = scene
    tint = np.linspace(-0.15, 0.15, len(views), dtype=np.float32)
    views = [replace(view, example=np.clip(view.content + change * view.alpha[..., None], 0, 1))
             for view, change in zip(views, tint)]
    model = ColorModel(task.field, 1.0)
    latent = LatentColors(model, views, numbers, 1e-5, np.random.default_rng(0))
    errors = latent.fit(8)
    assert errors[-1] < errors[0]
    if numbers:
        assert abs(np.corrcoef(latent.codes[:, 0], tint)[0, 1]) > 0.9
        assert np.allclose(latent.codes.mean(0), 0, atol=1e-5)
        shared = LatentColors(ColorModel(task.field, 1.0), views, 0, 0.0, np.random.default_rng(0))
        assert errors[-1] < 0.8 * shared.fit(8)[-1]


@pytest.mark.slow  # only for comparisons; trains a head
def test_tuning_lowers_the_decoders_loss(scene, monkeypatch):
    monkeypatch.setattr(stylized_nerf, "LEARNING_RATE", 1e-3)
    task, views = scene
    teacher = PaintingTeacher(random_network(), views, task, SMALL)

    def loss():
        teacher.random = task.random(9)
        return float(np.mean([float(teacher._loss(k, None).detach()) for k in range(4)]))

    before = loss()
    teacher.tune(12, None)
    assert loss() < before


@pytest.fixture(scope="module")
def taught(small_head):
    """Colors of the head and figures."""
    return paint_by_mutual_teaching(FieldTask(*small_head, device="cpu"), SMALL, random_network())


@pytest.mark.slow  # only for comparisons; its steps are above
def test_a_head_and_a_network_teach_each_other(small_head, taught):
    field = small_head[0]
    colors, figures = taught
    assert colors.shape == (len(field.density), 3)
    assert colors.min() >= 0 and colors.max() <= 1
    assert len(figures["fit"]["rmse"]) == 2
    assert all(row[-1] < row[0] for row in figures["fit"]["rmse"])
    assert np.abs(colors - ColorModel(field, 1.0).colors).mean() > 0.03
    again, _ = paint_by_mutual_teaching(FieldTask(*small_head), SMALL, random_network())
    assert np.array_equal(again, colors)


@pytest.mark.slow  # tests/stylize/test_stylize.py computes elsewhere, too
def test_the_teacher_on_another_device_gives_the_same(small_head, taught, other_device):
    there, figures = paint_by_mutual_teaching(
        FieldTask(*small_head, device=other_device), SMALL, random_network(place=PLACE))
    assert figures["device"] == "gpu: Other 9 (Test)"
    assert np.allclose(taught[0], there, atol=1e-4)


@pytest.mark.slow  # only for comparisons; trains a head
def test_missing_weights_are_told(small_head, monkeypatch, tmp_path):
    monkeypatch.setenv("LFPORTRAIT_MODELS", str(tmp_path))
    monkeypatch.setattr(models, "cache_folder", lambda: tmp_path)
    with pytest.raises(UserError, match=r"wct_se_16x_relu4_1\.safetensors"):
        stylize_with_figures(*small_head, StylizeConfig(method="stylized-nerf"))


@pytest.mark.slow  # only for comparisons; trains a head
@pytest.mark.parametrize(("change", "message"), [
    ({"rounds": 0}, "at least 1"), ({"latent": -1}, "negative")])
def test_wrong_parameters_are_told(small_head, change, message):
    with pytest.raises(UserError, match=message):
        paint_by_mutual_teaching(FieldTask(*small_head), replace(SMALL, **change))


@pytest.mark.data
def test_the_published_decoder_makes_the_picture_again(shared_data, shared_weights, monkeypatch):
    from lfportrait.media.pictures import read_image
    from lfportrait.metrics import psnr

    monkeypatch.setenv("LFPORTRAIT_MODELS", str(shared_weights))
    picture = read_image(shared_data / "faceblit_reference" / "target1.png")[:, :, :3]
    picture = picture[:picture.shape[0] // 8 * 8, :picture.shape[1] // 8 * 8] / np.float32(255)
    network = load_adain()
    with torch.no_grad():
        again = network.decode(network.encode(tensor(picture))[-1])[0].permute(1, 2, 0).numpy()
    assert psnr(np.clip(again, 0, 1), picture) > 28
