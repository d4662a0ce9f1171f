"""The marching loop and the harmonics, for the kernels of stages that cast rays of their own.

A coded picture has a ray for every sub-pixel, of which one channel is evaluated: the same loop as a
rendering's, with another shading, and the same texture where a ray ends.
"""

from .kernels.march import enter_box, make_channel_shade, make_march, sh_basis
from .kernels.texture import PROBES, REACH, make_detail, make_texture_share

__all__ = ["PROBES", "REACH", "enter_box", "make_channel_shade", "make_detail", "make_march",
           "make_texture_share", "sh_basis"]
