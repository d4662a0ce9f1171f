"""A user study like the paper's: a page on which people choose between portraits, and its results.

`design` finds what is compared, lays down who sees what, and writes the page (its script and style
are in ``web/``). `analysis` reads the answer files and makes figures of them, `results` writes
these.
"""

from .analysis import (
    Answers,
    Ranking,
    Share,
    Trial,
    analyse,
    bradley_terry,
    effective_answers,
    fleiss_kappa,
    holm,
    kendall_agreement,
    krippendorff_alpha,
    rank,
    read_answers,
    sign_test,
    wilson,
)
from .design import (
    QUESTIONS,
    Entry,
    Pair,
    Question,
    Sheet,
    StudyConfig,
    entries_of,
    pairs_of,
    questions_of,
    sheets_of,
    study_script,
    write_study,
)
from .results import Row, interval_chart, write_results

__all__ = ["QUESTIONS", "Answers", "Entry", "Pair", "Question", "Ranking", "Row", "Share", "Sheet",
           "StudyConfig", "Trial", "analyse", "bradley_terry", "effective_answers", "entries_of",
           "fleiss_kappa", "holm", "interval_chart", "kendall_agreement", "krippendorff_alpha",
           "pairs_of", "questions_of", "rank", "read_answers", "sheets_of", "sign_test",
           "study_script", "wilson", "write_results", "write_study"]
