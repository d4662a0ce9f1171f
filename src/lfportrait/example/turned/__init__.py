"""Paintings whose face is turned: the frontal picture that is painted from.

`frontal` unrolls the painting by the pose of its face (`lfportrait.face.face_pose`), with the help
of a head that stands for any; `mesh` draws that head onto the painting.
"""

from .frontal import FRONTAL, PROFILE, Frontal, frontal_view, frontalised, suited
from .mesh import head_mesh

__all__ = ["FRONTAL", "PROFILE", "Frontal", "frontal_view", "frontalised", "head_mesh",
           "suited"]
