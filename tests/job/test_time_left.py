"""The time left that jobs show, told while the recorded steps of real ones are played back."""

import json
from pathlib import Path
from types import SimpleNamespace

import pytest

from lfportrait.job.graph import MakeConfig
from lfportrait.job.pipeline import Source, TimeLeft, usual_steps
from lfportrait.progress import Progress

RECORDED = json.loads((Path(__file__).parent / "recorded_steps.json").read_text("utf-8"))
"""Seconds of each step on two cores: of jobs by which the table was made, and of others."""
COUNTED = ("features in photo", "comparing photos", "comparing photos in full: pair",
           "placing photo", "cutting out the person", "refine")
SHARES = {"64^3": (0.0, 1 / 18), "128^3": (1 / 18, 6 / 18), "256^3": (6 / 18, 1.0)}
NARROW = {"128^3": (0.0, 5 / 17), "256^3": (5 / 17, 1.0)}


@pytest.fixture
def clock(monkeypatch):
    now = SimpleNamespace(now=0.0)
    fake = SimpleNamespace(perf_counter=lambda: now.now, process_time=lambda: now.now)
    monkeypatch.setattr("lfportrait.progress.time", fake)
    monkeypatch.setattr("lfportrait.job.pipeline.time", fake)
    return now


def tell(progress, name, share, narrow):
    """What a stage tells when a step has come so far."""
    spans = NARROW if narrow else SHARES
    if name in spans:
        low, high = spans[name]
        # The head is closed and trimmed, and tested, once the last level is trained.
        trained = min(1.0, share / 0.7) if name == "256^3" else share
        progress.total = 1000
        progress.update(int(1000 * (low + (high - low) * trained)), f"{name}, 1.2 M voxels")
    elif name in COUNTED:
        progress.update(progress.done, f"{name} {int(96 * share)} of 96")
    elif name != "start":
        progress.update(progress.done, name)


def played(job, clock, slower=lambda second: 1.0, every=0.5):
    """Seconds since the begin, seconds left as told, and as they were, every half a second."""
    left = TimeLeft(MakeConfig(), Source(*job["source"]), look=job["look"], cores=2)
    narrow, found, progress = not job["source"][2], [], None
    for stage, name, usual in job["steps"]:
        if progress is None or progress.title != stage:
            progress = Progress(stage, enabled=False, outlook=left)
        done = 0.0
        while done < usual:
            tell(progress, name, done / usual, narrow)
            found.append((clock.now, left.left()))
            part = min(every, usual - done)
            done += part
            clock.now += part * slower(clock.now)
    return [(at, told, clock.now - at) for at, told in found]


def right(points):
    """Share of the time from the tenth second on in which a third is not missed."""
    late = [abs(told - truth) <= truth / 3 for at, told, truth in points if at >= 10.0]
    return sum(late) / len(late)


@pytest.mark.parametrize("slower", [1.0, 3.0])
@pytest.mark.parametrize("name", RECORDED)
def test_from_the_tenth_second_on_it_is_right_within_a_third(name, slower, clock):
    """Also on a machine that is three times as slow, which it must learn."""
    assert right(played(RECORDED[name], clock, lambda second: slower)) >= 0.85


PHOTOS = Source(64, 0.5, placed=False, matted=False)


def test_a_part_that_was_done_before_takes_no_time(clock):
    whole, rest = (TimeLeft(MakeConfig(), PHOTOS, cores=2) for _ in range(2))
    rest.skip("capture")
    clock.now = 6.0
    assert 20.0 < rest.left() < whole.left() - 20.0


def test_a_job_that_ends_with_the_first_look_is_shorter(clock):
    short = TimeLeft(MakeConfig(), PHOTOS, only=True, cores=2)
    whole = TimeLeft(MakeConfig(), PHOTOS, cores=2)
    clock.now = 6.0
    assert 10.0 < short.left() < whole.left() - 30.0


def test_what_is_compiled_beside_counts_until_it_is_there(clock):
    """A hundred functions, which take two cores 43 seconds."""
    warmup, told = SimpleNamespace(left=100), []
    left = TimeLeft(MakeConfig(), PHOTOS, warmup=warmup, cores=2)
    for clock.now, warmup.left in ((0.0, 100), (6.0, 86), (26.0, 40), (43.0, 0)):
        left.at("capture", "compiling kernels, once: some")
        told.append(left.left())
    assert told[1] - told[2] == pytest.approx(20.0, abs=5.0)
    assert told[2] - told[3] == pytest.approx(17.0, abs=5.0)


def test_nothing_is_said_at_first_and_little_is_left_at_the_end(clock):
    left = TimeLeft(MakeConfig(), PHOTOS, cores=2)
    assert left.left() is None
    clock.now = 10.0
    left.at("share", "report")
    left.at("share", "a step that nobody knows")
    assert left.left() < 1.0


def test_the_facts_of_photos_are_those_of_the_first(tmp_path):
    from PIL import Image

    for number in range(4):
        Image.new("RGB", (400, 200), (number, 0, 0)).save(tmp_path / f"{number}.png")
    assert Source.of(tmp_path, MakeConfig()) == (4, 0.08, False, False, False)
    assert Source.of(tmp_path, MakeConfig(made_from="face")).fitted
    assert Source.of(tmp_path / "0.png", MakeConfig()) == (1, 0.08, False, False, True)


def test_a_fitted_head_is_neither_placed_nor_trained():
    photo = Source(1, 1.0, placed=False, matted=False, fitted=True)
    steps = {(step.stage, step.name): step.usual
             for step in usual_steps(MakeConfig(), photo, True, 2)}
    names = {name for stage, name in steps if stage == "reconstruct"}
    assert {"colors", "first look"} <= names and not any("^3" in name for name in names)
    TimeLeft(MakeConfig(), photo, only=True)  # ends with the first look
    assert ("capture", "fitting the head") in steps
    assert ("capture", "refining the cameras") not in steps
    assert sum(seconds for (stage, _), seconds in steps.items()
               if stage in ("capture", "reconstruct")) < 20
