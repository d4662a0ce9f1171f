"""The last screen: the place of the head stays, and files say what they are for."""

import pytest


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
