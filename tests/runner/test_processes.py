"""Our own processes: what is sent arrives, what is printed does not get between, ends are heard."""

import platform
import queue

import numpy as np
import pytest

from lfportrait.runner import Child
from lfportrait.runner.processes import receive, send

ENTRY = "tests.runner.echo:serve"


def test_messages_survive_the_pipe(tmp_path):
    values = {"a": np.arange(12).reshape(3, 4)[:, ::2], "b": [None, 1.5], "c": np.float64(3)}
    with open(tmp_path / "pipe", "wb", buffering=0) as stream:
        send(stream, values)
    with open(tmp_path / "pipe", "rb", buffering=0) as stream:
        got = receive(stream)
        np.testing.assert_array_equal(got["a"], values["a"])
        assert got["b"] == values["b"] and got["c"] == 3
        with pytest.raises(EOFError):
            receive(stream)


def test_a_child_answers_and_its_prints_go_to_the_log(tmp_path):
    log = tmp_path / "logs" / "child.log"
    child = Child(ENTRY, log, {"LFPORTRAIT_NUMBER": "7"})
    picture = np.arange(600_000.0)
    child.send(("picture", picture))
    name, got = child.receive()
    np.testing.assert_array_equal(got, picture)
    got[:] = 0  # the caller's own
    child.send(("print",))
    assert name == "picture" and child.receive() == ("print",)
    child.send(("setting", "LFPORTRAIT_NUMBER"))
    assert child.receive() == ("7", "LFPORTRAIT_NUMBER")
    assert child.alive
    child.close()
    assert not child.alive and log.read_text() == "printed\n"


def test_a_child_looks_for_garbage_but_not_among_what_it_imported():
    child = Child(ENTRY)
    child.send(("garbage",))
    word, enabled, kept = child.receive()
    child.close()
    assert word == "garbage" and enabled and kept > 10_000


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="another C library's memory")
def test_a_child_uses_memory_again_that_was_freed():
    child = Child(ENTRY, settings={"NUMPY_MADVISE_HUGEPAGE": "0"})
    child.send(("faults",))
    assert child.receive()[1] < 2000
    child.close()


def test_the_end_of_a_child_is_heard(tmp_path):
    heard: queue.SimpleQueue = queue.SimpleQueue()
    child = Child(ENTRY, tmp_path / "log", group=True)
    child.listen(heard.put)
    child.send(("word",))
    assert heard.get() == ("word",)
    child.send(("die",))
    assert heard.get() is None
    child.close()
    with pytest.raises((OSError, ValueError)):
        child.send(("word",))
