"""A user study like the paper's: a page on which people choose between portraits, and its results.

`entries` finds what is compared and `design` lays down who sees what; `assembly` writes the page
(its script and style are in ``web/``). `answers` reads the answer files, `analysis` makes
figures of it with `statistics`, `results` writes them.
"""

from .analysis import analyse
from .answers import Answers, Trial, read_answers
from .assembly import study_script, write_study
from .config import QUESTIONS, Question, StudyConfig, questions_of
from .design import Pair, Sheet, pairs_of, sheets_of
from .entries import Entry, entries_of
from .results import Row, interval_chart, write_results
from .statistics import (
    Ranking,
    Share,
    bradley_terry,
    effective_answers,
    fleiss_kappa,
    holm,
    kendall_agreement,
    krippendorff_alpha,
    rank,
    sign_test,
    wilson,
)

__all__ = ["QUESTIONS", "Answers", "Entry", "Pair", "Question", "Ranking", "Row", "Share", "Sheet",
           "StudyConfig", "Trial", "analyse", "bradley_terry", "effective_answers", "entries_of",
           "fleiss_kappa", "holm", "interval_chart", "kendall_agreement", "krippendorff_alpha",
           "pairs_of", "questions_of", "rank", "read_answers", "sheets_of", "sign_test",
           "study_script", "wilson", "write_results", "write_study"]
