"""The figures of a cell against known answers; the consistency against a plain loop."""

import hashlib

import numpy as np
import pytest

from lfportrait import models
from lfportrait.capture import Camera
from lfportrait.models import ModelFile
from lfportrait.progress import Progress
from lfportrait_eval.tables import (
    Spread,
    Target,
    Views,
    agreement,
    measure,
    missing_networks,
    photo_agreement,
    photo_pairs,
    real_views,
    sources_of,
)
from lfportrait_eval.tables.documents import COLUMNS, GROUPS, best
from lfportrait_eval.tables.run import Teller
from tests.lfportrait_eval.metrics.test_features import random_alex


def flat(sitter, *grey: int) -> Views:
    """Views of one color each."""
    shape = sitter.arc.real[0].color.shape
    return Views([np.full(shape, grey[view % len(grey)], np.uint8)
                  for view in range(len(sitter.arc.real))],
                 [np.full(shot.color.shape, grey[0], np.uint8) for shot in sitter.close])


def test_views_of_one_color_agree(sitter):
    figures = agreement(flat(sitter, 120), sitter)
    assert figures["short_rmse"] == pytest.approx(0, abs=1e-6)
    assert figures["long_rmse"] == pytest.approx(0, abs=1e-6)
    assert figures["contrast"] == 0  # and this tells why


def test_views_that_change_by_a_shade_differ_by_it(sitter):
    figures = agreement(flat(sitter, 100, 151), sitter)
    assert figures["short_rmse"] == pytest.approx(51 / 255, rel=1e-5)
    assert figures["long_rmse"] == pytest.approx(51 / 255, rel=1e-5)
    assert figures["ends_rmse"] == pytest.approx(0, abs=1e-6)  # the first and the ninth are alike


def plain_rmse(pictures, sitter, first, second) -> float:
    """Error of one pair, pixel by pixel: lift, look up the nearest pixel, compare depths."""
    arc, errors = sitter.arc, []
    target, source = arc.real[first], arc.real[second]
    height, width = target.depth.shape
    for row in range(1, height - 1):
        for column in range(1, width - 1):
            around = target.depth[row - 1:row + 2, column - 1:column + 2]
            if not np.isfinite(around).all() or np.ptp(around) > 0.05:
                continue
            origin, direction = arc.cameras.rays(first, np.array([[column + 0.5, row + 0.5]]))
            along = target.depth[row, column] / (direction @ arc.cameras.pose[first, :3, 2])
            pixel, depth = arc.cameras[second].project(origin + along[:, None] * direction)
            x, y = np.floor(pixel[0, 0]).astype(int)
            if not (1 <= x < width - 1 and 1 <= y < height - 1):
                continue
            there = source.depth[y - 1:y + 2, x - 1:x + 2]
            if np.isfinite(there).all() and np.ptp(there) < 0.05 and abs(
                    source.depth[y, x] - depth[0, 0]) < 0.02:
                errors.append(pictures[first][row, column] - pictures[second][y, x])
    return float(np.sqrt(np.mean(np.square(errors))))


@pytest.mark.slow  # only for comparisons
def test_consistency_is_that_of_a_plain_loop(sitter):
    """Shades that grow with the view, over a ramp across the picture: large against resampling."""
    ramp = np.linspace(0, 120, 64)[None, :, None]
    pictures = [np.uint8(np.broadcast_to(ramp + 12 * view, (64, 64, 3))) for view in range(9)]
    figures = agreement(Views(pictures, real_views(sitter).close), sitter)
    floats = [picture / 255 for picture in pictures]
    for name, pairs in (("short", [(0, 1), (4, 5), (7, 8)]), ("long", [(0, 7), (1, 8)])):
        expected = np.mean([plain_rmse(floats, sitter, *pair) for pair in pairs])
        assert figures[f"{name}_rmse"] == pytest.approx(expected, rel=0.08)


def test_the_real_field_is_its_own_floor(sitter, style):
    real = real_views(sitter)
    figures = measure(real, Target(sitter, style, 4, 0), real)
    assert figures["contours"] == pytest.approx(1, abs=1e-3)
    assert figures["content"] == pytest.approx(0, abs=1e-4)
    assert figures["psnr_content"] > 50 and figures["ssim_content"] > 0.99
    assert "psnr_example" not in figures  # no reference for itself


def test_the_painting_itself_has_no_distance_to_its_patches(sitter, style):
    target = Target(sitter, style, 4, 0)
    side = sitter.close[0].color.shape[0]
    tiled = np.tile(target.picture, (3, 3, 1))[:side, :side]
    pasted = Views(real_views(sitter).arc, [tiled] * len(sitter.close))
    real = measure(real_views(sitter), target)
    assert measure(pasted, target)["patches"] < 0.4 * real["patches"]


def test_pairs_of_photos_are_about_as_far_apart_as_asked():
    cameras = Camera.arc(np.arange(0, 60, 4.0), distance=4.0, width=8, height=8, focal=8.0)
    pairs = photo_pairs(cameras, 8.0)
    assert pairs and len({view for pair in pairs for view in pair}) == 2 * len(pairs)
    assert all(abs(second - first) == 2 for first, second in pairs[:3])
    assert photo_pairs(cameras, 1.0) == []


def test_the_best_is_found_by_what_better_means():
    rows = {"a": {"patches": Spread(3, 0, 2), "contours": Spread(0.2, 0, 2),
                  "sharpness": Spread(1.4, 0, 2)},
            "b": {"patches": Spread(4, 0, 2), "contours": Spread(0.5, 0, 2),
                  "sharpness": Spread(0.9, 0, 2)},
            "few": {"patches": Spread(1, 0, 1)}}
    assert [best(rows, name, list(rows)) for name in ("patches", "contours", "sharpness")] == [
        "a", "b", "b"]
    assert best(rows, "contrast", list(rows)) is None
    assert all(name in COLUMNS for _, names in GROUPS.values() for name in names)


def test_a_spread_is_of_what_is_known():
    spread = Spread.of([1.0, None, 3.0, float("nan")])
    assert spread is not None and (spread.mean, spread.count) == (2.0, 2)
    assert spread.deviation == pytest.approx(np.sqrt(2))
    assert Spread.of([None]) is None


def test_words_of_the_command_line_are_sitters(files):
    cap, field = files / "head.cap", files / "head.npz"
    named, plain = sources_of((f"ann={cap}:{field}", str(cap)), ("", str(field)))
    assert (named.name, named.capture, named.field) == ("ann", cap, field)
    assert (plain.name, plain.field) == ("head", field)
    assert named.key() == plain.key() != sources_of((str(cap),))[0].key()


def test_the_time_left_is_that_of_the_methods(capsys):
    cells = [(sitter, "s", method) for sitter in "ab" for method in ("slow", "quick")]
    with Progress("tables") as progress:
        teller = Teller(progress, cells)
        assert teller.seconds_left() == 0
        teller.done(("a", "s", "slow"), 100.0)
        assert teller.seconds_left() == 300
        teller.done(("a", "s", "quick"), 10.0)
        assert teller.seconds_left() == 110
        teller.failed(("b", "s", "slow"), "no weights")
        assert teller.seconds_left() == 10
    lines = capsys.readouterr().err
    assert "a, s, quick: 10 s; 2 of 4, about 2 min left" in lines
    assert "b, s, slow: not measured: no weights; 3 of 4" in lines


@pytest.mark.slow  # only for comparisons
def test_lpips_joins_the_figures_where_its_weights_are(sitter, style, tmp_path, monkeypatch):
    folder = tmp_path / "models"
    folder.mkdir()
    random_alex(folder)
    for name, file in (("alexnet", "alexnet.pth"), ("lpips-alex", "alex.pth")):
        digest = hashlib.sha256((folder / file).read_bytes()).hexdigest()
        monkeypatch.setitem(models.REGISTRY, name, (ModelFile(file, digest, "", ""),))
    assert "lpips_alex" not in missing_networks() and "lpips_vgg" in missing_networks()
    changing = measure(flat(sitter, 100, 151), Target(sitter, style, 4, 0))
    assert changing["short_lpips_alex"] > 0.001
    assert agreement(flat(sitter, 120), sitter)["short_lpips_alex"] == pytest.approx(0, abs=1e-6)
    assert changing["lpips_alex_content"] > changing["short_lpips_alex"]
    photos = photo_agreement(sitter.field, sitter.capture, {"long": 24.0}, 64)
    assert 0 < photos["long_lpips_alex"] < changing["lpips_alex_content"]
