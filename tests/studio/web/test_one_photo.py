"""One photo on the first screen: a sitter is made of it, and its head begins at once."""

import pytest

from tests.studio.web.conftest import picture

pytestmark = pytest.mark.slow  # in a browser; photos by requests: tests/studio/test_uploads.py


@pytest.fixture
def photo(tmp_path):
    path = tmp_path / "dora: 1.png"
    picture(3, 400).save(path)
    return path


def choose(opened, files):
    opened.go("sitters")
    opened.page.set_input_files(".new-sitter input[type=file]", files)


def test_a_photo_becomes_a_sitter_whose_head_is_begun(opened, photo):
    for name in ("dora- 1", "dora- 1 2"):  # a name that is taken gets a number
        choose(opened, photo)
        opened.page.wait_for_selector("[data-screen=making][data-ready]")
        sitter = opened.run("location.hash.split('/')[1]")
        found = next(one for one in opened.ask("GET", "/api/projects")["projects"]
                     if one["id"] == sitter)
        assert found["name"] == name and found["photos"] == 1
        jobs = [job for job in opened.ask("GET", "/api/jobs")["jobs"] if job["project"] == sitter]
        assert "head" in {job["kind"] for job in jobs}
        if name.endswith("2"):
            opened.ask("POST", f"/api/jobs/{jobs[0]['id']}/cancel")
            break
        opened.until("""async (id) => {
          const { jobsOf } = await import("/static/state.js");
          return jobsOf(id).some(({ kind, state }) => kind === "head" && state === "failed");
        }""", sitter)
        # It shows no face: the line says so, and there is no head to be turned.
        text = opened.page.inner_text(".stage-list")
        assert "no face" in text or "models fetch" in text
        assert opened.page.query_selector(".latest .stage") is None


def test_one_photo_is_enough_to_go_on(opened, photo):
    sitter = opened.sitter("emil")
    opened.go(f"photos/{sitter}")
    opened.page.set_input_files("#photo-files", photo)
    opened.page.wait_for_selector("text=Make the head")
    opened.go(f"making/{sitter}")
    assert "a head is fitted to it" in opened.page.inner_text(".plan")


def shown(opened, job):
    """Hand a job over as the server does; the pages of the heads that are seen, and its picture."""
    opened.run("""async (job) => (await import("/static/state.js")).keepJob(job)""", job)
    return opened.run("""() => [
      [...document.querySelectorAll(".latest .stage.there iframe:not(.coming)")]
        .map((one) => one.src),
      document.querySelector(".latest .still").hidden]""")


def test_the_head_turns_as_far_as_it_is_made(opened):
    """It goes on turning until the finished one takes its place, as it was turned by then."""
    viewed = opened.ask("POST", "/api/projects/anna/viewer", {"version": "portrait"})["page"]
    opened.page.route("**/viewer", lambda route: route.fulfill(json={"page": viewed}))
    stages = [{"name": name, "title": name, "state": "waiting", "progress": None, "note": "",
               "seconds": 0, "left": 5, "picture": None, "page": None}
              for name in ("capture", "reconstruct", "surface")]
    job = {"id": "j-early", "kind": "head", "project": "anna", "name": "anna", "version": None,
           "export": None, "state": "running", "place": 0, "progress": 0.5, "left": 9,
           "notes": [], "error": None, "result": None, "stages": stages}
    opened.go("making/anna")
    assert shown(opened, job) == [[], False]
    stages[1] |= {"state": "running", "page": f"{viewed}?v=1"}
    opened.eventually(lambda: shown(opened, job)[1])
    opened.run("""() => {
      const { contentWindow } = document.querySelector(".latest iframe");
      contentWindow.kept = true;
      contentWindow.lfportrait.orbit.yaw = 0.25;
    }""")
    stages[1] |= {"state": "done"}
    stages[2] |= {"state": "running"}
    (page,), _ = shown(opened, job)
    assert page.endswith("?v=1")
    assert opened.run("document.querySelector('.latest iframe').contentWindow.kept"), "it stays"
    assert "left" in opened.page.inner_text(".phase.running .when")
    shown(opened, {**job, "state": "done"})
    opened.eventually(lambda: not shown(opened, {**job, "state": "done"})[0][0].endswith("?v=1"))
    turned = opened.run(
        "document.querySelector('.latest iframe').contentWindow.lfportrait.orbit.yaw")
    assert turned == pytest.approx(0.25, abs=0.2)
    assert not opened.complaints


def test_several_files_ask_for_a_name(opened):
    opened.go("sitters")
    opened.run("""async () => {
      const data = new DataTransfer();
      for (const n of [1, 2]) data.items.add(new File([new Uint8Array([n])], `${n}.png`));
      document.getElementById("main").dispatchEvent(
        new DragEvent("drop", { dataTransfer: data, bubbles: true, cancelable: true }));
    }""")
    opened.page.wait_for_selector("dialog[open] input")
    opened.page.fill("dialog[open] input", "two")
    opened.page.keyboard.press("Enter")
    opened.page.wait_for_selector("[data-screen=photos][data-ready]")
