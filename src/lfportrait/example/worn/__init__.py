"""What a painter's sitter wears, found in the painting as it is given.

`spectacles` finds rims, bridge and temples.
"""
