"""The marching loop and the harmonics, for the kernels of stages that cast rays of their own.

A coded picture has a ray for every sub-pixel, of which one channel is evaluated: the same loop as a
rendering's, with another shading.
"""

from .kernels.march import enter_box, make_channel_shade, make_march, sh_basis

__all__ = ["enter_box", "make_channel_shade", "make_march", "sh_basis"]
