"""Structure from motion, step by step: features, matches, placing the photos, the lens.

`capture.photo_cameras` joins the steps; COLMAP (pycolmap) places the photos.
"""
