"""Numba kernels of the splats."""
