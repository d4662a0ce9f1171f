"""What is chosen, answered or removed by a click, on each screen."""

import pytest

from tests.job.test_pipeline import PANEL
from tests.studio.web.conftest import picture

pytestmark = pytest.mark.slow  # in a browser; the requests behind it: tests/studio


def test_the_wizard_is_gone_through_to_its_end(opened, tmp_path):
    """Half a band, no bands, the views from the middle, clean edges; each answer is written."""
    page = opened.page
    opened.go("show/anna")
    # A small one: its patterns are drawn at once.
    (tmp_path / "small.toml").write_text(PANEL.to_toml())
    page.set_input_files("#display-file", tmp_path / "small.toml")
    page.wait_for_selector(".toast:has-text('small')")
    copy = page.input_value("#display")
    # The panel's own window has a test of its own.
    opened.run("() => { window.open = () => window; }")
    page.click("text=Pattern wizard")
    page.wait_for_selector(".wizard form")
    before = opened.ask("GET", f"/api/displays/{copy}/wizard")["display"]
    follow = page.locator(".wizard").get_by_role("button", name="Next")

    def answer(step, *words, number=None):
        page.wait_for_selector(f".wizard li[aria-current=step]:has-text('{step}')")
        if number is not None:
            page.locator(".wizard input").fill(number)
        for word in words:
            page.locator(".wizard").get_by_role("button", name=word, exact=True).click()
        with page.expect_response("**/wizard"):
            follow.click()

    follow.click()
    page.wait_for_selector("#alerts .toast:has-text('Answer the questions')")
    answer("Lenses", "Upright", number="1.5")
    page.wait_for_selector(".wizard .note:has-text('pitch')")
    answer("Lenses", "No bands", "White")
    views = before["views"]
    answer("Views", "Yes", number=f"{views // 2 - 1}, {views // 2}")
    answer("Edges", "Clean")
    page.wait_for_selector(".wizard >> text=The panel is set")
    after = opened.ask("GET", f"/api/displays/{copy}/wizard")["display"]
    assert 1 / after["pitch"] - 1 / before["pitch"] == pytest.approx(1.5 / 3 / before["width"])
    page.locator(".wizard").get_by_role("button", name="Close").click()
    opened.until("() => !document.querySelector('.wizard')")
    opened.until("() => document.activeElement.textContent === 'Pattern wizard'")
    opened.ask("DELETE", f"/api/displays/{copy}")


def test_the_keyboard_stays_where_a_list_is_drawn_again(opened):
    held = opened.run("""async () => {
      const { fill, h } = await import("/static/dom.js");
      const list = h("ul");
      document.body.append(list);
      const item = (text) => h("li", {}, h("button", { text }));
      const draw = (...names) => fill(list, names.map(item));
      const seen = [];
      const note = () => seen.push(document.activeElement.textContent);
      draw("a", "b", "c");
      list.querySelectorAll("button")[1].focus();
      draw("new", "a", "b", "c");
      note();
      draw("new", "a", "c");
      note();
      draw("new", "a");
      note();
      draw();
      seen.push(document.activeElement === document.body);
      list.remove();
      return seen;
    }""")
    assert held == ["b", "c", "a", True], "the same, what moved up, the last"


def test_what_the_machine_says_stays_open_while_jobs_come_and_go(opened):
    opened.go("sitters")
    opened.until("() => document.querySelectorAll('.checks li').length")
    opened.page.click(".machine summary")
    shut = opened.run("() => document.querySelector('.machine details').open")
    opened.run("""async () => {
      const { tell } = await import("/static/state.js");
      tell("job", { id: "j-none", kind: "check", stages: [] });
    }""")
    assert opened.run("() => document.querySelector('.machine details').open") is shut
    assert opened.run("() => document.activeElement.tagName") == "SUMMARY"


def test_a_name_that_is_refused_is_asked_for_again_with_why(opened):
    opened.go("sitters")
    opened.page.click("text=New sitter")
    opened.page.wait_for_selector("dialog[open] input")
    opened.page.keyboard.type("Anna")
    opened.page.keyboard.press("Enter")
    opened.page.wait_for_selector("dialog .note.bad:has-text('already')")
    assert opened.page.input_value("dialog input") == "Anna"
    opened.page.keyboard.press("Escape")
    opened.until("() => !document.querySelector('dialog')")
    opened.until("() => document.activeElement.textContent === 'New sitter'")


def test_an_address_that_nobody_wrote_shows_the_sitters(opened):
    for place in ("photos/%E0%A4%A", "show/nobody", "evil/../x"):
        opened.run("(place) => { location.hash = place; }", place)
        opened.reload()
        assert opened.page.get_attribute("[data-ready]", "data-screen") == "sitters", place
        assert not [each for each in opened.complaints if "URI" in each], place


def test_a_removed_version_gives_way_to_another_one(opened):
    """What is shown after the one that was shown; the server's answers are played."""
    shown = opened.run("""async () => {
      const { Portrait } = await import("/static/screens/portrait.js");
      let left = [{ id: "one", name: "one", mix: {} }, { id: "two", name: "two", mix: {} }];
      const asked = window.fetch, shown = [];
      window.fetch = async (path, { method = "GET" } = {}) => {
        if (method === "DELETE") left = left.filter(({ id }) => !String(path).endsWith(id));
        return new Response(JSON.stringify(method === "GET" ? { versions: left } : { ok: true }));
      };
      const screen = Object.assign(Object.create(Portrait.prototype), {
        sitter: { id: "anna" }, chosen: "two", open: true, save: { stop() {} },
        list: document.createElement("ul"),
        versions: [...left], address() {}, drawVersions() {}, drawActions() {},
        async display() { shown.push(this.version.id); },
      });
      try {
        const removing = screen.remove(left[1]);
        document.querySelector("dialog button.danger").click();
        await removing;
      } finally { window.fetch = asked; }
      return [shown, screen.open];
    }""")
    assert shown == [["one"], False], "shown again, and nothing of the other is written into it"


def test_the_faces_of_a_painting_that_comes_are_looked_for(opened, tmp_path):
    """Several: it is asked which one. None: it is said."""
    face = [[60.0 + n, 80.0 + n] for n in range(68)]
    count = 0
    for number in range(3):  # all of them: a slow page may still ask for a picture
        picture(40 + number, 200).save(tmp_path / f"new{number}.png")
    opened.go("style/ben")
    opened.page.route("**/picture?*size=0*", lambda route: route.fulfill(
        body=(tmp_path / f"new{count}.png").read_bytes(), content_type="image/png"))
    opened.page.route("**/faces?*", lambda route: route.fulfill(json={
        "faces": [{"number": n + 1, "box": [20 + 80 * n, 20, 60, 80], "landmarks": face}
                  for n in range(count)], "width": 200, "height": 200,
        "chosen": 1 if count else None}))
    for count in range(3):
        opened.page.set_input_files("#painting-files", [tmp_path / f"new{count}.png"])
        if count == 2:
            opened.page.wait_for_selector("dialog[open] .face-box")
            assert opened.page.locator(".face-box").count() == 2
            assert opened.page.locator(".face-box[aria-pressed=true]").inner_text() == "1"
            opened.page.keyboard.press("Escape")
        else:
            word = "is in the gallery" if count else "No face was found in new"
            opened.page.wait_for_selector(f".toast:has-text('new{count}') >> text={word}")
        own = next(one["id"] for one in opened.ask("GET", "/api/styles?project=ben")["styles"]
                   if one["name"] == f"new{count}")
        opened.ask("DELETE", f"/api/styles/{own}?project=ben")


def test_a_video_can_be_removed_and_photos_come_instead(opened, tmp_path):
    (tmp_path / "turn.mp4").write_bytes(b"no film, but of its kind")
    picture(50).save(tmp_path / "one.png")
    sitter = opened.sitter("Vera")
    opened.go(f"photos/{sitter}")
    page = opened.page
    page.set_input_files("#photo-files", [tmp_path / "turn.mp4"])
    page.wait_for_selector(".shot-card")
    page.set_input_files("#photo-files", [tmp_path / "one.png"])
    page.wait_for_selector(".note.bad:has-text('remove what is there')")
    page.get_by_role("button", name="Remove turn.mp4").click()
    opened.until("() => !document.querySelector('.shot-card')")
    page.set_input_files("#photo-files", [tmp_path / "one.png"])
    page.wait_for_selector(".shot-card:has-text('one.png')")


def test_stop_stops_what_was_read_ahead(opened, tmp_path):
    for number in range(8):
        picture(60 + number).save(tmp_path / f"{number}.png")
    sitter = opened.sitter("Stella")
    opened.go(f"photos/{sitter}")
    held = []
    opened.page.route("**/uploads/*", lambda route: held.append(route))
    opened.page.set_input_files("#photo-files", sorted(tmp_path.iterdir()))
    while len(held) < 4:
        opened.page.wait_for_timeout(20)
    opened.page.click("text=Stop")
    for route in held:
        route.abort()
    opened.page.wait_for_timeout(300)
    assert len(held) == 4 and opened.ask("GET", f"/api/projects/{sitter}/photos")["photos"] == []


def test_a_batch_takes_each_sitter_in_the_style_of_its_version(opened):
    """The page names versions alone: projects and styles beside them would be all with all."""
    asked = []
    opened.page.route("**/api/batch", lambda route: (
        asked.append(route.request.post_data_json), route.fulfill(json={
            "file": "/there/jobs.toml", "text": "[[sitter]]", "command": "lfportrait batch it",
            "out": "/there/jobs-results", "notes": [
                "the batch paints Try without its identity: lfportrait restyle adds that to its "
                "styled.npz"]})))
    opened.go("show/anna/files")
    opened.page.wait_for_selector(".kind-card")
    opened.page.click("summary:has-text('Several at once')")
    opened.page.locator("details li input").first.check()
    opened.page.click("text=Write a batch file")
    opened.page.wait_for_selector("details pre")
    (sent,) = asked
    assert set(sent) == {"displays", "versions"} and sent["versions"] == [["anna", "portrait"]]
    # What to do with it, where the result will be, and what is lost.
    said = opened.page.inner_text("details [role=status]")
    assert "into a terminal" in said and "lfportrait batch it" in said
    assert "/there/jobs-results/index.html" in said and "without its identity" in said


def test_a_study_has_the_name_of_a_sitter_only_where_it_is_of_one(opened):
    asked = []
    opened.page.route("**/api/study", lambda route: (
        asked.append(route.request.post_data_json), route.fulfill(json={
            "file": "/there/study.txt", "text": "lfportrait study\n", "command": "lfportrait study",
            "page": "/there/study/index.html"})))
    opened.page.route("**/api/projects/ben/versions", lambda route: route.fulfill(json={
        "versions": [{"id": "v-1", "name": "One", "fine": False}]}))
    opened.go("show/anna/files")
    opened.page.click("summary:has-text('Several at once')")
    picks = opened.page.locator("details li input")
    picks.nth(1).wait_for()
    rows = opened.page.locator("details li").all_inner_texts()
    assert [row.endswith("(preview)") for row in rows] == [False, True], "a study takes fine ones"
    for count in (1, 2):
        picks.nth(count - 1).check()
        with opened.page.expect_response("**/api/study"):
            opened.page.click("text=Write a study file")
    assert [one["title"] for one in asked] == ["anna", ""]
    opened.until("""() => document.querySelector("details [role=status]").innerText
      .includes("/there/study/index.html")""")
    assert opened.page.locator("details [role=status] pre").count() == 1, "it is said once"
