"""Training a field on photos: level by level, with cameras refined on the way, and resumable.

`trainer` runs the levels and keeps the state; `pixels` says which rays, `stepping` casts them and
says how far a step goes; `lattice` refines and prunes, `poses` moves cameras; `meter` keeps curves.
"""
