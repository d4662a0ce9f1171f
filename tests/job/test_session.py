"""A session keeps what styles share, and gives what a stylisation gives."""

import os
from dataclasses import replace

import numpy as np
import pytest

import lfportrait as lf
from lfportrait.errors import UserError
from lfportrait.example import Exemplar
from lfportrait.example.skin.painting import SkinPainter
from lfportrait.files import write_image
from lfportrait.job import Session
from lfportrait.stylize import stylization as module
from lfportrait.stylize import stylize_with_figures
from tests.stylize.test_on_skin import PREVIEW, SMALL, capture, head, skin, violet  # noqa: F401


@pytest.fixture
def session(head, capture, skin):  # noqa: F811
    """One whose head's skin is known: to find it takes as long as to paint it."""
    found = Session(head, capture, SMALL)
    found._skins[SMALL.pixels] = skin
    return found


@pytest.fixture
def made(monkeypatch):
    """What each new painter was prepared for."""
    every = []

    class Counted(SkinPainter):
        def __init__(self, *given):
            every.append(given)
            super().__init__(*given)

    monkeypatch.setattr(module, "SkinPainter", Counted)
    return every


@pytest.mark.slow  # whole stylisations; what a session keeps: below
def test_what_it_gives_is_what_a_stylisation_gives(head, capture, violet):  # noqa: F811
    session = Session(head, capture, SMALL)
    styled = session.stylize(violet)
    alone, _ = stylize_with_figures(head, capture, violet, SMALL)
    assert np.array_equal(styled.sh, alone.sh) and session.shown is styled
    quick = session.preview(violet)
    alone, _ = stylize_with_figures(head, capture, violet, PREVIEW, skin=session.skin(
        PREVIEW.pixels))
    assert np.array_equal(quick.sh, alone.sh)
    assert session.figures["method"] == "skin"


def test_painters_and_surface_are_made_once(head, capture, violet, made):  # noqa: F811
    session = Session(head, capture, SMALL)
    found = session.skin(PREVIEW.pixels)
    session.preview(violet)
    session.preview(violet)
    assert len(made) == 1 and session.skin(PREVIEW.pixels) is found
    session.preview(violet, replace(SMALL, seed=1))
    assert len(made) == 2


@pytest.mark.slow  # painters that are kept: above
def test_what_is_tried_is_painted_by_landmarks_close_by(session, violet, made):  # noqa: F811
    def tried(point, way):
        landmarks = violet.landmarks + (np.arange(68) == point)[:, None] * np.multiply(
            way, violet.size)
        return session.preview(replace(violet, image=violet.image.copy(), landmarks=landmarks),
                               keep=False)

    first = tried(30, [0, 0])
    moved = tried(30, [0.1, 0])
    assert len(made) == 1 and not np.array_equal(first.sh, moved.sh)
    assert np.array_equal(tried(30, [0, 0]).sh, first.sh)
    tried(37, [0, 0.1])
    assert len(made) == 2, "an eye is painted over"
    tried(37, [0, 0.11])
    assert len(made) == 2
    session.preview(violet)
    assert len(made) == 3, "what is kept is exact"
    tried(30, [0.1, 0])
    assert len(made) == 3, "and serves, too"


@pytest.mark.slow  # whole stylisations; previews: above
def test_what_is_tried_in_full_is_exact(session, violet, made):  # noqa: F811
    unrefined = replace(SMALL, steps=0)
    session.stylize(violet, unrefined)
    nose = violet.landmarks + (np.arange(68) == 30)[:, None] * [0.1 * violet.size, 0]
    session.stylize(replace(violet, landmarks=nose), unrefined, keep=False)
    assert len(made) == 2


@pytest.mark.slow  # paints once more; mixes: tests/stylize/test_mixing.py
def test_mixtures_and_light_fields(session, violet):  # noqa: F811
    with pytest.raises(UserError, match="nothing is stylised"):
        session.mix(strength=0.5)
    first = session.preview(violet)
    half = session.mix(strength=0.5, regions={"hair": 0})
    assert session.shown is half and not np.array_equal(half.sh, first.sh)
    panel = lf.Display(width=60, height=40, views=12, pitch=7.3, slant=0.16, offset=2.1,
                       subpixels="RGB", cone=40.0)
    assert session.encode(panel).shape == (40, 60, 3)


def test_files_are_read_and_paintings_again_when_they_change(head, capture,  # noqa: F811
                                                             violet, tmp_path):  # noqa: F811
    head.save(tmp_path / "field.npz")
    capture.save(tmp_path / "capture")
    session = lf.Session(tmp_path / "field.npz", tmp_path / "capture", SMALL)
    session.preview(violet)
    assert (tmp_path / "field.skin.npz").is_file()
    painting = tmp_path / "a.png"
    write_image(painting, violet.image)
    np.savetxt(tmp_path / "a.landmarks.txt", violet.landmarks)
    first = session.exemplar(painting)
    assert isinstance(first, Exemplar) and session.exemplar(painting) is first
    write_image(painting, violet.image[..., ::-1].copy())
    os.utime(painting, (1, 1))
    assert not np.array_equal(session.exemplar(painting).image, first.image)
    with pytest.raises(UserError, match="no facial landmarks"):
        Session(head, replace(capture, landmarks=None))
