"""Pages and sweeps of a head from one photo, in a batch, go no further than it is good."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from lfportrait.cache import StageFolder
from lfportrait.job import Task, Tools, do_stage
from lfportrait.job.graph import MakeConfig
from lfportrait.lightfield import Display
from lfportrait.share import PageConfig
from lfportrait.stylize import StyledField
from tests.fields import head_field

PANEL = Display(128, 96, views=16, pitch=7.3, slant=0.15, cone=56, name="tiny")


@pytest.fixture
def done(tmp_path, monkeypatch):
    """Does a task of a styled head; what a video was filmed with."""
    real = replace(head_field(16), cone=40.0)
    count = len(real.density)
    gray = np.full((count, 3), 0.5)
    styled = StyledField.of(real, gray[None], ["ink"], gray, np.zeros((count, 1), np.uint8),
                            ["hair"])
    (tmp_path / "anna" / "ink").mkdir(parents=True)
    styled.save(tmp_path / "anna/ink/styled.npz")
    filmed = []
    monkeypatch.setattr("lfportrait.job.work.sweep_frames",
                        lambda field, cone, *_, **__: filmed.append(cone) or [])
    monkeypatch.setattr("lfportrait.job.work.write_video", lambda *_: None)

    def do(stage, output, config, display=None):
        task = Task(f"anna/ink/{stage}", stage, "anna/ink", (output,), "k", (), config, 0,
                    {"styled": "anna/ink/styled.npz"}, display=display)
        do_stage(task, tmp_path, StageFolder(tmp_path / "anna/ink"), Tools())
        return tmp_path / "anna/ink" / output
    return do, filmed


def test_a_batchs_sweep_keeps_to_the_cone(done):
    do, filmed = done
    do("sweep", "sweep.mp4", MakeConfig(), PANEL)
    do("sweep", "sweep.mp4", MakeConfig(), replace(PANEL, cone=30))
    assert filmed == [40.0, 30.0]


# One that is asked for, and none.
@pytest.mark.parametrize("cone, limit", [
    (0.0, 20.0), pytest.param(60.0, 30.0, marks=pytest.mark.slow), (360.0, None)])
def test_a_batchs_page_keeps_to_the_cone_unless_another_is_asked_for(done, cone, limit):
    page = done[0]("page", "portrait.html", MakeConfig(page=PageConfig(cone=cone)))
    header = json.loads(re.search(r'id="portrait">(.*?)</script>', page.read_text())[1])
    found = header["start"].get("limit")
    assert found is None if limit is None else np.degrees(found) == pytest.approx(limit)
