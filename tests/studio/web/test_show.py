"""The last screen: the place of the head stays, and files say what they are for."""

import re

import pytest

pytestmark = pytest.mark.slow  # in a browser; panels by requests: tests/studio/test_displays.py


def test_the_place_of_the_head_survives_a_reload(opened):
    opened.go("show/anna")
    slider = opened.page.get_by_label("depth_scale")
    slider.focus()
    opened.page.keyboard.press("Home")
    opened.until("""async () => {
      const { projects } = await (await fetch("/api/projects")).json();
      return projects.find(({ id }) => id === "anna").placement.depth_scale === 0.2;
    }""")
    opened.reload()
    assert float(opened.page.get_by_label("depth_scale").input_value()) == pytest.approx(0.2)
    assert [text for text in opened.complaints if "400" in text] == []


def test_every_kind_of_file_has_a_purpose_and_a_size(opened):
    opened.go("show/anna/files")
    opened.page.wait_for_selector(".kind-card")
    kinds = opened.ask("GET", "/api/projects/anna/exports")["kinds"]
    cards = opened.page.locator(".kind-card").all_inner_texts()
    assert len(cards) == len(kinds) >= 15
    assert all("about" in card and card.count("\n") >= 3 for card in cards)


def test_the_same_screen_in_the_panels_window_is_pixel_for_pixel(opened):
    opened.go("show/anna")
    with opened.page.expect_popup() as opening:
        opened.run("""async () => {
          const { showOnPanel } = await import("/static/panelwindow.js");
          await showOnPanel("/static/favicon.svg", { width: 32, height: 32 });
        }""")
    panel = opening.value
    panel.wait_for_selector("img")
    shown = panel.evaluate("""() => {
      const image = document.querySelector("img"), box = image.getBoundingClientRect();
      return [box.left, box.top, box.width * devicePixelRatio - image.naturalWidth];
    }""")
    assert shown == [0, 0, 0]
    assert "full screen" in panel.inner_text("#note")
    panel.close()


def drafted(opened, **more):
    """The versions of Anna, with one more that is a preview."""
    def answer(route):
        answer = route.fetch()
        versions = answer.json()["versions"]
        route.fulfill(response=answer, json={"versions": [*versions, {
            **versions[0], "id": "v-try", "name": "Try", "fine": False,
            "from_command_line": False, "style": "builtin-fauve", **more}]})

    opened.page.route("**/api/projects/anna/versions", answer)


def order(opened, name):
    """Order a file by a button of its dialog; what the server is asked for."""
    opened.page.click(".kind-card >> nth=0 >> text=Make")
    opened.page.wait_for_selector("dialog[open]")
    with opened.page.expect_response(lambda answer: answer.request.method == "POST"
                                     and answer.url.endswith("/exports")) as asked:
        opened.page.click(f"dialog >> text={name}")
    return asked.value.request.post_data_json


def test_a_preview_is_called_one_and_its_files_can_wait(opened):
    drafted(opened)
    opened.page.route("**/api/projects/anna/exports", lambda route: route.fulfill(
        status=409, json={"error": {"code": "busy", "message": "not here"}})
        if route.request.method == "POST" else route.continue_())
    opened.go("show/anna/files")
    opened.page.wait_for_selector(".kind-card")
    note = opened.page.locator("[data-screen] > .note")
    # What `make` made is fine.
    opened.page.select_option("header select", "portrait")
    note.wait_for(state="hidden")
    opened.page.click(".kind-card >> nth=0 >> text=Make")
    opened.page.wait_for_selector("dialog[open]")
    assert opened.page.locator("dialog button[type=submit]").count() == 1
    opened.page.keyboard.press("Escape")
    opened.page.select_option("header select", "v-try")
    opened.page.wait_for_selector("[data-screen] > .note:has-text('is a preview')")
    assert "Make it fine" in note.inner_text()
    sent = order(opened, "Make it fine first")
    assert sent["fine"] is True and sent["version"] == "v-try"
    assert order(opened, "Make it of the preview now")["fine"] is False
    # Being made: the note says how far, and a file can wait.
    opened.run("""async () => {
      const { keepJob } = await import("/static/state.js");
      keepJob({ id: "j-9", kind: "fine", project: "anna", version: "v-try", state: "waiting",
                stages: [], notes: [], place: 0, progress: null, left: null });
      keepJob({ id: "j-8", kind: "export", project: "anna", version: "v-try", state: "waiting",
                stages: [], notes: [], place: 0, progress: null, left: null, export: "coded",
                after: "j-9" });
    }""")
    opened.page.wait_for_selector("[data-screen] > .note:has-text('waiting')")
    assert "Make it fine" not in note.inner_text()
    opened.page.wait_for_selector(".files >> text=waiting until the version is fine")
    assert order(opened, "Wait for the fine version")["fine"] is True


def test_a_file_that_is_refused_is_asked_for_again_with_what_was_typed(opened):
    asked = []

    def refuse(route):
        if route.request.method != "POST":
            return route.continue_()
        asked.append(route.request.post_data_json)
        return route.fulfill(status=400, json={"error": {
            "code": "bad_request", "message": "lpi must be another number"}})

    opened.page.route("**/api/projects/anna/exports", refuse)
    opened.go("show/anna/files")
    opened.page.locator(".kind-card", has_text="Lenticular print").get_by_role("button").click()
    dialog = opened.page.locator("dialog")
    for number, lpi in enumerate(("61.5", "62.5"), 1):
        dialog.get_by_label("name").fill("Sheet")
        dialog.get_by_label("lpi").fill(lpi)
        opened.page.click("dialog button[value=yes]")
        opened.page.wait_for_selector("dialog .note.bad:has-text('lpi must be another number')")
        opened.eventually(lambda: len(asked) == number)  # noqa: B023
        assert dialog.get_by_label("lpi").input_value() == lpi
        assert dialog.get_by_label("name").input_value() == "Sheet"
        assert dialog.count() == 1
    assert [one["options"]["lpi"] for one in asked] == [61.5, 62.5]
    opened.page.keyboard.press("Escape")
    opened.until("() => !document.querySelector('dialog')")
    assert opened.page.locator("#alerts .toast").all_inner_texts() == []


def test_a_version_that_turns_fine_is_no_preview_any_more(opened):
    drafted(opened)
    opened.go("show/anna")
    opened.page.select_option("header select", "v-try")
    note = opened.page.locator("[data-screen] > .note")
    note.wait_for()
    opened.page.unroute("**/api/projects/anna/versions")
    drafted(opened, fine=True)
    opened.run("""async () => {
      const { tell } = await import("/static/state.js");
      tell("versions", { project: "anna" });
    }""")
    note.wait_for(state="hidden")
    opened.eventually(lambda: "preview" not in opened.page.inner_text(
        "header select option[value=v-try]"))


def kept(opened, *jobs):
    """Jobs of Anna as if the server had said so."""
    opened.run("""async (jobs) => {
      const { keepJob } = await import("/static/state.js");
      for (const job of jobs) keepJob({ stages: [], notes: [], place: 0, progress: null, left: null,
                                        project: "anna", version: "v-try", ...job });
    }""", list(jobs))


def test_files_say_what_they_are_of_and_can_go_on(opened):
    drafted(opened)
    kinds = opened.ask("GET", "/api/projects/anna/exports")["kinds"]
    opened.page.route("**/api/projects/anna/exports", lambda route: route.fulfill(json={
        "kinds": kinds, "exports": [{
            "id": "x", "name": "Anna.png", "kind": "coded", "version": "v-try", "size_bytes": 2e6,
            "created": 1.0, "fine": False, "file": "/x", "path": "/exports/Anna.png"}]}))
    opened.go("show/anna/files")
    made = opened.page.locator(".files li")
    assert "Coded picture · Try · preview" in made.inner_text()
    stage = {"name": "export", "state": "running", "progress": 0.5, "seconds": 60, "left": 60}
    error = {"code": "not_ready", "message": "the version was not made fine, so the file was not "
             "made: let it go on, and the version is made fine first"}
    kept(opened, {"id": "j-1", "kind": "export", "state": "running", "export": "quilt",
                  "title": "Anna_qs.png", "quality": "preview", "stages": [stage]},
         {"id": "j-2", "kind": "export", "state": "failed", "export": "page", "title": "Anna.html",
          "quality": "fine", "error": error},
         # What it waited for was cancelled.
         {"id": "j-3", "kind": "fine", "state": "cancelled", "title": "Try"},
         {"id": "j-4", "kind": "export", "state": "waiting", "export": "hop", "title": "Anna.hop",
          "quality": "fine", "after": "j-3"})
    opened.eventually(lambda: "left" in made.all_inner_texts()[0])  # and how long it still takes
    running, failed, waiting = made.all_inner_texts()[:3]
    assert "Anna_qs.png" in running and "Quilt · Try · preview" in running
    assert "Page · Try" in failed and "preview" not in failed
    assert "until the version is fine" not in waiting
    with opened.page.expect_request("**/api/jobs/j-2/resume"):
        made.nth(1).get_by_role("button", name="Go on").click()


def test_buttons_of_files_stay_the_same_while_one_is_made(opened):
    drafted(opened)
    opened.go("show/anna/files")
    stage = {"name": "export", "state": "running", "progress": 0.1, "seconds": 60, "left": 60}
    kept(opened, {"id": "j-1", "kind": "export", "state": "running", "export": "quilt",
                  "title": "Anna_qs.png", "progress": 0.1, "stages": [stage]})
    bar, button = (opened.page.locator(f".files li {name}") for name in ("progress", "button"))
    opened.eventually(lambda: bar.count() == 1)
    before, text = button.element_handle(), opened.page.locator(".files li").inner_text
    assert "s left" in text()
    # Between pressing it down and letting it go.
    opened.run("""async () => {
      const { tell, state } = await import("/static/state.js");
      const job = state.jobs.find(({ id }) => id === "j-1");
      Object.assign(job, { progress: 0.9 });
      Object.assign(job.stages[0], { left: 5, due: performance.now() + 5000 });
      tell("progress", { job: "j-1", stage: "export" });
    }""")
    opened.eventually(lambda: bar.evaluate("bar => bar.value") == 0.9 and "a few s" in text())
    assert before.evaluate("button => button.isConnected")


def test_two_versions_of_a_sitter_have_names_in_the_queue(opened):
    opened.go("making/anna")
    kept(opened, {"id": "j-1", "kind": "fine", "state": "running", "title": "First",
                  "name": "Anna"},
         {"id": "j-2", "kind": "fine", "state": "waiting", "title": "Second", "name": "Anna"})
    rows = opened.page.locator("ol.queue li")
    opened.eventually(lambda: rows.count() == 2)
    assert "First" in rows.nth(0).inner_text() and "Second" in rows.nth(1).inner_text()
    opened.page.wait_for_selector("section.stage-list h2:text-is('Fine portrait: First')")
    opened.page.wait_for_selector("p.lead:has-text('painted')")  # photos have no part in it


def test_the_portrait_says_how_far_its_fine_version_is(opened):
    drafted(opened)
    opened.go("portrait/anna/v-try")
    stage = {"name": "stylize", "state": "running", "progress": 0.1, "seconds": 10, "left": 90}
    kept(opened, {"id": "j-1", "kind": "fine", "state": "running", "stages": [stage]})
    link = opened.page.locator("a", has_text="Fine version")
    opened.eventually(lambda: "10 %" in link.inner_text())
    opened.run("""async () => {
      const { tell, state } = await import("/static/state.js");
      const job = state.jobs.find(({ id }) => id === "j-1");
      Object.assign(job.stages[0], { due: performance.now() + 10000 });
      tell("progress", { job: "j-1", stage: "stylize" });
    }""")
    # Half of it, or more where the page is drawn late.
    opened.eventually(lambda: re.search(r"[5-9]\d %", link.inner_text()))


def test_every_choice_of_a_file_says_what_it_is(opened):
    opened.go("show/anna/files")
    opened.page.wait_for_selector(".kind-card")
    kinds = [kind for kind in opened.ask("GET", "/api/projects/anna/exports")["kinds"]
             if kind["options"]]
    assert len(kinds) >= 5
    for language, code in (("English", "en"), ("Deutsch", "de")):
        opened.page.get_by_role("combobox").filter(has_text="Deutsch").select_option(label=language)
        opened.page.wait_for_selector(f"html[lang={code}]", state="attached")
        notes = opened.run("""async (kinds) => {
          const { said } = await import("/static/i18n.js");
          return kinds.flatMap(({ options }) => options.map(({ note }) => [note, said(note)]));
        }""", kinds)
        assert all(len(note) > 10 for note, _ in notes), notes
        assert all((note == shown) is (code == "en") for note, shown in notes), notes
    card = opened.page.locator(".kind-card", has_text="Linsenrasterdruck")
    card.wait_for()
    assert ".0 MB" not in card.inner_text(), "nobody knows it that well"
    card.get_by_role("button").click()
    paper = opened.page.locator("dialog").get_by_label("size")
    assert "a4-landscape" in opened.page.locator(f"#{paper.get_attribute('aria-describedby')}"
                                                 ).inner_text()
    # An empty number would be 0; half a picture is refused before anything typed is lost.
    opened.page.locator("dialog").get_by_label("lpi").fill("")
    opened.page.click("dialog button[value=yes]")
    assert opened.page.locator("dialog[open]").count() == 1
    opened.page.keyboard.press("Escape")
    opened.page.locator(".kind-card", has_text="Flacher Film").get_by_role("button").click()
    opened.page.locator("dialog").get_by_label("frames").fill("2.5")
    opened.page.click("dialog button[value=yes]")
    assert opened.page.locator("dialog[open]").count() == 1
