"""All figures of a job, on a tiny one."""

import numpy as np
import pytest

from lfportrait import models
from lfportrait.errors import UserError
from lfportrait.example import Exemplar
from lfportrait.field import VoxelField
from lfportrait_eval.metrics import (
    PatchIndex,
    RowLabels,
    arc_cameras,
    evaluate_field,
    evaluate_job,
    job,
    views_fidelity,
)
from tests.lfportrait_eval.bench.test_bench import ball_capture
from tests.portraits import drawn_face
from tests.share.test_video import ball


def painted(field: VoxelField) -> VoxelField:
    """The field with matt colors that vary over its surface."""
    points = field.lattice_points()
    return field.with_sh(np.float32(np.sin(7 * points)[..., None] * 1.2))


@pytest.fixture
def no_models(monkeypatch):
    monkeypatch.setattr(models, "available", lambda name: False)


def exemplar() -> Exemplar:
    generator = np.random.default_rng(0)
    points = 30 + 40 * generator.random((68, 2))
    return Exemplar(generator.integers(0, 256, (100, 100, 3), dtype=np.uint8), points)


@pytest.mark.slow  # only for comparisons
def test_a_matt_field_is_consistent_and_the_style_is_measured(no_models):
    field = ball()
    figures = evaluate_field(field, painted(field), exemplar(), views=9, size=96)
    rows = figures["consistency"]
    assert set(rows) == {"gap_1", "gap_7", "extremes"}
    # One field seen from all sides: what is left is resampling.
    assert rows["gap_1"]["normalised"] < 0.25 and rows["gap_1"]["valid"] > 0.5
    assert figures["content"]["feature_distance"] > 0.01
    assert -1 <= figures["contours"]["gradient_correlation"] <= 1
    assert figures["style"]["patch_fidelity"] > 1
    assert "identity" not in figures and "fid_64" not in figures["style"]


def test_an_unstylised_field_equals_its_floor(no_models):
    field = ball()
    figures = evaluate_field(field, field, views=3, size=64)
    for row in figures["consistency"].values():
        assert row["rmse"] == pytest.approx(row["floor_rmse"])
    assert figures["content"]["feature_distance"] == pytest.approx(0, abs=1e-6)
    assert figures["contours"]["gradient_correlation"] == pytest.approx(1)
    assert "style" not in figures


def test_lpips_is_measured_where_its_networks_are(no_models, monkeypatch):
    field = ball()
    assert "lpips" not in evaluate_field(field, field, views=3, size=48)["content"]
    monkeypatch.setattr(models, "missing", lambda names: [])
    monkeypatch.setattr(job, "lpips", lambda a, b, device: float(np.abs(a - b).max()) + 0.25)
    assert evaluate_field(field, field, views=3, size=48)["content"]["lpips"] == 0.25


def test_what_can_not_be_measured_is_none(no_models):
    field = ball()
    flat = field.with_sh(np.zeros_like(field.sh))
    figures = evaluate_field(flat, flat, views=2, size=48)
    assert figures["consistency"]["gap_1"]["normalised"] is None
    assert figures["consistency"]["gap_1"]["rmse"] < 1 / 255


def test_a_job_folder_is_measured_whole(tmp_path, no_models):
    field = ball()
    ball_capture().save(tmp_path / "capture")
    field.save(tmp_path / "field.npz")
    painted(field).save(tmp_path / "styled.npz")
    figures = evaluate_job(tmp_path, views=3, size=48)
    assert figures["test"]["views"] == 2 and figures["test"]["psnr"] > 20
    assert "gap_1" in figures["consistency"]


def test_what_is_no_job_is_told(tmp_path):
    with pytest.raises(UserError, match="not a finished job: it has no capture"):
        evaluate_job(tmp_path)


def test_paint_is_measured_where_its_regions_and_the_painting_are_known(no_models):
    field = ball()
    styled = painted(field)
    options = {"views": 3, "size": 48, "close": 96}
    assert evaluate_field(field, styled, exemplar(), **options)["repeats"] is None
    labels = RowLabels(np.full((len(field.density), 1), 255, np.uint8), ("hair",))
    figures = evaluate_field(field, styled, drawn_face(120, 90), labels=labels,
                             wanted=lambda cameras, view: styled.render(cameras, view).color,
                             **options)
    assert set(figures["repeats"]) == {"hair"}
    assert set(figures["repeats"]["hair"]["views"]) == {"-20", "0", "20", "90", "180"}
    assert 0 <= figures["repeats"]["hair"]["ratio"] < 10
    assert figures["sharpness"] == pytest.approx({"-20": 1, "0": 1, "20": 1, "mean": 1})
    nothing = np.full((96, 96, 3), np.nan)
    assert evaluate_field(field, styled, wanted=lambda cameras, view: nothing,
                          **options)["sharpness"]["mean"] is None


def test_views_painted_with_the_exemplar_itself_are_faithful():
    field = ball()
    shots = [painted(field).render(arc_cameras(field, [yaw], 48)).color for yaw in (0.0, 45.0)]
    same = PatchIndex(np.clip(np.concatenate(shots), 0, 1))
    noise = PatchIndex(np.random.default_rng(0).random((32, 32, 3)))
    assert views_fidelity(painted(field), same, size=48) < 0.1
    assert views_fidelity(painted(field), noise, size=48) > 5
