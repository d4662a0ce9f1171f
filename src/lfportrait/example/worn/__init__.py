"""What the painter's sitter wears: found in the painting, and taken off.

Hats and bonnets shade or cover a forehead, spectacles lie across nose and cheeks. Copied onto a
sitter who wears none, they are patches of another color. So they are taken off before a painting is
painted from: `forehead` finds what is no bare skin above the brows, `spectacles` finds rims
(`ridges`, `rims`), and `filled` paints what they cover as the painter might have, in his light and
with his strokes.
"""

from .filled import bared, without_spectacles
from .glasses import spectacles

__all__ = ["bared", "spectacles", "without_spectacles"]
