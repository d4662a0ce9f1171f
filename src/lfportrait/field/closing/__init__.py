"""Close the back of a head that no photo shows, with the surrounding colors.

Photos taken in an arc before a person leave the head open behind: thin, ragged, and who looks from
there sees the face from inside. The surface is read off along rays towards an axis in the middle
of neck and head (`chart`): distances, with one row a height and, above the brows, one an elevation.
Where no photo looks at it (`photos`), the distance is continued from what lies around, as a plate
under tension that bends as little as it can (Smith and Wessel 1990), and kept behind what any photo
sees; colors diffuse into the gap. Of a head that a narrow arc shows, hair and skin keep
apart, and both begin as the photos leave them (`colors`). The lattice gets a shell of
points there (`shell`). What photos saw stays as it is.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
