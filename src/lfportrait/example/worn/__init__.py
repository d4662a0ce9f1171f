"""What the painter's sitter wears: found in the painting, and taken off.

Hats and bonnets shade or cover a forehead, spectacles lie across nose and cheeks. Copied onto a
sitter who wears none, they are patches of another color. So a painting is bared first: `forehead`
finds what is no bare skin above the brows, and `filled` fills it as the painter might have, in his
light and with his strokes.
"""

from .filled import bared

__all__ = ["bared"]
