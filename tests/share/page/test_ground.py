"""A page before a painted ground: its color, and the plane behind the head."""

import dataclasses
import re

import numpy as np
import pytest
from PIL import Image

from lfportrait.capture import Camera
from lfportrait.field import Backdrop, head_points
from lfportrait.lightfield import Display, EncodeConfig, ViewMask, encode, world_ground
from lfportrait.share import orbit_cameras, sweep_cameras, write_page
from tests.fields import head_field
from tests.lightfield.test_ground import checkered
from tests.share.page.browser import Opened, decibels
from tests.share.page.portraits import painted_head


def luma(color):
    values = [int(color[k:k + 2], 16) / 255 for k in (1, 3, 5)]
    return float(np.dot(values, [0.299, 0.587, 0.114]))


@pytest.mark.parametrize("color", [(30, 60, 50), (235, 220, 180), (128, 40, 20), (0, 0, 0)])
def test_the_pages_ground_has_its_hue_and_text_stays_legible(tmp_path, color):
    field = head_field(24)
    picture = np.full((8, 8, 3), color, np.uint8)
    drop = Backdrop(picture, 2.0, np.array([0.0, 0.5, 1.0]), head_points(field))
    write_page(dataclasses.replace(field, backdrop=drop), tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text("utf-8")
    light = np.dot(color, [0.299, 0.587, 0.114]) > 127
    assert f'data-ground="{"light" if light else "dark"}"' in page
    assert f'aria-label="Light ground" aria-pressed="{str(bool(light)).lower()}"' in page
    ground = re.findall(r"--ground: (#[0-9a-f]{6}); --glow", page)[-1]
    assert luma(ground) > 0.85 if light else luma(ground) < 0.2
    order = np.argsort([int(ground[k:k + 2], 16) for k in (1, 3, 5)], kind="stable")
    assert order.tolist() == np.argsort(color, kind="stable").tolist()


def test_without_one_it_is_as_ever(tmp_path):
    write_page(head_field(24), tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text("utf-8")
    assert 'data-ground="dark"' in page and page.count("--ground: #") == 2


SIZE = 96


@pytest.fixture(scope="module")
def grounded():
    """A head with a painting's colors, before a checkered ground."""
    return dataclasses.replace(painted_head(), backdrop=checkered(head_field(48), 80.0).backdrop)


@pytest.fixture(scope="module")
def opened(browser, grounded, tmp_path_factory):
    path = tmp_path_factory.mktemp("grounded") / "page.html"
    write_page(grounded, path)
    with Opened(browser, path) as each:
        each.show(0, 1, 1)
        yield each


def wanted(field, cameras, view):
    ground = world_ground(field, EncodeConfig(), 1 / 80)
    return field.render(cameras, view, background=ground.seen(cameras, view))


@pytest.mark.slow  # in a browser; encoded: tests/lightfield/test_ground.py
def test_the_plane_is_drawn_at_its_depth_with_its_shadow(opened, grounded):
    assert opened.complaints == []
    cameras = sweep_cameras(60.0, 4, SIZE, grounded)
    for view in range(4):  # from 0, 30, 0 and -30 degrees
        drawn, truth = opened.view(cameras, view), wanted(grounded, cameras, view)
        free = truth.alpha < 1e-3
        assert 0.2 < free.mean() < 0.8 and drawn[..., 3].min() == 1
        assert decibels(drawn[..., :3][free], truth.color[free]) > 32
        assert decibels(drawn[..., :3], np.clip(truth.color, 0, 1)) > 32
    # At half its depth, or without its shadow, it would be another picture.
    for other in (EncodeConfig(ground_depth=0.2), EncodeConfig(shadow=0.0)):
        plane = world_ground(grounded, other, 1 / 80)
        beside = grounded.render(cameras, 3, background=plane.seen(cameras, 3)).color
        assert decibels(beside[free], wanted(grounded, cameras, 3).color[free]) < 28


@pytest.mark.slow  # in a browser
def test_its_mirror_images_go_on_beyond_its_borders(opened, grounded):
    camera = Camera.arc([10.0], distance=4.0, width=SIZE, height=SIZE, focal=30.0)
    truth = wanted(grounded, camera, 0)
    free = truth.alpha < 1e-3
    # The page takes the mean of what a pixel sees from so far, ours a point.
    assert decibels(opened.view(camera, 0)[..., :3][free], truth.color[free]) > 22


@pytest.mark.slow  # in a browser
def test_there_is_a_ground_from_all_sides(opened, grounded):
    cameras = orbit_cameras(8, SIZE, grounded)
    views = [opened.view(cameras, view) for view in range(8)]
    assert min(view[..., 3].min() for view in views) == 1
    # From behind one looks straight at it again.
    corner = np.s_[:20, :14, :3]
    assert np.abs(views[0][corner] - views[4][corner]).max() < 0.02
    # Without a jump anywhere: from degree to degree little changes.
    close = orbit_cameras(360, 24, grounded)
    last = None
    for view in [*range(30, 50), *range(170, 190)]:
        drawn = opened.view(close, view)[:5, :4, :3]
        if last is not None and view != 170:
            assert np.abs(drawn - last).max() < 0.15
        last = drawn


@pytest.mark.slow  # in a browser
def test_the_button_goes_from_the_painted_ground_to_plain_ones_and_back(opened, grounded):
    def look():
        corner = opened.view(orbit_cameras(1, SIZE, grounded), 0)[0, 0, 3]
        return float(corner), opened.page.get_attribute("html", "data-ground")

    first = look()
    assert first[0] == 1
    shown = []
    for _ in range(3):
        opened.press("#ground")
        shown.append(look())
    other = {"light": "dark", "dark": "light"}[first[1]]
    assert shown == [(0.0, first[1]), (0.0, other), first]


@pytest.mark.slow  # in a browser
def test_the_photo_has_a_plain_ground(opened, grounded):
    camera = orbit_cameras(1, SIZE, grounded)
    try:
        opened.show(0, 1, 0.0)
        assert opened.view(camera, 0)[0, 0, 3] == 0
        opened.show(0, 1, 0.5)
        assert opened.view(camera, 0)[0, 0, 3] == pytest.approx(0.5, abs=0.01)
    finally:
        opened.show(0, 1, 1)


@pytest.mark.slow  # in a browser
@pytest.mark.parametrize("place", [{}, {"focus": 0.2, "depth": 0.5, "size": 0.6, "shiftX": 0.1}])
def test_coded_pictures_have_it_as_ours_do(opened, grounded, place):
    display = Display(180, 120, views=9, pitch=5.3, slant=0.16, offset=2.1, cone=40, distance=4,
                      name="panel")
    config = EncodeConfig(method="direct", focus=place.get("focus", 0.0),
                          depth_scale=place.get("depth", 1.0), size=place.get("size", 0.8),
                          shift_x=place.get("shiftX", 0.0))
    ours = encode(grounded, display, config, mask=ViewMask.build(display, cache=False)) / 255.0
    theirs = opened.coded(display, **place) / 255.0
    assert ours[0].min() > 0.02
    assert decibels(theirs, ours) > 30
    black = encode(grounded, display, dataclasses.replace(config, ground="black")) / 255.0
    nearer = encode(grounded, display, dataclasses.replace(config, ground_depth=0.2)) / 255.0
    assert decibels(black, ours) < 15 and decibels(nearer, ours) < 26


def test_a_picture_of_ones_own_or_none(grounded, tmp_path):
    figures = write_page(grounded, tmp_path / "page.html", None, EncodeConfig(ground="black"))
    assert figures["ground_bytes"] == 0
    assert '"ground":{' not in (tmp_path / "page.html").read_text("utf-8")
    Image.fromarray(np.full((40, 60, 3), (200, 90, 40), np.uint8)).save(tmp_path / "own.png")
    figures = write_page(head_field(24), tmp_path / "page.html", None,
                         EncodeConfig(ground=str(tmp_path / "own.png")))
    assert 100 < figures["ground_bytes"] < 100_000
    assert '"ground":{' in (tmp_path / "page.html").read_text("utf-8")
