"""StyleBlit against its plain form, its invariants, and whole transfers."""

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import gaussian_filter

from lfportrait.example import (
    BlitConfig,
    Exemplar,
    Guides,
    SurfaceGuide,
    TableConfig,
    Transfer,
    TransferConfig,
    build_table,
    synthesise,
    transfer,
)
from lfportrait.example.guides.position import pixel_centres
from lfportrait.example.styleblit import Style, plant
from tests.portraits import HEAD_LANDMARKS, ball_head, drawn_face
from tests.reference import styleblit as reference


def _problem(seed=0, height=40, width=48, style_height=56, style_width=44):
    random = np.random.default_rng(seed)
    style_appearance = random.normal(0, 0.08, (style_height, style_width)).astype(np.float32)
    position = pixel_centres((height, width)) * np.float32(0.9) + np.float32(2.3)
    position += random.normal(0, 0.4, position.shape).astype(np.float32)
    position = np.clip(position, 0.5, np.array([style_width, style_height]) - 0.6)
    appearance = random.normal(0, 0.08, (height, width)).astype(np.float32)
    weights = np.empty((height, width, 2), np.float32)
    weights[:] = (3.3, 255.0)
    picture = random.random((style_height, style_width, 3)).astype(np.float32)
    labels = np.zeros((height, width, 0), np.uint8)
    style_labels = np.zeros((style_height, style_width, 0), np.uint8)
    guides = Guides(position.astype(np.float32), appearance, labels, pixel_centres((height, width)))
    table = build_table(style_appearance, TableConfig(cell=2, levels=16), 3.0)
    return guides, weights, Style(style_appearance, style_labels, table, picture)


def made_of(guides, weights, style, config, label_weight=0.0, seed=0, scale=None):
    """A synthesis with seeds of its own."""
    return synthesise(guides, weights, label_weight, style, config,
                      plant(guides.anchor, config.top, seed, scale), scale=scale)


# Each scale and each width once; slow: the other pairs.
@pytest.mark.parametrize(("scale", "width"), [
    (1.0, 48), (None, 37), *(pytest.param(*both, marks=pytest.mark.slow)
                             for both in ((1.0, 37), (None, 48)))])
def test_equals_the_plain_form(scale, width):
    guides, weights, style = _problem(height=28, width=width)
    own = made_of(guides, weights, style, BlitConfig(threshold=-1.0, tolerance=-1e9, radius=0),
                  scale=scale)
    assert (own.level == 0).all()
    config = BlitConfig(threshold=60.0, radius=0, levels=4)
    made = made_of(guides, weights, style, config, seed=5, scale=scale)
    stored = plant(guides.anchor, 4, 5, scale)
    seeds = {}
    for level in range(1, 5):
        begin = stored.starts[level]
        count = int(stored.shapes[level].prod())
        seeds[level] = [(stored.points[n], divmod(int(stored.pixels[n]), width))
                        for n in range(begin, begin + count) if stored.pixels[n] >= 0]
    shift, level = reference.synthesise(
        guides.position, guides.appearance, guides.anchor, weights, style.appearance, own.shift,
        own.error, seeds, 4, config.threshold, config.tolerance, free=scale is None)
    same = (level == made.level) & (np.abs(shift - made.shift) < 1e-3).all(axis=-1)
    assert same.mean() > 0.998  # a rounding at the threshold may differ
    assert len(np.unique(level)) >= 3


@pytest.mark.slow  # equal to the plain form: above
@pytest.mark.parametrize("width", [5, 16, 21])
def test_tiles_do_not_show(width):
    """A torn anchor plane, whose tiles have too many seeds to share, gives the same chunks."""
    guides, weights, style = _problem(3, 21, width)
    torn = Guides(guides.position, guides.appearance, guides.labels, guides.anchor.copy())
    # One pixel of each tile lies far away.
    torn.anchor[::8, ::16] += 4000
    config = BlitConfig(radius=0, min_improvement=1e9)
    results = [made_of(g, weights, style, config, seed=2) for g in (guides, torn)]
    kept = np.ones((21, width), bool)
    kept[::8, ::16] = False
    same = (results[0].shift == results[1].shift).all(axis=-1)[kept]
    assert same.mean() > 0.9  # seeds whose pixel went away take another one


def test_same_seed_same_bytes():
    problem = _problem(1)
    first = made_of(*problem, BlitConfig(), seed=3, scale=1.0)
    second = made_of(*problem, BlitConfig(), seed=3, scale=1.0)
    other = made_of(*problem, BlitConfig(), seed=4, scale=1.0)
    assert first.image.tobytes() == second.image.tobytes()
    assert first.image.tobytes() != other.image.tobytes()


def test_perfect_guides_copy_the_exemplar():
    """A target that is the exemplar itself comes back as it was, chunks or not."""
    random = np.random.default_rng(2)
    style_appearance = random.normal(0, 0.08, (60, 50)).astype(np.float32)
    picture = (random.integers(0, 256, (60, 50, 3)) / 255).astype(np.float32)
    guides = Guides(pixel_centres((60, 50)), style_appearance, np.zeros((60, 50, 0), np.uint8),
                    pixel_centres((60, 50)))
    weights = np.full((60, 50, 2), (3.3, 255.0), np.float32)
    made = made_of(guides, weights, Style(
        style_appearance, np.zeros((60, 50, 0), np.uint8),
        build_table(style_appearance, TableConfig(), 3.0), picture), BlitConfig(), scale=1.0)
    assert np.allclose(made.image, picture, atol=1e-6)


def test_unpainted_pixels_stay_black():
    guides, weights, style = _problem(3)
    guides.position[:10] = np.nan
    made = made_of(guides, weights, style, BlitConfig(), scale=1.0)
    assert (made.image[:10] == 0).all() and np.isfinite(made.image).all()
    assert np.isnan(made.shift[:10]).all()


def test_wrong_labels_are_not_copied():
    """Left half of the exemplar is red and labelled so: the target's left half gets red only."""
    style_labels = np.zeros((32, 64, 1), np.uint8)
    style_labels[:, :32] = 255
    picture = np.zeros((32, 64, 3), np.float32)
    picture[:, :32, 0], picture[:, 32:, 2] = 1, 1
    # The guide is 12 pixels off, so that without labels chunks would carry the wrong color over.
    position = pixel_centres((32, 64)) * np.float32(0.8)
    labels = np.zeros((32, 64, 1), np.uint8)
    labels[position[..., 0] < 32] = 255
    flat = np.zeros((32, 64), np.float32)
    guides = Guides(position, flat, labels, pixel_centres((32, 64)))
    weights = np.full((32, 64, 2), (0.5, 255.0), np.float32)
    table = build_table(flat, TableConfig(), 3.0)

    def wrong(label_weight):
        made = made_of(guides, weights, Style(flat, style_labels, table, picture),
                       BlitConfig(radius=0), label_weight, scale=1.0)
        return ((made.image[..., 0] > 0.5) != (labels[..., 0] > 0)).mean()

    assert wrong(0.0) > 0.02
    assert wrong(100.0) == 0.0


def test_voting_keeps_a_coherent_chunk():
    guides, weights, style = _problem(4)
    guides.position[:] = pixel_centres((40, 48))[..., :] * 0 + pixel_centres((40, 48)) * 0.9
    made = made_of(guides, weights, style, BlitConfig(threshold=1e6, levels=1, radius=1), scale=1.0)
    assert made.image.min() >= 0 and made.image.max() <= 1


def _shifted(image, dx, dy):
    return np.roll(image, (dy, dx), axis=(0, 1))


def test_anchored_seeds_move_with_the_picture():
    """Everything moved by (5, 3): with anchored seeds the result moves along, byte for byte."""
    guides, weights, style = _problem(6, 64, 64, 80, 80)
    first = made_of(guides, weights, style, BlitConfig(radius=0), seed=1)
    moved = Guides(_shifted(guides.position, 5, 3), _shifted(guides.appearance, 5, 3),
                   guides.labels, _shifted(guides.anchor, 5, 3))
    second = made_of(moved, weights, style, BlitConfig(radius=0), seed=1)
    back = _shifted(second.image, -5, -3)
    # Seeds on the border of the picture have no neighbour to tell the guide's slope.
    assert np.mean(np.abs(back - first.image).max(axis=-1) < 1e-3) > 0.99
    fixed = Guides(moved.position, moved.appearance, guides.labels, guides.anchor)
    loose = made_of(fixed, weights, style, BlitConfig(radius=0), seed=1)
    assert np.mean((_shifted(loose.image, -5, -3) == first.image).all(axis=-1)) < 0.9


def test_transfer_paints_the_whole_picture_in_the_exemplar_s_colors(tmp_path):
    style = drawn_face(256, 192, skin=(250, 120, 40), hair=(20, 20, 160), ground=(10, 90, 60))
    photo = drawn_face(220, 200, seed=1)
    result = transfer(photo.image, style, landmarks=photo.landmarks)
    assert result.image.shape == photo.image.shape and result.image.dtype == np.float32
    assert set(result.seconds) == {"table_seconds", "regions_seconds", "guides_seconds",
                                   "synthesis_seconds"}
    points = photo.landmarks
    cheek = (points[2] + points[31]) / 2
    crown = points[27] + 1.15 * (points[27] - points[57])
    for place, color in ((cheek, (250, 120, 40)), (crown, (20, 20, 160)),
                          ((5, 5), (10, 90, 60))):
        x, y = (int(v) for v in place)
        found = result.image[y - 2:y + 3, x - 2:x + 3].mean(axis=(0, 1)) * 255
        assert np.abs(found - color).max() < 40, (place, found)
    result.dump(tmp_path)
    names = {path.stem for path in tmp_path.iterdir()}
    assert {"position", "appearance", "labels", "table_error", "chunks", "mask", "result"} <= names
    assert Image.open(tmp_path / "chunks.png").size == (200, 220)


def test_transfer_region_and_strength():
    style, photo = drawn_face(128, 96, ground=(0, 0, 0)), drawn_face(128, 96, seed=1)
    prepared = Transfer(style, TransferConfig(extent="head"))
    result = prepared.apply(photo.image, photo.landmarks, mask=photo.mask)
    untouched = photo.mask == 0
    assert np.allclose(result.image[untouched], photo.image[untouched] / 255, atol=1e-5)
    nothing = Transfer(style, TransferConfig(strength=0.0)).apply(photo.image, photo.landmarks)
    assert np.allclose(nothing.image, photo.image / 255, atol=1e-6)


@pytest.mark.slow  # whole pictures: beside this
def test_transfer_scales_strokes_with_the_face():
    style, photo = drawn_face(384, 288), drawn_face(128, 96, seed=1)
    result = transfer(photo.image, style, landmarks=photo.landmarks)
    assert result.guides.anchor[0, 1, 0] - result.guides.anchor[0, 0, 0] == pytest.approx(3, 0.1)


def _camera_view(yaw, size=144):
    """Surface points of a ball seen from ``yaw`` (orthographic), and the photo of it."""
    y, x = np.mgrid[:size, :size]
    u, v = (x + 0.5) / size * 1.4 - 0.7, 0.7 - (y + 0.5) / size * 1.4
    depth = np.sqrt(np.maximum(0.36 - u ** 2 - v ** 2, 0))
    points = np.stack([u * np.cos(yaw) + depth * np.sin(yaw), v,
                       depth * np.cos(yaw) - u * np.sin(yaw)], axis=-1)
    points[u ** 2 + v ** 2 > 0.35] = np.nan
    shade = 0.5 + 0.3 * np.nan_to_num(points[..., 0]) + 0.1 * np.sin(
        30 * np.nan_to_num(points[..., 1]))
    return points, np.repeat(shade[..., None], 3, axis=2).astype(np.float32)


def test_views_paint_the_same_stroke_in_the_same_place():
    """Two views 5 degrees apart agree far better with anchored guides than when seeds are fixed."""
    style = drawn_face(240, 180, seed=3)
    strokes = gaussian_filter(np.random.default_rng(0).normal(0, 500, style.image.shape), (4, 4, 0))
    style.image = np.clip(style.image + strokes, 0, 255).astype(np.uint8)
    prepared = Transfer(style)
    guide = SurfaceGuide(HEAD_LANDMARKS, style, prepared.regions)
    landmarks = np.zeros((68, 2))
    landmarks[:, 0], landmarks[:, 1] = HEAD_LANDMARKS[:, 0], -HEAD_LANDMARKS[:, 1]
    landmarks = (landmarks + 0.7) / 1.4 * 144
    surfaces, places, pictures = [], [], {True: [], False: []}
    for yaw in (0.0, np.radians(5)):
        points, photo = _camera_view(yaw)
        position, anchor = guide(points)
        surfaces.append(points)
        for anchored in (True, False):
            made = prepared.apply(photo, landmarks, position=position,
                                  seeds_anchor=anchor if anchored else None)
            pictures[anchored].append(made.image)
        places.append(position)
    # For every point of the second view, its pixel in the first one.
    x = (surfaces[1][..., 0] + 0.7) / 1.4 * 144
    y = (0.7 - surfaces[1][..., 1]) / 1.4 * 144
    seen = np.isfinite(x) & (surfaces[1][..., 2] > 0.2)
    i, j = x[seen].astype(int), y[seen].astype(int)
    difference = {anchored: np.abs(pair[0][j, i] - pair[1][seen]).mean()
                  for anchored, pair in pictures.items()}
    assert difference[True] < 0.8 * difference[False]
    assert np.abs(places[0][j, i] - places[1][seen]).mean() < 3


def test_ball_head_all_around_is_painted():
    style = drawn_face(240, 180)
    position, anchor = SurfaceGuide(HEAD_LANDMARKS, style)(
        ball_head(np.linspace(-3, 3, 80), np.linspace(-1.5, 0.95, 60)))
    made = Transfer(style).apply(np.full((60, 80, 3), 0.5, np.float32),
                                 drawn_face(60, 80).landmarks, position=position,
                                 seeds_anchor=anchor)
    assert np.isfinite(made.image).all() and (made.mask == 1).all()


@pytest.mark.data
@pytest.mark.parametrize("name", ["ken", pytest.param("bronzestatue", marks=pytest.mark.slow)])
def test_real_exemplar_on_the_reference_photo(shared_data, name):
    """The result stays nearer to the exemplar's colors than the photo, over the whole picture."""
    folder = shared_data / "styles"
    style = Exemplar(np.asarray(Image.open(folder / f"{name}.png").convert("RGB")),
                     np.loadtxt(folder / f"{name}.landmarks.txt"), name)
    photo = np.asarray(Image.open(shared_data / "faceblit_reference" / "target1.png")
                       .convert("RGB"))
    het = np.loadtxt(folder / "het.landmarks.txt") * 1.05 - (20, -10)
    result = transfer(photo, style, landmarks=het)
    mean = style.image.reshape(-1, 3).mean(axis=0) / 255
    assert np.abs(result.image.reshape(-1, 3).mean(axis=0) - mean).max() < 0.12


def test_load_finds_landmarks_and_masks_beside(tmp_path):
    face = drawn_face(128, 96)
    np.savetxt(tmp_path / "face.landmarks.txt", face.landmarks)
    opaque = np.dstack([face.image, np.full((128, 96), 255, np.uint8)])
    Image.fromarray(opaque).save(tmp_path / "face.png")
    loaded = Exemplar.load(tmp_path / "face.png")
    assert loaded.name == "face" and loaded.mask is None
    assert np.array_equal(loaded.image, face.image)
    assert np.allclose(loaded.landmarks, face.landmarks, atol=1e-3)
    opaque[..., 3] = face.mask * 255
    Image.fromarray(opaque).save(tmp_path / "face.png")
    cut_out = Exemplar.load(tmp_path / "face.png").mask
    assert cut_out is not None and np.array_equal(cut_out, face.mask)
    Image.fromarray(np.zeros((128, 96), np.uint8)).save(tmp_path / "face.mask.png")
    named = Exemplar.load(tmp_path / "face.png").mask
    assert named is not None and named.max() == 0
