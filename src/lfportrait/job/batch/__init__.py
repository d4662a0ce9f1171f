"""Many portraits: sitters x styles x displays from one file, on this machine or a Ray cluster.

`jobs_file` reads what is wanted, `plan` draws the graph of stages that share work and knows how far
it is, `driver` gives the tasks out, does them and writes the index; `journal` reports it.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
