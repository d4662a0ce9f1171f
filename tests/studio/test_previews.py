"""The queue of previews: what goes first, and what is not asked any more."""

import asyncio
from types import SimpleNamespace

import pytest
from starlette.requests import Request

from lfportrait.studio import previews
from lfportrait.studio.answers import Events, Refusal
from lfportrait.studio.previews import Previews, Turn
from lfportrait.studio.routes.call import Call
from tests.studio.conftest import run_apart


class Asked:
    """Questions to a process that answers none before `let` is called."""

    def __init__(self, folder, queue):
        self.queue = queue
        self.facts = {"asked": str(folder / "asked"), "open": str(folder / "open")}
        self.answers = {}

    def put(self, name, *more, **named):
        """Ask, without waiting for the answer."""
        self.answers[name] = asyncio.ensure_future(self.queue.ask(name, self.facts, *more,
                                                                  **named))

    async def until(self, count):
        """Wait until so many questions have reached the process."""
        for _ in range(12000):
            if len(self.order()) >= count:
                return
            await asyncio.sleep(0.005)
        raise AssertionError(f"only {self.order()} were asked")

    def order(self):
        """The questions that reached the process, in their order."""
        try:
            with open(self.facts["asked"]) as stream:
                return stream.read().split()
        except FileNotFoundError:
            return []

    async def let(self):
        """Have all answered; the names that were, and the refusals of the others."""
        open(self.facts["open"], "w").close()
        found = await asyncio.gather(*self.answers.values(), return_exceptions=True)
        return {name: one["name"] if isinstance(one, dict) else getattr(one, "code", repr(one))
                for name, one in zip(self.answers, found, strict=True)}


def tried(tmp_path, monkeypatch, act):
    """Run ``act`` with questions of which the first is being answered."""
    real = previews.Child
    monkeypatch.setattr(previews, "Child", lambda entry, *more, **group: real(
        "tests.studio.slow_answers:serve", *more, **group))

    async def all_of_it():
        queue = Previews(tmp_path / "log", Events())
        asked = Asked(tmp_path, queue)
        asked.put("first")
        await asked.until(1)
        try:
            return await act(asked), asked.order()
        finally:
            await queue.close()

    return run_apart(all_of_it())


async def forever():
    await asyncio.Event().wait()


def test_what_is_changed_now_goes_before_galleries(tmp_path, monkeypatch):
    async def act(asked):
        for name in ("thumb-1", "thumb-2", "thumb-3"):
            asked.put(name, turn=Turn.LATER)
        asked.put("viewer")
        asked.put("point-1", "editor")
        asked.put("point-2", "editor")
        asked.put("slider", "colors")
        await asyncio.sleep(0)
        return await asked.let()

    answers, order = tried(tmp_path, monkeypatch, act)
    assert order == ["first", "point-2", "slider", "viewer", "thumb-1", "thumb-2", "thumb-3"]
    assert answers.pop("point-1") == "busy", "a newer place of the landmark came"
    assert answers == {name: name for name in answers}


def test_a_page_that_has_gone_is_not_answered(tmp_path, monkeypatch):
    async def act(asked):
        left = asyncio.Event()

        async def gone():
            await left.wait()

        asked.put("stays", gone=forever)
        asked.put("leaves", gone=gone)
        asked.put("cancelled")
        await asyncio.sleep(0)
        left.set()
        asked.answers["cancelled"].cancel()
        await asyncio.wait([asked.answers["leaves"]], timeout=60)
        assert asked.answers["leaves"].done(), "it is said before the first is answered"
        return await asked.let()

    answers, order = tried(tmp_path, monkeypatch, act)
    assert order == ["first", "stays"] and answers["stays"] == "stays"
    assert answers["leaves"] == "busy"


def test_what_is_being_answered_ends_though_its_page_has_gone(tmp_path, monkeypatch):
    async def act(asked):
        left = asyncio.Event()

        async def gone():
            await left.wait()

        await asked.let()
        (tmp_path / "open").unlink()
        asked.put("copied", gone=gone)
        await asked.until(2)
        left.set()
        await asyncio.sleep(0.05)
        assert not asked.answers["copied"].done()
        return await asked.let()

    answers, _ = tried(tmp_path, monkeypatch, act)
    assert answers["copied"] == "copied"


def test_a_full_gallery_does_not_refuse_a_landmark(tmp_path, monkeypatch):
    monkeypatch.setattr(previews, "_MOST", 2)

    async def act(asked):
        for name in ("one", "two", "three"):
            asked.put(name, turn=Turn.LATER)
        asked.put("point", "editor")
        await asyncio.sleep(0)
        return await asked.let()

    answers, order = tried(tmp_path, monkeypatch, act)
    assert answers["three"] == "busy" and order == ["first", "point", "one", "two"]


def test_the_end_refuses_what_waits(tmp_path, monkeypatch):
    async def act(asked):
        asked.put("waits", gone=forever)
        await asyncio.sleep(0)
        await asked.queue.close()
        with pytest.raises(Refusal) as refused:
            await asked.answers["waits"]
        asked.answers["first"].cancel()
        return refused.value.code

    code, order = tried(tmp_path, monkeypatch, act)
    assert code == "preview_lost" and order == ["first"]


@pytest.mark.parametrize("leaves", [True, False])
def test_a_request_without_a_connection_is_not_asked(tmp_path, monkeypatch, leaves):
    async def act(asked):
        messages = [{"type": "http.request", "body": b""}]
        ended = asyncio.Event()

        async def receive():
            if messages:
                return messages.pop()
            await ended.wait()
            return {"type": "http.disconnect"}

        call = Call(Request({"type": "http"}, receive), SimpleNamespace(previews=asked.queue), {})
        asked.answers["asked"] = asyncio.ensure_future(call.ask("asked", asked.facts))
        await asyncio.sleep(0)
        if leaves:
            ended.set()
            await asyncio.wait_for(asyncio.wait([asked.answers["asked"]]), 60.0)
        return await asked.let()

    answers, order = tried(tmp_path, monkeypatch, act)
    assert order == (["first"] if leaves else ["first", "asked"])
    assert answers["asked"] == ("busy" if leaves else "asked")
