"""Regions by the labels of rows, and repeats of paint in them, on a ball."""

import numpy as np
import pytest
from scipy import ndimage

from lfportrait.field import VoxelField
from lfportrait_eval.metrics import (
    RowLabels,
    arc_cameras,
    exemplar_regions,
    face_unit,
    head_cameras,
    region_repeats,
)
from tests.portraits import HEAD_LANDMARKS, drawn_face
from tests.share.test_video import ball

LABELS = ("skin", "hair", "body", "background")


def halves(field: VoxelField) -> RowLabels:
    """Hair above, body below."""
    up = field.lattice_points()[:, 1] > 0
    weights = np.zeros((len(up), len(LABELS)), np.uint8)
    weights[up, 1] = weights[~up, 2] = 255
    return RowLabels(weights, LABELS)


def painted(field: VoxelField, period: float | None) -> VoxelField:
    """Noise in space; with a period, that of a tile that comes again beside and above itself."""
    points, generator = field.lattice_points(), np.random.default_rng(0)
    if period is None:
        noise = ndimage.gaussian_filter(generator.standard_normal((96, 96, 96)), 2.0)
        values = ndimage.map_coordinates(noise, 47.5 * (points.T + 1), order=1)
    else:
        tile = ndimage.gaussian_filter(generator.standard_normal((32, 32)), 3.0, mode="wrap")
        values = ndimage.map_coordinates(tile, 32 / period * points.T[:2], order=1,
                                         mode="grid-wrap")
    return field.with_sh(np.repeat(0.6 * values[:, None, None] / values.std(), 3, axis=1))


def test_labels_are_seen_as_masks_from_all_sides():
    field = ball()
    cameras = arc_cameras(field, [0.0, 90.0, 180.0], 80)
    for masks in halves(field).masks(field, cameras, ("hair", "body", "beard")):
        assert set(masks) == {"hair", "body"}
        assert masks["hair"][20:34, 30:50].all() and not masks["hair"][44:].any()
        assert masks["body"][46:60, 30:50].all() and not masks["body"][:36].any()
    many = halves(field).masks(field, cameras, LABELS)
    assert set(many[0]) == set(LABELS) and not many[0]["background"].any()
    assert (many[1]["hair"] == masks["hair"]).mean() > 0.99
    smaller = halves(field).masks(field, cameras, ("hair",), margin=4.0)[0]["hair"]
    assert smaller.sum() < many[0]["hair"].sum() and smaller[24:32, 35:45].all()
    with pytest.raises(ValueError, match="not those of a field"):
        RowLabels(np.zeros((3, 1), np.uint8), ("hair",)).masks(field, cameras, ("hair",))


def test_labels_of_a_field_and_of_its_file(tmp_path):
    field = ball()
    assert RowLabels.of(field) is None
    labels = halves(field)
    field.labels, field.regions = labels.weights, list(labels.names)
    assert RowLabels.of(field).names == LABELS
    field.save(tmp_path / "plain.npz")
    assert RowLabels.read(tmp_path / "plain.npz") is None
    np.savez(tmp_path / "styled.npz", labels=labels.weights, region_names=np.array(LABELS))
    found = RowLabels.read(tmp_path / "styled.npz")
    assert found.names == LABELS and (found.weights == labels.weights).all()


def test_the_exemplar_comes_at_the_scale_of_the_view():
    exemplar = drawn_face(200, 150)
    picture, masks = exemplar_regions(exemplar, exemplar.size / 2, ("hair", "body", "beard"))
    assert picture.shape == (100, 75, 3) and set(masks) == {"hair", "body"}
    reddish = picture[masks["body"]].mean(axis=0)
    assert reddish[0] > 1.5 * reddish[1] and masks["body"].sum() > 500
    _, smaller = exemplar_regions(exemplar, exemplar.size / 2, ("body",), margin=3.0)
    assert 0 < smaller["body"].sum() < masks["body"].sum()


def test_the_size_of_a_face_is_that_of_its_landmarks():
    field = ball()
    half, whole = (face_unit(field, size, HEAD_LANDMARKS) for size in (200, 400))
    assert whole == pytest.approx(2 * half)
    assert face_unit(field, 400) == pytest.approx(0.145 * 400)
    # Close up, brows and chin are as far apart as the picture's height over 2.3.
    pixels = head_cameras(HEAD_LANDMARKS, [0.0], 230).project(HEAD_LANDMARKS)[0][0]
    assert np.ptp([pixels[17:27, 1].mean(), pixels[:, 1].max()]) == pytest.approx(100, abs=12)


def test_paint_in_rows_repeats_and_other_paint_does_not():
    field, exemplar = ball(resolution=56), drawn_face(200, 150)
    labels = halves(field)
    options = {"size": 192, "degrees": (0.0, 180.0)}
    rows = region_repeats(painted(field, 0.3), exemplar, labels, **options)
    other = region_repeats(painted(field, None), exemplar, labels, **options)
    for name in ("hair", "body"):
        assert set(rows[name]["views"]) == {"0", "180"}
        assert min(rows[name]["views"].values()) > 0.6 and rows[name]["ratio"] > 1.8, rows
        assert max(other[name]["views"].values()) < 0.5 and other[name]["ratio"] < 1.4, other
    # A region too small to tell is left open.
    field_labels = RowLabels(np.zeros_like(labels.weights), LABELS)
    empty = region_repeats(painted(field, None), exemplar, field_labels, **options)
    assert np.isnan(empty["hair"]["ratio"]) and np.isnan(empty["hair"]["views"]["0"])


def test_neck_and_clothes_are_the_body():
    from types import SimpleNamespace

    weights = np.array([[255, 0, 0], [10, 120, 100], [0, 200, 100]], np.uint8)
    labels = RowLabels.of(SimpleNamespace(labels=weights, regions=("hair", "neck", "clothes")))
    assert labels.names == ("hair", "neck", "clothes", "body")
    assert labels.weights[:, 3].tolist() == [0, 220, 255]
    named = RowLabels.of(SimpleNamespace(labels=weights, regions=("hair", "body", "skin")))
    assert named.names == ("hair", "body", "skin") and named.weights is weights
    assert RowLabels.of(SimpleNamespace()) is None
