"""A head from one photo, or from a few: a statistical head, and what the photo shows besides.

`portrait_capture` finds the face, cuts the person out and fits the head
(`lfportrait.face.head_fit`) for a capture in the portrait frame; `portrait_field` makes the field:
the head laid over its photo (`warp`), hair and body inflated from the matte (`piece`, `solid`),
points of a lattice around the surface (`lattice`), and their colors (`paint`).
"""
