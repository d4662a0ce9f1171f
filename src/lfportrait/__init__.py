"""lfportrait: photos and one painting in, a stylised 3D portrait for a light-field display out."""

__version__ = "0.1.0"
