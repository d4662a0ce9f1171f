"""An object on a table is cut out of its photos although the network's mattes are wrong."""

from dataclasses import replace

import numpy as np
import pytest

from lfportrait.capture import Camera, Capture, matte_agreement
from lfportrait.cli import reconstruction
from lfportrait.errors import UserError
from lfportrait.field.geometry.mattes import Solid, _cut, backing_planes, cut_out, trim
from lfportrait.field.kernels.depth_maps import confirm_depth, fuse_distance, outline_distance
from lfportrait.job.prepare import cut_person

TABLE, RADIUS, VIEWS = -0.75, 0.75, 24


def texture(points, seed):
    """A texture in space, in [0.1, 0.9]: many waves, so that matches are unique."""
    random = np.random.default_rng(seed)
    waves = random.standard_normal((60, 3)) * 11.0
    phase = random.uniform(0, 2 * np.pi, 60)
    total = np.sin(points @ waves.T + phase).sum(axis=1)
    return np.clip(0.5 + 0.08 * total, 0.1, 0.9)


def photo(cameras, view):
    """A ball on a table, lit alike and both grey; the picture and the ball's mask."""
    origins, directions = cameras.rays(view)
    middle = np.einsum("ij,ij->i", origins, directions)
    inner = middle**2 - (origins**2).sum(axis=1) + RADIUS**2
    ball = inner > 0
    image = np.full(len(directions), 0.35)
    down = directions[:, 1] < -1e-3
    along = np.where(down, (TABLE - origins[:, 1]) / np.where(down, directions[:, 1], 1), 0)
    point = origins + along[:, None] * directions
    table = down & (np.linalg.norm(point, axis=1) < 4.0)
    image[table] = 0.6 * texture(point[table], 1)
    near = (origins - (middle + np.sqrt(np.maximum(inner, 0)))[:, None] * directions)[ball]
    image[ball] = 0.3 + 0.6 * texture(near, 2)
    shape = int(cameras.height[view]), int(cameras.width[view])
    grey = np.uint8(np.clip(image, 0, 1) * 255 + 0.5).reshape(shape)
    return np.dstack([grey] * 3), ball.reshape(shape)


def turntable():
    """Photos once around the ball, every eighth held out, and the true masks."""
    angle = np.linspace(-180, 180, VIEWS, endpoint=False)
    rings = [Camera.arc(angle[start::2], distance=3.2, width=100, height=76, focal=87,
                        pitch=pitch) for start, pitch in ((0, 20), (1, 45))]
    order = np.arange(VIEWS).reshape(2, -1).T.ravel()
    cameras = Camera.concatenate(rings)[order]
    shots = [photo(cameras, view) for view in range(VIEWS)]
    capture = Capture(cameras, [image for image, _ in shots], None,
                      [f"{view}.png" for view in range(VIEWS)], np.arange(VIEWS) % 8 == 4)
    return capture, [mask for _, mask in shots]


def wrong_mattes(masks):
    """What a poor network says: nothing in a third of the photos, the table, too, in a sixth."""
    mattes = []
    for view, mask in enumerate(masks):
        matte = mask.astype(np.float32)
        if view % 3 == 1:
            matte[:] = 0
        elif view % 6 == 2:
            matte[30:] = 1
        mattes.append(matte)
    return mattes


def overlap(matte, mask):
    person = matte > 0.5
    return (person & mask).sum() / (person | mask).sum()


@pytest.fixture(scope="module")
def scene():
    return turntable()


@pytest.fixture(scope="module")
def result(scene):
    """What is made of the wrong mattes: seconds of work that two tests look at."""
    capture, masks = scene
    return cut_out(capture, wrong_mattes(masks))


@pytest.fixture
def known(scene, result, monkeypatch):
    """For the wrong mattes the result is known: it is not made again."""
    def cut_out_of(capture, mattes, *_):
        assert all(np.array_equal(*images) for images in zip(capture.images, scene[0].images))
        assert all(np.array_equal(*pair) for pair in zip(mattes, wrong_mattes(scene[1])))
        return result

    monkeypatch.setattr("lfportrait.field.geometry.cut_out", cut_out_of)


def test_all_photos_show_the_object_whatever_the_network_says(scene, result):
    _, masks = scene
    given = wrong_mattes(masks)
    assert np.mean([overlap(matte, mask) > 0.9 for matte, mask in zip(given, masks)]) < 0.6
    scores = [overlap(matte, mask) for matte, mask in zip(result, masks)]
    assert min(scores) > 0.87
    assert np.median(scores) > 0.93
    assert all(matte.dtype == np.float32 and matte.min() >= 0 and matte.max() <= 1
               for matte in result)


@pytest.mark.slow  # the shape is found once more
def test_a_photo_without_the_object_is_named(scene):
    capture, masks = scene
    # One camera is turned away.
    pose = capture.cameras.pose.copy()
    pose[5, :3, :3] = pose[5, :3, :3] @ np.diag([-1.0, 1.0, -1.0])
    cameras = replace(capture.cameras, pose=pose)
    with pytest.warns(UserWarning, match=r"1 of 24 photos do not show the object.*: 5\.png"):
        result = cut_out(replace(capture, cameras=cameras), wrong_mattes(masks))
    assert result[5].max() < 0.5
    scores = [overlap(matte, mask) for matte, mask in zip(result, masks)]
    assert min(scores[:5] + scores[6:]) > 0.87


@pytest.mark.parametrize(("seen", "follows"), [(19, True), (13, False)])
def test_edges_are_followed_unless_they_contradict_the_outline(seen, follows):
    y, x = np.mgrid[:90, :120]
    radius = np.hypot(y - 45, x - 60)
    random = np.random.default_rng(0)
    grey = np.where(radius < seen, 200, 70) + random.normal(0, 4, radius.shape)
    coarse = np.clip(0.5 - (radius - 20) / 12, 0, 1).astype(np.float32)
    matte, followed = _cut(np.dstack([np.uint8(grey)] * 3), coarse)
    assert followed == follows
    edge = seen if follows else 20
    assert overlap(matte, radius < edge) > 0.97


@pytest.mark.slow  # the shape is found once more
def test_held_out_photos_tell_nothing_of_the_shape(scene, result):
    capture, masks = scene
    images = [image if not out else image[::-1].copy()
              for image, out in zip(capture.images, capture.held_out)]
    other = Capture(capture.cameras, images, None, capture.names, capture.held_out)
    blind = [np.ones_like(matte) if out else matte
             for matte, out in zip(wrong_mattes(masks), capture.held_out)]
    again = cut_out(other, blind)
    for view in capture.training():
        assert np.array_equal(result[view], again[view])


@pytest.mark.slow  # agreement: below
def test_the_network_is_taken_at_its_word_where_it_agrees_with_itself(scene, known):
    capture, masks = scene
    cut, how = cut_person(capture, soft=[mask.astype(np.float32) for mask in masks])
    assert how == cut.figures["mattes"] == "network"
    assert min(overlap(matte / 255, mask) for matte, mask in zip(cut.alphas, masks)) > 0.94
    cut, how = cut_person(capture, soft=list(wrong_mattes(masks)))
    assert how == cut.figures["mattes"] == "geometry"
    assert min(overlap(matte / 255, mask) for matte, mask in zip(cut.alphas, masks)) > 0.87


@pytest.mark.slow  # depth is searched twice; once: above
def test_depth_frees_good_mattes_of_what_lies_elsewhere(scene):
    capture, masks = scene
    given = [mask.astype(np.float32) for mask in masks]
    for matte in given:  # a piece of the table, in every photo
        matte[64:72, 22:62] = 1
    result = trim(capture, given)
    assert np.mean([overlap(matte, mask) for matte, mask in zip(given, masks)]) < 0.88
    assert np.mean([overlap(matte, mask) for matte, mask in zip(result, masks)]) > 0.93
    plain = [mask.astype(np.float32) for mask in masks]
    # A matte of something else is none of the solid's business.
    other = np.zeros_like(plain[3])
    other[:15] = 1
    result = trim(capture, [*plain[:3], other, *plain[4:]])
    assert np.array_equal(result[3], other)
    assert min(overlap(matte, mask) for view, (matte, mask) in enumerate(zip(result, masks))
               if view != 3) > 0.97


def test_photos_without_texture_have_no_shape(scene):
    capture, masks = scene
    capture = replace(capture, images=[np.full_like(image, 90) for image in capture.images])
    assert cut_out(capture, wrong_mattes(masks)) is None


@pytest.mark.slow  # no shape: above
def test_what_most_mattes_call_no_person_is_not_cut_out(scene, monkeypatch):
    capture, masks = scene
    random = np.random.default_rng(0)
    # The network sees its persons elsewhere in every photo.
    given = [np.roll(mask, random.integers(30, 68), axis=1).astype(np.float32) for mask in masks]
    results = []

    def heard(*arguments):
        results.append(cut_out(*arguments))
        return results[-1]

    monkeypatch.setattr("lfportrait.field.geometry.cut_out", heard)
    cut, how = cut_person(capture, soft=given)
    assert results == [None]
    assert cut.alphas is None and how.startswith("none")
    cut, how = cut_person(capture, soft=[np.zeros((76, 100), np.float32)] * len(capture))
    assert cut.alphas is None and how.startswith("none")


@pytest.mark.slow  # what is cut out: above
def test_reconstruct_cuts_the_object_out_unless_told_otherwise(scene, known, tmp_path,
                                                               monkeypatch):
    capture, masks = scene
    capture.save(tmp_path / "capture")
    config = reconstruction.ReconstructConfig(resolutions=(24,), rays=(0.02,),
                                              mvs_init=False)
    given = iter(wrong_mattes(masks))
    monkeypatch.setattr("lfportrait.face.person_matte", lambda image, up: next(given))
    figures = reconstruction.Reconstruct(tmp_path / "capture", tmp_path / "a.npz", quiet=True,
                                         config=config).run()
    assert figures["mattes"] == "geometry"

    def missing(image, up):
        raise UserError("no weights")

    monkeypatch.setattr("lfportrait.face.person_matte", missing)
    with pytest.raises(UserError, match="--keep-background"):
        reconstruction.Reconstruct(tmp_path / "capture", tmp_path / "b.npz", quiet=True,
                                   config=config).run()
    figures = reconstruction.Reconstruct(tmp_path / "capture", tmp_path / "c.npz", quiet=True,
                                         config=config, keep_background=True).run()
    assert figures["mattes"].startswith("none")


def test_agreement_tells_mattes_that_fit_each_other_from_others(scene):
    capture, masks = scene
    good = [mask.astype(np.float32) for mask in masks]
    assert matte_agreement(capture.cameras, good).min() > 0.85
    assert np.mean(matte_agreement(capture.cameras, wrong_mattes(masks)) > 0.6) < 0.7
    one = [np.zeros_like(good[0]), *good[1:]]
    agree = matte_agreement(capture.cameras, one)
    assert agree[0] == 0 and agree[1:].min() > 0.85


def cloud(random, count=4000):
    """Points of the ball and of the table, and what the mattes say of them."""
    away = random.standard_normal((count, 3))
    ball = RADIUS * away / np.linalg.norm(away, axis=1, keepdims=True)
    table = np.column_stack([random.uniform(-1.7, 1.7, count), np.full(count, TABLE),
                             random.uniform(-1.7, 1.7, count)])
    points = np.concatenate([ball, table]) + random.normal(0, 0.008, (2 * count, 3))
    return points, np.repeat([0.7, 0.3], count).astype(np.float32)


def test_a_table_is_found_and_a_back_is_not(scene):
    points, persons = cloud(np.random.default_rng(1))
    above = scene[0].cameras.position
    planes = backing_planes(points, persons, above, 0.7)
    assert len(planes) == 1
    assert planes[0, 1] > 0.999 and abs(planes[0, 3] - TABLE) < 0.01
    # What the mattes call the person like the rest belongs to it; cameras stand before a table.
    assert not len(backing_planes(points, np.full(len(points), 0.7, np.float32), above, 0.7))
    assert not len(backing_planes(points, persons, above * [1, -1, 1], 0.7))
    assert not len(backing_planes(points[:4000], persons[:4000], above, 0.7))


def test_a_table_and_a_wall_are_both_found():
    random = np.random.default_rng(2)
    points, persons = cloud(random)
    wall = np.column_stack([random.uniform(-1.4, 1.4, 3000), random.uniform(TABLE, 1.5, 3000),
                            np.full(3000, -1.1)])
    cameras = Camera.arc(np.linspace(-60, 60, 9), distance=3, width=9, height=9, focal=9,
                         pitch=30).position
    planes = backing_planes(np.concatenate([points, wall]),
                            np.append(persons, np.full(3000, 0.1, np.float32)), cameras, 0.7)
    assert len(planes) == 2
    assert planes[:, 1].max() > 0.999 and planes[:, 2].max() > 0.999


def test_fused_distances_equal_the_plain_ones():
    random = np.random.default_rng(0)
    cameras = Camera.arc([25.0, -40.0], distance=2.0, width=12, height=9, focal=10.0)
    depths = random.uniform(1.2, 2.8, (2, 9, 12)).astype(np.float32)
    depths[random.random(depths.shape) < 0.3] = 0
    mattes = random.random(depths.shape).astype(np.float32)
    axis, reach = np.linspace(-0.91, 0.87, 19), 0.3
    found = fuse_distance(axis, np.stack([cameras.row(0), cameras.row(1)]), depths, mattes,
                          np.array([[9, 12], [9, 12]]), reach)
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    pixels, along = cameras.project(np.stack([x, y, z], -1).reshape(-1, 3))
    expected = np.zeros((4, 19**3))
    for view in range(2):
        column, row = (np.floor(pixels[view, :, i]).astype(int) for i in (0, 1))
        inside = (along[view] > 0) & (column >= 0) & (column < 12) & (row >= 0) & (row < 9)
        place = np.clip(row, 0, 8), np.clip(column, 0, 11)
        ahead = (depths[view][place] - along[view]) / reach
        counts = inside & (depths[view][place] > 0) & (ahead >= -1)
        near = counts & (ahead <= 1)
        assert 100 < near.sum() < counts.sum()
        expected += [np.where(counts, np.minimum(ahead, 1), 0), counts,
                     np.where(near, mattes[view][place], 0), near]
    # A point on the border of two pixels may be in either.
    for one, other in zip(found, expected):
        assert np.count_nonzero(~np.isclose(one.ravel(), other, atol=1e-5)) <= 2


def test_depth_is_confirmed_as_by_projection():
    random = np.random.default_rng(3)
    cameras = Camera.arc([0.0, 12.0, -30.0], distance=2.0, width=24, height=18, focal=22.0)
    inverses = (1.0 / random.uniform(1.9, 2.1, (3, 18, 24))).astype(np.float32)
    inverses[random.random(inverses.shape) < 0.2] = np.nan
    rows, slacks = np.stack([cameras.row(view) for view in range(3)]), np.array([0.006, 0.003])
    confirmed = np.empty((18, 24), bool)
    confirm_depth(inverses[0], rows[0], rows[1:], inverses[1:], np.array([[18, 24], [18, 20]]),
                  slacks, confirmed)
    v, u = np.nonzero(np.isfinite(inverses[0]))
    local = np.stack([(u + 0.5 - 12) / 22, (v + 0.5 - 9) / 22, np.ones(len(u))], 1)
    world = (local / inverses[0][v, u, None]) @ cameras.pose[0, :3, :3].T + cameras.position[0]
    expected = np.zeros((18, 24), bool)
    for other, (slack, wide) in enumerate(zip(slacks, (24, 20)), 1):
        pixels, along = cameras[other].project(world)
        column, row = np.floor(pixels[0]).astype(int).T
        inside = (along[0] > 0) & (row >= 0) & (row < 18) & (column >= 0) & (column < wide)
        there = inverses[other][np.clip(row, 0, 17), np.clip(column, 0, 23)]
        expected[v, u] |= inside & (abs(there - 1 / along[0]) < slack)
    assert 20 < expected.sum() < 0.9 * len(u)
    assert np.count_nonzero(confirmed != expected) <= 1


def test_the_outline_of_a_ball_is_where_rays_touch_it():
    size, reach = 60, 1.2
    axis = reach * (2 * (np.arange(size) + 0.5) / size - 1)
    spacing = axis[1] - axis[0]
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    away = np.sqrt((x - 0.1)**2 + y**2 + z**2) - 0.6
    distance = np.clip(away / (3 * spacing), -1, 1).astype(np.float32)
    camera = Camera.arc([33.0], distance=3, width=80, height=60, focal=80, pitch=15)
    solid = Solid(float(axis[0]), float(spacing), distance)
    outline = solid.outline(camera).ravel()
    origins, directions = camera.rays(0)
    nearest = np.linalg.norm(np.cross(origins - [0.1, 0, 0], directions), axis=1) - 0.6
    band = abs(nearest) < 1.5 * spacing
    assert band.sum() > 100
    assert abs(outline - nearest)[band].max() < 0.25 * spacing
    assert np.array_equal(outline < 0, nearest < 0) or (
        abs(nearest[(outline < 0) != (nearest < 0)]).max() < 0.25 * spacing)
    # Empty space is leapt over without anything being missed.
    plain = outline_distance(distance, np.zeros(distance.shape, np.uint8), axis[0], spacing,
                             camera.row(0), 60, 80)
    assert np.allclose(np.clip(plain * 3 * spacing, -2 * spacing, None).ravel(),
                       np.clip(outline, -2 * spacing, None), atol=0.1 * spacing)


def test_outlines_that_follow_few_rays_equal_those_of_all():
    """The blocks that are skipped, on two balls and a thin bar between them."""
    size, reach = 64, 1.2
    axis = reach * (2 * (np.arange(size) + 0.5) / size - 1)
    spacing = axis[1] - axis[0]
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    away = np.minimum(np.sqrt((x - 0.5)**2 + y**2 + z**2) - 0.4,
                      np.sqrt((x + 0.5)**2 + y**2 + z**2) - 0.3)
    away = np.minimum(away, np.hypot(y, z) - 0.01 + np.maximum(abs(x) - 0.5, 0))
    solid = Solid(float(axis[0]), float(spacing),
                  np.clip(away / (3 * spacing), -1, 1).astype(np.float32))
    camera = Camera.arc([12.0], distance=3, width=83, height=61, focal=80, pitch=5)
    outline = solid.outline(camera) / spacing
    # One pixel at a time: a picture of a row and a column, whose grid holds its own ray.
    every = np.empty_like(outline)
    for row in range(61):
        for column in range(83):
            one = camera.row(0)
            one[14:] -= column, row
            every[row, column] = 3 * outline_distance(solid.distance, solid._clear, solid.first,
                                                      spacing, one, 1, 1)[0, 0]
    deep = every < -2.4
    assert deep.sum() > 200 and np.all(outline[deep] < -2.0)
    rest = ~deep & (outline > -2.4)
    assert np.sum(rest & (every < 2.5)) > 100
    assert abs(np.minimum(outline, 2.5) - np.minimum(every, 2.5))[rest].max() < 0.1
