"""The studio as its command starts it, but its built-in paintings are small.

What is found out of a painting takes seconds at full size, in each test file again.
"""

from lfportrait.cli import program
from lfportrait.studio import previews


class QuickChild(previews.Child):
    """The process that answers at once."""

    def __init__(self, entry, log, **options):
        assert entry == "lfportrait.studio.work.resident:serve"
        super().__init__(f"{__spec__.name}:serve", log, **options)


def serve():
    """What that process does."""
    from lfportrait.demo import demo_exemplar
    from lfportrait.studio.work import resident

    name, *_ = demo_exemplar.__defaults__
    demo_exemplar.__defaults__ = name, 96, 128
    resident.serve()


if __name__ == "__main__":
    previews.Child = QuickChild
    program()
