"""Materials of exemplar and sitter: skin, hair, neck, clothes, background, features."""

from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from scipy.ndimage import binary_dilation, binary_erosion

from lfportrait import cache
from lfportrait.example import Exemplar, Regions
from lfportrait.example.guides.regions import find_regions
from lfportrait.example.kernels.labels import move_to_material
from lfportrait.example.painter import picture_materials as storage
from lfportrait.example.painter.materials import (
    RARE,
    ExemplarMaterials,
    even_uses,
    guide_agreement,
    light_neck,
    main_material,
    material_guides,
    pieces,
)
from lfportrait.example.painter.patch_painter import GuideWeights
from lfportrait.example.painter.picture_materials import (
    CLOTHES,
    EARS,
    FEATURES,
    GROUND,
    HAIR,
    NECK,
    SKIN,
    SmallPicture,
    hide_ground,
    known_shares,
    material_shares,
    one_hue,
    painted_shares,
    picture_shares,
)
from lfportrait.example.patches import PatchSearch, PatchSource, PatchTarget, synthesise_patches
from lfportrait.example.skin.hair import below_hair, hair_by_place, without_bays
from lfportrait.example.skin.painting import DARKEST, sitter_looks, sitter_shares
from lfportrait.example.surface_guide import HeadPlane
from lfportrait.labels import BY_HAND, MATERIALS
from lfportrait.labels import PICTURE_LABELS as LABELS
from tests.portraits import HEAD_LANDMARKS, drawn_face

ALL = np.ones(len(MATERIALS), bool)
PLANE = HeadPlane(HEAD_LANDMARKS)
SHADE = 101, 80, 65
"""The drawn face's skin in the shade."""


@pytest.fixture(scope="module")
def drawn(painter):
    """The drawn face with a short neck."""
    image, (x, y) = painter.exemplar.image.copy(), painter.exemplar.landmarks[8].astype(int)
    image[y + 1:y + 7, x - 12:x + 12] = image[y - 20, x]
    return Exemplar(image, painter.exemplar.landmarks)


@pytest.fixture(scope="module")
def shares(painter, drawn):
    return picture_shares(drawn, painter.transfer.regions, painter.transfer.labels)


def _labels(count, seed=0):
    """Random soft labels that sum to about 255."""
    parts = np.random.default_rng(seed).dirichlet(np.full(len(LABELS), 0.3), count)
    return np.round(255 * parts).astype(np.uint8)


def _sitter(count, seed=0, hair=True):
    """What of a skin the materials need, at random."""
    random = np.random.default_rng(seed)
    hairy, clothes, ears, tone, seen = random.random((5, count)).astype(np.float32)
    return SimpleNamespace(cached=lambda _, make: make(), hair=hairy if hair else None,
                           clothes=clothes, ears=ears, tone=tone, seen=seen,
                           detail=random.normal(0, 0.05, count).astype(np.float32),
                           plane=PLANE, flat=random.uniform(-1, 1, (count, 2)).astype(np.float32))


def _like(sitter, **other):
    return SimpleNamespace(**{**vars(sitter), **other})


def test_a_body_is_neck():
    labels = 255 * np.eye(len(LABELS), dtype=np.uint8)
    found = {name: MATERIALS[share.argmax()] for name, share in zip(LABELS,
                                                                   material_shares(labels))}
    assert found == {**dict.fromkeys(("brows", "eyes", "nose", "lips"), "features"),
                     "skin": "skin", "hair": "hair", "body": "neck", "background": "background"}
    assert np.allclose(material_shares(_labels(200)).sum(axis=1), 1, atol=1e-5)
    assert not material_shares(np.zeros((3, len(LABELS)), np.uint8)).any()


def test_materials_of_a_drawn_face(drawn, shares):
    assert np.allclose(shares.sum(axis=-1), 1, atol=1e-4) and shares.min() > -1e-6
    image, points = drawn.image, drawn.landmarks
    nose, chin = points[30].astype(int), points[8].astype(int)

    def at(place):
        return MATERIALS[shares[place[1], place[0]].argmax()]

    assert at(nose) == at(points[66].astype(int)) == "features"
    assert at(((points[30] + points[14]) / 2).astype(int)) == "skin"
    assert at((nose[0], int(points[24, 1] - 0.5 * (chin[1] - points[24, 1])))) == "hair"
    # A neck, and then a high collar.
    assert at((chin[0], chin[1] + 1)) == "neck"
    assert at((chin[0], chin[1] + 8)) == at((chin[0], image.shape[0] - 3)) == "clothes"
    assert at((3, 3)) == "background"
    # The red of the clothes is nowhere skin or hair, the blue behind them nowhere clothes.
    red = np.abs(image - np.array([160.0, 60, 50])).max(axis=-1) < 30
    blue = np.abs(image - np.array([90.0, 130, 170])).max(axis=-1) < 30
    assert shares[red][:, [SKIN, HAIR, FEATURES]].mean() < 0.05
    assert shares[blue][:, GROUND].mean() > 0.95


def test_below_the_jaw_colors_tell_neck_and_hair_from_clothes(painter):
    exemplar, regions = painter.exemplar, painter.transfer.regions
    image = exemplar.image.copy()
    x, y = exemplar.landmarks[8].astype(int)
    neck, lock = np.s_[y:y + 25, x - 9:x + 9], np.s_[y - 4:y + 25, x + 9:x + 14]
    image[neck], image[lock] = image[y - 20, x], image[10 + y // 3, x]
    hair, person = np.zeros(image.shape[:2], np.float32), regions.person.copy()
    hair[lock] = person[lock] = 1
    shares = picture_shares(Exemplar(image, exemplar.landmarks), Regions(
        exemplar.landmarks, person, np.maximum(regions.hair, hair)), painter.transfer.labels)
    assert shares[y + 12, x, NECK] > 0.95
    assert shares[y + 12, x + 11, HAIR] > 0.9
    assert shares[y + 30, x - 20, CLOTHES] > 0.9
    assert np.allclose(shares.sum(axis=-1), 1, atol=1e-4)


def test_what_lies_on_a_forehead_in_the_color_of_hair_is_hair(painter):
    exemplar, regions = painter.exemplar, painter.transfer.regions
    image, hair = exemplar.image.copy(), regions.hair.copy()
    x, y = exemplar.landmarks[[21, 22]].mean(axis=0).astype(int) - [0, 9]
    fringe, highlight = np.s_[y - 4:y + 3, x - 14:x - 3], np.s_[y - 4:y + 3, x + 4:x + 14]
    image[fringe], image[highlight] = (62, 42, 32), (250, 250, 250)
    hair[fringe] = hair[highlight] = 0
    found = Regions(exemplar.landmarks, regions.person, hair)
    for strict in (True, False):
        shares = painted_shares(Exemplar(image, exemplar.landmarks), found, found.labels(), strict)
        assert shares[y, x - 9, HAIR] > 0.8 and shares[y, x + 9, SKIN] > 0.8
    # Red paint in the shade is neither the cheeks' nor the hair's: it stays skin.
    image[fringe] = (130, 30, 40)
    red = painted_shares(Exemplar(image, exemplar.landmarks), found, found.labels())
    assert red[y, x - 9, SKIN] > 0.8
    # A photo's forehead is what the networks say.
    photo = picture_shares(Exemplar(image, exemplar.landmarks), found, found.labels(), False)
    assert photo[y, x - 9, HAIR] < 0.1


@pytest.mark.parametrize(("color", "material"), [((75, 60, 50), NECK), ((130, 30, 25), CLOTHES)])
def test_right_below_the_chin_what_is_darker_is_neck_unless_it_is_purer(painter, color, material):
    exemplar, regions = painter.exemplar, painter.transfer.regions
    image = exemplar.image.copy()
    x, y = exemplar.landmarks[8].astype(int)
    image[y + 1:y + 8, x - 12:x + 12] = color
    shares = picture_shares(Exemplar(image, exemplar.landmarks), regions, painter.transfer.labels)
    assert shares[y + 1, x, material] > 0.5


def test_a_hat_is_told_by_the_face_alone_not_by_locks_beside_it(painter):
    exemplar, regions = painter.exemplar, painter.transfer.regions
    image, hair = exemplar.image.copy(), regions.hair.copy()
    # Locks that labels take for skin, as they do ears, in the hat's color.
    x, y = exemplar.landmarks[[21, 22]].mean(axis=0).astype(int) - [0, 9]
    left, right = (int(exemplar.landmarks[n, 0]) for n in (0, 16))
    beside = np.zeros(image.shape[:2], bool)
    beside[y:int(exemplar.landmarks[33, 1]), max(left - 25, 0):left - 2] = True
    beside[y:int(exemplar.landmarks[33, 1]), right + 3:right + 25] = True
    brim = np.s_[y - 4:y + 3, x - 14:x + 14]
    image[beside] = image[brim] = (40, 28, 24)
    hair[beside] = hair[brim] = 0
    found = Regions(exemplar.landmarks, np.maximum(regions.person, beside), hair)
    labels = found.labels()
    labels[beside] = 255 * np.eye(len(LABELS), dtype=np.uint8)[LABELS.index("skin")]
    shares = painted_shares(Exemplar(image, exemplar.landmarks), found, labels)
    assert shares[y, x, HAIR] > 0.8


def _bearded(exemplar, beard, chin, lip):
    """The drawn face with paint along the jaw, on the chin and on the upper lip; and where."""
    points, image = exemplar.landmarks, exemplar.image.copy()
    there = {name: np.zeros(image.shape[:2], np.uint8) for name in ("beard", "chin", "lip")}
    ends = points[[48, 54]] + 0.3 * (points[[3, 13]] - points[[48, 54]])
    nose = points[[35, 31]] + 0.2 * (points[51] - points[[35, 31]])
    jaw = np.concatenate([points[3:14], ends[1:], points[54:47:-1], ends[:1]])
    cv2.fillPoly(there["beard"], [jaw.astype(np.int32)], 1)
    cv2.fillPoly(there["chin"], [points[[5, 6, 7, 8, 9, 10, 11, 54, 57, 48]].astype(np.int32)], 1)
    cv2.fillPoly(there["lip"], [np.concatenate([points[[48, 51, 54]], nose]).astype(np.int32)], 1)
    for part in there.values():
        cv2.fillPoly(part, [points[48:60].astype(np.int32)], 0)
    for name, color in (("beard", beard), ("chin", chin), ("lip", lip)):
        if color is not None:
            image[there[name] > 0] = color
    return Exemplar(image, points), there["beard"] > 0


# A red one and a grey one; dark ones are most unlike skin.
@pytest.mark.parametrize("color", [
    (170, 80, 30), (150, 150, 155),
    *(pytest.param(color, marks=pytest.mark.slow) for color in ((70, 50, 40), (25, 25, 25)))])
def test_a_beard_stays_in_the_face_whatever_its_color(painter, color):
    regions, labels = painter.transfer.regions, painter.transfer.labels
    bare = painted_shares(painter.exemplar, regions, labels)
    exemplar, there = _bearded(painter.exemplar, color, color, color)
    there &= bare[..., SKIN] > 0.9
    shares = painted_shares(exemplar, regions, labels)
    assert shares[there][:, FEATURES].mean() > 0.75 and bare[there][:, FEATURES].mean() < 0.02
    cheek = ((exemplar.landmarks[30] + exemplar.landmarks[14]) / 2).astype(int)
    assert shares[cheek[1], cheek[0], SKIN] > 0.95
    assert np.allclose(shares.sum(axis=-1), 1, atol=1e-4)
    # Photos' cheeks are painted of it.
    photo = painted_shares(exemplar, regions, labels, strict=False)
    assert photo[there][:, FEATURES].mean() < 0.1


@pytest.mark.parametrize("colors", [{"beard": None, "chin": None, "lip": (40, 40, 60)},
                                    {"beard": SHADE, "chin": SHADE, "lip": SHADE},
                                    {"beard": (90, 90, 90), "chin": (90, 90, 90), "lip": None},
                                    {"beard": None, "chin": (140, 90, 75), "lip": (90, 40, 120)}])
def test_shade_or_paint_on_a_chin_or_lip_is_no_beard(painter, colors):
    regions, labels = painter.transfer.regions, painter.transfer.labels
    exemplar, _ = _bearded(painter.exemplar, **colors)
    bare = painted_shares(painter.exemplar, regions, labels)
    shares = painted_shares(exemplar, regions, labels)
    face = bare[..., SKIN] > 0.5
    assert np.abs(shares - bare)[face][:, FEATURES].max() < 0.02


def test_clothes_are_of_one_cloth(painter):
    exemplar, regions, labels = (painter.exemplar, painter.transfer.regions,
                                 painter.transfer.labels)
    image = exemplar.image.copy()
    x, y = exemplar.landmarks[8].astype(int)
    worn = painted_shares(exemplar, regions, labels)[..., CLOTHES] > 0.9
    hand = np.zeros_like(worn)
    hand[y + 16:y + 26, x - 30:x - 12] = True
    hand &= worn
    assert 50 < hand.sum() < 0.3 * worn.sum()
    image[hand] = (240, 220, 200)
    shares = painted_shares(Exemplar(image, exemplar.landmarks), regions, labels)
    inside, rest = (binary_erosion(part, iterations=3) for part in (hand, worn & ~hand))
    assert shares[inside][:, FEATURES].mean() > 0.9 and shares[rest][:, CLOTHES].mean() > 0.9
    assert np.allclose(shares.sum(axis=-1), 1, atol=1e-4)
    photo = painted_shares(Exemplar(image, exemplar.landmarks), regions, labels, strict=False)
    assert photo[inside][:, FEATURES].mean() > 0.9 and photo[rest][:, CLOTHES].mean() > 0.9
    # Of two colors each is half of the cloth.
    image = exemplar.image.copy()
    image[worn & (np.indices(worn.shape)[1] // 10 % 2 == 0)] = (30, 30, 35)
    striped = painted_shares(Exemplar(image, exemplar.landmarks), regions, labels)
    assert striped[worn][:, CLOTHES].mean() > 0.85


@pytest.fixture(scope="module")
def bust():
    """A drawn portrait, its regions and labels, and where clothes and hair are, bool [h, w]."""
    exemplar = drawn_face(320, 260, seed=3)
    regions = find_regions(exemplar.image, exemplar.landmarks, exemplar.mask, networks=False)
    shares = painted_shares(exemplar, regions, regions.labels())
    return exemplar, regions, shares[..., CLOTHES] > 0.9, shares[..., HAIR] > 0.9


def _painted_over(bust, *parts):
    """Shares of the drawn portrait with places painted over in other colors."""
    exemplar, regions, *_ = bust
    image = exemplar.image.copy()
    for where, color in parts:
        image[where] = color
    painting, labels = Exemplar(image, exemplar.landmarks), regions.labels()
    shares = painted_shares(painting, regions, labels)
    one_hue(painting, regions, labels, shares)
    return shares


def test_a_coat_of_two_hues_is_of_the_lit_one(bust):
    exemplar, _, worn, _ = bust
    left = np.indices(worn.shape)[1] < exemplar.landmarks[8, 0]
    lit, shade = (binary_erosion(worn & part, iterations=6) for part in (left, ~left))
    shares = _painted_over(bust, (worn & left, (84, 100, 70)), (worn & ~left, (60, 40, 90)))
    assert shares[lit][:, CLOTHES].mean() > 0.9 and shares[shade][:, CLOTHES].mean() < 0.1
    # A coat that is dark on one side, but of one hue, is all one.
    shares = _painted_over(bust, (worn & left, (84, 100, 70)), (worn & ~left, (42, 50, 35)))
    assert min(shares[part][:, CLOTHES].mean() for part in (lit, shade)) > 0.8


def test_hair_is_of_the_crowns_hue(bust):
    _, regions, _, hairy = bust
    down = regions.frame.local(hairy.shape)[1]
    shares = _painted_over(bust, (hairy & (down > -0.3), (30, 70, 60)))
    crown, below = hairy & (down < -0.45), hairy & (down > -0.25)
    assert shares[crown][:, HAIR].mean() > 0.9 and shares[below][:, HAIR].mean() < 0.1
    # Brown hair is nearly black in the dark: that is no other hue.
    shares = _painted_over(bust, (hairy, (100, 60, 30)), (hairy & (down > -0.3), (25, 18, 24)))
    assert min(shares[part][:, HAIR].mean() for part in (crown, below)) > 0.8


def test_hair_by_hand_is_hair_of_any_hue(bust):
    exemplar, regions, _, hairy = bust
    down = regions.frame.local(hairy.shape)[1]
    image, by_hand = exemplar.image.copy(), np.zeros(hairy.shape, np.uint8)
    image[hairy & (down > -0.3)] = (30, 70, 60)
    by_hand[hairy] = BY_HAND.index("hair")
    shares = np.zeros((*hairy.shape, len(MATERIALS)), np.float32)
    shares[..., HAIR], shares[..., GROUND] = hairy, ~hairy
    for hand, left in ((None, 0.1), (by_hand, 1.0)):
        kept = shares.copy()
        one_hue(replace(exemplar, image=image, by_hand=hand), regions, regions.labels(), kept)
        mean = kept[hairy & (down > -0.25)][:, HAIR].mean()
        assert mean == 1.0 if hand is not None else mean < left


def test_a_narrow_rim_of_dark_hair_is_not_of_the_foreheads_hue(bust):
    exemplar, regions, _, hairy = bust
    right, down = regions.frame.local(hairy.shape)
    face = ~hairy & (np.hypot(right, down) < 0.6)
    image = exemplar.image.copy()
    image[hairy], image[face] = (30, 22, 28), (230, 150, 70)
    shares = np.zeros((*hairy.shape, len(MATERIALS)), np.float32)
    shares[..., HAIR] = hairy & ((down > -0.3) | binary_dilation(face, iterations=3))
    shares[..., SKIN] = 1 - shares[..., HAIR]
    kept = shares.copy()
    one_hue(Exemplar(image, exemplar.landmarks), regions, regions.labels(), kept)
    np.testing.assert_array_equal(kept, shares)


def test_a_coat_with_strokes_of_the_grounds_color_is_one(bust):
    _, regions, worn, _ = bust
    ground = regions.person < 0.5
    strokes = np.indices(worn.shape).sum(axis=0) % 10 < 4
    image = bust[0].image.copy()
    for where, color in ((ground, (40, 90, 100)), (ground & strokes, (120, 50, 40)),
                         (worn, (120, 50, 40)), (worn & strokes, (40, 90, 100))):
        image[where] = color
    shares = np.zeros((*worn.shape, len(MATERIALS)), np.float32)
    shares[..., GROUND], shares[..., CLOTHES] = ground, worn
    hide_ground(SmallPicture(Exemplar(image, bust[0].landmarks), regions, regions.labels()), shares)
    assert shares[binary_erosion(worn, iterations=8)][:, CLOTHES].mean() > 0.95


@pytest.mark.parametrize(("shoulder", "taken"), [
    ((250, 225, 190), True), ((110, 78, 60), False), ((250, 225, 190), None)])
def test_lit_shoulders_are_no_clothes(painter, shoulder, taken):
    """Paler than the cheeks, as the forehead is; not as brown as shade, nor all that is worn."""
    exemplar, regions, labels = (painter.exemplar, painter.transfer.regions,
                                 painter.transfer.labels)
    image = exemplar.image.copy()
    worn = painted_shares(exemplar, regions, labels)[..., CLOTHES] > 0.9
    left, top = (int(axis.min()) for axis in np.nonzero(worn)[::-1])
    right = int(np.nonzero(worn)[1].max())
    rows, columns = np.indices(worn.shape)
    bare = worn & (columns < left + 0.5 * (right - left)) & (rows > top + 4)
    # More than half of it, so that most of the clothes' colors are these.
    bare |= worn & (columns > left + 0.85 * (right - left))
    if taken is None:
        bare = worn
    forehead = (exemplar.landmarks[21] + exemplar.landmarks[22]).astype(int) // 2 - [0, 8]
    across = np.s_[forehead[1] - 5:forehead[1] + 4, forehead[0] - 16:forehead[0] + 16]
    image[across] = (250, 225, 190)
    image[bare] = shoulder
    shares = painted_shares(Exemplar(image, exemplar.landmarks), regions, labels)
    inside, rest = (binary_erosion(part, iterations=3) for part in (bare, worn & ~bare))
    assert bare.sum() > 0.5 * worn.sum()
    if taken:
        assert shares[inside][:, CLOTHES].mean() < 0.05
        assert shares[rest][:, CLOTHES].mean() > 0.9
    else:
        assert shares[inside][:, [CLOTHES, NECK]].sum(axis=1).mean() > 0.9


def test_ears_lie_beside_the_face(painter):
    exemplar, regions = painter.exemplar, painter.transfer.regions
    points = exemplar.landmarks
    middle = ((points[0] + points[16]) / 2).astype(int)
    ears = np.zeros(exemplar.image.shape[:2], bool)
    for x in (int(points[0, 0]) - 6, int(points[16, 0]) + 6):
        ears[middle[1] - 2:middle[1] + 12, x - 4:x + 5] = True
    hair = np.where(ears, 0, regions.hair)
    found = Regions(points, np.maximum(regions.person, ears), hair)
    labels = found.labels()
    labels[ears] = 255 * np.eye(len(LABELS), dtype=np.uint8)[LABELS.index("skin")]
    image = exemplar.image.copy()
    image[ears] = (215, 165, 140)
    there = Exemplar(image, points)
    shares = painted_shares(there, found, labels)
    assert shares[ears][:, EARS].mean() > 0.8
    assert np.allclose(shares.sum(axis=-1), 1, atol=1e-4)
    cheeks = ((points[30] + points[[2, 14]]) / 2).astype(int)
    assert not shares[cheeks[:, 1], cheeks[:, 0], EARS].any()
    assert not painted_shares(there, found, labels, strict=False)[..., EARS].any()
    # What is of these ears may be painted with them, or with skin; the rest stays away.
    theirs = ExemplarMaterials.of(image.astype(np.float32) / 255, shares, exemplar.size)
    assert theirs.present[EARS]
    inside = shares[..., EARS] > 0.8
    near = {part: shares[..., part].ravel()[theirs.nearest[part][inside]] for part in (SKIN, EARS)}
    assert np.median(near[SKIN]) > 0.6 and np.median(near[EARS]) > 0.8


def test_a_coat_in_the_color_of_skin_begins_away_from_the_neck(painter):
    exemplar, regions = painter.exemplar, painter.transfer.regions
    image = exemplar.image.copy()
    red = np.abs(image - np.array([160.0, 60, 50])).max(axis=-1) < 30
    image[red] = (180, 140, 120)
    shares = picture_shares(Exemplar(image, exemplar.landmarks), regions, painter.transfer.labels)
    x, y = exemplar.landmarks[8].astype(int)
    assert shares[y + 12, x, NECK] > 0.75
    assert shares[-3, x - 40, CLOTHES] > 0.5


def test_where_hair_is_only_if_it_is_long():
    down = np.array([-0.5, 0.3, 0.7, 0.9, 1.2])

    def at(degrees):
        flat = np.stack([np.full(5, np.radians(degrees) * PLANE.radius), down * PLANE.height], 1)
        return below_hair(PLANE, np.asarray(flat, np.float32)).tolist()

    assert at(0) == [0, 0, 0, 0, 1]
    assert at(30) == at(-30) == pytest.approx([0, 0, 0, 0.1, 1], abs=0.01)
    # Cheeks are bare; sideburns end at the middle of the ears.
    assert at(62) == at(-62) == [0, 1, 1, 1, 1]
    assert at(80) == at(-80) == pytest.approx([0, 0, 1, 1, 1], abs=0.01)
    # The nape's hair grows further down, and does not end in a level line.
    ends = np.array([at(degrees) for degrees in range(160, 181)])
    assert (ends[:, :2] == 0).all() and (ends[:, 4] == 1).all()
    assert (ends[:, 2] < 0.1).all() and np.ptp(ends[:, 3]) > 0.2
    # Left and right meet behind.
    assert at(180) == pytest.approx(at(-180), abs=1e-3)


def test_most_hair_begins_in_an_arc_around_the_forehead_and_ends_at_the_nape():
    up = np.array([1.0, 0.75, 0.5, 0.2, -0.2, -0.7, -0.95])

    def at(degrees):
        flat = np.stack([np.full(7, np.radians(degrees) * PLANE.radius), -up * PLANE.height], 1)
        return hair_by_place(PLANE, np.asarray(flat, np.float32)).round().astype(int).tolist()

    assert at(0) == at(-20) == [1, 1, 0, 0, 0, 0, 0]
    assert at(75) == at(-75) == [1, 1, 1, 0, 0, 0, 0]
    assert at(95) == [1, 1, 1, 1, 0, 0, 0]
    assert at(120) == [1, 1, 1, 1, 1, 0, 0]
    assert at(180) == [1, 1, 1, 1, 1, 1, 0]


def test_hair_closes_over_narrow_bays_and_leaves_wide_ones():
    random = np.random.default_rng(5)
    flat = (random.uniform((-3, -2), (3, 2), (60000, 2)) * PLANE.height).astype(np.float32)
    x, y = (flat / PLANE.height).T
    # A slit that comes from the left, a small island, and a face.
    slit = (np.abs(y) < 0.08) & (x < 0)
    island = np.hypot(x - 1, y - 1) < 0.1
    face = np.hypot(x - 1.5, y + 0.9) < 0.7
    hair = np.asarray(~(slit | island | face), np.float32)
    closed = without_bays(PLANE, flat, hair)
    assert (closed >= hair).all()
    inside = (x > -2.9) & (x < 2.9)
    assert closed[(slit | island) & inside].min() > 0.9
    assert closed[np.hypot(x - 1.5, y + 0.9) < 0.6].max() < 0.1


@pytest.mark.parametrize(("light", "stays"), [(0.6, 1), (0.3, 0), (0.9, 0)])
def test_skin_stands_in_for_a_neck_in_another_light(light, stays):
    random = np.random.default_rng(3)
    picture = np.zeros((40, 40), np.float32)
    their = np.zeros((40, 40, len(MATERIALS)), np.float32)
    their[:20, :, SKIN], their[20:, :, NECK] = 1, 1
    picture[:20] = random.normal(0.6, 0.05, (20, 40))
    picture[20:] = random.normal(light, 0.02, (20, 40))
    theirs = SimpleNamespace(shares=their, tone=picture)
    shares = np.zeros((1000, len(MATERIALS)), np.float32)
    shares[:700, SKIN], shares[700:, NECK] = 1, 1
    tone = np.concatenate([random.normal(0.5, 0.05, 700), random.normal(0.5, 0.02, 300)])
    changed = shares.copy()
    light_neck(changed, tone.astype(np.float32), theirs)
    assert np.array_equal(changed[:700], shares[:700])
    assert abs(changed[700:, NECK].mean() - stays) < 0.05
    assert np.allclose(changed.sum(axis=1), 1)
    # Of an exemplar without a neck nothing can be said.
    theirs.shares[..., NECK] = 0
    light_neck(shares, tone.astype(np.float32), theirs)
    assert (shares[700:, NECK] == 1).all()


def test_an_exemplar_without_a_body_has_no_clothes(painter):
    labels = painter.transfer.labels.copy()
    labels[..., LABELS.index("background")] += labels[..., LABELS.index("body")]
    labels[..., LABELS.index("body")] = 0
    shares = picture_shares(painter.exemplar, painter.transfer.regions, labels)
    inside = painter.transfer.regions.person >= 0.5
    assert np.array_equal(shares[inside], material_shares(labels)[inside])
    assert not shares[..., [NECK, CLOTHES]].any()


def test_the_nearest_place_of_a_material_is_of_it(painter, shares):
    picture = painter.exemplar.image.astype(np.float32) / np.float32(255)
    theirs = ExemplarMaterials.of(picture, shares, painter.exemplar.size)
    # Its ears lie under its hair.
    assert theirs.present.tolist() == [True] * EARS + [False]
    height, width = shares.shape[:2]
    y, x = np.indices((height, width))
    for material in range(EARS):
        for places in (theirs.nearest[material], theirs.deep[material]):
            assert places.min() >= 0 and places.max() < height * width
            assert np.quantile(shares[..., material].ravel()[places], 0.02) > 0.4
        near = theirs.nearest[material]
        inside = np.repeat(np.repeat(shares[::2, ::2, material] > 0.6, 2, 0), 2, 1)
        inside = inside[:height, :width]
        assert np.array_equal(near[inside], (y * width + x)[inside])
        rows, columns = np.nonzero(shares[::2, ::2, material] > 0.6)
        for j, i in ((0, 0), (height // 2, width // 3), (height - 1, width - 1)):
            if inside[j, i]:
                continue
            wanted = np.hypot(2 * rows - j, 2 * columns - i).min()
            v, u = divmod(int(near[j, i]), width)
            assert abs(np.hypot(v - j, u - i) - wanted) <= 3
    # Well inside the background is further from the head than its edge.
    nose = painter.exemplar.landmarks[30].astype(int)
    from_nose = [np.hypot(*np.subtract(divmod(int(places[GROUND, nose[1], nose[0]]), width),
                                       nose[::-1])) for places in (theirs.nearest, theirs.deep)]
    assert from_nose[1] > from_nose[0] + 2


def test_a_material_that_is_not_there_moves_nothing(painter, shares):
    picture = painter.exemplar.image.astype(np.float32) / np.float32(255)
    bald = shares.copy()
    bald[..., SKIN] += bald[..., HAIR]
    bald[..., HAIR] = 0
    theirs = ExemplarMaterials.of(picture, bald, painter.exemplar.size)
    assert theirs.present.tolist() == [True, False, True, True, True, True, False]
    index = np.arange(picture[..., 0].size).reshape(picture.shape[:2])
    assert np.array_equal(theirs.nearest[HAIR], index)
    assert np.array_equal(theirs.deep[HAIR], index)


@pytest.mark.parametrize("hairy", [True, False])
def test_the_sitters_materials_are_told_by_the_sitter(hairy):
    sitter, labels = _sitter(300, hair=hairy), _labels(300)
    shares = sitter_shares(sitter, labels, ALL)
    assert np.allclose(shares.sum(axis=1), 1, atol=1e-4)
    assert shares.min() > -1e-6 and not shares[:, [GROUND, FEATURES]].any()
    assert np.allclose(shares[:, CLOTHES], sitter.clothes, atol=1e-4)
    nothing, everything = np.zeros(300, np.float32), np.ones(300, np.float32)
    bare = sitter_shares(_like(sitter, ears=nothing, clothes=nothing), labels, ALL)
    assert not bare[:, CLOTHES].any()
    if hairy:
        assert np.allclose(bare[:, HAIR], sitter.hair, atol=1e-4)
    else:
        # The exemplar's, but none on the neck, and more where hair is on most heads; hair ends
        # along a line, not in a broad band of half hair and half skin.
        place, below = hair_by_place(PLANE, sitter.flat), below_hair(PLANE, sitter.flat)
        assert all((part == 0).any() and (part == 1).any() for part in (place, below))
        labels[:] = 0
        labels[:, LABELS.index("hair")] = np.linspace(0, 255, 300)
        labels[:, LABELS.index("skin")] = 255 - labels[:, LABELS.index("hair")]
        theirs = material_shares(labels)[:, HAIR] * (1 - below)
        most = np.maximum(place, theirs)
        most = (1 - below) * without_bays(PLANE, sitter.flat, most)
        wanted = theirs + np.maximum(most - theirs, 0) * (1 - theirs)
        bare = sitter_shares(_like(sitter, ears=nothing, clothes=nothing), labels, ALL)
        sure = np.abs(wanted - 0.5) > 0.1
        assert np.array_equal((bare[:, HAIR] > 0.5)[sure], (wanted > 0.5)[sure])
        assert ((bare[:, HAIR] < 0.05) | (bare[:, HAIR] > 0.95))[sure].mean() > 0.9
    dressed = sitter_shares(_like(sitter, clothes=everything), labels, ALL)
    assert np.allclose(dressed[:, CLOTHES], 1)
    eared = sitter_shares(_like(sitter, hair=nothing, ears=everything, clothes=nothing), labels,
                          ALL)
    assert np.allclose(eared[:, [SKIN, EARS]].sum(axis=1), 1)
    # The painter's, where he shows them, or his skin, whichever is more alike.
    assert (eared[:, EARS] > eared[:, SKIN]).all() and (eared[:, SKIN] > 0.4).all()
    assert not bare[:, EARS].any()


def test_where_the_guide_leads_off_the_exemplar_hair_stays_hair_and_the_rest_is_neck():
    labels = np.zeros((3, len(LABELS)), np.uint8)
    labels[:, LABELS.index("background")] = 255
    sitter = SimpleNamespace(hair=np.float32([1, 0, 0.5]), ears=np.zeros(3), clothes=np.zeros(3))
    wanted = np.zeros((3, len(MATERIALS)))
    wanted[:, HAIR], wanted[:, NECK] = sitter.hair, 1 - sitter.hair
    assert np.allclose(sitter_shares(sitter, labels, ALL), wanted, atol=1e-4)
    # A bald sitter's head is skin where the exemplar has hair.
    labels[:, LABELS.index("background")], labels[:, LABELS.index("hair")] = 5, 250
    sitter.hair = np.zeros(3, np.float32)
    assert (sitter_shares(sitter, labels, ALL)[:, SKIN] > 0.95).all()


def test_what_the_exemplar_lacks_has_a_stand_in():
    sitter, labels = _sitter(100), _labels(100)
    whole = sitter_shares(sitter, labels, ALL)

    def without(*missing):
        present = ALL.copy()
        present[list(missing)] = False
        found = sitter_shares(sitter, labels, present)
        assert not found[:, list(missing)].any()
        assert np.allclose(found.sum(axis=1), 1, atol=1e-4)
        return found

    assert np.allclose(without(HAIR)[:, SKIN], whole[:, SKIN] + whole[:, HAIR])
    assert np.allclose(without(CLOTHES)[:, NECK], whole[:, NECK] + whole[:, CLOTHES])
    assert np.allclose(without(EARS)[:, SKIN], whole[:, SKIN] + whole[:, EARS])
    assert np.allclose(without(CLOTHES, NECK, EARS)[:, SKIN], 1 - whole[:, HAIR], atol=1e-4)


def test_tones_become_those_of_the_exemplars_material(painter, shares):
    picture = painter.exemplar.image.astype(np.float32) / np.float32(255)
    theirs = ExemplarMaterials.of(picture, shares, painter.exemplar.size)
    sitter = _sitter(4000)
    materials = np.zeros((4000, len(MATERIALS)), np.float32)
    materials[:1900, SKIN] = materials[1900:3900, HAIR] = materials[3900:3950, NECK] = 1
    materials[3950:, CLOTHES] = 1
    sitter.seen[:100], sitter.seen[100:] = 0, 0.8
    sitter.seen[1900:3900] = 1
    tone, detail = sitter_looks(sitter, materials, theirs)
    for part, material in ((slice(0, 1900), SKIN), (slice(1900, 3900), HAIR)):
        wanted = theirs.tone[theirs.shares[..., material] > 0.5]
        assert np.allclose(np.quantile(tone[part], [0.1, 0.5, 0.9]),
                           np.quantile(wanted, [0.1, 0.5, 0.9]), atol=0.02)
        assert (np.diff(tone[part][np.argsort(sitter.tone[part])]) > -1e-3).all()
        seen = sitter.detail[part] * sitter.seen[part]
        gain = (detail[part] * seen).sum() / (seen ** 2).sum()
        assert np.allclose(detail[part], gain * seen, atol=1e-4) and 0.49 < gain < 2.51
    # Of so few pixels nothing can be learnt.
    assert np.allclose(tone[3900:], sitter.tone[3900:])
    assert not detail[:100].any()


def test_hair_that_no_photo_saw_is_of_middling_tones(painter, shares):
    picture = painter.exemplar.image.astype(np.float32) / np.float32(255)
    theirs = ExemplarMaterials.of(picture, shares, painter.exemplar.size)
    sitter = _sitter(4000)
    materials = np.zeros((4000, len(MATERIALS)), np.float32)
    materials[:2000, SKIN] = materials[2000:, HAIR] = 1
    sitter.seen[:], sitter.seen[3000:3500], sitter.seen[3500:] = 1, 0, 0.5
    tone, _ = sitter_looks(sitter, materials, theirs)
    sitter.seen[3000:] = 1
    bare, _ = sitter_looks(sitter, materials, theirs)
    low, high = np.quantile(tone[2000:3000], [0.25, 0.75])
    assert tone[3000:3500].min() > low - 0.002 and tone[3000:3500].max() < high + 0.002
    assert bare[3000:3500].min() < low - 0.002 and bare[3000:3500].max() > high + 0.01
    # What was half seen keeps half of its own.
    assert low > tone[3500:].min() > bare[3000:].min() + 1e-3
    assert high < tone[3500:].max()


def test_skin_ends_where_neck_begins():
    share = np.linspace(0, 1, 101)
    labels = np.zeros((101, len(LABELS)), np.uint8)
    labels[:, LABELS.index("skin")] = np.round(255 * share)
    labels[:, LABELS.index("body")] = 255 - labels[:, LABELS.index("skin")]
    sitter = _like(_sitter(101), hair=np.zeros(101, np.float32), clothes=np.zeros(101, np.float32),
                   ears=np.zeros(101, np.float32))
    shares = sitter_shares(sitter, labels, ALL)
    assert np.allclose(shares.sum(axis=1), 1, atol=1e-5)
    mixed = (shares[:, SKIN] > 0.05) & (shares[:, NECK] > 0.05)
    assert mixed.sum() < 15 and (np.diff(shares[:, SKIN]) >= -1e-6).all()


@pytest.mark.parametrize(("off", "left"), [(0.03, 1.0), (0.75, 0.0)])
def test_a_neck_is_painted_of_one_paint_where_most_of_it_is(off, left):
    random = np.random.default_rng(4)
    their = np.zeros((40, 40, len(MATERIALS)), np.float32)
    their[:20, :, SKIN], their[20:, :, NECK] = 1, 1
    picture = np.zeros((40, 40), np.float32)
    picture[:20] = random.normal(0.6, 0.05, (20, 40))
    # So much of the exemplar's neck lies in deep shade, the rest in the face's light.
    shade = np.sort(random.random((20, 40)).ravel()).reshape(20, 40) < off
    picture[20:] = np.where(shade, 0.2, random.normal(0.6, 0.02, (20, 40)))
    shares = np.zeros((1000, len(MATERIALS)), np.float32)
    shares[:700, SKIN], shares[700:, NECK] = 1, 1
    tone = np.concatenate([random.normal(0.5, 0.05, 700), random.normal(0.5, 0.02, 300)])
    light_neck(shares, tone.astype(np.float32), SimpleNamespace(shares=their, tone=picture))
    assert np.allclose(shares[700:, NECK], left)


def test_skin_is_no_darker_than_most_of_the_exemplars(painter, shares):
    theirs = ExemplarMaterials.of(painter.exemplar.image.astype(np.float32) / 255, shares, 40.0)
    sitter = _sitter(3000)
    materials = np.zeros((3000, len(MATERIALS)), np.float32)
    materials[:, SKIN] = 1
    tone, _ = sitter_looks(sitter, materials, theirs)
    there = theirs.shares[..., [SKIN, EARS]].sum(axis=-1) > 0.5
    least = np.quantile(theirs.tone[there], DARKEST)
    assert tone.min() >= least - 1e-6 and (tone < least + 1e-3).mean() > DARKEST / 2


def test_pixels_of_a_tone_are_used_as_often_as_it_is_asked_for():
    random = np.random.default_rng(5)
    theirs = SimpleNamespace(tone=np.repeat(np.float32([[0.2], [0.8]]), 30, 0).repeat(60, 1),
                             shares=np.zeros((60, 60, len(MATERIALS)), np.float32),
                             hue=np.zeros((60, 60), np.float32))
    theirs.shares[..., SKIN] = 1
    shares = np.zeros((4000, len(MATERIALS)), np.float32)
    shares[:, SKIN] = 1
    tone = np.where(random.random(4000) < 0.2, 0.2, 0.8).astype(np.float32)
    even = even_uses(shares, tone, theirs, 1.0)
    # A plain count: how many places ask for a pixel's tone, over how many pixels have it.
    for value in (0.2, 0.8):
        alike = theirs.tone == np.float32(value)
        wanted = (tone == np.float32(value)).sum() / alike.sum()
        assert np.allclose(even[alike], wanted, rtol=0.1)
    # What nobody asks for is rare, not ruled out; of a material that is not asked for, nothing is.
    light = even_uses(shares, np.full(4000, 0.8, np.float32), theirs, 1.0)
    assert np.allclose(light[:30], 4000 / 3600 / RARE, rtol=1e-3)
    shares[:] = np.eye(len(MATERIALS), dtype=np.float32)[HAIR]
    assert not even_uses(shares, tone, theirs, 1.0).any()
    assert np.allclose(even_uses(np.roll(shares, SKIN - HAIR, 1), tone, theirs,
                                 2 * np.ones(len(MATERIALS), np.float32)), 2 * even)
    # Skin of another hue is hardly used, and its part falls to the rest.
    theirs.hue[:, :20] = 0.3
    rare = even_uses(np.roll(shares, SKIN - HAIR, 1), tone, theirs, 1.0)
    assert np.allclose(rare[:, 20:], 1.5 * even[:, 20:], rtol=0.01)
    assert rare[:, :20].max() < 0.01 * even.max()


def test_pieces_come_from_where_the_exemplar_has_the_tone():
    size, side = 40.0, 80
    theirs = SimpleNamespace(tone=np.zeros((side, side), np.float32),
                             hue=np.zeros((side, side), np.float32))
    theirs.tone[:, side // 2:] = 0.8
    own = np.arange(side * side, dtype=np.int32).reshape(side, side)
    theirs.deep = theirs.nearest = np.repeat(own[None], len(MATERIALS), 0)
    plane = np.random.default_rng(6).random((4000, 2)).astype(np.float32) * 200
    shares = np.zeros((4000, len(MATERIALS)), np.float32)
    shares[:, HAIR] = 1
    # All are guided to the border of dark and light.
    wanted = np.full((4000, 2), side / 2, np.float32)
    tone = np.where(plane[:, 0] < 100, 0.0, 0.8).astype(np.float32)
    found = pieces(main_material(shares), theirs, wanted, plane, tone, size)
    x, y = np.clip(found, 0, side - 1).astype(int).T
    far = np.abs(plane[:, 0] - 100) > 0.5 * size
    assert (np.abs(theirs.tone[y, x] - tone)[far] < 0.1).mean() > 0.8
    # They are rigid: what lies side by side comes from side by side.
    near = plane[0] + np.float32([0.01, 0.01])
    again = pieces(main_material(np.repeat(shares[:1], 2, 0)), theirs, wanted[:2],
                   np.stack([plane[0], near]), tone[:2], size)
    assert np.allclose(again[1] - again[0], near - plane[0], atol=1e-4)
    # Nor from where it has another hue, if there is a choice.
    stains = theirs.hue
    stains[:side // 2] = 0.3
    _, row = pieces(main_material(shares), theirs, wanted, plane, tone, size).T
    assert (row < side // 2).mean() < 0.5 * (y < side // 2).mean()


def test_places_that_are_moved_far_are_not_at_home():
    guided = np.zeros((4, 2), np.float32)
    wanted = np.float32([[0, 0], [0.9, 0], [0, 3.5], [6, 8]])
    assert np.allclose(guide_agreement(guided, wanted, 2.0), [1, 1, 0.5, 0])


def test_what_a_painting_is_made_of_is_kept(drawn, monkeypatch, tmp_path):
    monkeypatch.setattr(cache, "user_cache", lambda kind: tmp_path / kind)
    exemplar, regions = drawn, drawn.regions()
    labels = regions.labels()
    first = known_shares(exemplar, regions, labels)
    assert np.abs(first - painted_shares(exemplar, regions, labels)).max() <= 0.5 / 255 + 1e-6
    monkeypatch.setattr(storage, "painted_shares", lambda *_: pytest.fail("found again"))
    again = known_shares(exemplar, regions, labels)
    assert again.dtype == np.float32 and np.array_equal(again, first)
    monkeypatch.undo()
    monkeypatch.setattr(cache, "user_cache", lambda kind: tmp_path / kind)
    photo = known_shares(exemplar, regions, labels, strict=False)
    assert len(list((tmp_path / "materials").iterdir())) == 2
    assert np.abs(photo - painted_shares(exemplar, regions, labels, strict=False)).max() < 0.003


@pytest.mark.parametrize("count", [0, 1, 700])
def test_kernels_of_the_materials(count):
    random = np.random.default_rng(count)
    shares = random.integers(0, 4, (count, len(MATERIALS))).astype(np.float32)  # with ties
    found = main_material(shares)
    assert np.array_equal(found, shares.argmax(axis=1))
    nearest = random.integers(0, 30 * 20, (len(MATERIALS), 30, 20)).astype(np.int32)
    nearest[:, ::2] = np.arange(30 * 20).reshape(30, 20)[::2]  # at home in every second row
    position = random.uniform(-5, 40, (count, 2)).astype(np.float32)
    moved = np.empty_like(position)
    move_to_material(position, found, nearest, moved)
    x, y = (np.clip(position[:, axis], 0, size - 1).astype(int)
            for axis, size in ((0, 20), (1, 30)))
    near = nearest[found, y, x]
    there = np.stack([near % 20, near // 20], axis=1) + np.float32(0.5)
    assert np.array_equal(moved, np.where((near == y * 20 + x)[:, None], position, there))


def _flesh(stained: bool) -> ExemplarMaterials:
    """Skin that is red in the shade and yellow in the light, perhaps with a green stain."""
    tone = np.linspace(0.35, 0.75, 240, dtype=np.float32)[None].repeat(120, 0)
    warm = np.float32([0.18, -0.02, -0.14]) * (0.4 + tone[..., None])
    picture = tone[..., None] + warm
    if stained:
        picture[40:80, 100:140] += np.float32([-0.12, 0.06, 0.02])
    shares = np.zeros((120, 240, len(MATERIALS)), np.float32)
    shares[..., SKIN] = 1
    shares[:, :20], shares[:, :20, HAIR] = 0, 1
    return ExemplarMaterials.of(picture, shares, 120.0)


def test_flesh_of_another_hue_than_its_tone_mostly_has_is_known():
    stained, plain = _flesh(True).hue, _flesh(False).hue
    assert stained[50:70, 110:130].min() > 0.08
    # Shade is of another hue than light: that is usual.
    assert plain[:, 30:].max() < 0.03 and stained[:20, 30:].max() < 0.03
    assert not stained[:, :20].any()


def test_skin_of_many_hues_has_no_usual_one():
    tone = np.linspace(0.35, 0.75, 240, dtype=np.float32)[None].repeat(120, 0)
    picture = tone[..., None] + np.float32([0.2, -0.02, -0.16])
    picture[60:] = tone[60:, :, None] + np.float32([-0.2, 0.06, 0.1])
    shares = np.zeros((120, 240, len(MATERIALS)), np.float32)
    shares[..., SKIN] = 1
    assert not ExemplarMaterials.of(picture, shares, 120.0).hue.any()


def test_where_skin_is_plain_patches_of_another_hue_are_not_taken():
    theirs = _flesh(True)
    search = PatchSearch(levels=3)
    out = {}
    for weight in (0.0, 1.0):
        weights = GuideWeights(hue=weight)
        source = PatchSource.of(
            (theirs.luma[..., None] + np.float32([0.1, 0, -0.1])).clip(0, 1),
            material_guides(theirs.shares, theirs.tone, theirs.detail, theirs.hue, weights))
        shares = np.zeros((64, 64, len(MATERIALS)), np.float32)
        shares[..., SKIN] = 1
        flat = np.zeros((64, 64), np.float32)
        # Tones of the stain's place, where the search begins.
        guides = material_guides(shares, flat + theirs.tone[60, 120], flat, flat, weights)
        y, x = np.mgrid[:64, :64].astype(np.float32)
        start = np.stack([100 + x * 0.6, 40 + y * 0.6], axis=-1)
        _, places = synthesise_patches(PatchTarget(guides, start, start), source, search)
        out[weight] = theirs.hue.reshape(-1)[places].mean()
    assert out[0.0] > 0.02 and out[1.0] < 0.4 * out[0.0]
