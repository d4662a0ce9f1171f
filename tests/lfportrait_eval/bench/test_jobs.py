"""Whole jobs are measured and told; the jobs here are made up, but for one that fails at once."""

import functools
import json
import sys
import threading
import time
from pathlib import Path

import pytest

from lfportrait.cli import main
from lfportrait.cli.common import parsed
from lfportrait.cli.make import Demo, Make
from lfportrait.errors import UserError
from lfportrait.job import Warmup
from lfportrait.progress import Progress
from lfportrait_eval.bench import bench_jobs, job_tables
from lfportrait_eval.bench.jobs import Ended, run_process


def figures_of_a_run() -> dict:
    steps = {"start": {"seconds": 0.5, "core_seconds": 0.5},
             "128^3": {"seconds": 8.0, "core_seconds": 15.0},
             "compiling kernels, once": {"seconds": 1.5, "core_seconds": 0.3}}
    return {"device": "cpu", "style": "fauve", "display": "generic-4k",
            "seconds": {"wall": 21.0, "total": 16.5, "capture": 4.0}, "peak_memory_bytes": 3 << 29,
            "first_look": {"seconds": 7.25},
            "capture": {"stage_seconds": 4.0, "views": 50,
                        "calibration": {"photos": 60, "registered": 50}, "steps": {
                            "matching": {"seconds": 3.0, "core_seconds": 6.0}}},
            "reconstruct": {"stage_seconds": 10.0, "test": {"psnr": 31.5}, "steps": steps},
            "share": {"stage_seconds": 2.5, "steps": {
                "page|video": {"seconds": 2.5, "core_seconds": 1.25}}}}


class Runner:
    """Writes what a job would, as the words of its command ask."""

    def __init__(self, *seconds: float, run: dict | None = None) -> None:
        self.seconds, self.run = list(seconds), run or figures_of_a_run()
        self.commands: list = []

    def __call__(self, words) -> Ended:
        assert words[:3] == [sys.executable, "-m", "lfportrait"]
        kind = {"make": Make, "demo": Demo}[words[3]]
        command = parsed(kind, words[4:], "lfportrait")
        self.commands.append(command)
        if getattr(command, "photos", Path()).name == "blurred":
            return Ended(2, 1.0, 1.0, "capture: 1.0 s\nlfportrait: all photos are blurred\n\n")
        assert not command.out.exists()
        (command.out / "capture" / "images").mkdir(parents=True)
        (command.out / "capture" / "images" / "a.png").write_bytes(b"x" * 700)
        (command.out / "capture" / "capture.json").write_bytes(b"x" * 300)
        (command.out / "field.npz").write_bytes(b"x" * 4000)
        (command.out / "run.json").write_bytes(b"x" * 20)
        command.json.write_text(json.dumps(self.run))
        return Ended(0, self.seconds.pop(0) if self.seconds else 20.0, 30.0, "")


def test_the_demo_is_made_by_default_and_removed():
    runner = Runner()
    figures = bench_jobs(style="charcoal", display="generic-1080p", device="cpu", seed=4,
                         run=runner)
    [command] = runner.commands
    assert isinstance(command, Demo) and command.quiet and not command.quick
    assert (command.style, command.display) == ("charcoal", "generic-1080p")
    assert (command.device, command.seed) == ("cpu", 4)
    assert not command.out.parent.exists()
    assert list(figures["jobs"]) == ["demo"] and not figures["failed"]
    assert figures["device"] == "cpu" and figures["peak_memory_bytes"] == 3 << 29
    assert figures["vectors"]["lanes"] >= 1 and figures["machine"]["cores"] >= 1


def test_figures_of_a_job():
    job = bench_jobs([Path("ann")], run=Runner())["jobs"]["ann"]
    assert job["seconds"] == {"total": 20.0, "capture": 4.0, "reconstruct": 10.0, "share": 2.5,
                              "outside": 3.5}
    assert job["core_seconds"] == 30.0 and job["cores_in_use"] == 1.5
    assert job["first_look_seconds"] == 7.25 and job["psnr"] == 31.5 and job["compiled"]
    assert (job["photos"], job["given_photos"]) == (50, 60)
    assert job["files"] == {"field.npz": 4000, "capture/": 1000, "run.json": 20}
    assert list(job["files"]) == ["field.npz", "capture/", "run.json"]
    assert job["folder_bytes"] == 5020
    stage = job["stages"]["reconstruct"]
    assert stage["core_seconds"] == 15.8 and stage["cores_in_use"] == 1.58
    assert stage["steps"]["128^3"] == {"seconds": 8.0, "core_seconds": 15.0,
                                       "cores_in_use": 1.88}


def test_a_job_that_tells_less_is_measured_too():
    run = figures_of_a_run()
    del run["first_look"], run["reconstruct"]["test"], run["share"]["steps"]
    del run["capture"]["calibration"], run["reconstruct"]["steps"]["compiling kernels, once"]
    figures = bench_jobs([Path("ann")], run=Runner(run=run))
    job = figures["jobs"]["ann"]
    assert job["first_look_seconds"] is None and job["psnr"] is None and not job["compiled"]
    assert job["stages"]["share"] == {"seconds": 2.5, "core_seconds": None, "cores_in_use": None,
                                      "steps": {}}
    assert "| ann | 50 | 20.0 s | 4.0 s | 10.0 s | - | - | 2.5 s | - | 1.50 GiB | 0 MB |" \
        in job_tables(figures).splitlines()


def test_tables_have_a_row_for_each_job_and_each_long_step():
    figures = bench_jobs([Path("ann"), Path("ben")], run=Runner())
    figures["machine"] = {"processor": "Slow 1", "cores": 2}
    figures["vectors"] = {"unit": "AVX2", "lanes": 8, "torch": "AVX512", "bfloat16": True}
    conditions, jobs, about, steps, *_ = job_tables(figures).split("\n\n")
    assert conditions == ("Slow 1, cores: 2; kernels: AVX2, 8 lanes; torch: AVX512, bfloat16; "
                          "a single run of each job.")
    row = "50 of 60 | 20.0 s | 4.0 s | 10.0 s | - | - | 2.5 s | 7.2 s | 1.50 GiB | 0 MB |"
    assert jobs.splitlines()[2:] == [f"| ann | {row}", f"| ben | {row}"]
    assert len({line.count("|") for line in jobs.splitlines()}) == 1
    assert about == ("ann: cores in use: 1.50; device: cpu; held-out photos: 31.50 dB; kernels "
                     "were compiled in this run. Steps of more than 1 s:")
    assert steps.splitlines() == [
        "| stage | step | time | cores in use |", "| --- | --- | --- | --- |",
        "| capture | matching | 3.0 s | 2.00 |", "| reconstruct | 128^3 | 8.0 s | 1.88 |",
        "| reconstruct | compiling kernels, once | 1.5 s | 0.20 |",
        "| share | page\\|video | 2.5 s | 0.50 |", "| - | outside of the stages | 3.5 s | - |"]


def test_the_median_of_several_runs():
    runner = Runner(21.0, 19.0, 40.0)
    figures = bench_jobs([Path("ann")], repeats=3, run=runner)
    job = figures["jobs"]["ann"]
    assert len(runner.commands) == 3
    assert job["seconds"]["total"] == 21.0 and job["totals"] == [21.0, 19.0, 40.0]
    assert "the median of 3 runs of each job" in job_tables(figures)
    with pytest.raises(UserError, match="--repeat is 0"):
        bench_jobs(repeats=0, run=runner)


def test_captures_of_one_name_are_told_apart():
    paths = [Path("a/photos"), Path("b/photos"), Path("film.mp4")]
    assert list(bench_jobs(paths, run=Runner())["jobs"]) == [
        str(paths[0]), str(paths[1]), "film.mp4"]


def test_what_fails_is_told_after_the_figures_of_the_others(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr("lfportrait_eval.bench.bench_jobs",
                        functools.partial(bench_jobs, run=Runner()))
    target = tmp_path / "figures.json"
    assert main(["bench", "job", "--captures", "ann", "blurred", "--quiet", "--json",
                 str(target)]) == 2
    told = capsys.readouterr()
    assert told.err == "lfportrait: 1 of 2 jobs failed: blurred: all photos are blurred\n"
    assert "| ann | 50 of 60 |" in told.out and "blurred" not in told.out
    figures = json.loads(target.read_text())
    assert list(figures["jobs"]) == ["ann"]
    assert figures["failed"] == {"blurred": "all photos are blurred"}


@pytest.mark.parametrize(("errors", "why"), [
    ("", "ended with exit code -9 and said nothing"),
    ("Traceback:\nValueError: no\nlfportrait: internal error; please report it with the lines "
     "above\n", "ValueError: no")])
def test_why_a_job_failed(errors, why):
    figures = bench_jobs(run=lambda words: Ended(-9, 1.0, 1.0, errors))
    assert figures["failed"] == {"demo": why} and figures["peak_memory_bytes"] == 0
    assert len(job_tables(figures).splitlines()) == 1


@pytest.mark.slow  # only the project measures
def test_a_job_is_a_process(tmp_path):
    missing = tmp_path / "nobody"
    figures = bench_jobs([missing])
    assert figures["failed"]["nobody"].startswith(f"there is no folder or file {missing}")


def test_a_process_is_timed():
    ended = run_process([sys.executable, "-c", "import sys, time\nend = time.process_time() + 0.2\n"
                         "while time.process_time() < end: pass\nsys.exit('bad')"])
    assert ended.code == 1 and ended.errors.strip() == "bad"
    assert ended.seconds > 0.2
    assert ended.core_seconds > 0.15 or sys.platform == "win32"


def test_compiling_is_a_step_of_that_name():
    # The bench finds a first run by this step.
    warmup = Warmup(())
    compiled = warmup._done["encode"] = threading.Event()

    class Watching(Progress):
        def update(self, done: int, note: str = "") -> None:
            super().update(done, note)
            compiled.set()

    progress = Watching("encode", enabled=False)
    warmup.wait(("encode",), progress)
    time.sleep(0.02)
    assert "compiling kernels, once" in progress.costs
