"""The radiance field of a head: a `Capture` becomes a `VoxelField` (Paper 2.1, Eq. 1-3).

`reconstruct` trains it, starting from what `geometry` carves and by the steps of `training`; `grid`
holds and renders it, `storage` is its file, `surface` its surface as points or as a mesh. What
trains is imported when it is asked for.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
