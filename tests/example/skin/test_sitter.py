"""What a sitter shows where: lists over the pixels that own a point."""

from dataclasses import replace

import numpy as np
import pytest

from lfportrait.capture import Camera
from lfportrait.errors import UserError
from lfportrait.example import face_size
from lfportrait.example.guides.filters import grey, skin_distance
from lfportrait.example.skin.hair import (
    _classified_hair,
    around_face,
    settled_hair,
    without_bare_ears,
)
from lfportrait.example.skin.sitter import Skin, _clothes, _depth
from lfportrait.field.surface import SurfaceGraph
from tests.example.skin.conftest import PIXELS
from tests.portraits import HEAD_LANDMARKS

CHIN = HEAD_LANDMARKS[8, 1]


def test_lists_are_those_of_the_owning_pixels(skin, points):
    count = int(skin.atlas.own.sum())
    assert np.array_equal(skin.index, np.flatnonzero(skin.atlas.own))
    for values in (skin.tone, skin.detail, skin.appearance, skin.contours, skin.clothes, skin.ears,
                   skin.seen):
        assert values.shape == (count,) and values.dtype == np.float32
        assert np.isfinite(values).all()
    assert skin.hair is not None
    assert skin.flat.shape == (count, 2)
    assert np.allclose(skin.flat, skin.plane.unwrap(points), atol=1e-5)
    for share in (skin.contours, skin.clothes, skin.ears, skin.seen):
        assert share.min() >= 0 and share.max() <= 1
    luma = grey(skin.atlas.color).ravel()[skin.index]
    assert np.allclose(skin.tone + skin.detail, luma, atol=1e-5)
    assert np.abs(skin.detail).mean() < 0.3 * skin.tone.std()
    assert skin.face == pytest.approx(PIXELS * face_size(skin.plane.unwrap(HEAD_LANDMARKS)))


def test_pixels_know_their_owners_number_in_the_lists(skin):
    slots = skin.slots
    assert np.array_equal(slots.ravel()[skin.index], np.arange(len(skin.index)))
    assert np.array_equal(slots >= 0, skin.atlas.owner >= 0)
    known = slots >= 0
    assert np.array_equal(skin.index[slots[known]], skin.atlas.owner[known])


def test_regions_are_told_by_landmarks_and_by_the_sitter(skin, points):
    labels, names = skin.labels
    assert labels.shape == (len(points), len(names)) and labels.dtype == np.uint8
    assert np.abs(labels.sum(axis=1, dtype=int) - 255).max() <= 6
    named = np.array(names)[labels.argmax(axis=1)]
    x, y, z = points.T
    for name, chosen in {
            "nose": (np.abs(x) < 0.03) & (np.abs(y + 0.17) < 0.02) & (z > 0),
            "skin": (np.abs(np.abs(x) - 0.25) < 0.06) & (np.abs(y + 0.2) < 0.04) & (z > 0),
            "lips": (np.abs(x) < 0.1) & (np.abs(y + 0.32) < 0.01) & (z > 0),
            "hair": y > 0.4, "clothes": y < -0.8}.items():
        assert chosen.sum() > 10 and (named[chosen] == name).mean() > 0.9, name
    # Behind them there are none.
    assert not np.isin(named[z < 0], ("brows", "eyes", "nose", "lips")).any()


def test_detail_is_strong_where_colors_change(skin, points):
    hairline = (np.abs(points[:, 1] - points[:, 2]) < 0.02) & (points[:, 1] > 0.25)
    plain = (np.abs(points[:, 0]) < 0.2) & (points[:, 2] > 0) & (np.abs(points[:, 1]) < 0.1)
    assert hairline.sum() > 100 and plain.sum() > 100
    assert np.abs(skin.detail[hairline]).mean() > 3 * np.abs(skin.detail[plain]).mean()
    assert skin.contours[hairline].mean() > 0.7 > 0.4 > skin.contours[plain].mean()


def test_ears_lie_at_the_ends_of_the_jaw(skin, points):
    ears = skin.ears > 0.5
    for end, side in ((0, -1), (16, 1)):
        mine = points[ears & (side * points[:, 0] > 0)]
        assert len(mine) > 50
        assert np.linalg.norm(mine - HEAD_LANDMARKS[end], axis=1).max() < 0.45
        assert (mine[:, 2] < HEAD_LANDMARKS[end, 2]).all()
    # Brows and the foot of the nose.
    assert points[ears, 1].max() < 0.12 and points[ears, 1].min() > -0.38


def test_clothes_are_what_differs_from_the_face_below_the_chin(skin, points):
    assert not skin.clothes[points[:, 1] > CHIN].any()
    blue, bare = points[:, 1] < -0.76, (points[:, 1] < CHIN) & (points[:, 1] > -0.68)
    assert (skin.clothes[blue] > 0.5).mean() > 0.98
    assert (skin.clothes[bare] < 0.5).mean() > 0.98


def test_what_no_photo_saw_below_the_chin_is_dressed_as_what_is_around(skin, points):
    """It is dark and grey in a field, as a jacket may be."""
    x, y, z = points.T
    colors = skin.atlas.color.reshape(-1, 3)[skin.index].copy()
    hollow = (np.abs(x) < 0.15) & (y < CHIN - 0.02) & (y > CHIN - 0.12) & (z > 0)
    sleeve = (np.abs(x) < 0.15) & (y < -0.8) & (z > 0)
    seen = np.ones(len(points), np.float32)
    depth = (skin.plane.origin[1] - y) / skin.plane.height

    def dressed():
        return _clothes(skin.plane, colors, np.float32(points), skin.flat, seen, depth, None)

    assert hollow.sum() > 50 and sleeve.sum() > 50
    colors[hollow] = 0.15
    assert (dressed()[hollow] > 0.5).mean() > 0.3
    seen[hollow | sleeve] = 0
    colors[sleeve] = colors[np.abs(points - HEAD_LANDMARKS[30]).sum(axis=1) < 0.3].mean(axis=0)
    assert (dressed()[hollow] > 0.5).mean() < 0.05
    assert (dressed()[sleeve] > 0.5).mean() > 0.9


def test_shade_below_a_chin_is_worn_by_nobody(skin, points):
    """A collar as dark and brown is, as it goes on further down."""
    x, y, z = points.T
    plain = skin.atlas.color.reshape(-1, 3)[skin.index]
    depth = (skin.plane.origin[1] - y) / skin.plane.height
    hollow = (np.abs(x) < 0.15) & (y < CHIN - 0.02) & (y > CHIN - 0.12) & (z > 0)
    cheeks = plain[np.abs(points - HEAD_LANDMARKS[30]).sum(axis=1) < 0.3].mean(axis=0)

    def dressed(dark, colors):
        colors = colors.copy()
        colors[dark] = 0.3 * cheeks
        return _clothes(skin.plane, colors, np.float32(points), skin.flat,
                        np.ones(len(points), np.float32), depth, None)[hollow & (depth > 1.1)]

    assert dressed(hollow, plain).max() < 0.1
    assert np.median(dressed(y < CHIN - 0.02, plain)) > 0.6


def test_what_no_photo_shows_is_unseen(field, skin, points):
    assert (skin.seen == 1).all()
    front = Camera.arc(np.linspace(-40, 40, 90), distance=4.0, width=60, height=60, focal=90.0)
    seen = Skin.of(field, HEAD_LANDMARKS, front, PIXELS, networks=False)
    assert seen.seen[(points[:, 2] > 0.3) & (points[:, 1] > -0.2)].min() > 0.9
    assert seen.seen[points[:, 2] < -0.5].max() == 0
    # Grain at a graze is no structure: where photos look along a surface it counts less than that.
    assert (seen.contours <= skin.contours * seen.seen + 1e-6).all()
    grazed = (seen.seen > 0.2) & (seen.seen < 0.8)
    assert grazed.any() and seen.contours[grazed].max() == 0
    assert np.abs(seen.detail[grazed]).max() < 1e-6
    facing = (points[:, 2] > 0.3) & (np.abs(points[:, 0]) < 0.2)
    assert np.isclose(seen.contours, skin.contours)[facing].mean() > 0.8


def test_the_network_tells_hair_and_what_it_does_not_see_follows(field, points, monkeypatch):
    asked = []

    def dark(image, size):
        asked.append(image.shape)
        return (image.mean(axis=-1) < 80).astype(np.float32)

    monkeypatch.setattr("lfportrait.models.missing", lambda names: [])
    monkeypatch.setattr("lfportrait.face.hair_mask", dark)
    skin = Skin.of(field, HEAD_LANDMARKS, pixels=PIXELS)
    assert asked and all(rows == columns for rows, columns, _ in asked)
    assert len(asked) < len(skin.atlas.cameras)  # crown and throat are not shown to it
    truth = skin.atlas.color.reshape(-1, 3)[skin.index].mean(axis=1) < 80 / 255
    assert ((skin.hair > 0.5) == truth).mean() > 0.96
    assert (skin.clothes <= 1 - skin.hair + 1e-6).all()


def test_without_the_network_hair_is_told_by_its_color(field, skin, points, monkeypatch):
    monkeypatch.setattr("lfportrait.models.missing", list)
    told = Skin.of(field, HEAD_LANDMARKS, pixels=PIXELS)
    assert np.array_equal(told.hair, skin.hair)
    truth = skin.atlas.color.reshape(-1, 3)[skin.index].mean(axis=1) < 80 / 255
    above = points[:, 1] > CHIN
    assert ((told.hair > 0.5) == truth)[above].mean() > 0.93
    # A network that finds none is not believed where the crown is of another color.
    monkeypatch.setattr("lfportrait.models.missing", lambda names: [])
    monkeypatch.setattr("lfportrait.face.hair_mask",
                        lambda image, size: np.zeros(image.shape[:2], np.float32))
    assert Skin.of(field, HEAD_LANDMARKS, pixels=PIXELS).hair is not None


def test_hair_at_the_temples_has_no_level_edge(skin):
    """Hair by its color, that ends on a line which goes down beside the face."""
    up, angle = np.meshgrid(np.linspace(-0.5, 1, 61), np.linspace(0, 1.5, 61))
    up, angle = up.ravel(), angle.ravel()
    truth = up > 0.45 - 0.35 * np.clip((angle - 0.4) / 0.4, 0, 1)
    colors = np.where(truth[:, None], [0.2, 0.15, 0.1], [0.9, 0.7, 0.6]) + np.random.default_rng(
        0).normal(0, 0.02, (len(up), 3))
    flat = np.stack([angle * skin.plane.radius, -up * skin.plane.height], axis=1)
    told = _classified_hair(skin.plane, colors.astype(np.float32), flat.astype(np.float32),
                       np.ones(len(up), np.float32), np.zeros(len(up), np.float32), up > 0.7,
                       (angle < 0.7) & (up < 0.1), around_face(skin.plane, flat, -0.75))
    near = (angle < 0.88) & (up > 0.1)
    assert ((told > 0.5) == truth)[near].mean() > 0.99
    # Brows are no hair, however dark.
    assert not told[(up < 0.1) & (angle < 0.88)].any()


def test_hair_goes_on_behind_as_the_photos_leave_it(skin):
    """A strip of the nape that no photo saw is bare between bare places, hairy between hairy."""
    up, angle = np.meshgrid(np.linspace(-0.7, 1, 86), np.linspace(0, np.pi, 126))
    up, angle = up.ravel(), angle.ravel()
    seen = (angle < 0.9 * np.pi).astype(np.float32)
    for line in (-0.35, -0.6):
        truth = (up > line) & (angle > 0.9) | (up > 0.45)
        colors = np.where(truth[:, None], [0.2, 0.15, 0.1], [0.9, 0.7, 0.6])
        colors[seen == 0] = 0.5
        flat = np.stack([angle * skin.plane.radius, -up * skin.plane.height], axis=1)
        told = _classified_hair(skin.plane, colors.astype(np.float32), flat.astype(np.float32),
                                seen, np.zeros(len(up), np.float32), up > 0.7,
                                (angle < 0.7) & (up < 0.1), around_face(skin.plane, flat, -0.75))
        clear = (np.abs(up - line) > 0.08) & (seen == 0) & (up < 0.2)
        assert ((told > 0.5) == truth)[clear].mean() > 0.97


def test_a_seam_where_photos_end_is_hair_between_hair_and_skin_between_skin():
    """Half of a sheet is hair; photos end in the middle of it, where nothing is sure."""
    x, y = (part.ravel().astype(float) for part in np.meshgrid(np.arange(80), np.arange(50)))
    truth = y < 25
    colors = np.where(truth[:, None], [0.3, 0.2, 0.1], [0.8, 0.6, 0.5])
    seen = np.clip((50 - x) / 10, 0, 1).astype(np.float32)
    seam = np.abs(x - 42) < 4
    told = np.where(seam, np.where(truth, 0.3, 0.7), truth).astype(np.float32)
    graph = SurfaceGraph.over(np.stack([x, y, 0 * x], axis=1), colors, 1.0)
    found = settled_hair(graph, told, seen)
    assert ((told > 0.5) == truth)[seam].mean() < 0.1
    assert ((found > 0.5) == truth).mean() > 0.99
    # What photos show for sure stays to the bit.
    sure = (seen == 1) & ~seam
    assert np.array_equal(found[sure], told[sure])


@pytest.mark.parametrize("color, bare", [((0.7, 0.53, 0.45), True), ((0.3, 0.2, 0.15), False)],
                         ids=["in the shade", "under hair"])
def test_an_ear_that_no_photo_faces_is_hair_only_if_it_looks_so(skin, color, bare):
    up, angle = np.meshgrid(np.linspace(-0.9, 1.2, 120), np.linspace(-2, 2, 240))
    up, angle = up.ravel(), angle.ravel()
    hair = np.clip(10 * (up - 0.4), 0, 1).astype(np.float32)
    ears = (np.hypot(np.abs(angle) - 1.5, up + 0.2) < 0.2).astype(np.float32)
    seen = (np.abs(angle) < 1.2).astype(np.float32)
    hair[ears > 0] = 0.6
    noise = np.random.default_rng(0).normal(0, 0.02, (len(up), 3))
    colors = np.where(hair[:, None] > 0.5, (0.35, 0.22, 0.15), (0.9, 0.7, 0.6)) + noise
    right = (ears > 0) & (angle > 0)
    colors[ears > 0] = (0.35, 0.22, 0.15)
    colors[right] = np.array(color) + noise[right]
    points = np.stack([np.sin(angle), up, np.cos(angle)], axis=1) + skin.plane.origin
    flat = np.stack([angle * skin.plane.radius, -up * skin.plane.height], axis=1)
    given = [values.astype(np.float32) for values in (points, colors, flat)]
    found = without_bare_ears(skin.plane, *given, seen, ears, hair)
    assert np.array_equal(found[~right], hair[~right])
    assert np.array_equal(found[right], 0 * hair[right] if bare else hair[right])
    # What photos show for sure stays, and so does a head of one color.
    assert np.array_equal(without_bare_ears(skin.plane, *given, seen + 1, ears, hair), hair)
    assert without_bare_ears(skin.plane, *given, 0 * seen, ears, hair) is hair


def test_strands_in_the_color_of_skin_are_hair_and_a_bare_patch_is_not(skin):
    """Hair by its color with strands that shine, a bare patch, an ear, and a hairline."""
    up, angle = np.meshgrid(np.linspace(-0.5, 1.2, 341), np.linspace(0, 1.5, 601))
    up, angle = up.ravel(), angle.ravel()
    truth = up > 0.45
    from_patch, from_ear = (np.hypot(angle - x, up - 0.85) for x in (0.35, 1.15))
    patch, ear = from_patch < 0.15, (from_ear < 0.15).astype(np.float32)
    strand = truth & (up > 0.5) & (np.abs((angle * 10) % 1 - 0.5) < 0.12)
    strand &= (from_patch > 0.3) & (from_ear > 0.3)
    colors = np.where(truth[:, None], [0.35, 0.22, 0.15], [0.9, 0.7, 0.6])
    colors[strand | (from_ear < 0.02)] = (0.72, 0.55, 0.46)
    colors[patch] = (0.9, 0.7, 0.6)
    flat = np.stack([angle * skin.plane.radius, -up * skin.plane.height], axis=1)
    found = _classified_hair(skin.plane, colors.astype(np.float32), flat.astype(np.float32),
                        np.ones(len(up), np.float32), ear, truth & ~strand & ~patch,
                        (angle < 0.7) & (up < 0.1), around_face(skin.plane, flat, -0.75))
    assert strand.sum() > 1000 and patch.sum() > 1000 and (from_ear < 0.02).sum() > 20
    assert np.quantile(found[strand], 0.02) > 0.7
    assert found[from_patch < 0.1].max() < 0.05
    assert found[(up < 0.44) & (up > 0.35)].max() < 0.05
    # What is pale in an ear is no strand.
    assert found[from_ear < 0.02].max() < 0.05


def test_a_network_that_contradicts_itself_is_not_believed(field, skin, monkeypatch):
    random = np.random.default_rng(0)
    monkeypatch.setattr("lfportrait.models.missing", lambda names: [])
    monkeypatch.setattr("lfportrait.face.hair_mask", lambda image, size: np.float32(
        random.random(image.shape[:2]) < 0.4))
    assert np.array_equal(Skin.of(field, HEAD_LANDMARKS, pixels=PIXELS).hair, skin.hair)


def test_a_head_of_one_color_has_no_hair(field):
    plain = field.with_sh(np.full((len(field.density), 3, 1), 0.4))
    assert Skin.of(plain, HEAD_LANDMARKS, pixels=30.0, networks=False).hair is None


def test_a_head_that_knows_its_hair_is_believed_whatever_its_color(field, monkeypatch):
    """Fair hair that hangs down on one side; a network would find something else."""
    rows = field.lattice_points()
    known = replace(field, sh=np.full_like(field.sh, 0.4),
                    hair=np.where(rows[:, 0] > 0.1, 255, 0).astype(np.uint8))
    monkeypatch.setattr("lfportrait.models.missing", lambda names: [])
    monkeypatch.setattr("lfportrait.face.hair_mask",
                        lambda image, size: np.ones(image.shape[:2], np.float32))
    skin = Skin.of(known, HEAD_LANDMARKS, pixels=30.0)
    x = skin.atlas.points.reshape(-1, 3)[skin.index, 0]
    voxel = float(field.spacing.max())
    assert skin.hair is not None and (skin.hair[x > 0.1 + voxel] > 0.99).all()
    assert (skin.hair[x < 0.1 - voxel] < 0.01).all()
    # What lies in between has a share of it.
    between = skin.hair[np.abs(x - 0.1) < voxel]
    assert ((between > 0.1) & (between < 0.9)).any()
    assert not (skin.clothes * skin.hair > 0.01).any()


def test_what_is_seen_of_a_soft_shell_has_places(field):
    """Light from before the surface, which lies where half of it is gone, takes its paint, too."""
    soft = replace(field, density=0.1 * field.density)
    places = Skin.of(soft, HEAD_LANDMARKS, pixels=PIXELS, networks=False).rows
    nowhere = np.isnan(places[:, 0])
    cameras = Camera.arc(np.array([0.0, 90.0, 180.0]), distance=4.0, width=100, height=100,
                         focal=165.0)
    for view in range(3):
        weights = soft.sample_weights(cameras, view)
        seen = np.bincount(weights.rows, weights.weights, len(places))
        assert seen[nowhere].sum() < 0.015 * seen.sum()
    # What lies outside of the shell, and deep within, has none.
    assert nowhere.any()


def test_too_few_landmarks_are_told(field):
    landmarks = np.full((68, 3), np.nan)
    landmarks[:10] = HEAD_LANDMARKS[:10]
    with pytest.raises(UserError, match="only 10 of 68"):
        Skin.of(field, landmarks, pixels=PIXELS, networks=False)


def test_distance_from_the_skin_s_colors():
    random = np.random.default_rng(0)
    colors = np.float64([0.8, 0.6, 0.5]) + random.normal(0, 0.02, (300, 3))
    face = np.arange(300) < 200
    colors[200:250] *= 0.6  # shaded
    colors[250:] = (0.2, 0.3, 0.7)
    away = skin_distance(colors, face)
    assert np.median(away[:200]) < 2
    assert away[200:250].max() < 0.5 * away[250:].min()
    assert not skin_distance(colors, face & (np.arange(300) < 30)).any()


def test_shoulders_may_be_higher_than_a_chin(skin):
    places = np.float32([(0, CHIN, 0.5), (0.4, CHIN + 0.1, 0), (0.55, CHIN + 0.1, -0.3),
                         (-0.55, CHIN + 0.1, -0.3), (0.55, skin.plane.origin[1], 0)])
    middle, jaw, *shoulders, brows = _depth(skin.plane, places, True)
    assert middle == pytest.approx(1, abs=0.05) and jaw < 1 and min(shoulders) > 1.3 and brows < 1
    assert np.allclose(_depth(skin.plane, places, False)[2:4], jaw)


def test_a_head_on_which_the_network_sees_no_hair_is_bald(field, monkeypatch):
    """Unlike one of which nothing is known; specks and a shaven nape are no hair."""
    plain = field.with_sh(np.full((len(field.density), 3, 1), 0.4))

    def specks(image, size):
        out = np.zeros(image.shape[:2], np.float32)
        out[:, ::40] = 1.0
        return out

    monkeypatch.setattr("lfportrait.models.missing", lambda names: [])
    monkeypatch.setattr("lfportrait.face.hair_mask", specks)
    hair = Skin.of(plain, HEAD_LANDMARKS, pixels=30.0).hair
    assert hair is not None and hair.dtype == np.float32 and not hair.any()
    monkeypatch.setattr("lfportrait.face.hair_mask", lambda image, size: np.float32(
        np.random.default_rng(0).random(image.shape[:2]) < 0.4))
    assert Skin.of(plain, HEAD_LANDMARKS, pixels=30.0).hair is None, "it may have some"
