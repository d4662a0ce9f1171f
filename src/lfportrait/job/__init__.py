"""The main job: all stages in order, from photos to a coded light field.

`graph` has their parameters, keys and costs, `work` does them, `pipeline` joins them and knows how
long they will still take, `lfportrait.cache` sees that nothing finished is done twice, `prepare`
makes captures of photos and cuts the person out of those with a background, `summary` fills the
report. `photo_check` looks at photos before any of that; `style_check` does the same for a
painting. `inspection` says what files are and how they will be read. `first_look` shows a portrait
while its field is trained. `batch` is a package of its own: many jobs at once. Modules are imported
when something of them is asked for.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
