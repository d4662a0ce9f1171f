"""What the server says in English has a German sentence: gathered from the code that says it."""

import ast
import json
import re
from pathlib import Path

import pytest

import lfportrait
from lfportrait import models, studio
from lfportrait.share import own_exports
from lfportrait.studio.projects import ADVICE
from tests.share.page.browser import program

PACKAGE = Path(lfportrait.__file__).parent
STUDIO = Path(studio.__file__).parent
GERMAN = json.loads((STUDIO / "web/strings.server.de.json").read_text("utf-8"))

FINDINGS = ("job/photo_check.py", "job/style_check.py", "health.py",
            "lightfield/placement.py", "lightfield/screens/bridge.py")
"""Every sentence in these is shown: advice, what a painting will give, the machine, the depth."""
FILES = ("lightfield/prints/sheet.py", "lightfield/prints/depth.py", "lightfield/prints/pages.py",
         "share/page/packing.py", "plugins.py")
"""What is wrong with a choice for a file."""
SHOWN = {"Refusal": 1, "UserError": 0, "Failure": 1, "update": 1, "say": -1, "warn": 0,
         "note": -1}
"""Functions of the studio and of stages whose argument of this place is shown."""
ELSEWHERE = ("cli", "studio", "batch")
"""Folders whose progress no job of the studio shows; the studio's own is looked at apart."""
SAME = {
    "{}", "{} in {}", "{} on {} {}", "pygame-ce {}: `lfportrait show`", "lfportrait devices",
    "export NUMBA_CACHE_DIR=FOLDER", "export LFPORTRAIT_MODELS=FOLDER", "pip install {}",
    "pip install 'lfportrait[show]'", "apt install {}", "lfportrait models fetch {}",
    "lfportrait models add {}", "stylize --style-network vgg19-se",
    "stylize --method stylized-nerf"}
"""Commands, names and numbers: alike in all languages."""
PARTS = {"{} compiled, {}", "none compiled yet: the first run takes minutes longer, its kernels "
         "are kept", "{}, but a job takes {} GB", "{}, but {} {} GB", "a job takes",
         "all networks take"}
"""Parts of sentences that are there as a whole."""

DRAWN = {"{} photos, {} of use", "No problems found: these photos are suitable for a portrait.",
         "{} photos without a face that is seen (from the side, from behind, or hidden) are not "
         "drawn here."}
"""Written into the picture of a check of photos, in English."""
COMMAND = {"one photo", "{} photo{}", "a few photos",
           "--from face takes photos, and {} has cameras already; leave out --from face"}
"""Said by commands alone: the studio has no such option."""


def template(node):
    """A text with {} for what is put into it, or None."""
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else None
    if isinstance(node, ast.JoinedStr):
        return "".join(one.value if isinstance(one, ast.Constant) else "{}" for one in node.values)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        both = template(node.left), template(node.right)
        return None if both == (None, None) else "".join(one or "{}" for one in both)
    return None


def sentences(tree):
    """All texts of more than a word but docstrings, those within another one's places, too."""
    found = set()
    waiting = [tree]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            continue
        text = template(node)
        if text is None:
            waiting += ast.iter_child_nodes(node)
            continue
        if " " in text.strip() and re.search("[a-z]", text):
            found.add(text)
        waiting += [one.value for one in ast.walk(node) if isinstance(one, ast.FormattedValue)]
    return found


def called(tree, names):
    """The texts that are given to functions."""
    found = set()
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        name = getattr(node.func, "id", getattr(node.func, "attr", ""))
        place = names.get(name)
        if place is None or len(node.args) <= place or (
                name == "Refusal" and getattr(node.args[0], "value", "") == "bad_request"):
            continue  # a wrong request is the page's fault, never the person's
        text = template(node.args[place])
        if text is not None and " " in text.strip():
            found.add(text)
    return found


def said():
    """All that is shown, by the file that says it."""
    for path in FINDINGS:
        yield path, sentences(ast.parse((PACKAGE / path).read_text("utf-8")))
    for path in FILES:
        yield path, called(ast.parse((PACKAGE / path).read_text("utf-8")), {"UserError": 0})
    for path in STUDIO.rglob("*.py"):
        yield path.name, called(ast.parse(path.read_text("utf-8")), SHOWN)
    stages = {name: SHOWN[name] for name in ("update", "say", "warn", "note")}
    for path in PACKAGE.rglob("*.py"):
        text = path.read_text("utf-8")
        # Most files call none of them: they need not be parsed.
        if (not {*ELSEWHERE} & {*path.relative_to(PACKAGE).parts}
                and re.search(rf"\b({'|'.join(stages)})\b", text)):
            yield path.name, called(ast.parse(text), stages)
    yield "models.py", {*models.PURPOSES.values()}
    yield "projects.py", {*ADVICE.values()}
    yield "kinds.py", {text for one in own_exports() if one.group for text in (
        one.title, one.purpose, *(option.note for option in one.options))}


def test_whatever_the_server_says_is_there_in_german():
    every = {(name, text) for name, texts in said() for text in texts}
    assert len({text for _, text in every}) > 200
    lacking = {(name, text) for name, text in every
               if text not in GERMAN and text not in SAME | PARTS | DRAWN | COMMAND}
    assert lacking == set()


def test_german_sentences_keep_numbers_and_places():
    for english, german in GERMAN.items():
        assert english.count("{}") == german.count("{}"), english
        assert german.strip() and (english != german or not re.search(
            "[a-z]{3} [a-z]{3}", english)), english
        assert sorted(re.findall(r"\d+", english)) == sorted(re.findall(r"\d+", german)), english


SAID = {
    "There are no photos between 12 degrees to the left and the front; take 3 photos there.":
        "Zwischen 12 Grad nach links und vorn gibt es keine Fotos; machen Sie dort 3 Fotos.",
    "4 photos: dark; more light.": "4 Fotos: dunkel; mehr Licht.",
    "The face is turned 12 degrees to the picture's left, leans 7 degrees to the picture's right: "
    "used unchanged": "Das Gesicht ist um 12 Grad im Bild nach links gedreht, um 7 Grad im Bild "
                      "nach rechts geneigt: Es wird genommen, wie es ist",
    "256 points to a head's height: up to about 3.5 million in all, 3.7 GiB, about 90 s more":
        "256 Punkte auf die Höhe eines Kopfes: höchstens etwa 3.5 Millionen zusammen, 3.7 GiB, "
        "noch etwa 90 s",
    "cutting out the person: 3 of 64": "die Person wird ausgeschnitten: 3 von 64",
    "missing: segments the hair in photos": "fehlt: findet das Haar in Fotos",
    "a.heic: raw photos are not read; export it as JPEG or TIFF":
        "a.heic: Rohfotos werden nicht gelesen; geben Sie es als JPEG oder TIFF aus",
    "choose at least two versions to compare":
        "wählen Sie mindestens zwei Versionen zum Vergleich",
    "0.5 lenses per inch can't be printed: --lpi must lie between 1 and 200, or be 0":
        "0.5 lenses per inch lassen sich nicht drucken: --lpi muss zwischen 1 und 200 liegen "
        "oder 0 sein",
    "a sentence that nobody knows": "a sentence that nobody knows"}


@pytest.mark.slow  # in a browser; the sentences are above
@pytest.mark.skipif(program() is None, reason="no Chromium is installed")
def test_a_german_page_says_it_in_german(opened):
    found = opened.page.evaluate(
        "async (texts) => { const { said, speak } = await import('/static/i18n.js');"
        " const before = texts.map(said); await speak('de');"
        " return [before, texts.map(said)]; }", list(SAID))
    assert found == [list(SAID), list(SAID.values())]
