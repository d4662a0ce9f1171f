"""The page in a real browser: what it draws, and what it does where something is missing."""

from dataclasses import replace

import numpy as np
import pytest

from lfportrait.capture import Camera
from lfportrait.field import VoxelField
from lfportrait.share import PageConfig, orbit_cameras, write_page
from tests.fields import shell_field
from tests.share.page.browser import Opened, chromium, decibels
from tests.share.page.portraits import stroke_texture

SIZE = 128


def looks(field, opened, views=range(5)):
    """The page's and the renderer's pictures of some views, on black, and opacities."""
    cameras = orbit_cameras(5, SIZE, field)
    for view in views:
        seen = field.render(cameras, view, background=0.0, anisotropic=False)
        yield opened.view(cameras, view), np.clip(seen.color, 0, 1), seen.alpha


def test_it_opens_at_once_without_a_request_or_a_complaint(browser, page):
    with Opened(browser, page) as each:
        assert each.complaints == []
        assert each.requests == [page.resolve().as_uri()]
        # In milliseconds: half a second where nothing else runs.
        assert float(each.page.get_attribute("html", "data-ready")) < 30_000
        assert each.page.title() == "Anna </script> @script@"
        assert each.page.inner_text("#caption").split("\n\n") == [
            "Anna </script> @script@", "A & B", "May 2026"]
        assert [button.inner_text() for button in each.page.query_selector_all("#styles button")
                ] == ["waves", "ink & <b>wash"]
        assert "Anna" in each.page.get_attribute("#canvas", "aria-label")
        # Every button has a name for those who do not see its drawing.
        assert all(button.get_attribute("aria-label") or button.inner_text()
                   for button in each.page.query_selector_all("button"))


def test_views_are_those_of_the_renderer_and_have_its_edges(opened, head):
    for blend, rare, views in ((1, 0.99, range(5)), (0, 1, [1])):
        opened.show(0, 1, blend)
        for drawn, color, alpha in looks(head.mix(strength=blend), opened, views):
            assert decibels(drawn[..., :3], color) > 48
            assert decibels(drawn[..., 3], alpha) > 48
            edge = (alpha > 0.05) & (alpha < 0.95)
            # Neither a dark nor a light seam: what differs at edges leans to no side.
            assert edge.sum() > 50
            assert abs((drawn[..., :3] - color)[edge].mean()) < 0.004
            # A ray that grazes the surface may end on another stroke.
            assert np.quantile(np.abs(drawn[..., :3] - color)[edge], rare) < 0.06


@pytest.mark.slow  # above one is drawn
def test_a_head_from_one_photo_turns_as_far_as_it_is_good_unless_unlocked(browser, tmp_path):
    field = replace(shell_field(16, basis=1), cone=40.0)
    write_page(field, tmp_path / "page.html")
    yaw = "() => 180 / Math.PI * lfportrait.orbit.yaw"
    with Opened(browser, tmp_path / "page.html") as each:
        each.page.locator("#canvas").focus()
        each.run("() => lfportrait.orbit.turn(9, 9)")
        assert each.run(yaw) == pytest.approx(20)
        # Nor does it sway further.
        eye = each.run("() => lfportrait.orbit.camera([90, 90], 1, 0.2).eye")
        assert np.degrees(np.arctan2(eye[0], eye[2])) == pytest.approx(20)
        each.page.keyboard.press("a")
        each.run("() => lfportrait.orbit.turn(5 - 20 * Math.PI / 180, 0)")
        assert each.page.get_attribute("#around", "aria-pressed") == "true"
        assert each.run(yaw) == pytest.approx(np.degrees(5))
        each.press("#around")
        assert each.run(yaw) == pytest.approx(-20)  # the nearer end
        assert each.page.get_attribute("#around", "aria-pressed") == "false"
    write_page(field, tmp_path / "page.html", PageConfig(cone=360))
    with Opened(browser, tmp_path / "page.html") as each:
        each.run("() => lfportrait.orbit.turn(2, 0)")
        assert each.run(yaw) == pytest.approx(np.degrees(2))
        assert each.page.locator("#around").is_hidden()


def sharpness(picture):
    """Mean square of the differences between neighbouring pixels."""
    return (np.diff(picture, axis=0) ** 2).mean() + (np.diff(picture, axis=1) ** 2).mean()


def close(field, turn=20.0):
    """A camera that sees a sixth of the head."""
    camera = orbit_cameras(5, SIZE, field)[2]
    return Camera.arc([turn], distance=float(np.linalg.norm(camera.pose[0, :3, 3])), width=SIZE,
                      height=SIZE, focal=6 * float(camera.focal[0, 0]))


@pytest.mark.slow  # views: above
def test_strokes_are_as_sharp_as_the_renderers(opened, head):
    camera = close(head)
    color = np.clip(head.render(camera, background=0.0, anisotropic=False).color, 0, 1)
    blurred = np.clip(head.with_sh(head.sh).render(camera, background=0.0).color, 0, 1)
    opened.show(0, 1, 1)
    drawn = opened.view(camera, 0)[..., :3]
    assert decibels(drawn, color) > 45 > 25 > decibels(blurred, color)
    assert sharpness(drawn) == pytest.approx(sharpness(color), rel=0.05)
    assert sharpness(blurred) < 0.5 * sharpness(color)


@pytest.mark.slow  # views: above
def test_a_device_with_small_textures_shows_coarser_strokes(opened, head):
    finest, octaves = opened.run("() => [lfportrait.renderer.texture.finest(200),"
                                " lfportrait.renderer.texture.octaves]")
    assert 1 <= finest < octaves
    begin_with = """async (level) => {
      const { renderer } = lfportrait;
      renderer.slots = [null, null];
      renderer.finest = level;
      await renderer.show(0, 1, 1, true);
      return renderer.bytes.reduce((sum, bytes) => sum + bytes, 0);
    }"""
    whole, less = opened.run(begin_with, 0), opened.run(begin_with, 1)
    assert less < whole
    for drawn, color, _ in looks(head, opened, [0]):
        assert decibels(drawn[..., :3], color) > 48  # from there it takes the second level anyway
    camera = close(head)
    sharp = sharpness(np.clip(head.render(camera, background=0.0, anisotropic=False).color, 0, 1))
    assert 0.2 < sharpness(opened.view(camera, 0)[..., :3]) / sharp < 0.9
    opened.run(begin_with, 0)


@pytest.mark.slow  # views: above
@pytest.mark.parametrize("blend", [0.0, 0.3, 1.0])
def test_the_slider_goes_from_one_field_to_the_other(opened, head, blend):
    opened.show(0, 2, blend)
    mixed = head.mix(strength=blend, style=head.styles[1])
    for drawn, color, _ in looks(mixed, opened, [1]):
        assert decibels(drawn[..., :3], color) > 48


# Its kernels take five seconds to compile; test_packing.py reads degree 1 back.
@pytest.mark.slow
@pytest.mark.parametrize("degree", [1, 2])
def test_harmonics_are_kept_where_they_are_asked_for(browser, tmp_path, degree):
    field = shell_field(size=32, basis=9)
    write_page(field, tmp_path / "photo.html", PageConfig(sh=degree))
    # What is left out is zero: fields of fewer coefficients have kernels of their own.
    kept = np.arange(field.sh.shape[2]) < (degree + 1) ** 2
    field = field.with_sh(np.ascontiguousarray(field.sh * kept))
    with Opened(browser, tmp_path / "photo.html") as each:
        assert each.complaints == []
        for drawn, color, _ in looks(field, each, [0, 1, 4]):
            assert decibels(drawn[..., :3], color) > 42


@pytest.mark.slow  # a browser's clicks
def test_slider_buttons_and_keys_are_wired(browser, page):
    with Opened(browser, page, width=400, height=260, reduced_motion="reduce") as each:
        state = "() => [lfportrait.mix.style, lfportrait.renderer.blend, lfportrait.renderer.slots]"
        assert each.run(state)[:2] == [1, 1]
        each.page.fill("#blend", "250")
        each.run("() => lfportrait.mix.busy")
        assert each.run(state) == [1, 0.25, [0, 1]]
        each.press("#styles button:nth-child(2)")
        each.page.wait_for_selector("#styles button:nth-child(2)[aria-pressed=true]")
        each.page.locator("#canvas").focus()
        for key in ("ArrowRight", "ArrowUp", "+"):
            each.page.keyboard.press(key)
        yaw, pitch, zoom = each.run("() => [lfportrait.orbit.yaw, lfportrait.orbit.pitch,"
                                    " lfportrait.orbit.zoom]")
        assert yaw > 0.05 and pitch > 0.05 and zoom > 1.1
        each.page.mouse.move(240, 100)
        each.page.mouse.down()
        each.page.mouse.move(190, 100)
        each.page.mouse.up()
        each.page.mouse.wheel(0, -200)
        turned, closer = each.run("() => [lfportrait.orbit.yaw, lfportrait.orbit.zoom]")
        assert turned > yaw + 0.2 and closer > zoom * 1.2
        each.page.dblclick("#canvas", position={"x": 160, "y": 100})
        assert each.run("() => [lfportrait.orbit.yaw, lfportrait.orbit.zoom]") == [0, 1]
        each.press("#ground")
        assert each.page.get_attribute("html", "data-ground") == "light"
        with each.page.expect_download() as download:
            each.press("#picture")
        assert download.value.suggested_filename == "anna-script-script.png"
        assert each.complaints == []


SLIDE = """async (blend) => {
  const { mix, viewer } = lfportrait;
  await mix.set(blend);
  viewer.slid = Infinity;  // so long as the slider moves, no picture of the mix itself is drawn
  while (viewer.mixing || viewer.moved) await new Promise((done) => setTimeout(done, 5));
}"""


@pytest.mark.slow  # what is mixed: `mix` in tests/field, tests/share
def test_a_slider_mixes_pictures_of_its_ends(browser, page):
    """Nearly exactly: this painting's strokes are beyond black and white, and clipped there."""
    with Opened(browser, page, width=240, height=160, reduced_motion="reduce") as each:
        each.loaded()
        each.run("() => lfportrait.viewer.settled()")
        painting = each.canvas()
        each.run("() => { lfportrait.viewer.slid = 0; lfportrait.viewer.expect(); }")
        each.page.wait_for_function("() => lfportrait.viewer.ends.whole")
        assert np.array_equal(each.canvas(), painting)  # they are drawn unseen
        each.run(SLIDE, 0.4)
        mixed = each.canvas()
        each.run("() => { lfportrait.viewer.slid = 0; return lfportrait.viewer.settled(); }")
        exact = each.canvas()
        assert decibels(mixed / 255, exact / 255) > 36
        assert decibels(painting / 255, exact / 255) < 30
        # Nobody was at the slider: pictures of the ends are coarse at first.
        assert each.run("() => lfportrait.viewer.ends.pairs.length") == 0
        each.run("() => { lfportrait.viewer.slid = 0; lfportrait.viewer.pace = 1; }")
        each.run(SLIDE, 0.5)
        assert each.run("() => lfportrait.viewer.ends.pairs[0].share") < 0.3
        each.run("() => { lfportrait.viewer.pace = 0; }")
        # Seen from elsewhere they are others.
        each.run("() => { lfportrait.orbit.turn(0.3, 0); lfportrait.viewer.change(); }")
        assert each.run("() => Object.keys(lfportrait.renderer.targets)"
                        ".filter((name) => name.startsWith('ends'))") == []
        each.run(SLIDE, 0.2)
        each.page.wait_for_function(
            "() => lfportrait.viewer.ends.whole && !lfportrait.viewer.ends.finer")
        mixed = each.canvas()
        each.run("() => { lfportrait.viewer.slid = 0; return lfportrait.viewer.settled(); }")
        assert decibels(mixed / 255, each.canvas() / 255) > 36
        assert each.complaints == []


@pytest.mark.slow  # waits for a browser
def test_it_sways_unless_motion_is_not_wanted(browser, page):
    count = "() => lfportrait.viewer.drawn"
    with Opened(browser, page, reduced_motion="no-preference") as each:
        each.loaded()

        def drawn_in(milliseconds):
            before = each.run(count)
            each.page.wait_for_timeout(milliseconds)
            return each.run(count) - before

        # A busy browser draws late, and may tell of the wish late.
        assert any(drawn_in(200) for _ in range(40))
        each.page.emulate_media(reduced_motion="reduce")
        each.run("() => lfportrait.viewer.settled()")
        assert any(drawn_in(400) == 0 for _ in range(20))
        canvas, still = each.run("() => [lfportrait.renderer.canvas.height,"
                                 " lfportrait.viewer.still]")
        assert still >= canvas  # every pixel is drawn


def stands(each):
    """The poster is seen, and a sentence; nothing else is offered."""
    assert each.page.is_visible("#poster") and each.page.is_visible("#message")
    assert each.page.eval_on_selector("#poster", "image => image.naturalWidth") > 100
    assert not each.page.is_visible("#tools") and not each.page.is_visible("#canvas")
    return each.told()


@pytest.mark.slow  # a page each
@pytest.mark.parametrize("damage", ["cut", "changed"])
def test_a_damaged_file_shows_the_poster_and_a_sentence(browser, page, tmp_path, damage):
    data = page.read_bytes()
    start = data.index(b'data-stream="set0.0"') + 2000
    hurt = tmp_path / "hurt.html"
    hurt.write_bytes(data[:start] if damage == "cut" else data[:start] + b"AAAA" + data[start + 4:])
    with Opened(browser, hurt, live=False) as each:
        assert ("cut off" if damage == "cut" else "damaged") in stands(each)


@pytest.mark.slow  # a browser of its own
def test_a_browser_without_webgl2_shows_the_poster_and_a_sentence(playwright, page):
    with chromium(playwright, "--disable-3d-apis") as browser, \
            Opened(browser, page, live=False) as each:
        assert "no WebGL2" in stands(each)
        assert not [line for line in each.complaints if "WebGL" not in line]


@pytest.mark.slow  # a page of its own
def test_a_lost_context_shows_the_poster_and_comes_back(browser, page, head):
    with Opened(browser, page) as each:
        each.run("() => { window.gone = lfportrait.renderer.gl.getExtension('WEBGL_lose_context');"
                 " window.gone.loseContext(); }")
        each.page.wait_for_selector("body.standing")
        assert "took the picture away" in stands(each)
        each.run("() => window.gone.restoreContext()")
        each.page.wait_for_selector("body.live")
        assert not each.page.is_visible("#message")
        for drawn, color, _ in looks(head, each, [0]):
            assert decibels(drawn[..., :3], color) > 48


@pytest.mark.slow  # a large field; what a page takes: test_packing.py
@pytest.mark.parametrize(("size", "most"), [(112, 1_300_000), (224, 6_000_000)])
def test_a_large_field_keeps_to_its_megabytes_and_to_a_telephones_memory(browser, tmp_path, size,
                                                                         most):
    """One of 256 lines, cut to the head, and one of half as many."""
    part = size / 224
    shell = shell_field(size=size, basis=1, density=60)
    # Colors as smooth as a photo's, with its noise.
    points = shell.lattice_points()
    colors = 0.4 * np.sin(points @ np.array([[5, 3, 1], [2, 6, 3], [1, 2, 7]])) / 0.28209479
    colors += np.random.default_rng(0).normal(0, 0.01, colors.shape)
    # A texture as large as a head's, and about as strong.
    texture = stroke_texture(shell, 0, pixels=384.0 * part, side=round(900 * part))
    texture = texture.with_texels(texture.texels // np.int8(32))
    field = VoxelField(shell.links, shell.density, colors[:, :, None].astype(np.float32),
                       texture=texture)
    assert len(field.density) > 900_000 * part ** 3
    figures = write_page(field, tmp_path / "large.html")
    assert figures["bytes"] <= most
    assert (tmp_path / "large.html").stat().st_size == figures["bytes"]
    assert figures["shape"] == [size] * 3 and min(figures["texture"]) > 700 * part
    with Opened(browser, tmp_path / "large.html", reduced_motion="reduce") as each:
        textures = each.run("() => lfportrait.renderer.bytes")
        session = each.context.new_cdp_session(each.page)
        session.send("HeapProfiler.collectGarbage")
        heap = session.send("Runtime.getHeapUsage")
        held = sum(each or 0 for each in textures)
        assert 30e6 * part ** 3 < held < 95e6 * part ** 2
        assert held + heap["usedSize"] + heap.get("backingStorageSize", 0) < (
            5e6 + 95e6 * part ** 2)
