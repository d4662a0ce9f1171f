"""The page's words: all there in both languages, numbers and names of parameters unchanged."""

import json
import re
from pathlib import Path

import pytest

from lfportrait import studio
from tests.share.page.browser import program

WEB = Path(studio.__file__).parent / "web"
ENGLISH = json.loads((WEB / "strings.en.json").read_text("utf-8"))
GERMAN = json.loads((WEB / "strings.de.json").read_text("utf-8"))
SCRIPTS = sorted(WEB.rglob("*.js"))
PARAMETERS = ("pitch", "slant", "offset", "nearest", "continuous", "filtered", "visual.json")


def test_german_is_complete():
    assert list(GERMAN) == list(ENGLISH)
    assert all(text.strip() for text in [*ENGLISH.values(), *GERMAN.values()])
    same = [key for key in ENGLISH if ENGLISH[key] == GERMAN[key] and len(ENGLISH[key]) > 12]
    assert same == [], "these were left in English"


def test_places_numbers_and_parameters_are_the_same():
    def places(text):
        return sorted(set(re.findall(r"\{(\w+)", text)))

    def numbers(text):
        return sorted(re.findall(r"\d+", re.sub(r"\{[^}]*\}", "", text)))

    for key, english in ENGLISH.items():
        assert places(english) == places(GERMAN[key]), key
        assert numbers(english) == numbers(GERMAN[key]), key
        if key.startswith(("wizard.", "blend.", "display.")):
            for name in PARAMETERS:
                assert (name in english) == (name in GERMAN[key]), key


def used_keys():
    """Keys that a script names in full, and the beginnings of those that it puts together."""
    whole, begun = set(), set()
    for path in SCRIPTS:
        text = path.read_text("utf-8")
        whole |= set(re.findall(r"\bt\(\s*\"([^\"]+)\"", text))
        whole |= {key for pair in re.findall(
            r"\bt\([^()\"`]*\?\s*\"([^\"]+)\"\s*:\s*\"([^\"]+)\"", text) for key in pair}
        begun |= {start for start in re.findall(r"\bt\(\s*`([^`$]*)\$", text) if start}
        begun |= {f"{start}." for start in re.findall(r"\bknown\(\s*\"(\w+)\"", text)}
    return whole, begun


def test_every_word_that_is_asked_for_is_there():
    whole, begun = used_keys()
    assert len(whole) > 150
    assert whole - set(ENGLISH) == set()
    assert all(any(key.startswith(start) for key in ENGLISH) for start in begun)


def test_no_word_is_there_that_nobody_asks_for():
    whole, begun = used_keys()
    quoted = {word for path in SCRIPTS for word in
              re.findall(r"\"([a-z_]+(?:[.-][\w.-]+)*)\"", path.read_text("utf-8"))}
    # `${name}.${value}` of the placement's choices begins with a variable.
    begun |= {"ground.", "blend."}
    unused = {key for key in ENGLISH if key not in whole and key not in quoted
              and not any(key.startswith(start) for start in begun)}
    assert unused == set()


def test_scripts_ask_nobody_else():
    for path in [*SCRIPTS, *WEB.rglob("*.css"), *WEB.rglob("*.html")]:
        text = path.read_text("utf-8")
        text = text.replace("http://www.w3.org/2000/svg", "")
        assert not re.search(r"https?://|//[a-z]+\.[a-z]", text), path.name
        # The page's policy has no room for either.
        assert not re.search(r"innerHTML|insertAdjacentHTML|\beval\(|\sstyle=\"", text), path.name


@pytest.mark.slow  # in a browser; the words are above
@pytest.mark.skipif(program() is None, reason="no Chromium is installed")
def test_the_language_changes_at_once_and_stays(opened):
    page = opened.page
    assert page.inner_text("h1") == "Sitters"
    page.select_option(".rail .preferences select", "de")
    page.wait_for_selector("h1:text('Modelle')")
    assert page.get_attribute("html", "lang") == "de"
    opened.reload()
    assert page.inner_text("h1") == "Modelle"
    for name in ("making", "photos", "show"):
        opened.go(f"{name}/ben")
        shown = page.inner_text("#main")
        left = [text for key, text in ENGLISH.items() if len(text) > 20 and "{" not in text
                and text != GERMAN[key] and text in shown]
        assert left == []
