"""Whether strokes stick: what is painted on the surface does, what each view paints does not."""

import numpy as np
import pytest

from lfportrait.example import Exemplar
from lfportrait_eval.metrics.strokes import strokes_stick, strokes_table
from tests.fields import head_field
from tests.portraits import HEAD_LANDMARKS, drawn_face


@pytest.fixture(scope="module")
def figures():
    """Of an exemplar whose strokes are noise; the stylised field is the head itself."""
    face = drawn_face(200, 160, skin=(120, 90, 200))
    noise = np.random.default_rng(0).integers(-60, 60, face.image.shape)
    image = np.uint8(np.clip(face.image + noise, 0, 255))
    head = head_field()
    return strokes_stick(head, HEAD_LANDMARKS, Exemplar(image, face.landmarks, "noise", face.mask),
                         angles=(0.0, 20.0), gap=2.0, size=96, distance=4.0, styled=head,
                         detect=lambda _: None, pixels=60.0)


def test_what_lies_on_the_surface_sticks(figures):
    assert figures["skin"]["mean"] < figures["per_view"]["mean"]
    assert figures["anchored"]["mean"] < figures["per_view"]["mean"]
    assert figures["skin_ratio"] == figures["skin"]["mean"] / figures["per_view"]["mean"]
    for row in ("skin", "per_view"):
        assert figures[row]["mean"] == pytest.approx(np.mean([figures[row]["0"],
                                                              figures[row]["20"]]))


def test_renderings_of_a_stylised_field_are_measured(figures):
    assert figures["rendered"] == figures["floor"]
    assert 0 < figures["rendered_ratio"] < 0.2
    table = strokes_table({"noise": figures}).splitlines()
    assert len(table) == 2 and table[1].startswith("noise")
    assert f"{figures['rendered_ratio']:.3f}" in table[1]


def test_what_is_not_found_is_no_figure(figures):
    assert np.isnan(figures["detected"]["mean"])
    without = {way: row for way, row in figures.items() if not way.startswith("rendered")}
    assert "nan" in strokes_table({"noise": without}).splitlines()[1]
