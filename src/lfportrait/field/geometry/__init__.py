"""Where matter may be before anything is trained: hulls, plane sweeps, solids cut out of photos."""

from .cutout import cut_out, trim

__all__ = ["cut_out", "trim"]
