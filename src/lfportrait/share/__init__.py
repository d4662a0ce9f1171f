"""Outputs to view and share: page, videos, moving light fields, 3D files, report."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
