"""Example-based transfer: one painted portrait -> any portrait photo in its manner (Paper 2.2)."""

from .exemplar import Exemplar, face_size
from .guides import Guides, appearance_guide, position_guide
from .table import LookUpTable, TableConfig, build_table
from .styleblit import BlitConfig, Synthesis, synthesise
from .transfer import Transfer, TransferConfig, TransferResult, transfer

__all__ = [
    "BlitConfig", "Exemplar", "Guides", "LookUpTable", "Synthesis", "TableConfig", "Transfer",
    "TransferConfig", "TransferResult", "appearance_guide", "build_table", "face_size",
    "position_guide", "synthesise", "transfer",
]
