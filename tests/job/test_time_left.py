"""The time left that jobs show, told while the recorded steps of real ones are played back."""

import json
from pathlib import Path
from types import SimpleNamespace

import pytest

from lfportrait.job.steps import MakeConfig
from lfportrait.job.time_left import Source, TimeLeft
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
    monkeypatch.setattr("lfportrait.job.time_left.time", fake)
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


@pytest.mark.parametrize("name", RECORDED)
def test_from_the_tenth_second_on_it_is_right_within_a_third(name, clock):
    assert right(played(RECORDED[name], clock)) >= 0.85
