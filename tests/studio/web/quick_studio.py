"""The studio as its command starts it, but its built-in paintings are drawn small.

At full size each takes six seconds to draw, which the screens wait for, in each test file again.
The head that they are drawn from is kept coarser, too: to bake it takes as long as the rest.
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
    from lfportrait.demo import demo_exemplar, studio
    from lfportrait.studio.work import resident

    studio._GRID = 65

    name, _, _, *others = demo_exemplar.__defaults__
    demo_exemplar.__defaults__ = (name, 96, 128, *others)
    resident.serve()


if __name__ == "__main__":
    previews.Child = QuickChild
    program()
