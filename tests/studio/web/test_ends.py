"""A studio that is killed and started again, and pages that were open all the while."""

import signal

import pytest

from tests.studio.web.conftest import Opened

pytestmark = pytest.mark.slow  # in a browser; studios that are killed: tests/studio/test_server.py


def killed(studio):
    studio.process.send_signal(signal.SIGKILL)
    studio.process.wait(60)
    studio.process.stdout.close()


def started(studio):
    """The same folder at the same port, with a new key."""
    studio.start(int(studio.home.rsplit(":", 1)[1].strip("/")))


def hurried(each):
    """The page tries to hear of its studio again at once, not after three seconds."""
    each.run("""() => {
      const later = window.setTimeout;
      window.setTimeout = (act, wait, ...more) => later(act, wait === 3000 ? 50 : wait, ...more);
    }""")


def test_a_page_goes_on_with_the_new_address_of_a_killed_studio(browser, portraits_of):
    studio = portraits_of
    with Opened(browser, studio, "photos/ben") as each:
        hurried(each)
        killed(studio)
        each.page.wait_for_selector("#alerts >> text=does not answer", timeout=60000)
        started(studio)
        # It is there, but does not know this page: that is what the page says.
        each.page.wait_for_selector("#alerts >> text=address that the terminal printed",
                                    timeout=60000)
        # Typed into the same window nothing but the address's end is new.
        each.run("(hash) => { location.hash = hash; }", studio.address.partition("#")[2])
        each.page.wait_for_selector("[data-screen=sitters][data-ready]")
        assert "token" not in each.page.url
        assert [one["id"] for one in each.ask("GET", "/api/projects")["projects"]] == ["ben"]


def test_a_page_goes_on_when_another_one_was_let_in(browser, portraits_of):
    studio = portraits_of
    with Opened(browser, studio, "photos/ben") as each:
        hurried(each)
        killed(studio)
        started(studio)
        other = each.context.new_page()
        other.goto(studio.address)
        other.wait_for_selector("[data-screen=sitters][data-ready]")
        other.evaluate("""async () => {
          const { post } = await import("/static/api.js");
          await post("/api/projects", { name: "Cleo", demo: false });
        }""")
        # The first page hears of it without a reload.
        each.until("""async () => {
          const { state } = await import("/static/state.js");
          return state.projects.some(({ name }) => name === "Cleo");
        }""")


def test_a_studio_that_was_ended_by_its_page_is_not_missed(browser, portraits_of):
    with Opened(browser, portraits_of) as each:
        each.page.click("text=End the studio")
        each.page.locator("dialog button.main").click()
        each.page.wait_for_selector("text=The studio has ended.")
        assert portraits_of.process.wait(60) == 0
        each.page.wait_for_timeout(300)
        assert each.page.inner_text("#alerts") == ""
