"""A dozen options at first, all of them when asked."""

import re

import pytest

from lfportrait.cli import main


def options(capsys, *words):
    with pytest.raises(SystemExit) as end:
        main(list(words))
    assert end.value.code == 0
    text = capsys.readouterr().out
    return re.findall(r"^[│ ]{1,3}(?:-h, )?(--[a-z][\w.-]*)", text, flags=re.MULTILINE), text


@pytest.mark.parametrize("command", ["make", "stylize", "transfer", "reconstruct", "encode",
                                     "batch", "styles check"])
def test_help_is_short_and_all_of_it_is_there(capsys, command):
    words = command.split()
    short, text = options(capsys, *words, "--help")
    every, _ = options(capsys, *words, "--help-all")
    assert 2 <= len(short) <= 16 and {*short} <= {*every}
    assert ("--help-all" in text) == (len(every) > len(short))


def test_the_help_of_the_main_command_fits_a_screen(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    _, text = options(capsys, "make", "--help")
    assert len(text.splitlines()) <= 50


def test_defaults_are_those_of_the_command(capsys):
    for words in ("--help", "--help-all"):
        _, text = options(capsys, "transfer", words)
        line = re.sub(r"[│|\s]+", " ", text)
        assert re.search(r"--quality .*?\(default: (\w+)\)", line)[1] == "best"


def test_what_a_command_needs_is_among_it(capsys):
    short, _ = options(capsys, "make", "--help")
    assert {"--style", "--out", "--display"} <= {*short}
    short, _ = options(capsys, "stylize", "--help")
    assert {"--style", "--capture", "--out", "--method", "--preview", "--strength"} <= {*short}
    short, _ = options(capsys, "transfer", "--help")
    assert {"--style", "--out", "--quality", "--region"} <= {*short}
    short, text = options(capsys, "print", "--help")
    assert "--lpi" in short and "(required)" in text
