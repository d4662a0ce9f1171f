"""One photo on the first screen: a sitter is made of it, and its head begins at once."""

import pytest

from tests.studio.web.conftest import picture


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
