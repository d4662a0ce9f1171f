"""Losses, networks, the linear color fit, and a small stylisation end to end."""

import json

import numpy as np
import pytest
import torch
from torch.optim.adam import adam

from lfportrait.capture import Camera
from lfportrait.errors import UserError
from lfportrait.media.pictures import read_image
from lfportrait.stylize import StylizeConfig, load_network, refinement, stylize_with_figures
from lfportrait.stylize.fit import ColorModel, StyleView, affine_color_map, prepare_view
from lfportrait.stylize.kernels import adam_step, gather_colors, scatter_colors
from lfportrait.stylize.losses import (
    _halved,
    _normalised,
    _read,
    _resnet50,
    _vgg16,
    content_loss,
    has_half_numbers,
    laplacian,
    laplacian_loss,
    nearest_neighbour_loss,
)
from tests.fields import shell_field


def test_nearest_neighbour_loss_of_a_picture_with_itself_is_zero():
    features = torch.randn(50, 8, generator=torch.Generator().manual_seed(0))
    assert float(nearest_neighbour_loss(features, features)) < 1e-6
    assert float(nearest_neighbour_loss(3.0 * features, features.flip(0))) < 1e-6


def test_nearest_neighbour_loss_equals_numpy():
    random = np.random.default_rng(0)
    a, b = random.standard_normal((30, 5)), random.standard_normal((40, 5))
    unit = [v / np.linalg.norm(v, axis=1, keepdims=True) for v in (a, b)]
    wanted = (1 - (unit[0] @ unit[1].T).max(1)).mean()
    got = nearest_neighbour_loss(torch.tensor(a), torch.tensor(b), chunk=7)
    assert abs(float(got) - wanted) < 1e-9


def test_content_loss_counts_inside_only():
    a, b = torch.zeros(4, 3, 3), torch.zeros(4, 3, 3)
    b[:, 0, 0] = 2.0
    inside = torch.zeros(3, 3, dtype=torch.bool)
    inside[1:, 1:] = True
    assert float(content_loss(a, b)) == pytest.approx(4.0 / 9)
    assert float(content_loss(a, b, inside)) == 0.0


def test_laplacian_sees_edges_not_slopes():
    slope = torch.arange(12.0).expand(3, 10, 12) / 12
    assert laplacian(slope)[:, :, 1:-1].abs().max() < 1e-6
    edge = torch.zeros(3, 10, 12)
    edge[..., 6:] = 1.0
    assert laplacian(edge).abs().max() == 1.0
    assert float(laplacian_loss(edge, edge)) == 0.0
    total = float(laplacian_loss(edge, slope, reduction="sum"))
    assert total == pytest.approx(360 * float(laplacian_loss(edge, slope)), rel=1e-5)
    assert float(laplacian_loss(edge, slope, pool=2)) > 0


@pytest.mark.parametrize("name", ["embedded"])
def test_the_embedded_network_answers_to_structure(name):
    network = load_network(name)
    x = torch.linspace(0, 1, 64)
    stripes = (torch.sin(40 * x) > 0).float().expand(1, 3, 64, 64)
    maps = network(stripes)
    assert [tuple(m.shape) for m in maps] == [(1, 64, 16, 16)] * 2
    again = network(stripes)
    assert all(torch.equal(a, b) for a, b in zip(maps, again))
    flat = network(torch.full((1, 3, 64, 64), 0.5))
    turned = network(stripes.transpose(2, 3))
    # Stripes differ from flat grey and from the same stripes lying down.
    for a, b, c in zip(maps, flat, turned):
        assert (a.mean((2, 3)) - b.mean((2, 3))).norm() > 0.5
        assert (a.mean((2, 3)) - c.mean((2, 3))).norm() > 0.2


def _random_weights(channels, numbers, seed=0):
    """Weights of VGG-16's convolutions, a few channels wide."""
    generator = torch.Generator().manual_seed(seed)
    weights, before = {}, 3
    for number in numbers:
        weights[f"features.{number}.weight"] = torch.randn(channels, before, 3, 3,
                                                           generator=generator) / before
        weights[f"features.{number}.bias"] = torch.randn(channels, generator=generator)
        before = channels
    return weights


def test_half_numbers_keep_features_and_slopes():
    weights = _random_weights(8, (0, 2, 5, 7, 10, 12, 14))
    whole, half = _normalised(_vgg16(weights)), _normalised(_vgg16(_halved(weights)))
    image = torch.rand(1, 3, 64, 48, generator=torch.Generator().manual_seed(1))
    slopes = []
    for network in (whole, half):
        given = image.clone().requires_grad_(True)
        maps = network(given)
        assert all(values.dtype == torch.float32 for values in maps)
        slope, = torch.autograd.grad(sum(values.square().mean() for values in maps), given)
        slopes.append(slope.flatten())
    for one, other in zip(whole(image), half(image)):
        assert (one - other).norm() < 0.02 * one.norm()
    assert torch.nn.functional.cosine_similarity(*slopes, dim=0) > 0.99


def test_a_small_network_computes_in_whole_numbers():
    picture = torch.rand(1, 3, 32, 32, generator=torch.Generator().manual_seed(2))
    for one, other in zip(load_network("embedded")(picture),
                          load_network("embedded", half=True)(picture)):
        assert torch.allclose(one, other, atol=1e-5)  # bfloat16 would be off by a hundredth
    assert isinstance(has_half_numbers(), bool)


def test_neighbours_may_be_sought_in_half_numbers():
    generator = torch.Generator().manual_seed(3)
    features, style = (torch.randn(300, 64, generator=generator) for _ in range(2))
    whole, half = (float(nearest_neighbour_loss(features, style, half=half))
                   for half in (False, True))
    assert whole <= half + 1e-6 and half == pytest.approx(whole, rel=2e-3)


def test_an_unknown_network_is_told():
    with pytest.raises(UserError, match="vgg19-se"):
        load_network("vgg99")


@pytest.mark.data
@pytest.mark.parametrize(("file", "build", "key", "layer", "index"), [
    ("vgg16_relu3_3", _vgg16, "vgg16_relu3_3", "relu after features.14", 2),
    ("resnet50_v1_folded_to_layer3", _resnet50, "resnet50_v1", "layer2", 1)])
def test_networks_give_the_published_activations(shared_weights, file, build, key, layer, index):
    expected = json.loads((shared_weights / "expected.json").read_text())
    y, x, size = expected[key]["crop"]
    image = read_image(shared_weights / expected["image"])[y:y + size, x:x + size, :3]
    network = build(_read(shared_weights / f"{file}.safetensors"))
    with torch.no_grad():
        maps = network(torch.from_numpy(image / np.float32(255)).permute(2, 0, 1)[None])
    wanted = expected[key][layer]
    got = maps[index]
    assert list(got.shape) == wanted["shape"]
    assert float(got.mean()) == pytest.approx(wanted["mean"], rel=1e-3)
    assert float(got.std()) == pytest.approx(wanted["std"], rel=1e-3)
    assert np.allclose(got.flatten()[:5].numpy(), wanted["first5"], rtol=2e-3, atol=2e-3)


# -- linear colors -------------------------------------------------------------------------------


def random_csr(pixels=37, rows=23, seed=0):
    random = np.random.default_rng(seed)
    dense = random.random((pixels, rows)) * (random.random((pixels, rows)) < 0.2)
    indptr = np.concatenate([[0], np.cumsum((dense > 0).sum(1))])
    return (dense, indptr.astype(np.int64), np.nonzero(dense)[1].astype(np.int32),
            dense[dense > 0].astype(np.float32))


def test_products_with_sparse_weights_equal_numpy():
    dense, indptr, rows, weights = random_csr()
    random = np.random.default_rng(1)
    colors, image = random.random((23, 3), np.float32), random.random((37, 3), np.float32)
    out = np.empty((37, 3), np.float32)
    gather_colors(indptr, rows, weights, colors, out)
    assert np.allclose(out, dense @ colors, atol=1e-5)
    back = np.ones((3, 23), np.float32)
    scatter_colors(indptr, rows, weights, np.ascontiguousarray(image.T), back)
    assert np.allclose(back, 1 + (dense.T @ image).T, atol=1e-5)


def test_adams_step_equals_torch():
    random = np.random.default_rng(0)
    colors = random.uniform(0.3, 0.7, (9, 3)).astype(np.float32)
    parameter = torch.tensor(colors.copy(), requires_grad=True)
    # Its function: the class first imports torch's compiler, for seconds.
    moments, count = [torch.zeros(9, 3), torch.zeros(9, 3)], torch.tensor(0.0)
    mean, square = np.zeros_like(colors), np.zeros_like(colors)
    for step in range(1, 6):
        slope = random.standard_normal((9, 3)).astype(np.float32)
        with torch.no_grad():
            adam([parameter], [torch.tensor(slope)], moments[:1], moments[1:], [], [count],
                 amsgrad=False, beta1=0.9, beta2=0.99, lr=0.01, weight_decay=0.0, eps=1e-12,
                 maximize=False)
        gradient = np.ascontiguousarray(slope.T)
        adam_step(colors, gradient, mean, square, np.float32(0.01), step)
        assert not gradient.any()
    assert np.allclose(colors, parameter.detach().numpy(), atol=1e-5)


def styled_views(field, colors, count=6):
    """Views whose example is the field painted with known colors."""
    cameras = Camera.arc(np.linspace(-150, 150, count), distance=3.0, width=48, height=48,
                         focal=55.0, pitch=10.0)
    model = ColorModel(field, 1.0)
    views = []
    for index in range(count):
        view = prepare_view(field, cameras, index, None, None, None, 1.0)
        view.example = model.picture(view, colors)
        views.append(view)
    return views


def test_the_fit_finds_the_colors_that_made_the_pictures():
    field = shell_field(basis=4, size=20, density=80.0)
    points = field.lattice_points()
    colors = np.float32(0.5 + 0.4 * np.sin(3 * points))
    views = styled_views(field, colors)
    model = ColorModel(field, 1.0)
    errors = model.fit(views, 25)
    assert errors[-1] < 0.02 * errors[0]
    for view in views:
        assert np.abs(model.picture(view) - view.example)[view.alpha > 0.5].mean() < 0.01
    known = model.seen > 0.5
    assert known.sum() > 50
    assert np.abs(model.colors - colors)[known].mean() < 0.04


def test_rows_that_no_view_sees_follow_the_others():
    field = shell_field(basis=1, size=20, density=80.0)
    model = ColorModel(field, 1.0)
    colors = np.clip(0.2 + 0.5 * model.original[:, ::-1], 0, 1)
    model.fit(styled_views(field, colors, count=2), 12)
    share = model.fill_unseen()
    assert 0.05 < share < 0.95
    unseen = model.seen < 1e-3
    assert np.abs(model.colors - colors)[unseen].mean() < 0.06


def test_affine_color_maps_are_found():
    random = np.random.default_rng(0)
    source = random.random((500, 3), np.float32)
    matrix = np.array([[0.5, 0.2, 0], [0, 0.7, 0.1], [0.3, 0, 0.4]])
    offset = np.array([0.1, 0, 0.2])
    found, shift = affine_color_map(source, source @ matrix.T + offset, np.ones(500, np.float32))
    assert np.abs(found - matrix).max() < 0.02
    assert np.abs(shift - offset).max() < 0.02


# -- end to end -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def job():
    """A small field of the modelled head, its capture, and a painted exemplar."""
    from lfportrait.demo import demo_capture, demo_exemplar
    from lfportrait.field import ReconstructConfig, reconstruct_with_figures

    capture = demo_capture(size=72, views=16)
    field, _ = reconstruct_with_figures(capture, ReconstructConfig(
        resolutions=(24, 48), rays=(0.04, 0.08), batch=(2048,)))
    return field, capture, demo_exemplar(width=180, height=240)


SMALL = StylizeConfig(method="paper", guide="surface", size=88, arc=40.0, views=3,
                      pitches=(5.0,), fit_iterations=6, steps=4, content_network="embedded",
                      style_network="embedded")


@pytest.fixture(scope="module")
def styled_here(job):
    """That head in the painting's style, all of it computed on the CPU; and the figures."""
    return stylize_with_figures(*job, SMALL, device="cpu")


def test_a_head_takes_on_the_exemplar(job, styled_here):
    field, _, exemplar = job
    styled, figures = styled_here
    assert styled.basis == 1
    assert np.array_equal(styled.density, field.density)
    assert figures["fit"]["rmse"][-1] < 0.6 * figures["fit"]["rmse"][0]
    refinement = figures["refinement"]
    assert refinement["networks"] == {"content": "embedded", "style": "embedded"}
    assert set(refinement["before"]["gradient_norms"]) == {"style", "content", "laplacian", "fit"}
    # The palette moves from the photo's towards the painting's.
    camera = Camera.arc([0.0], distance=4.0, width=96, height=96, focal=170.0)
    alpha = field.render(camera).alpha > 0.9
    real, painted = (f.render(camera).color[alpha].mean(0) for f in (field, styled))
    palette = exemplar.image[exemplar.mask > 0.5].mean(0) / 255.0
    assert np.linalg.norm(painted - palette) < 0.7 * np.linalg.norm(real - palette)


def test_networks_on_another_device_give_the_same(job, styled_here, other_device):
    field, here = job[0], styled_here
    there = stylize_with_figures(*job, SMALL, device=other_device)
    assert here[1]["device"] == "cpu"
    assert there[1]["device"] == "gpu: Other 9 (Test)"
    assert np.allclose(here[0].sh, there[0].sh, atol=1e-5)
    assert np.abs(here[0].sh - field.sh[..., :1]).max() > 0.1


@pytest.mark.slow  # a network that goes on elsewhere: above; errors that are not a device's: below
@pytest.mark.parametrize("error, why", [
    (torch.OutOfMemoryError("no room"), "has too little memory"),
    (RuntimeError("MPS backend out of memory"), "has too little memory"),
    (torch.AcceleratorError("CUDA error: unspecified launch failure"), "was lost")])
def test_a_gpu_that_fails_leaves_the_networks_to_the_cpu(job, styled_here, other_device,
                                                         monkeypatch, error, why):
    left, gradients = [3], refinement.nearest_neighbour_loss

    def full(features, *arguments, **options):
        left[0] -= features.device.type != "cpu"
        if left[0] < 0 and features.device.type != "cpu":
            raise error
        return gradients(features, *arguments, **options)

    monkeypatch.setattr(refinement, "nearest_neighbour_loss", full)
    with pytest.warns(UserWarning, match=f"Other 9 {why}: the networks compute on the CPU"):
        styled, figures = stylize_with_figures(*job, SMALL, device=other_device)
    assert figures["device"] == "cpu"
    assert np.array_equal(styled.sh, styled_here[0].sh)


@pytest.mark.parametrize("count, steps", [(1, 3), (4, 2), (4, 9)])
def test_refinement_begins_with_the_probe_and_takes_every_view_in_turn(count, steps):
    views = [object() for _ in range(count)]
    refined = refinement.Refinement(None, views, StylizeConfig(steps=steps), device="cpu")
    order = [views.index(one) for one in refined._order()]
    assert len(order) == steps and views[order[0]] is refined.probe
    for begin in range(0, steps, count):
        turn = order[begin:begin + count]
        assert len(set(turn)) == len(turn)


def test_what_weighs_the_terms_is_the_first_step(job, monkeypatch):
    calls, loss = [], refinement.nearest_neighbour_loss
    monkeypatch.setattr(refinement, "nearest_neighbour_loss",
                        lambda *args, **options: calls.append(1) or loss(*args, **options))
    _, figures = stylize_with_figures(*job, SMALL, device="cpu")
    assert len(calls) == figures["refinement"]["steps"] + 1


def test_a_fault_on_a_gpu_is_not_hidden(job, other_device, monkeypatch):
    def faulty(*arguments, **options):
        raise RuntimeError("sizes do not match")

    monkeypatch.setattr(refinement, "nearest_neighbour_loss", faulty)
    with pytest.raises(RuntimeError, match="sizes do not match"):
        stylize_with_figures(*job, SMALL, device=other_device)


def test_a_capture_without_landmarks_is_told(job):
    from dataclasses import replace

    field, capture, exemplar = job
    with pytest.raises(UserError, match="landmarks"):
        stylize_with_figures(field, replace(capture, landmarks=None), exemplar, SMALL)


def test_views_are_cropped_to_the_head():
    field = shell_field(size=16)
    camera = Camera.arc([0.0], distance=6.0, width=200, height=160, focal=150.0)
    view = prepare_view(field, camera, 0, None, None, None, 1.0)
    assert isinstance(view, StyleView)
    assert view.shape[0] < 120
    whole = field.render(camera, 0, background=1.0).color
    assert np.isclose(view.alpha.sum(), field.render(camera, 0).alpha.sum(), rtol=1e-3)
    assert view.content.mean() < whole.mean()
