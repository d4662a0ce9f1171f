"""ARF: its color match, its descent, and a small head from start to end."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from lfportrait.errors import UserError
from lfportrait.field import C0
from lfportrait.stylize import FieldTask, StylizeConfig, stylize_with_figures
from lfportrait.stylize.losses import total_variation
from lfportrait_eval.baselines.config import ArfConfig
from lfportrait_eval.baselines.field.arf import ColorMap
from lfportrait_eval.baselines.field.photo_views import (
    following_rows,
    photo_views,
    total_variation_slope,
)
from lfportrait_eval.baselines.kernels import rmsprop_step
from tests.fields import shell_field

SMALL = StylizeConfig(method="arf", parameters=(
    ArfConfig(size=96, views=4, steps=12, network="embedded"),))


def test_matched_colors_have_the_paintings_mean_and_covariance():
    random = np.random.default_rng(0)
    source = 0.4 + 0.05 * random.standard_normal((5000, 3)).astype(np.float32)
    mixing = np.array([[1.0, 0.4, 0.0], [0.0, 0.7, 0.3], [0.2, 0.0, 0.5]])
    target = 0.55 + 0.05 * random.standard_normal((4000, 3)) @ mixing
    moved = ColorMap.between(source, target).colors(source)
    assert np.allclose(moved.mean(0), target.mean(0), atol=1e-4)
    assert np.allclose(np.cov(moved.T), np.cov(target.T), atol=1e-5)


def test_a_map_of_colors_leaves_the_background():
    change = ColorMap(0.5 * np.eye(3), np.array([0.1, 0.2, 0.3]))
    alpha = np.array([[0.0, 0.5, 1.0]], np.float32)
    color = np.array([0.2, 0.4, 0.6], np.float32)
    picture = alpha[..., None] * color + (1 - alpha[..., None]) * np.float32(0.9)
    moved = change.picture(picture, alpha, 0.9)
    assert np.allclose(moved[0, 0], 0.9)
    assert np.allclose(moved[0, 2], 0.5 * color + (0.1, 0.2, 0.3), atol=1e-6)
    assert np.allclose(moved[0, 1], 0.5 * (moved[0, 0] + moved[0, 2]), atol=1e-6)


def test_rmsprop_equals_its_formula():
    random = np.random.default_rng(1)
    colors = random.uniform(0.3, 0.7, (7, 3)).astype(np.float32)
    wanted, square, known = colors.copy(), np.zeros_like(colors), np.zeros((7, 3))
    for _ in range(4):
        slope = random.standard_normal((3, 7)).astype(np.float32)
        slope[1, 2] = 0
        squared = slope.T.astype(float) ** 2
        fresh = np.where(known == 0, squared, 0.95 * known + 0.05 * squared)
        touched = slope.T != 0
        known[touched] = fresh[touched]
        wanted = wanted - np.where(touched, 0.01 * slope.T / np.sqrt(np.maximum(known, 1e-30)), 0)
        rmsprop_step(colors, slope, square, np.float32(0.01))
        assert not slope.any()
    assert np.allclose(colors, np.clip(wanted, 0, 1), atol=1e-5)


def test_the_slope_of_the_voxels_variation_equals_torch():
    field = shell_field(size=10, basis=1)
    count = len(field.density)
    following = following_rows(field.links, count)
    colors = np.random.default_rng(2).random((count, 3), np.float32)
    rows = np.arange(0, count, 3)
    gradient = np.zeros((3, count), np.float32)
    total_variation_slope(colors, following, np.ones(3), rows, 0.7, gradient)
    parameter = torch.tensor(colors.astype(np.float64), requires_grad=True)
    ahead = parameter[torch.from_numpy(following[rows].astype(np.int64))]
    change = (ahead - parameter[rows][:, None]) / C0
    (0.7 * (1e-9 + change.square().sum(1)).sqrt().sum() / len(rows)).backward()
    assert np.allclose(gradient.T, parameter.grad.numpy(), atol=1e-6)


def test_neighbours_along_x_y_and_z():
    links = np.full((2, 2, 3), -1, np.int32)
    links[0, 0, 0], links[0, 0, 1], links[0, 1, 0], links[1, 0, 0] = 0, 1, 2, 3
    assert following_rows(links, 4).tolist() == [[1, 2, 3], [1, 1, 1], [2, 2, 2], [3, 3, 3]]


def test_the_variation_of_a_ramp():
    ramp = torch.arange(6.0).expand(1, 3, 4, 6)
    assert float(total_variation(ramp)) == pytest.approx(0.5)


@pytest.mark.slow  # only for comparisons; trains a head
def test_photos_are_cropped_to_the_head(small_head):
    field, capture, exemplar = small_head
    views = photo_views(FieldTask(field, capture, exemplar), 96, 5)
    assert len(views) == 5
    for view in views:
        assert max(view.shape) in (80, 96)
        assert all(side % 16 == 0 for side in view.shape)
        # The photo lies where the field's render does.
        render = field.render(view.camera, 0).color
        assert np.abs(render - view.content)[view.inside].mean() < 0.06


@pytest.fixture(scope="module")
def stylised(small_head):
    """The head and its figures."""
    return stylize_with_figures(*small_head, SMALL, device="cpu")


@pytest.mark.slow  # only for comparisons; its steps are above
def test_a_head_in_arfs_manner(small_head, stylised):
    field, capture, exemplar = small_head
    styled, figures = stylised
    assert figures["method"] == "arf"
    assert np.array_equal(styled.density, field.density)
    assert figures["fit"]["rmse"][-1] < figures["fit"]["rmse"][0]
    before, after = (figures["refinement"][k]["losses"] for k in ("before", "after"))
    assert figures["refinement"]["networks"]["features"] in ("vgg16", "embedded")
    assert after["style"] < before["style"]
    assert np.abs(styled.sh[..., 0] - field.sh[..., 0]).mean() > 0.1
    again, _ = stylize_with_figures(field, capture, exemplar, SMALL)
    assert np.array_equal(again.sh, styled.sh)


@pytest.mark.slow  # tests/stylize/test_stylize.py computes elsewhere, too
def test_arf_on_another_device_gives_the_same(small_head, stylised, other_device):
    here, there = stylised, stylize_with_figures(*small_head, SMALL, device=other_device)
    assert (here[1]["device"], there[1]["device"]) == ("cpu", "gpu: Other 9 (Test)")
    assert np.allclose(here[0].sh, there[0].sh, atol=1e-5)


@pytest.mark.slow  # only for comparisons
def test_arf_needs_no_landmarks_and_writes_its_views(small_head, tmp_path):
    field, capture, exemplar = small_head
    quick = SMALL.with_section(replace(SMALL.parameters[0], steps=1))
    stylize_with_figures(field, replace(capture, landmarks=None), exemplar, quick, dump=tmp_path)
    assert list(tmp_path.glob("view_*.png"))


@pytest.mark.slow  # only for comparisons; trains a head
@pytest.mark.parametrize(("change", "message"), [
    ({"size": 20}, "at least 64 pixels"), ({"views": 0}, "at least one view"),
    ({"steps": -1}, "negative")])
def test_wrong_parameters_are_told(small_head, change, message):
    field, capture, exemplar = small_head
    with pytest.raises(UserError, match=message):
        stylize_with_figures(field, capture, exemplar,
                             SMALL.with_section(replace(SMALL.parameters[0], **change)))


@pytest.mark.slow  # only for comparisons; trains a head
def test_a_capture_of_something_else_is_told(small_head):
    field, capture, exemplar = small_head
    away = np.eye(4)
    away[0, 3] = 50.0
    elsewhere = replace(capture, cameras=capture.cameras.transformed(away))
    with pytest.raises(UserError, match="another capture"):
        stylize_with_figures(field, elsewhere, exemplar, SMALL)
