"""Ref-NPR: registration with its visibility test, and a small head from start to end."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from lfportrait.capture import Camera
from lfportrait.errors import UserError
from lfportrait.stylize import FieldTask, StylizeConfig, load_network, stylize_with_figures
from lfportrait.stylize.losses import _vgg19_se_deep
from lfportrait_eval.baselines.config import RefNprConfig
from lfportrait_eval.baselines.field.photo_views import nearest_places, view_of
from lfportrait_eval.baselines.field.ref_npr import painted_view, registered, steady_places
from lfportrait_eval.baselines.field.stylized_nerf import ENCODER

SMALL = StylizeConfig(method="ref-npr", parameters=(RefNprConfig(
    size=96, views=4, steps=12, fit_iterations=3, network="embedded"),))


@pytest.fixture(scope="module")
def scene(small_head):
    task = FieldTask(*small_head)
    return task, painted_view(task, 96)


def turned(task, degrees):
    camera = Camera.arc(np.array([degrees]), distance=4.0, width=256, height=256, focal=600.0)
    return view_of(task, camera, 96, None)


def test_nearest_places_equal_numpy():
    random = np.random.default_rng(0)
    a, b = random.standard_normal((30, 5)), random.standard_normal((40, 5))
    unit = [v / np.linalg.norm(v, axis=1, keepdims=True) for v in (a, b)]
    cosine = unit[0] @ unit[1].T
    nearest, distance = nearest_places(torch.tensor(a), torch.tensor(b), chunk=7)
    assert np.array_equal(nearest.numpy(), cosine.argmax(1))
    assert np.allclose(distance.numpy(), 1 - cosine.max(1))


@pytest.mark.slow  # only for comparisons; trains a head
def test_the_reference_is_painted(scene):
    _, reference = scene
    assert np.abs(reference.example - reference.content)[reference.inside].mean() > 0.05
    outside = reference.alpha < 1e-3
    assert np.allclose(reference.example[outside], 1.0, atol=1e-3)


@pytest.mark.slow  # only for comparisons; trains a head
def test_the_painting_is_laid_on_a_turned_view(scene):
    task, reference = scene
    shares = []
    for degrees in (0.0, 25.0, 60.0, 180.0):
        view = turned(task, degrees)
        shares.append(registered(view, reference))
        known = view.trust > 0
        # Every registered color is one of the painting's, seen from where both see the place.
        assert not (known & ~view.inside).any()
    assert shares[0] > 0.5
    assert shares[0] > shares[1] > shares[2] > 0.02
    # The back of the head is not seen from the front, though it lies at the same pixels.
    assert shares[3] < 0.01


@pytest.mark.slow  # only for comparisons; trains a head
def test_registered_colors_are_those_of_the_same_place(scene):
    """With the frontal render itself as its painting, a turned view gets its own colors."""
    task, reference = scene
    mirror = replace(reference, example=reference.content)
    view = turned(task, 25.0)
    registered(view, mirror)
    known = view.trust > 0
    same = np.abs(view.example - view.content)[known].mean()
    spread = np.abs(view.content[known] - view.content[known].mean(0)).mean()
    assert same < 0.4 * spread


@pytest.mark.slow  # only for comparisons; trains a head
def test_outlines_are_dropped(scene):
    _, reference = scene
    steady = steady_places(reference)
    assert 0 < steady.sum() < reference.inside.sum()
    assert not (steady & ~reference.inside).any()


@pytest.fixture(scope="module")
def stylised(small_head):
    """The head and its figures."""
    return stylize_with_figures(*small_head, SMALL, device="cpu")


@pytest.mark.slow  # only for comparisons; its steps are above
def test_a_head_in_the_manner_of_one_painted_view(small_head, stylised):
    field, capture, exemplar = small_head
    styled, figures = stylised
    assert np.array_equal(styled.density, field.density)
    assert figures["fit"]["rmse"][-1] < figures["fit"]["rmse"][0]
    assert 0.05 < figures["registered_share"] < 0.9
    before, after = (figures["refinement"][k]["losses"] for k in ("before", "after"))
    assert after["color"] < before["color"]
    assert np.abs(styled.sh[..., 0] - field.sh[..., 0]).mean() > 0.1
    # The frontal view shows the painting more than the photo.
    view = painted_view(FieldTask(field, capture, exemplar), 96)
    shown = styled.render(view.camera, 0).color
    painted, real = (np.abs(shown - picture)[view.inside].mean()
                     for picture in (view.example, view.content))
    assert painted < 0.6 * real
    again, _ = stylize_with_figures(field, capture, exemplar, SMALL)
    assert np.array_equal(again.sh, styled.sh)


@pytest.mark.slow  # tests/stylize/test_stylize.py computes elsewhere, too
def test_ref_npr_on_another_device_gives_the_same(small_head, stylised, other_device):
    here, there = stylised, stylize_with_figures(*small_head, SMALL, device=other_device)
    assert (here[1]["device"], there[1]["device"]) == ("cpu", "gpu: Other 9 (Test)")
    assert np.allclose(here[0].sh, there[0].sh, atol=1e-5)


def test_the_deep_network_has_one_map_of_stride_16():
    random = torch.Generator().manual_seed(0)
    widths = {"1": 16, "2": 32, "3": 64, "4": 128, "5": 128}
    weights, before = {"conv0.weight": torch.eye(3)[:, :, None, None],
                       "conv0.bias": torch.zeros(3)}, 3
    for name in (*ENCODER, "42", "43", "44", "51"):
        after = widths[name[0]]
        weights[f"conv{name[0]}_{name[1]}.weight"] = 0.1 * torch.randn(after, before, 3, 3,
                                                                       generator=random)
        weights[f"conv{name[0]}_{name[1]}.bias"] = torch.zeros(after)
        before = after
    maps = _vgg19_se_deep(weights)(torch.rand(1, 3, 64, 96))
    assert [tuple(values.shape) for values in maps] == [(1, 128, 4, 6)]


@pytest.mark.data
def test_the_deep_network_has_weights(shared_weights, monkeypatch):
    monkeypatch.setenv("LFPORTRAIT_MODELS", str(shared_weights))
    values, = load_network("vgg19-se-deep")(torch.rand(1, 3, 64, 96))
    assert values.shape == (1, 128, 4, 6)
    assert float(values.max()) > 0


@pytest.mark.slow  # only for comparisons; trains a head
@pytest.mark.parametrize(("change", "message"), [
    ({"size": 20}, "at least 64 pixels"), ({"steps": -1}, "negative")])
def test_wrong_parameters_are_told(small_head, change, message):
    with pytest.raises(UserError, match=message):
        stylize_with_figures(*small_head,
                             SMALL.with_section(replace(SMALL.parameters[0], **change)))


@pytest.mark.slow  # only for comparisons; trains a head
def test_a_capture_without_landmarks_is_told(small_head):
    field, capture, exemplar = small_head
    with pytest.raises(UserError, match="landmarks"):
        stylize_with_figures(field, replace(capture, landmarks=None), exemplar, SMALL)
