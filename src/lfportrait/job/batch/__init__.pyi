from .driver import BatchConfig, batch, prepare_batch
from .jobs_file import TAKEN, load_jobs, overlaid
from .journal import BatchTable, JsonLines, Watcher, batch_status, dry_table
from .plan import dry_figures

__all__ = ["TAKEN", "BatchConfig", "BatchTable", "JsonLines", "Watcher", "batch",
           "batch_status", "dry_figures", "dry_table", "load_jobs", "overlaid", "prepare_batch"]
