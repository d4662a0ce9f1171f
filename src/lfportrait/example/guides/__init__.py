"""Guides of the transfer: position in the painting, appearance and region of each pixel.

Where: `position`, from landmarks and `control_points`, with an `outline` that meets the painting's.
How: `appearance` (`blurs` helps it). What: `regions` finds person and hair, `labels` makes soft
labels of them; `face_frame` and `color_segmentation` help. `maps` holds the guides of a picture.
"""
