"""Geometry from photos before training: hulls, depth, solids.

`sweep` finds depth maps, `mattes` makes a solid of them and follows its outlines and the field's;
`clean_plates` shows what is behind the person; `head_surface` begins with the usual proportions of
a bust, `knots` finds what stands out behind it; `exposure` compares the photos' brightness, and
`start` makes the first lattice.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
