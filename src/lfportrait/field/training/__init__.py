"""Training a field on photos: level by level, with cameras refined on the way, and resumable.

`trainer` runs the levels; `pixels` says which rays, `casting` casts them, `steps` says how far a
step goes; `lattice` refines and prunes, `poses` and `align` move cameras; `checkpoint` keeps the
state, `meter` the curves.
"""
