"""From a field to a light-field display: one ray for each sub-pixel (Shen et al. 2023, 2.3, Eq. 8).

`display` knows the panel, and reads its files and coded pictures; `placement` says where a field
stands before it and how deep is sharp, and has the options of coding; `coding` codes a field, with
its `ground`. `interlacing` makes coded pictures of views (`views`, `quilts`), takes them apart and
shows what an eye sees; `patterns` show whether the panel's numbers are right.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
