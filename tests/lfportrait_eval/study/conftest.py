"""One small study for all tests of this folder."""

import pytest

from lfportrait.files import read_json
from lfportrait_eval.study import StudyConfig, write_study
from tests.lfportrait_eval.study.people import collection


@pytest.fixture(scope="session")
def browser(plain_browser):
    """Pages here are text and videos."""
    return plain_browser


@pytest.fixture(scope="session")
def videos(tmp_path_factory):
    return collection(tmp_path_factory.mktemp("videos"))


@pytest.fixture(scope="session")
def study(videos, tmp_path_factory):
    folder = tmp_path_factory.mktemp("study") / "study"
    write_study([str(video) for video in videos], folder,
                StudyConfig(title="Whose is <b>better</b> </script>?"))
    return folder


@pytest.fixture(scope="session")
def design(study):
    return read_json(study / "study.json")


@pytest.fixture(scope="session")
def short(videos, tmp_path_factory):
    """A study of three pairs, as its page takes time to click through."""
    folder = tmp_path_factory.mktemp("short") / "study"
    write_study([str(video) for video in videos[:3]], folder, StudyConfig())
    return folder


@pytest.fixture(scope="session")
def single(videos, tmp_path_factory):
    """A study of one pair: three answers."""
    folder = tmp_path_factory.mktemp("single") / "study"
    write_study([str(video) for video in videos[:2]], folder, StudyConfig(repeats=0))
    return folder
