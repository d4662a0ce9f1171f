"""Guides of the synthesis: where in the exemplar a pixel belongs, how it looks, what it is.

`regions` finds person and hair, `labels` makes soft labels of them, `control_points` and `outline`
say which place answers which, and `maps` computes the guides of every pixel.
"""
