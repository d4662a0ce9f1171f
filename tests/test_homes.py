"""Users without a home, and packages that may not be written to: any container."""

import warnings
from pathlib import Path

import numba
import pytest

from lfportrait import files, simd
from lfportrait.cache import user_cache  # itself, not what tests have instead


@pytest.fixture
def temporary(tmp_path, monkeypatch):
    place = tmp_path / "tmp"
    place.mkdir()
    monkeypatch.setattr(files.tempfile, "gettempdir", lambda: str(place))
    monkeypatch.setattr(files.tempfile, "tempdir", str(place))
    return place


def test_the_temporary_home_is_the_users_own(temporary):
    home = files.temporary_home()
    assert home.parent == temporary and home == files.temporary_home()
    assert home.stat().st_mode & 0o077 == 0
    home.chmod(0o777)  # anybody may have put code there
    other = files.temporary_home()
    assert other != home and other.stat().st_mode & 0o077 == 0


def test_a_link_is_nobodys_home(temporary, tmp_path):
    home = files.temporary_home()
    home.rmdir()
    home.symlink_to(tmp_path)
    assert files.temporary_home() not in (home, tmp_path)


@pytest.mark.parametrize("place", ["~/.cache/lfportrait", "a file"])
def test_the_cache_of_a_user_without_a_home_is_temporary(temporary, tmp_path, monkeypatch, place):
    if place == "a file":
        (tmp_path / "home").write_text("")
        place = str(tmp_path / "home" / "lfportrait")
    monkeypatch.setattr("pooch.os_cache", lambda name: place)
    monkeypatch.chdir(tmp_path)
    folder = user_cache("models")
    assert folder == files.temporary_home() / "models"
    assert not Path("~").exists()


def test_kernels_are_kept_somewhere(temporary, monkeypatch):
    kept = numba.config.CACHE_DIR
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        simd.keep_kernels()  # here there is a place

    def nowhere(function):
        raise RuntimeError("cannot cache function: no locator available")
    monkeypatch.setattr(simd, "FunctionCache", nowhere)
    try:
        with pytest.warns(UserWarning, match="set NUMBA_CACHE_DIR=FOLDER to keep them"):
            simd.keep_kernels()
        assert Path(numba.config.CACHE_DIR) == files.temporary_home() / "kernels"
    finally:
        numba.config.CACHE_DIR = kept
