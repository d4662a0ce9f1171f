"""Gaussian splats of a field: laid on its surface, fitted to its views, written for other programs.

`fitting` lays one on each visible surface point, and moves them until they look like the field;
`cloud` renders them, and writes them as other programs read them.
"""
