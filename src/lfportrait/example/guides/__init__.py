"""Guides of the transfer: position in the painting, appearance and region of each pixel.

Where: `position`, from control points. How: `filters`, with the appearance guide and the blurs that
it needs. What: `regions` finds person and hair and makes soft labels of them; `color_segmentation`
helps where networks fail.
"""
