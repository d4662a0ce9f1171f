"""The landmark editor: by hand, by keys, undone and redone, mirrored, and what is written."""

import numpy as np
import pytest

from tests.studio.web.conftest import Opened

pytestmark = pytest.mark.slow  # in a browser; landmarks are tried in tests/job/test_session.py


@pytest.fixture(scope="module")
def page(opened_here):
    """The page, which the tests here go through one after the other."""
    return opened_here


@pytest.fixture(scope="module")
def painting(page):
    """The sitter's own painting: its id, and its points."""
    styles = page.ask("GET", "/api/styles?project=ben")["styles"]
    own = next(style["id"] for style in styles if style["kind"] == "project")
    return own, page.ask("GET", f"/api/styles/{own}/landmarks?project=ben")["points"]


@pytest.fixture
def editor(page, painting):
    """The editor, entered again, of the points as they were at first."""
    page.painting, first = painting
    page.page.unroute_all()
    page.go("sitters")
    for _ in range(100):
        page.ask("PUT", f"/api/styles/{page.painting}/landmarks?project=ben", {"points": first})
        page.go(f"style/ben/{page.painting}/landmarks")
        page.page.wait_for_selector(".mark")
        # The test before may have left a change that was on its way.
        if np.abs(points(page) - first).max() <= 0.06 and np.abs(stored(page) - first).max() == 0:
            return page
        page.go("sitters")
    raise AssertionError("the points do not come back")


def points(editor):
    """What the page says of its points, float [68, 2]."""
    editor.until("""() => [...document.querySelectorAll(".mark")].every(
      (mark) => mark.getAttribute("aria-label"))""")
    labels = editor.run("""() => [...document.querySelectorAll(".mark")].map(
      (mark) => mark.getAttribute("aria-label"))""")
    numbers = [label.replace(",", "").split() for label in labels]
    return np.array([[float(words[words.index("x") + 1]), float(words[words.index("y") + 1])]
                     for words in numbers])


def stored(editor):
    found = editor.ask("GET", f"/api/styles/{editor.painting}/landmarks?project=ben")
    return np.array(found["points"])


def saved(editor):
    """What the server has, once the page has written."""
    for _ in range(600):
        editor.page.wait_for_selector("header [role=status]:text('Saved')")
        found = stored(editor)
        # The word may still be that of the change before.
        if np.abs(found - points(editor)).max() <= 0.06:
            break
        editor.page.wait_for_timeout(100)
    return found


def middle(editor, number):
    box = editor.page.locator(f".mark[data-number='{number}'] .halo").bounding_box()
    return np.array([box["x"] + box["width"] / 2, box["y"] + box["height"] / 2])


def drag(editor, number, by):
    mouse, start = editor.page.mouse, middle(editor, number)
    mouse.move(*start)
    mouse.down()
    mouse.move(*(start + np.array(by) / 2))
    mouse.move(*(start + by))
    mouse.up()


def moved(before, after):
    return np.flatnonzero(np.abs(after - before).max(axis=1) > 0.11).tolist()


def scale(editor):
    """Pixels of the window for one of the painting."""
    a, b = middle(editor, 0), middle(editor, 16)
    places = points(editor)
    return np.hypot(*(a - b)) / np.hypot(*(places[0] - places[16]))


def test_a_point_is_dragged_and_written_into_the_file_that_the_commands_read(editor):
    before, factor = points(editor), scale(editor)
    drag(editor, 30, [12, -8])
    after = points(editor)
    assert moved(before, after) == [30]
    np.testing.assert_allclose((after - before)[30], np.array([12, -8]) / factor, atol=0.2)
    np.testing.assert_allclose(saved(editor), after, atol=0.06)
    beside = editor.studio.folder / "ben" / "paintings" / "ken.landmarks.txt"
    np.testing.assert_allclose(np.loadtxt(beside), after, atol=0.06)


def test_arrows_move_by_one_pixel_and_with_shift_by_ten(editor):
    before = points(editor)
    editor.page.locator(".mark[data-number='57']").focus()
    for key, by in (("ArrowLeft", [-1, 0]), ("ArrowDown", [0, 1]), ("Shift+ArrowRight", [10, 0]),
                    ("Shift+ArrowUp", [0, -10])):
        editor.page.keyboard.press(key)
        after = points(editor)
        assert moved(before, after) == [57]
        np.testing.assert_allclose((after - before)[57], by, atol=0.11)
        before = after


def test_tab_goes_from_point_to_point(editor):
    editor.page.locator(".mark[data-number='0']").focus()
    focused = "() => document.activeElement.dataset.number"
    for number in ("1", "2"):
        editor.page.keyboard.press("Tab")
        assert editor.run(focused) == number
    editor.page.keyboard.press("Shift+Tab")
    assert editor.run(focused) == "1"
    editor.page.locator(".loupe").wait_for()


def test_a_part_moves_as_a_whole(editor):
    for number, part in ((39, range(36, 42)), (66, range(48, 68)), (8, range(17)),
                         (24, range(22, 27))):
        before = points(editor)
        editor.page.click(".segments >> text=Part")
        editor.page.locator(f".mark[data-number='{number}']").focus()
        editor.page.keyboard.press("Shift+ArrowDown")
        after = points(editor)
        assert moved(before, after) == list(part)
        np.testing.assert_allclose((after - before)[list(part)], [[0, 10]] * len(part), atol=0.11)
    editor.page.click(".segments >> text=Face")
    editor.page.locator(f".mark[data-number='{number}']").focus()
    editor.page.keyboard.press("ArrowLeft")
    assert moved(after, points(editor)) == list(range(68))


def test_nothing_leaves_the_picture(editor):
    size = editor.ask("GET", f"/api/styles/{editor.painting}/landmarks?project=ben")
    editor.page.click(".segments >> text=Face")
    editor.page.locator(".mark[data-number='8']").focus()
    shape = points(editor) - points(editor)[8]
    editor.page.click("[aria-label^='Whole']")
    drag(editor, 8, [0, 2000])
    after = points(editor)
    assert after[:, 1].max() <= size["height"] - 1
    np.testing.assert_allclose(after - after[8], shape, atol=0.21)  # and keeps its shape


def test_steps_are_undone_and_redone(editor):
    first = points(editor)
    drag(editor, 8, [0, 15])
    second = points(editor)
    mark = editor.page.locator(".mark[data-number='36']")
    mark.focus()
    for _ in range(3):
        editor.page.keyboard.press("ArrowRight")
    third = points(editor)
    editor.page.keyboard.press("Control+z")  # a run of arrows is one step
    np.testing.assert_allclose(points(editor), second)
    editor.page.keyboard.press("Control+z")
    np.testing.assert_allclose(points(editor), first)
    editor.page.keyboard.press("Control+Shift+z")
    editor.page.keyboard.press("Control+y")
    np.testing.assert_allclose(points(editor), third)
    editor.eventually(editor.page.locator("[aria-label^=Redo]").is_disabled)
    editor.page.click("[aria-label^=Undo]")
    np.testing.assert_allclose(points(editor), second)
    np.testing.assert_allclose(saved(editor), second, atol=0.06)


def test_one_side_is_mirrored_onto_the_other(editor):
    from lfportrait.face.landmarks import MIRRORED

    mirror = np.asarray(MIRRORED)
    drag(editor, 36, [-9, 6])
    editor.page.locator(".mark[data-number='36']").focus()
    before = points(editor)
    editor.page.keyboard.press("m")
    after = points(editor)
    assert set(moved(before, after)) <= set(range(42, 48))
    # Each pair is now as far from the middle line, and level with each other along it.
    line = [27, 28, 29, 30, 33, 51, 62, 66, 57, 8]
    origin = after[line].mean(0)
    along = np.linalg.svd(after[line] - origin)[2][0]
    across = np.array([-along[1], along[0]])
    left, right = after[36:42] - origin, after[mirror[36:42]] - origin
    np.testing.assert_allclose(left @ along, right @ along, atol=0.2)
    np.testing.assert_allclose(left @ across, -(right @ across), atol=0.2)


@pytest.mark.parametrize("degrees", [-25, 25])
def test_a_turned_face_is_mirrored_onto_its_far_or_near_side(page, degrees):
    from lfportrait.face.landmarks import GENERIC_LANDMARKS, MIRRORED

    angle = np.radians(degrees)
    turned = GENERIC_LANDMARKS @ [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0],
                                  [-np.sin(angle), 0, np.cos(angle)]]
    true = 200 + 150 * turned[:, :2] * [1, -1]
    wrong = true.copy()
    wrong[42:48] += [40, -25]
    found = page.run("""async (points) => {
      const { Landmarks } = await import("/static/landmarks.js");
      const face = new Landmarks(points, [400, 400]);
      face.mirror(36);
      const middle = face.mirror(30);
      return [face.points, middle];
    }""", wrong.tolist())
    middle = [number for number in range(68) if MIRRORED[number] == number]
    origin = true[middle].mean(0)
    along = np.linalg.svd(true[middle] - origin)[2][0]
    part = true[36:42] - origin
    plain = origin + 2 * np.outer(part @ along, along) - part
    there = true[MIRRORED[36:42]]
    off = np.abs(np.asarray(found[0])[MIRRORED[36:42]] - there).max()
    assert off < 0.65 * np.abs(plain - there).max(), "nearer than the mirror image of a turned face"
    assert found[1] is False


def test_reset_goes_back_to_what_was_found_and_can_be_undone(editor):
    """The detector's answer stands in for it: it needs networks, and a painted face."""
    found = np.add(points(editor), [3.0, -2.0])

    def answer(route):
        if route.request.method != "DELETE":
            return route.continue_()
        return route.fulfill(json={"points": found.tolist(), "found": found.tolist(),
                                   "edited": False, "width": 400, "height": 400})

    drag(editor, 48, [20, 0])
    changed = points(editor)
    saved(editor)
    editor.page.route("**/landmarks?project=ben", answer)
    editor.page.click("[aria-label='As they were found']")
    editor.until("(x) => Math.abs(Number(document.querySelector('.mark[data-number=\"48\"]')"
                 ".getAttribute('aria-label').match(/x ([\\d.]+)/)[1]) - x) < 0.11", found[48, 0])
    np.testing.assert_allclose(points(editor), found, atol=0.11)
    editor.page.keyboard.press("Control+z")
    np.testing.assert_allclose(points(editor), changed, atol=0.11)


def test_points_stay_put_while_the_picture_is_enlarged_and_moved(editor):
    before, factor = points(editor), scale(editor)
    box = editor.page.locator(".viewport").bounding_box()
    corner = middle(editor, 30)
    editor.page.mouse.move(*corner)
    editor.page.mouse.wheel(0, -300)
    editor.eventually(lambda: scale(editor) > 1.5 * factor)
    np.testing.assert_allclose(middle(editor, 30), corner, atol=1)  # what is under the pointer
    editor.page.click("[aria-label^='Whole']")
    editor.page.mouse.move(box["x"] + 8, box["y"] + box["height"] / 2)
    editor.page.mouse.down()
    editor.page.mouse.move(box["x"] + 60, box["y"] + box["height"] / 2 + 30)
    editor.page.mouse.up()
    np.testing.assert_allclose(points(editor), before)
    assert editor.page.locator("[aria-label^=Undo]").is_disabled()


def test_a_reload_loses_nothing(editor):
    drag(editor, 62, [5, 5])
    after = points(editor)
    saved(editor)
    editor.reload()
    editor.page.wait_for_selector(".mark")
    np.testing.assert_allclose(points(editor), after, atol=0.11)
    # A change that is not written yet is written when the screen is left.
    editor.page.locator(".mark[data-number='62']").focus()
    editor.page.keyboard.press("Shift+ArrowUp")
    last = points(editor)
    editor.go("sitters")
    np.testing.assert_allclose(stored(editor), last, atol=0.06)


def test_two_fingers_enlarge_and_do_not_move_a_point(browser, studio, painting):
    with Opened(browser, studio, width=390, height=844, has_touch=True) as phone:
        phone.go(f"style/ben/{painting[0]}/landmarks")
        phone.page.wait_for_selector(".mark")
        before, factor = points(phone), scale(phone)
        session = phone.context.new_cdp_session(phone.page)
        one, other = middle(phone, 30), middle(phone, 8)
        for step in range(6):
            spread = (other - one) * step * 0.1
            kind = "touchStart" if step == 0 else "touchMove"
            session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [
                {"x": (one - spread)[0], "y": (one - spread)[1], "id": 0},
                {"x": (other + spread)[0], "y": (other + spread)[1], "id": 1}]})
        session.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
        phone.eventually(lambda: scale(phone) > 1.3 * factor)
        np.testing.assert_allclose(points(phone), before)


def test_the_painting_stays_where_it_is_when_a_point_is_taken(browser, studio, painting):
    """In German, whose words are longer."""
    place = """() => {
      const { offsetTop, offsetLeft, offsetWidth, offsetHeight } =
        document.querySelector(".viewport");
      return [offsetTop, offsetLeft, offsetWidth, offsetHeight];
    }"""
    with Opened(browser, studio, locale="de") as each:
        for width in (1280, 950, 390):
            each.page.set_viewport_size({"width": width, "height": 800})
            each.go(f"style/ben/{painting[0]}/landmarks")
            each.page.wait_for_selector(".mark")
            before = each.run(place)
            said = each.page.inner_text(".spoken")
            for number in (0, 24, 48):
                each.page.locator(f".mark[data-number='{number}']").focus()
                assert each.page.inner_text(".spoken") != said
                assert each.run(place) == before
            # Whatever is said of it.
            each.run("""() => {
              document.querySelector(".spoken").textContent = "x ".repeat(200);
              document.querySelector("header [role=status]").textContent = "Saved";
            }""")
            assert each.run(place) == before
            each.go("sitters")
