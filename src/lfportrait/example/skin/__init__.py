"""Painting on the skin: a head's surface as an atlas of charts, painted once for all views.

`charts` looks at a field from all around, `sitter` adds what the sitter shows where, `painting`
paints it by one exemplar.
"""
