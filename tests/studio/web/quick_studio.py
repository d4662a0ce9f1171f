"""The studio as its command starts it, but its built-in paintings are drawn small.

At full size each takes six seconds to draw, which the screens wait for, in each test file again.
"""

from lfportrait.cli import program
from lfportrait.demo import demo_exemplar
from lfportrait.studio import previews


class QuickChild(previews.Child):
    """The process that answers at once."""

    def __init__(self, entry, log, **options):
        assert entry == "lfportrait.studio.work.resident:serve"
        super().__init__(f"{__spec__.name}:serve", log, **options)


def serve():
    """What that process does."""
    from lfportrait.studio.work import resident

    name, _, _, *others = demo_exemplar.__defaults__
    demo_exemplar.__defaults__ = (name, 192, 256, *others)
    resident.serve()


if __name__ == "__main__":
    previews.Child = QuickChild
    program()
