"""The painting that was chosen is seen on the head while that is still being made."""

import numpy as np
import pytest
from PIL import Image

pytest.importorskip("starlette")

from lfportrait.job.warmup import ball_capture, ball_field, drawn_exemplar
from lfportrait.progress import Progress
from lfportrait.studio.jobs import Order
from lfportrait.studio.projects import Project
from lfportrait.studio.work.pictures import EarlyPicture, Teller


@pytest.fixture
def painting(tmp_path):
    """A small painting's file, with its landmarks beside it."""
    drawn = drawn_exemplar()
    path = tmp_path / "drawn.png"
    Image.fromarray(drawn.image).save(path)
    np.savetxt(path.with_suffix(".landmarks.txt"), drawn.landmarks)
    return str(path)


class Early:
    """A look of a project's, and what it tells."""

    def __init__(self, folder):
        self.project, self.told = Project(folder), []
        order = Order("head", folder / "pictures", folder=folder,
                      options={"parameters": {"stylize.pixels": 64.0}})
        self.look = EarlyPicture(order, Teller(lambda *message: self.told.append(message),
                                               order.pictures))

    def offer(self):
        """Offer it a field, a second after the last time; whether it took it."""
        taken = []
        self.look._asked -= 1.0
        self.look.offer(Progress("", enabled=False), ball_capture(),
                        lambda: taken.append(1) or ball_field(1))
        return bool(taken)


@pytest.mark.slow  # paints a head
def test_the_look_is_the_picture_of_the_stage_to_come(tmp_path, painting):
    early = Early(tmp_path)
    assert not early.offer() and not early.look.over, "no painting is chosen yet"
    early.project.change(painting=painting)
    assert early.offer() and not early.offer()
    assert early.told == [("picture", "surface"), ("page", "surface")]
    assert early.look.figures["seconds"] > 0
    page = (tmp_path / "pictures/surface.html").read_bytes()
    assert b"data-stream" in page and len(page) < 2e6
    picture = np.asarray(Image.open(tmp_path / "pictures/surface.jpg"), float)
    head = picture[140:180, 460:500].mean(axis=(0, 1))
    assert head.max() - head.min() > 20, "the ball is grey, the painting is not"


def test_with_a_painting_that_is_gone_the_job_goes_on(tmp_path):
    early = Early(tmp_path)
    early.project.change(painting=str(tmp_path / "gone.png"))
    assert not early.offer()
    assert early.look.over and not early.look.figures and not early.told
