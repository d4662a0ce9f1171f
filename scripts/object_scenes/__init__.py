"""Stand-ins for the objects on which radiance fields are compared, of solids that know distances.

`solids` knows how far away things are, `materials` what they are made of; `grid` walks rays past
them, `shading` lights them, `tracing` makes pictures. Each kind of scene has a module that says
what stands where and hands it over as a `design`.
"""

from collections.abc import Callable

from .bulldozer import bricks
from .design import DISTANCE, Design
from .foliage import foliage
from .glass import glass
from .pottery import pottery
from .room import room
from .tracing import Scene

__all__ = ["DISTANCE", "KINDS", "Design", "Scene"]

KINDS: dict[str, Callable[[], Design]] = {
    "bricks": bricks, "foliage": foliage, "glass": glass, "pottery": pottery, "room": room}
"""What `make_object_scene.py` can make, by name."""
