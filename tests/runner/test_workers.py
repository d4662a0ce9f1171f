"""Tasks in processes: what they say, how they end, and what is left when they are stopped."""

import os
import time

import pytest

from lfportrait.errors import UserError
from lfportrait.runner import Callbacks, Child, Failure, Task, Workers, run_tasks

DIED = Failure("killed", "its process died")


def task(word, number=0):
    return Task(f"{word} {number}", word, "", (), "", ())


@pytest.fixture
def made(tmp_path):
    """Makes a runner; the processes that it began, and what tasks said, are its."""
    every = []

    def make(slots=1, ask=lambda task: (task.stage, str(tmp_path / "file")),
             wake=lambda: None, **more):
        def begin(_):
            child = Child("tests.runner.work:serve", tmp_path / "log", group=True)
            runner.began.append(child.number)
            return child

        told = []
        runner = Workers(slots, begin, ask, DIED, callbacks=Callbacks(
            lambda task, message: told.append(message), wake), **more)
        runner.began, runner.told = [], told
        every.append(runner)
        return runner

    yield make
    for runner in every:
        runner.close()


def outcomes(runner, *tasks):
    """How tasks ended, by their kind."""
    found = {}
    run_tasks(tasks, runner, lambda task, outcome: found.update(
        {task.name: outcome} if outcome is not None else {}))
    return [found[task.name] for task in tasks]


def alive(number):
    try:
        with open(f"/proc/{number}/stat") as stream:
            return stream.read().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def gone(*numbers):
    until = time.monotonic() + 60
    while any(map(alive, numbers)) and time.monotonic() < until:
        time.sleep(0.01)
    return not any(map(alive, numbers))


def test_a_process_does_task_after_task(made, tmp_path):
    runner = made()
    first, failed, fault, last = outcomes(runner, task("add"), task("fail"), task("fault"),
                                          task("add", 1))
    assert first.figures == last.figures == {"process": runner.began[0]}
    assert (failed.error, failed.code, failed.fault) == ("no light", "user_error", "")
    assert fault.code == "internal" and "KeyError" in fault.fault
    assert "KeyError" in (tmp_path / "log").read_text()
    assert runner.told == [("half", 0.5)] * 2 and len(runner.began) == 1
    assert runner.children == {}


def test_a_process_may_be_one_tasks_own(made):
    runner = made(stay=False)
    first, last = outcomes(runner, task("add"), task("add", 1))
    assert [first.figures["process"], last.figures["process"]] == runner.began
    assert gone(*runner.began)


@pytest.mark.parametrize("attempts, ends", [(1, DIED.message), (3, "")])
def test_a_task_whose_process_dies_is_given_out_again(made, attempts, ends):
    runner = made(attempts=attempts)
    (died,) = outcomes(runner, task("die"))
    assert died.error == ends and died.code == ("killed" if ends else "")
    (after,) = outcomes(runner, task("add"))
    assert after.figures and len(runner.began) == min(attempts, 3) + (attempts == 1)


def test_what_cannot_be_asked_is_how_a_task_ends(made):
    def ask(task):
        if task.stage == "bad":
            raise UserError("there is no light")
        return task.stage, "nothing"

    runner = made(ask=ask)
    bad, good = outcomes(runner, task("bad"), task("add"))
    assert bad.error == "there is no light" and good.figures


def test_a_task_that_is_stopped_has_no_outcome_and_leaves_nothing(made, tmp_path):
    woken = []
    runner = made(wake=lambda: woken.append(1))
    runner.start(task("slow"), 0)
    while not runner.told:
        runner.wait(1.0)
    assert woken and not runner.fits(0) and list(runner.children) == ["slow 0"]
    numbers = [int(word) for word in (tmp_path / "file").read_text().split()]
    assert all(map(alive, numbers)) or not os.path.exists("/proc/self/stat")
    child = runner.stop("slow 0")
    child.close()
    assert gone(*numbers) and runner.stop("slow 0") is None
    assert runner.fits(0) and runner.wait(0.0) == []
    (after,) = outcomes(runner, task("add"))
    assert after.figures["process"] == runner.began[1]
