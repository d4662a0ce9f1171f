"""The studio as its command starts it, but its built-in paintings are small.

What is found out of a painting takes seconds at full size, in each test file again. And the browser
may keep the page's fifty files: they are asked for again by a hundred pages. Photos are not looked
at by themselves, which is a process for each sitter that a test leaves; `test_jobs` has that.
"""

from starlette.datastructures import MutableHeaders

from lfportrait.cli import program
from lfportrait.studio import app, desk, previews
from lfportrait.studio.app import Guard


class KeepingGuard(Guard):
    """Answers as the studio does, but says that its own files may be kept."""

    async def __call__(self, scope, receive, send):
        async def kept(message):
            if message["type"] == "http.response.start" and scope["path"].startswith("/static/"):
                MutableHeaders(scope=message)["cache-control"] = "private, max-age=3600"
            await send(message)

        await super().__call__(scope, receive, kept)


class QuickChild(previews.Child):
    """The process that answers at once."""

    def __init__(self, entry, log, settings, **options):
        assert entry == "lfportrait.studio.work.resident:serve"
        super().__init__(f"{__spec__.name}:serve", log, settings, **options)


def serve():
    """What that process does."""
    from lfportrait.demo import demo_exemplar
    from lfportrait.studio.work import resident

    name, *_ = demo_exemplar.__defaults__
    demo_exemplar.__defaults__ = name, 96, 128
    resident.serve()


if __name__ == "__main__":
    previews.Child = QuickChild
    app.Guard = KeepingGuard
    desk._QUIET = 3600.0
    program()
