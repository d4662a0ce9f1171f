"""Old names of parameters work for one version, with a warning."""

import pytest

from lfportrait.cli import main
from lfportrait.errors import UserError
from lfportrait.field import ReconstructConfig
from lfportrait.job.batch.settings import overlaid
from lfportrait.renamed import new_words


def test_fields_by_their_old_names():
    with pytest.warns(UserWarning, match="at_most is max_resolution now"):
        assert ReconstructConfig(at_most=100) == ReconstructConfig(max_resolution=100)
    with pytest.raises(TypeError):
        ReconstructConfig(slack=1)  # of another class


def test_options_by_their_old_names(tmp_path, capsys):
    missing = str(tmp_path / "none")
    assert main(["reconstruct", missing, "--at-most", "100", "--no-close", "--finest", "96"]) == 2
    text = capsys.readouterr().err
    for words in ("--at-most is --max-resolution now", "--no-close is --no-fill-back now",
                  "--finest is --resolution now", "there is no"):
        assert words in text


@pytest.mark.parametrize(("word", "known", "wanted"), [
    ("--a.gain", ["--a.gain", "--a.min-improvement"], "--a.gain"),
    ("--a.gain=2", ["--a.min-improvement"], "--a.min-improvement=2"),
    ("--gain", ["--other"], "--gain"), ("gain", ["--min-improvement"], "gain")])
def test_only_options_that_are_gone_are_renamed(word, known, wanted, recwarn):
    assert new_words([word], known) == [wanted]
    assert len(recwarn) == (word != wanted)


def test_files_of_jobs_by_their_old_names():
    with pytest.warns(UserWarning, match="jobs: close is fill_back now"):
        assert not overlaid(ReconstructConfig(), {"close": False}, "jobs").fill_back
    with pytest.raises(UserError, match="there is no"):
        overlaid(ReconstructConfig(), {"slack": 1}, "jobs")
