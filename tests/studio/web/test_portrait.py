"""The portrait's screen: the viewer, the slider on the graphics, two side by side."""

import pytest

pytestmark = pytest.mark.slow  # in a browser; the page that it shows: tests/share/page

INNER = "(n) => document.querySelectorAll('.stage iframe:not(.coming)')[n].contentWindow.lfportrait"


@pytest.fixture(scope="module")
def portrait(opened_here):
    """The page with the portrait, which the tests here go through one after the other."""
    opened_here.page.set_viewport_size({"width": 900, "height": 700})
    opened_here.go("portrait/anna")
    opened_here.page.wait_for_selector(".stage iframe:not(.coming)", timeout=120000)
    return opened_here


def test_the_version_of_the_commands_is_shown_in_our_viewer(portrait):
    assert portrait.page.locator(".version").count() == 1
    sets = portrait.run(f"() => ({INNER})(0).renderer.header.sets.map(({{ name }}) => name)")
    assert sets[0] == "photo" and "waves" in sets
    assert portrait.page.get_attribute(".stage iframe", "title") == "Portrait of anna"


def test_strength_is_mixed_at_once_and_without_a_request(portrait):
    slider = portrait.page.locator("input[data-name=strength]")
    slider.focus()
    before = len(portrait.requests)
    portrait.page.keyboard.press("Home")
    portrait.until(f"() => ({INNER})(0).renderer.blend === 0")
    assert portrait.requests[before:] == [] or all(
        "/viewer" not in url for url in portrait.requests[before:])
    portrait.page.keyboard.press("End")
    portrait.until(f"() => ({INNER})(0).renderer.blend === 1")


def test_a_slider_goes_between_its_ends_on_the_graphics(portrait):
    """Likeness: both ends are asked for when the slider is taken, what lies between is at once."""
    sets = portrait.run(f"() => ({INNER})(0).renderer.header.sets.length")
    portrait.run("""() => {
      const slider = document.querySelector("input[data-name=identity]");
      slider.dispatchEvent(new PointerEvent("pointerdown"));
    }""")
    portrait.until(f"(n) => String(({INNER})(0).renderer.slots) === `${{n}},${{n + 1}}`", sets)
    # The page reads its own other end a moment after it is shown; that may not take these away.
    assert portrait.run(f"async (n) => {{ const inner = ({INNER})(0); await inner.mix.apply(true);"
                        " return String(inner.renderer.slots); }", sets) == f"{sets},{sets + 1}"
    asked = len(portrait.requests)
    for value in (0.25, 0.8):
        blend = portrait.run(f"""(value) => {{
          const slider = document.querySelector("input[data-name=identity]");
          slider.value = String(value);
          slider.dispatchEvent(new Event("input"));
          return ({INNER})(0).renderer.blend;
        }}""", value)
        assert blend == pytest.approx(value)
    assert [url for url in portrait.requests[asked:] if "/colors" in url] == []
    # Let go, it is the mix itself that is shown, and a mark on a box follows as well.
    portrait.run("() => document.querySelector('input[data-name=identity]')"
                 ".dispatchEvent(new Event('change'))")
    portrait.until(f"(n) => String(({INNER})(0).renderer.slots) === `${{n}},${{n}}`", sets)
    portrait.page.check("#keep-colors")
    portrait.until(f"(n) => document.documentElement && ({INNER})(0).renderer.blend === 0", sets)
    portrait.page.uncheck("#keep-colors")


def both_are_shown(portrait):
    portrait.until("() => document.querySelectorAll("
                   "'.stages-pair.two .stage iframe:not(.coming)').length === 2", seconds=120)


def test_two_side_by_side_turn_together(portrait):
    portrait.go("portrait/anna/portrait/portrait")
    both_are_shown(portrait)
    yaw = f"() => [0, 1].map((n) => ({INNER})(n).orbit.yaw)"
    for which in (0, 1):
        portrait.run(f"(n) => {{ const each = ({INNER})(n); each.orbit.turn(0.2, 0);"
                     " each.viewer.change(); }", which)
        portrait.until(f"() => {{ const [a, b] = ({yaw})(); return a === b && a !== 0; }}")
    assert portrait.run(yaw) == pytest.approx([0.4, 0.4])
    # A reload shows both again.
    portrait.reload()
    both_are_shown(portrait)
    portrait.page.uncheck("#linked")
    portrait.run(f"() => {{ const each = ({INNER})(0); each.orbit.turn(0.3, 0);"
                 " each.viewer.change(); }")
    portrait.page.wait_for_timeout(200)
    first, second = portrait.run(yaw)
    assert first != second
    portrait.page.click("text=Two side by side")
    portrait.until("() => document.querySelectorAll('.stage').length === 1")
    assert portrait.page.url.endswith("portrait/anna/portrait")


def test_strength_is_the_pages_own_only_between_photo_and_painting(portrait):
    """The page of a kept mix goes from the photo to the mix: the server has to color the rest."""
    assert portrait.run("""async () => {
      const { Stage } = await import("/static/stage.js");
      const pair = (...kinds) => {
        const stage = new Stage({ id: "anna" }, "");
        const sets = kinds.map((kind) => ({ kind }));
        Object.defineProperty(stage, "inner", { value: { renderer: { header: { sets } } } });
        return stage.pair;
      };
      return [pair("photo", "style"), pair("photo", "mix", "style"), pair("photo")];
    }""") == [True, False, False]


def test_a_proposed_name_gives_way_to_what_is_typed(portrait):
    portrait.go("sitters")
    portrait.page.get_by_role("button", name="Rename anna").click()
    portrait.page.wait_for_selector("dialog[open]")
    portrait.page.keyboard.type("Berta")
    assert portrait.page.input_value("dialog input") == "Berta"
    portrait.page.keyboard.press("Escape")


def test_what_was_looked_at_on_the_machine_has_names(portrait):
    portrait.go("sitters")
    portrait.page.wait_for_selector("ul.checks strong", state="attached")
    # It is open by itself where something is wrong with the machine.
    portrait.run("() => { document.querySelector('details.card').open = true; }")
    portrait.page.wait_for_selector("ul.checks strong")
    assert "processor" in portrait.page.locator("ul.checks strong").all_inner_texts()


def test_a_new_version_leaves_the_old_one_as_it_was(portrait):
    """What the sliders changed goes to the new version; the old one gets back what it had."""
    sent = portrait.run("""async () => {
      const { Portrait } = await import("/static/screens/portrait.js");
      const sent = [], asked = window.fetch;
      window.fetch = async (path, { method = "GET", body = null } = {}) => {
        sent.push([method, String(path).split("/").slice(-2).join("/"), body && JSON.parse(body)]);
        return new Response('{"id": "two"}', { headers: { "content-type": "application/json" } });
      };
      const screen = Object.assign(Object.create(Portrait.prototype), {
        sitter: { id: "anna" }, chosen: "one", open: false, list: document.createElement("ul"),
        versions: [{ id: "one", name: "one", style: "waves", mix: { strength: 0.6 } }],
        first: { id: "one", mix: { strength: 1 } },
        nameOf: async () => "two", reload: async () => {}, choose: async () => {},
      });
      try { await screen.copy(); } finally { window.fetch = asked; }
      return sent;
    }""")
    assert [each[:2] for each in sent] == [["POST", "one/copy"], ["PATCH", "versions/one"]]
    assert sent[1][2] == {"mix": {"strength": 1}}
