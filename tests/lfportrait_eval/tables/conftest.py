"""A small sitter of known truth, and styles, for the tables' tests."""

from pathlib import Path

import numpy as np
import pytest

from lfportrait.capture import Capture
from lfportrait.example import Exemplar
from lfportrait.field import VoxelField
from lfportrait.files import write_image
from lfportrait_eval.tables import Sitter
from tests.fields import head_field
from tests.lfportrait_eval.bench.test_bench import ball_capture
from tests.portraits import HEAD_LANDMARKS, drawn_face


@pytest.fixture(autouse=True)
def no_networks(monkeypatch, tmp_path):
    """No pretrained networks, so that no figure depends on the machine."""
    monkeypatch.delenv("LFPORTRAIT_MODELS", raising=False)
    monkeypatch.setattr("lfportrait.models.cache_folder", lambda: tmp_path / "models")


def head_capture(field: VoxelField) -> Capture:
    """Photos of a field, and its landmarks."""
    from dataclasses import replace

    capture = ball_capture(size=48, views=40)
    shots = [field.render(capture.cameras, view) for view in range(len(capture))]
    return replace(capture, landmarks=HEAD_LANDMARKS, images=[
        np.uint8(255 * np.clip(shot.color, 0, 1) + 0.5) for shot in shots],
        alphas=[np.uint8(255 * shot.alpha + 0.5) for shot in shots])


@pytest.fixture(scope="session")
def head() -> tuple[VoxelField, Capture]:
    """The head of `head_field` and its capture."""
    field = head_field()
    return field, head_capture(field)


@pytest.fixture
def sitter(head, tmp_path) -> Sitter:
    """The head as a sitter, in views of 64 pixels."""
    field, capture = head
    field.save(tmp_path / "head.npz")
    return Sitter("head", field, capture, tmp_path / "head.npz", pixels=40.0,
                  arc=(30.0, 9, 64), close_size=64)


@pytest.fixture(scope="session")
def files(tmp_path_factory, head) -> Path:
    """The head's field and capture, and two styles, as files."""
    folder = tmp_path_factory.mktemp("tables")
    field, capture = head
    field.save(folder / "head.npz")
    capture.save(folder / "head.cap")
    for name, skin in (("warm", (230, 180, 140)), ("cold", (150, 170, 220))):
        style = drawn_face(140, 110, skin=skin)
        write_image(folder / f"{name}.png", style.image)
        np.savetxt(folder / f"{name}.landmarks.txt", style.landmarks)
    return folder


@pytest.fixture(scope="session")
def style() -> Exemplar:
    """A drawn painting."""
    return drawn_face(140, 110)
