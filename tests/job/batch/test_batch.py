"""A batch on this machine: shared, resumed, killed, with bad sitters and a full disk."""

import errno
import io
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from lfportrait.cli import main
from lfportrait.errors import UserError
from lfportrait.files import write_image
from lfportrait.job.batch import BatchConfig, batch, batch_status, load_jobs
from lfportrait.job.batch import driver as driver_module
from lfportrait.job.pipeline import make

from .conftest import digests, of_anna
from .inline import Inline, single_thread

STAGES = {"capture": 2, "field": 2, "skin": 2, "stylize": 4, "encode": 8, "page": 4}


@pytest.fixture
def one_thread():
    with single_thread():
        yield


@pytest.fixture
def inline(one_thread, monkeypatch):
    monkeypatch.setattr(driver_module, "LocalRunner", Inline)


def started(events):
    return [event["task"] for event in events if event["event"] == "started"]


def test_a_batch_of_one_goes_on_where_a_file_is_missing(small, studio, inline, tmp_path):
    jobs, (made, figures, _) = studio / "one.toml", small
    assert figures["ran"] == dict.fromkeys(STAGES, 1) and not figures["failed"]
    before = digests(made)
    assert {"anna/ken/desk.png", "anna/ken/portrait.html", "anna/ken/styled.npz"} <= set(before)
    results = Path(shutil.copytree(made, tmp_path / "results"))
    (results / "anna/ken/portrait.html").unlink()
    again = batch(jobs, results)
    assert again["ran"] == {"page": 1} and digests(results) == before


def test_a_stage_that_fails_is_an_exit_code(small, studio, inline, monkeypatch, capsys, tmp_path):
    results = Path(shutil.copytree(small[0], tmp_path / "results"))
    (results / "anna/ken/portrait.html").unlink()
    monkeypatch.setattr("lfportrait.job.work.write_page", lambda *_: {}["nothing"])
    assert main(["batch", str(studio / "one.toml"), "--out", str(results), "--quiet"]) == 3
    assert "failed: anna/ken/page" in capsys.readouterr().out
    assert "Traceback" in (results / ".batch" / "faults.txt").read_text()


@pytest.mark.slow  # one sitter and style: above
def test_each_stage_is_done_once_and_all_files_are_there(made):
    results, figures, events = made
    assert figures["ran"] == STAGES and not figures["failed"]
    assert Counter(started(events)) == Counter(dict.fromkeys(started(events), 1))
    for sitter in ("anna", "bert"):
        for style in ("ken", "chalk"):
            for name in ("desk.png", "wall.png", "desk_quilt_qs3x2a1.5.png", "portrait.html",
                         "styled.npz", "thumbnail.jpg"):
                assert (results / sitter / style / name).is_file(), name
    assert json.loads((results / "results.json").read_text()) == figures
    assert [row["state"] for row in figures["jobs"]] == ["done"] * 12


@pytest.mark.slow  # a job of its own; what a batch leaves is above
def test_the_files_are_those_of_make(made, studio, tmp_path, one_thread):
    config = load_jobs(studio / "jobs.toml").parameters("anna", "chalk", "desk")
    make(studio / "sittings" / "anna", studio / "chalk.png", tmp_path / "out", studio / "tiny.toml",
         config)
    for one, other in (("field.npz", "field.npz"), ("styled.npz", "chalk/styled.npz"),
                       ("lightfield.png", "chalk/desk.png"),
                       ("portrait.html", "chalk/portrait.html")):
        assert (tmp_path / "out" / one).read_bytes() == (
            made[0] / "anna" / other).read_bytes(), one
    keys = [json.loads(path.read_text())["key"] for path in (
        tmp_path / "out/.stages/encode.json", made[0] / "anna/chalk/.stages/display-desk.json")]
    assert keys[0] == keys[1]


@pytest.mark.slow  # one that does what is missing: above
def test_a_second_run_does_nothing(made, studio, copy):
    events = []
    before = {path: path.stat().st_mtime_ns for path in copy.rglob("*.np*")}
    figures = batch(studio / "jobs.toml", copy, watchers=[events.append])
    assert not started(events) and figures["ran"] == {} and figures["done"] == 22
    assert before == {path: path.stat().st_mtime_ns for path in copy.rglob("*.np*")}
    assert digests(copy) == digests(made[0])


def command(*words):
    return subprocess.Popen([sys.executable, "-m", "lfportrait", "batch", *map(str, words)],
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def journal(results):
    path = results / ".batch" / "journal.jsonl"
    return [json.loads(line) for line in path.read_text().splitlines()] if path.is_file() else []


def children(process):
    listed = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    return [int(word) for word in listed.read_text().split()]


def alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().split(")")[1].split()[0] != "Z"
    except OSError:
        return False


def wait_for(condition, seconds=120):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it takes too long"
        time.sleep(0.02)


@pytest.mark.slow  # workers that die: tests/runner; what is left is made: a full disk, below
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_driver_and_workers_killed_it_ends_with_the_same_files(made, anna, tmp_path):
    results = tmp_path / "results"
    words = (anna, "--out", results, "--quiet", "--workers", 2, "--cores", 1)
    with command(*words) as process:
        wait_for(lambda: sum(entry["event"] == "done" for entry in journal(results)) >= 3)
        workers = children(process)
        assert workers  # one where memory is too short for two
        process.kill()
    # Nobody goes on writing when the batch is gone.
    wait_for(lambda: not any(map(alive, workers)), 60)
    before = {entry["task"] for entry in journal(results) if entry["event"] == "done"}
    assert 3 <= len(before) < 11
    status = batch_status(results)[1]
    assert not status["running"] and sum(row["done"] for row in status["stages"].values()
                                         if "done" in row) >= len(before)
    with command(*words, "--json-lines") as process:
        killed = 0
        again = []
        for line in process.stdout:
            again.append(json.loads(line))
            # The first two that are left, mostly both pictures' colors: where this process is slow
            # to end the first run, they may be done.
            if again[-1]["event"] == "started" and killed < 2:
                time.sleep(0.3)
                for worker in children(process):
                    with suppress(ProcessLookupError):  # the one before was just replaced
                        os.kill(worker, signal.SIGKILL)
                killed += 1
        failed = [event for event in again if event["event"] == "failed"]
        assert process.wait() == 0, (failed, process.stderr.read())
    assert killed == 2
    # Nothing is done twice that was done, and what was lost is given out again.
    assert not before & set(started(again))
    assert digests(results) == of_anna(digests(made[0]))


@pytest.fixture
def bad_studio(studio, tmp_path, monkeypatch):
    """The studio, and sitters that can't be portrayed."""
    monkeypatch.setattr(driver_module, "get_networks", lambda *_, **__: None)
    folder = shutil.copytree(studio, tmp_path / "studio")
    random = np.random.default_rng(0)
    for number in range(4):
        write_image(folder / "sittings" / "noise" / f"{number}.png",
                    random.integers(0, 256, (96, 128, 3), dtype=np.uint8))
    (folder / "sittings" / "none").mkdir()
    (folder / "sittings" / "none" / "notes.txt").write_text("no photo")
    torn = shutil.copytree(folder / "sittings" / "anna", folder / "sittings" / "torn")
    picture = sorted(torn.rglob("view_003*.png"))[0]
    picture.write_bytes(picture.read_bytes()[:200])
    (folder / "sittings" / "vague").mkdir()
    (folder / "sittings" / "vague" / "transforms.json").write_text("{")
    return folder


@pytest.mark.slow  # failures: above
def test_bad_sitters_stop_nobody_else(made, bad_studio, copy, inline):
    for name in ("portrait.html", "wall.png"):
        (copy / "bert" / "chalk" / name).unlink()
    events = []
    figures = batch(bad_studio / "jobs.toml", copy, watchers=[events.append])
    assert set(figures["failed"]) == {"noise/capture", "torn/capture", "none",
                                      "vague/capture"}
    assert "overlap" in figures["failed"]["noise/capture"]
    assert "view_003" in figures["failed"]["torn/capture"]
    assert "no photos" in figures["failed"]["none"]
    assert "not valid JSON" in figures["failed"]["vague/capture"]
    assert digests(copy).items() >= digests(made[0]).items()
    states = Counter((row["sitter"], row["state"]) for row in figures["jobs"])
    assert states == {("anna", "done"): 6, ("bert", "done"): 6, ("noise", "failed"): 6,
                      ("torn", "failed"): 6, ("none", "failed"): 1, ("vague", "failed"): 6}
    page = (copy / "index.html").read_text()
    assert "noise/capture" in page and "no photos" in page
    assert batch_status(copy)[1]["failed"] == figures["failed"]
    # They are tried again, and only they.
    again = []
    batch(bad_studio / "jobs.toml", copy, watchers=[again.append])
    assert set(started(again)) == {"noise/capture", "torn/capture", "vague/capture"}


@pytest.mark.slow  # failures: above
def test_no_face_is_told_of_its_sitter(made, studio, copy, inline, shared_weights, monkeypatch,
                                       tmp_path):
    from dataclasses import replace

    from lfportrait.capture import Capture

    monkeypatch.setenv("LFPORTRAIT_MODELS", str(shared_weights))
    folder = shutil.copytree(studio, tmp_path / "studio")
    capture = Capture.load(folder / "sittings" / "anna")
    grey = [np.full_like(image, 128) for image in capture.images]
    replace(capture, images=grey, landmarks=None).save(folder / "sittings" / "vase")
    figures = batch(folder / "jobs.toml", copy)
    assert list(figures["failed"]) == ["vase/capture"]
    assert "no face was found" in figures["failed"]["vase/capture"]


class FullDisk(io.BytesIO):
    """A file on a disk without space."""

    def write(self, data):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def full_for(word):
    """`open` on a disk that has no space for files with this word in their names."""
    def opened(path, mode="r", **options):
        full = word in Path(path).name and "w" in mode
        return FullDisk() if full else open(path, mode, **options)

    return opened


@pytest.mark.slow  # other failures: here
def test_a_full_disk_fails_what_is_written_then_and_the_rest_is_made_later(
        made, studio, copy, inline, monkeypatch):
    shutil.rmtree(copy / "bert" / "ken")
    (copy / "anna/ken/portrait.html").unlink()
    monkeypatch.setattr("lfportrait.files.open", full_for("styled"), raising=False)
    figures = batch(studio / "jobs.toml", copy)
    assert list(figures["failed"]) == ["bert/ken/styled"]
    assert "No space left" in figures["failed"]["bert/ken/styled"]
    assert (copy / "anna/ken/portrait.html").is_file()
    assert not list((copy / "bert" / "ken").glob("*styled*"))
    monkeypatch.delattr("lfportrait.files.open")
    assert not batch(studio / "jobs.toml", copy)["failed"]
    assert digests(copy) == digests(made[0])


@pytest.mark.slow  # above
def test_a_fault_of_ours_is_a_failure_with_a_traceback_kept(studio, copy, inline, monkeypatch):
    (copy / "anna/ken/portrait.html").unlink()
    (copy / "bert/ken/portrait.html").unlink()
    monkeypatch.setattr("lfportrait.job.work.write_page", lambda *_: {}["nothing"])
    figures = batch(studio / "jobs.toml", copy)
    assert set(figures["failed"]) == {"anna/ken/page", "bert/ken/page"}
    assert "internal error: KeyError: 'nothing'" in figures["failed"]["anna/ken/page"]
    assert "Traceback" in (copy / ".batch" / "faults.txt").read_text()


@pytest.mark.slow  # where a job computes: tests/test_device.py
def test_tasks_compute_where_the_batch_is_to(studio, copy, inline, monkeypatch):
    (copy / "anna/ken/desk.png").unlink()
    devices, start = [], Inline.start

    def noted(self, task, memory):
        devices.append(task.device)
        start(self, task, memory)

    monkeypatch.setattr(Inline, "start", noted)
    figures = batch(studio / "jobs.toml", copy, device="cpu")
    assert devices == ["cpu"] and not figures["failed"]
    with pytest.raises(UserError, match="auto, cpu, gpu or gpu:NAME"):
        batch(studio / "jobs.toml", copy, device="tpu")


def test_one_batch_at_a_time(studio, tmp_path):
    from lfportrait.job.batch.journal import locked

    with locked(tmp_path), pytest.raises(UserError, match="another batch is writing"):
        batch(studio / "jobs.toml", tmp_path)


def test_wrong_addresses(studio, tmp_path):
    with pytest.raises(UserError, match="--on takes local, ray or"):
        batch(studio / "jobs.toml", tmp_path, BatchConfig(on="rey"))


def test_without_ray_it_tells_what_to_install(studio, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(UserError, match=r"lfportrait\[ray\]"):
        batch(studio / "jobs.toml", tmp_path, BatchConfig(on="ray"))


def test_a_painting_that_is_missing_is_told_before_anything_is_made(studio, tmp_path, capsys):
    text = (studio / "jobs.toml").read_text().replace("ken.png", "nobody.png")
    (studio / "wrong.toml").write_text(text)
    assert main(["batch", str(studio / "wrong.toml"), "--out", str(tmp_path / "out")]) == 2
    told = capsys.readouterr().err
    assert "wrong.toml: style nobody: painting" in told
    assert not (tmp_path / "out").exists()


@pytest.mark.slow  # above
def test_the_command_tells_of_failures_by_its_exit_code(studio, copy, inline, monkeypatch, capsys,
                                                        tmp_path):
    words = ["batch", str(studio / "jobs.toml"), "--out", str(copy), "--quiet"]
    assert main([*words, "--json", str(tmp_path / "run.json")]) == 0
    assert json.loads((tmp_path / "run.json").read_text())["done"] == 22
    (copy / "anna/ken/portrait.html").unlink()
    monkeypatch.setattr("lfportrait.job.work.write_page", lambda *_: {}["nothing"])
    assert main(words) == 3
    assert "failed: anna/ken/page" in capsys.readouterr().out
    assert main(["batch", "status", str(copy)]) == 0
    assert "3 done, 1 failed" in capsys.readouterr().out
    assert main(["batch", str(studio / "jobs.toml")]) == 2
    assert main(["batch", "status", str(tmp_path / "nothing")]) == 2


def test_a_dry_run_writes_nothing(studio, tmp_path, capsys):
    assert main(["batch", str(studio / "jobs.toml"), "--out", str(tmp_path / "out"),
                 "--dry-run", "--json", str(tmp_path / "plan.json")]) == 0
    told = capsys.readouterr().out
    assert "22 tasks, 22 to do" in told and "anna/ken/styled" in told
    assert not (tmp_path / "out").exists()
    plan = json.loads((tmp_path / "plan.json").read_text())
    assert len(plan["graph"]) == 22 and plan["core_seconds"] > 0 and plan["disk_bytes"] > 0
