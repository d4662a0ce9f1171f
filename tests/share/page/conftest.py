"""A few pages for the tests that open them."""

import pytest

from lfportrait.share import PageConfig, write_page
from tests.share.page.browser import Opened
from tests.share.page.portraits import painted_head, pure_head


@pytest.fixture(scope="package", autouse=True)
def small_posters():
    """Posters of a quarter of their size, which take a sixteenth of the time.

    Only here: a test elsewhere may compare the bytes of pages that two processes wrote.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("lfportrait.share.page.assembly._HEIGHT", 250)
        yield


@pytest.fixture(scope="session")
def head():
    return painted_head(strokes=True)


@pytest.fixture(scope="package")
def page(head, small_posters, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "portrait.html"
    write_page(head, path, PageConfig(title="Anna </script> @script@", artist="A & B",
                                      date="May 2026"))
    return path


@pytest.fixture(scope="package")
def opened(browser, page):
    """The page for all tests that leave it as it is, or put further color sets behind its own."""
    with Opened(browser, page) as each:
        each.loaded()
        yield each


@pytest.fixture(scope="session")
def pure():
    return pure_head()


@pytest.fixture(scope="package")
def pure_page(pure, small_posters, tmp_path_factory):
    path = tmp_path_factory.mktemp("pure") / "portrait.html"
    write_page(pure, path, PageConfig(sh=2))
    return path
