"""Many portraits: sitters x styles x displays from one file, on this machine or a Ray cluster.

`jobs_file` reads what is wanted, `plan` draws the graph of stages that share work and knows how far
it is, `driver` gives the tasks out and writes the index, `runners` do them; `journal` reports it.
"""

from .driver import BatchConfig, batch, prepare_batch
from .jobs_file import load_jobs, overlaid
from .journal import BatchTable, JsonLines, Watcher, batch_status, dry_table
from .plan import dry_figures

__all__ = ["BatchConfig", "BatchTable", "JsonLines", "Watcher", "batch", "batch_status",
           "dry_figures", "dry_table", "load_jobs", "overlaid", "prepare_batch"]
