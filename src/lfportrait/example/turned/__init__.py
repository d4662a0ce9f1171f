"""Turned faces, handled with a generic head.

`frontal` unrolls a painting by the pose of its face (`lfportrait.face.face_pose`): the frontal
picture is what is painted from. `mesh` draws the head onto the painting. `aside` finds what a photo
shows of a face that is turned far.
"""

from ..frontal import (
           FRONTAL,
           PROFILE,
           FaceAside,
           Frontal,
           face_aside,
           frontal_view,
           frontalised,
           head_mesh,
           in_front,
           suited,
)

__all__ = ["FRONTAL", "PROFILE", "FaceAside", "Frontal", "face_aside", "frontal_view",
           "frontalised", "head_mesh", "in_front", "suited"]
