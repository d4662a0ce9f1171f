"""What the studio's own processes do: jobs, and previews on a head that stays in memory.

The server imports none of this: torch and Numba take seconds.
"""
