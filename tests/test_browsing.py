"""A browser that takes its time holds nothing up."""

import os
import subprocess
import sys
import time
import urllib.request

import pytest

WAITS = "import time; time.sleep(10)"
FETCHES = ("import sys, urllib.request; "
           "urllib.request.urlopen(sys.argv[1].split('#')[0]).read(); "
           "open(sys.argv[2], 'w').write('fetched')")
VIEW = ("import sys; from lfportrait.share import serve_page; "
        "serve_page(sys.argv[1], ready=lambda address, end: print(address, flush=True))")
STUDIO = ("import sys; from pathlib import Path; from lfportrait.studio import run; "
          "run(Path(sys.argv[1]))")


@pytest.fixture(params=["view", "studio"])
def start(request, tmp_path):
    """Starts a program that serves, with a browser; gives the address that it prints."""
    (tmp_path / "page.html").write_text("<p>here</p>")
    code, place = ((VIEW, tmp_path / "page.html") if request.param == "view"
                   else (STUDIO, tmp_path / "projects"))
    begun = []

    def started(browser, *arguments):
        (tmp_path / "browser.py").write_text(browser)
        words = (sys.executable, tmp_path / "browser.py", "%s", *arguments)
        process = subprocess.Popen(
            [sys.executable, "-c", code, str(place)], stdout=subprocess.PIPE, text=True,
            env={**os.environ, "BROWSER": " ".join(map(str, words))})
        begun.append(process)
        return process, process.stdout.readline().split()[0]

    yield started
    for process in begun:
        process.kill()
        process.wait()
        process.stdout.close()  # the browser may still have its other end


def test_the_page_is_there_while_the_browser_runs(start):
    process, address = start(WAITS)
    begin = time.monotonic()
    with urllib.request.urlopen(address.split("#")[0], timeout=20) as answer:
        assert answer.status == 200
    assert time.monotonic() - begin < 4
    process.terminate()  # nor is the end held up
    process.wait(20)


@pytest.mark.slow  # processes; other ones: above
def test_a_browser_that_fetches_the_page_before_it_ends(start, tmp_path):
    start(FETCHES, tmp_path / "mark")
    end = time.monotonic() + 30
    mark = tmp_path / "mark"
    while not (mark.exists() and mark.read_text()) and time.monotonic() < end:
        time.sleep(0.1)
    assert mark.read_text() == "fetched"
