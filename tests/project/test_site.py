"""The site's parts that need no MkDocs: hooks, navigation, and the check that it loads nothing."""

import re
from pathlib import Path

import numpy as np
import pytest

import check_site
import draw_gallery
import draw_tutorial
import site_hooks
from lfportrait.capture import Camera
from lfportrait.demo import demo_capture
from tests.share.test_video import ball

ROOT = Path(__file__).parents[2]


def test_links_out_of_the_docs_become_their_text():
    text = ("[`a/b.py`](../src/lfportrait/a/b.py) [rules](../CONTRIBUTING.md), "
            "[deeper](../../scripts/c.py)")
    assert site_hooks.on_page_markdown(text) == "`a/b.py` rules, deeper"


def test_links_within_the_docs_stay():
    text = "[skin](skin.md#how) [parameters](../parameters.md) ![head](../images/hero.webp)"
    assert site_hooks.on_page_markdown(text) == text


def test_two_colons_before_code_become_one():
    assert site_hooks.on_page_content("<p>In five lines::</p> a::b") == "<p>In five lines:</p> a::b"


def test_arguments_that_share_a_line_get_one_each():
    pytest.importorskip("griffe")
    from site_docstrings import apart

    text = ("What : all.\n\nParameters\n----------\none, *two : int [N], places\n    of all.\n"
            "three : One.\nfour\n    As ever.\n\nReturns\n-------\nfive, six : Both.\n\n"
            "Examples\n--------\n>>> a : b")
    assert apart(text) == (
        "What : all.\n\nParameters\n----------\none\n    int [N], places\n    of all.\n"
        "*two\n    int [N], places\n    of all.\nthree\n    One.\nfour\n    As ever.\n\n"
        "Returns\n-------\nfive\n    Both.\nsix\n    Both.\n\nExamples\n--------\n>>> a : b")
    assert apart("One, two : three.") == "One, two : three."


def test_comments_at_fields_become_attributes():
    pytest.importorskip("griffe")
    from site_docstrings import attributes

    lines = ["class Sample:", "    one: int = 1  # Of one.", "    # two, three: Of",
             "    # both: long.", "    two: list[", "        int]", "    three: int",
             "    # Above.", "    four: int", "    five: str"]
    fields = {"one": (1, 1), "two": (4, 5), "three": (6, 6), "four": (8, 8), "five": (9, 9)}
    assert attributes(lines, fields) == (
        "\n\nAttributes\n----------\none : Of one.\ntwo : Of both: long.\n"
        "three : Of both: long.\nfour : Above.\n")
    assert attributes(["class Plain:", "    one: int"], {"one": (1, 1)}) == ""


def test_every_page_has_a_place_in_the_navigation():
    docs = ROOT / "docs"
    listed = re.findall(r"[\w/-]+\.md", (ROOT / "mkdocs.yml").read_text("utf-8"))
    pages = [path.relative_to(docs).as_posix() for path in docs.rglob("*.md")]
    assert sorted(listed) == sorted(pages)


def test_every_stage_has_a_page_of_its_api():
    named = {re.search(r"^::: (\S+)$", path.read_text("utf-8"), re.MULTILINE)[1]
             for path in (ROOT / "docs" / "api").glob("*.md")}
    stages = {path.parent.name for path in (ROOT / "src" / "lfportrait").glob("*/__init__.py")}
    # One module has what all shaders run on.
    assert named == {"lfportrait", "lfportrait_eval", "lfportrait.gpu",
                     *(f"lfportrait.{stage}" for stage in stages - {"cli", "simd"})}


@pytest.mark.parametrize(("text", "found"), [
    ('<script src="https://cdn.example/a.js"></script>', ["https://cdn.example/a.js"]),
    ('<SCRIPT SRC="HTTP://cdn.example/a.js"></SCRIPT>', ["HTTP://cdn.example/a.js"]),
    ('<img src="//cdn.example/a.png">', ["//cdn.example/a.png"]),
    ('<img src="a.png" srcset="b.png 1x, https://e.example/c.png 2x">',
     ["https://e.example/c.png"]),
    ('<link rel="stylesheet" href="https://fonts.example/css">', ["https://fonts.example/css"]),
    ('<link rel="preconnect" href="https://fonts.example">', ["https://fonts.example"]),
    ('<link href="https://fonts.example">', ["https://fonts.example"]),
    ('<p style="background: url(http://e.example/a.png)">', ["http://e.example/a.png"]),
    ('<style>@import "https://e.example/a.css"; b {}</style>', ["https://e.example/a.css"]),
    ('<iframe src="https://e.example/"></iframe>', ["https://e.example/"]),
    ('<svg><image href="https://e.example/a.png"/></svg>', ["https://e.example/a.png"]),
    ('<a href="https://e.example/">a link for readers</a>', []),
    ('<link rel="canonical" href="https://e.example/">', []),
    ('<script src="a.js"></script><img src="../a.png"><code>src="https://e.example"</code>', []),
    ('<svg xmlns="http://www.w3.org/2000/svg"></svg>', []),
])
def test_what_a_page_loads_from_elsewhere_is_found(tmp_path, text, found, capsys):
    page = tmp_path / "sub" / "page.html"
    page.parent.mkdir()
    page.write_text(text, "utf-8")
    assert check_site.loaded_from_elsewhere(page) == found
    assert check_site.main([str(tmp_path)]) == bool(found)
    assert all(f"sub/page.html loads {address}" in capsys.readouterr().out for address in found)


def test_style_sheets_are_checked_and_no_pages_are_an_error(tmp_path):
    sheet = tmp_path / "a.css"
    sheet.write_text("@font-face { src: url('https://e.example/a.woff2') } b { c: url(d.png) }")
    assert check_site.loaded_from_elsewhere(sheet) == ["https://e.example/a.woff2"]
    assert check_site.main([str(tmp_path / "none")]) == 1


def test_rows_of_the_gallery_show_the_whole_head():
    views = draw_gallery.seen(ball(), (-40, 0, 40), 60)
    assert len(views) == 3 and len({view.shape for view in views}) == 1
    row = draw_gallery.strip([np.zeros((30, 20, 3), np.uint8), *views], 60)
    assert row.shape == (60, 40 + sum(view.shape[1] + draw_gallery.GAP for view in views), 3)
    for view in views:
        ink = (view < 200).any(axis=-1)
        assert ink[30, view.shape[1] // 2]
        # Something white is left on every side.
        assert not (ink[0].any() or ink[-1].any() or ink[:, 0].any() or ink[:, -1].any())


def test_pictures_of_the_tutorial_are_drawn():
    capture = demo_capture(size=64, views=24)
    assert draw_tutorial.photos(capture).shape == (260, 5 * 260 + 4 * draw_gallery.GAP, 3)
    sheet = draw_tutorial.cameras_and_mattes(capture)
    size = draw_tutorial.HEIGHT
    assert sheet.shape == (size, 3 * size + 2 * draw_gallery.GAP, 3)
    # Cameras are green dots on the half circle below the head; behind it there are none.
    places = (np.abs(np.int16(sheet[:, -size:]) - draw_tutorial.GOOD) < 30).all(axis=-1)
    assert places[size // 2:].sum() > 100 and not places[:size // 5].any()
    position = capture.cameras.position[draw_tutorial.nearest(capture, 40)]
    assert abs(np.degrees(np.arctan2(position[0], position[2])) - 40) < 15


def test_depth_is_light_where_it_is_near():
    field = ball()
    camera = Camera.arc([0.0], distance=4, width=64, height=64, focal=100)
    picture = draw_tutorial.depth_picture(field.render(camera, 0))
    assert (picture[0, 0] == 1).all() and picture[32, 32, 0] > 0.9
    ball_rim = picture[32, picture[32, :, 0] < 1, 0]
    assert ball_rim[:3].mean() < picture[32, 32, 0]


@pytest.mark.slow  # in a browser; `make site` checks its links
def test_a_page_on_the_disk_searches_in_a_frame(browser, tmp_path):
    """As Material does: it makes a `Worker` of an address and exchanges messages with it."""
    script = (ROOT / "docs" / "javascripts" / "iframe-worker.js").read_text("utf-8")
    (tmp_path / "worker.js").write_text(
        "addEventListener('message', (event) => setTimeout(() => postMessage(2 * event.data)));"
        "if (!('IFrameWorker' in parent)) throw Error('the frame is not known as one');", "utf-8")
    (tmp_path / "page.html").write_text(f"<body><script>{script}</script></body>", "utf-8")
    page = browser.new_page()
    complaints = []
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.goto((tmp_path / "page.html").as_uri())
    answers = page.evaluate("""() => new Promise((resolve) => {
      const answers = [], worker = new Worker(new URL("worker.js", location.href));
      worker.addEventListener("message", (event) => {
        answers.push(event.data);
        if (answers.length < 3) worker.postMessage(answers.at(-1) + 1);
        else resolve(answers);
      });
      worker.postMessage(1);
    })""")
    page.close()
    assert answers == [2, 6, 14] and not complaints
