"""The field's file, the visual hull, and reconstruction of a colored ball from its pictures."""

import copy
import csv
import errno
import functools
import gc
import itertools
import time
import warnings
import zipfile
from dataclasses import replace

import cv2
import numba
import numpy as np
import pytest

from lfportrait.capture import Camera, Capture
from lfportrait.cli.reconstruction import Reconstruct
from lfportrait.errors import UserError
from lfportrait.field import (
    Backdrop,
    Curves,
    ReconstructConfig,
    SurfaceTexture,
    VoxelField,
    reconstruct,
    reconstruct_with_figures,
)
from lfportrait.field.background import Background
from lfportrait.field.config import _ROOM
from lfportrait.field.geometry.exposure import matte_gains
from lfportrait.field.geometry.start import hull_box, ruled_out, visual_hull
from lfportrait.field.storage import check_field_path, save_checkpoint, save_field
from lfportrait.field.training.lattice import Lattice
from lfportrait.field.training.meter import CurveFile
from lfportrait.field.training.trainer import Trainer
from tests.fields import shell_field
from tests.reference.svox2 import Checkpoint


def test_a_field_survives_the_disk(tmp_path):
    field = shell_field(basis=4, shape=(9, 12, 15), box=(1.2, 0.9, 0.7), center=(0.1, 0.2, -0.3))
    field.frame[0, 3], field.cone = 5.0, 40.0
    field.hair = np.arange(len(field.density)).astype(np.uint8)
    field.clothes = 255 - field.hair
    field.save(tmp_path / "f.npz")
    back = VoxelField.load(tmp_path / "f.npz")
    for one in (back, field.as_read(), field.with_sh(field.sh)):
        assert np.array_equal(one.hair, field.hair)
        assert np.array_equal(one.clothes, field.clothes)
    assert back.cone == field.as_read().cone == field.with_sh(field.sh).cone == 40.0
    assert np.array_equal(back.links, field.links)
    assert np.array_equal(back.density, field.density)
    assert np.array_equal(back.sh, field.sh)  # exact: the test's values are float16 numbers
    assert np.allclose(back.center, field.center, atol=1e-6)
    assert np.allclose(back.radius, field.radius, atol=1e-6)
    assert np.array_equal(back.frame, field.frame)


def test_the_file_is_svox2s(tmp_path):
    field = shell_field(basis=9, shape=(7, 8, 9))
    field.save(tmp_path / "f.npz")
    with np.load(tmp_path / "f.npz", allow_pickle=False) as data:
        assert data["links"].shape == (9, 8, 7)  # x, y, z
        assert data["links"][3, 2, 1] == field.links[1, 2, 3]
        assert data["density_data"].shape == (len(field.density), 1)
        assert data["sh_data"].shape == (len(field.density), 27)
        assert data["sh_data"].dtype == np.float16
        assert int(data["basis_type"]) == 1


def room_field(shape=(40, 50, 60)):
    """A shell with spheres behind it, most of whose links are empty."""
    field = shell_field(basis=4, shape=shape, box=(1.2, 0.9, 0.7))
    links = np.full((64, 32), -1, np.int32)
    links[10:20, 5:15] = np.random.default_rng(2).permutation(100).reshape(10, 10)
    data = np.random.default_rng(3).random((100, 3, 4)).astype(np.float32)
    field.background = Background(links, data)
    return field


@pytest.mark.parametrize("bare", [False, True])
def test_what_a_file_gives_is_known_without_it(tmp_path, bare):
    rng = np.random.default_rng(5)
    field = shell_field(12, basis=4, center=(0.1, 0.2, 0.3), box=(0.7, 0.9, 1.1))
    rows = len(field.density)
    field = replace(field, sh=(1e5 * rng.normal(size=(rows, 3, 4)) ** 9).astype(np.float32))
    if not bare:
        links = np.full((8, 4), -1, np.int32)
        links[2, 1:3] = 0, 1
        field = replace(
            field, background=Background(links, rng.normal(size=(2, 3, 4)).astype(np.float32)),
            texture=SurfaceTexture(rng.integers(-99, 99, (9, 7, 3)).astype(np.int8),
                                   rng.normal(size=(2, 3, 4)),
                                   rng.integers(0, 2, rows).astype(np.uint8), 31.7),
            backdrop=Backdrop(rng.integers(0, 256, (5, 6, 3)).astype(np.uint8), 12.3,
                              np.array([0.1, 0.2, 1.0]),
                              rng.normal(size=(9, 3)).astype(np.float32)))
    field.save(tmp_path / "field.npz")
    read, known = VoxelField.load(tmp_path / "field.npz"), field.as_read()
    arrays = [{f"{name}.{part}": value for name, whole in vars(one).items()
               for part, value in (vars(whole) if hasattr(whole, "__dict__") else {"": whole}
                                   ).items()} for one in (read, known)]
    assert arrays[0].keys() == arrays[1].keys()
    for name, value in arrays[0].items():
        other = arrays[1][name]
        assert type(value) is type(other), name
        if isinstance(value, np.ndarray):
            assert value.dtype == other.dtype and np.array_equal(value, other), name
            assert value.flags.c_contiguous == other.flags.c_contiguous, name
        else:
            assert value == other, name


@pytest.mark.parametrize("save", [save_field, save_checkpoint])
def test_a_file_is_little_more_than_its_voxels(tmp_path, save):
    field = room_field()
    save(field, tmp_path / "f.npz")
    voxels = 4 * len(field.density) + 2 * field.sh.size + field.background.data.nbytes
    assert field.links.nbytes > 0.5 * voxels
    assert (tmp_path / "f.npz").stat().st_size < voxels + 0.3 * field.links.nbytes
    with zipfile.ZipFile(tmp_path / "f.npz") as archive:
        deflated = {entry.filename for entry in archive.infolist() if entry.compress_type}
        assert deflated == {"links.npy", "background_links.npy", "density_data.npy", "sh_data.npy"}


def test_colors_that_are_the_same_from_all_sides_take_little_room(tmp_path):
    field = shell_field(24)
    sh = np.random.default_rng(0).random((len(field.density), 3, 9), np.float32)
    sh[::2, :, 1:] = 0.0
    save_field(field.with_sh(sh), tmp_path / "f.npz")
    with zipfile.ZipFile(tmp_path / "f.npz") as archive:
        assert archive.getinfo("sh_data.npy").compress_size < 0.65 * 2 * sh.size
    with np.load(tmp_path / "f.npz") as found:
        assert np.array_equal(found["sh_data"], np.float16(sh).reshape(len(sh), -1))


@pytest.mark.parametrize("threads", [1, 2])
def test_arrays_of_several_pieces_are_deflated_as_one(tmp_path, threads):
    """The pieces are deflated side by side; a reader and the check of the file see one stream."""
    values = np.random.default_rng(3).integers(0, 4, (1200, 1200), np.int32)
    before = numba.get_num_threads()
    numba.set_num_threads(min(threads, numba.config.NUMBA_NUM_THREADS))
    try:
        save_field(shell_field(8), tmp_path / "f.npz", deflated=("many",), many=values,
                   none=np.empty(0, np.int32))
    finally:
        numba.set_num_threads(before)
    with zipfile.ZipFile(tmp_path / "f.npz") as archive:
        assert archive.testzip() is None
        assert archive.getinfo("many.npy").compress_size < values.nbytes / 4
    with np.load(tmp_path / "f.npz") as found:
        np.testing.assert_array_equal(found["many"], values)


@pytest.mark.parametrize("save", [save_field, save_checkpoint])
def test_a_file_has_the_same_bytes_whenever_it_is_written(tmp_path, save, monkeypatch):
    save(room_field(), tmp_path / "one.npz")
    later = time.localtime(time.time() + 1e8)
    monkeypatch.setattr(time, "localtime", lambda *_: later)
    save(room_field(), tmp_path / "two.npz")
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()


@pytest.mark.filterwarnings("error")
def test_a_full_disk_is_told(tmp_path, monkeypatch):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        gc.collect()  # what other tests left open is not complained of here
    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")
    monkeypatch.setattr(np.lib.format, "write_array", full)
    with pytest.raises(UserError, match="No space left"):
        save_field(room_field(), tmp_path / "f.npz")
    gc.collect()
    assert not list(tmp_path.iterdir())


def test_that_a_file_cant_be_written_is_told_at_once(tmp_path):
    (tmp_path / "taken").write_text("a file, no folder")
    for path in (tmp_path / "f.npy", tmp_path / "taken" / "f.npz"):
        with pytest.raises(UserError, match=r"written as \.npz|can't write"):
            check_field_path(path)


def test_a_field_is_svox2s_checkpoint(tmp_path):
    field = room_field()
    field.save(tmp_path / "f.npz")
    theirs = Checkpoint(tmp_path / "f.npz")
    # svox2's kernels take only tables in C order, as `numpy.load` gives them here.
    assert theirs.links.flags.c_contiguous
    assert np.array_equal(theirs.links, field.links.transpose(2, 1, 0))
    assert np.array_equal(theirs.density[:, 0], field.density)
    assert np.array_equal(theirs.sh, field.sh.reshape(len(field.sh), -1))
    for ours, other in zip((field.background.links, field.background.data), theirs.behind):
        assert np.array_equal(ours, other)


def test_files_of_older_versions_are_read(tmp_path):
    """They were written by `numpy.savez`, with nothing deflated."""
    field = room_field()
    field.save(tmp_path / "new.npz")
    with np.load(tmp_path / "new.npz") as data:
        np.savez(tmp_path / "old.npz", **data)
    assert (tmp_path / "old.npz").stat().st_size > (tmp_path / "new.npz").stat().st_size
    new, old = VoxelField.load(tmp_path / "new.npz"), VoxelField.load(tmp_path / "old.npz")
    for name in ("links", "density", "sh", "center", "radius", "frame"):
        assert np.array_equal(getattr(new, name), getattr(old, name)), name
    assert np.array_equal(new.background.data, old.background.data)


def test_svox2s_files_are_read_old_form_and_skip_distances_included(tmp_path):
    field = shell_field(basis=1, size=8)
    links = field.links.transpose(2, 1, 0).copy()
    links[links < 0] = -7
    np.savez(tmp_path / "old.npz", radius=np.ones(3, np.float32), center=np.zeros(3, np.float32),
             links=links, data=np.column_stack([field.density, field.sh.reshape(-1, 3)]))
    back = VoxelField.load(tmp_path / "old.npz")
    assert np.array_equal(back.links, field.links)
    assert np.allclose(back.sh, field.sh)


@pytest.mark.parametrize("spoil", ["missing key", "links", "text", "truncated", "basis", "bases",
                                   "basis in words", "words", "nan", "cube", "frame", "cone",
                                   "hair", "hair's kind", "clothes", "compressed"])
def test_damaged_files_are_told_in_one_line(tmp_path, spoil):
    path = tmp_path / "f.npz"
    field = shell_field(size=8)
    field.save(path)
    if spoil == "text":
        path.write_text("hello")
    elif spoil == "truncated":
        path.write_bytes(path.read_bytes()[:300])
    else:
        with np.load(path) as data:
            arrays = dict(data)
        if spoil == "missing key":
            del arrays["sh_data"]
        elif spoil == "links":
            arrays["links"] = arrays["links"] + 10_000
        elif spoil == "basis":
            arrays["basis_type"] = np.int64(4)
        elif spoil == "bases":
            arrays["basis_type"] = np.ones(3, np.int64)
        elif spoil == "basis in words":
            arrays["basis_type"] = np.str_("harmonics")
        elif spoil == "words":
            arrays["links"] = np.full(arrays["links"].shape, "x")
        elif spoil == "nan":
            arrays["density_data"][3] = np.nan
        elif spoil == "cube":
            arrays["radius"] = np.zeros(3, np.float32)
        elif spoil == "frame":
            arrays["frame"] = np.eye(3)
        elif spoil == "cone":
            arrays["cone"] = np.float64(400)
        elif spoil == "hair":
            arrays["hair"] = np.zeros(len(arrays["sh_data"]) - 1, np.uint8)
        elif spoil == "hair's kind":
            arrays["hair"] = np.zeros(len(arrays["sh_data"]), np.float32)
        elif spoil == "clothes":
            arrays["clothes"] = np.zeros(len(arrays["sh_data"]) + 1, np.uint8)
        np.savez(path, **arrays)
        if spoil == "compressed":
            np.savez_compressed(path, **arrays)
            content = bytearray(path.read_bytes())
            for place in range(100, len(content) - 1200, 37):
                content[place] ^= 0xFF
            path.write_bytes(content)
    with pytest.raises(UserError, match=r"f\.npz"):
        VoxelField.load(path)
    with pytest.raises(UserError, match="no such"):
        VoxelField.load(tmp_path / "none.npz")


def ball_capture(count=21, size=40, alpha=True, room=False):
    """A ball of radius 0.6 whose color is its normal, photographed from all around."""
    return copy.deepcopy(_photographed_ball(count, size, alpha, room))


@functools.cache
def _photographed_ball(count, size, alpha, room):
    random = np.random.default_rng(0)
    places = random.standard_normal((count, 3))
    places *= 3.0 / np.linalg.norm(places, axis=1, keepdims=True)
    cameras = Camera.look_at(places, np.zeros(3), width=size, height=size, focal=1.3 * size)
    images, alphas = [], []
    for view in range(count):
        # 4x4 samples a pixel, so that the outline is soft as in a photo.
        fine = np.arange(4 * size) / 4 + 0.125
        x, y = np.meshgrid(fine, fine)
        origins, directions = cameras.rays(view, np.stack([x.ravel(), y.ravel()], 1))
        b = (origins * directions).sum(1)
        root = b * b - (origins ** 2).sum(1) + 0.36
        hit = root > 0
        normal = (origins + (-b - np.sqrt(np.maximum(root, 0)))[:, None] * directions) / 0.6
        color = np.where(hit[:, None], 0.5 + 0.4 * normal, 0.0)
        weight = hit.reshape(size, 4, size, 4).mean((1, 3))
        color = color.reshape(size, 4, size, 4, 3).sum((1, 3)) / 16
        color = color / np.maximum(weight, 1e-6)[..., None]
        alphas.append(np.uint8(weight * 255 + 0.5))
        if not alpha:
            color = color * weight[..., None] + (1 - weight[..., None])
        images.append(np.uint8(np.clip(color, 0, 1) * 255 + 0.5))
    held_out = np.arange(count) % 7 == 3
    return Capture(cameras, images, alphas if alpha else None, [f"{i}.png" for i in range(count)],
                   held_out)


TINY = ReconstructConfig(resolutions=(24, 40), rays=(0.1, 0.2), batch=(1024,))


def test_the_hull_holds_the_ball_and_little_more():
    capture = ball_capture()
    hull = visual_hull(capture.cameras, capture.alphas, (32, 32, 32), np.zeros(3), np.ones(3))
    axis = 2 * (np.arange(32) + 0.5) / 32 - 1
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    radius = np.sqrt(x * x + y * y + z * z)
    assert hull[radius < 0.6].all()
    assert hull[radius > 0.85].mean() < 0.02
    center, box = hull_box(capture.cameras, capture.alphas)
    assert (center + box > 0.6).all()
    assert (center - box < -0.6).all()
    assert np.prod(box) < 1.0


def test_mattes_that_err_in_few_views_leave_no_crumbs():
    capture = ball_capture()
    axis = 2 * (np.arange(64) + 0.5) / 64 - 1
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    radius = np.sqrt(x * x + y * y + z * z)
    # Every tenth matte is four pixels too wide: what lies there is in most others' background.
    wide = [cv2.dilate(alpha, np.ones((9, 9), np.uint8)) if view % 10 == 0 else alpha
            for view, alpha in enumerate(capture.alphas)]
    filled = radius < 0.6 + 4 * (axis[1] - axis[0])
    wrong, hardly = ruled_out(capture.cameras, wide, filled, np.zeros(3), np.ones(3))
    assert not wrong[radius < 0.56].any()
    assert not wrong[~filled].any() and not hardly.any()
    assert wrong[filled & (radius > 0.68)].mean() > 0.95


def test_points_outside_most_pictures_are_hardly_shown():
    capture = ball_capture()
    filled = np.ones((8, 8, 8), bool)
    filled[0] = False
    _, hardly = ruled_out(capture.cameras, capture.alphas, filled, np.zeros(3), np.full(3, 30.0))
    assert hardly[7, 7, 7] and not hardly[0].any()


def test_loose_points_need_the_largest_piece():
    solid = np.zeros((40, 40, 40), bool)
    solid[4:16, 4:16, 4:16] = True
    solid[28:32, 28:32, 28:32] = True  # another object
    solid[16:18, 8, 8] = True  # a hair of the first
    lattice = Lattice.filled(solid, 10.0, 16, np.zeros(3), np.ones(3))
    loose = np.zeros_like(solid)
    loose[16:] = True
    kept = lattice.attached(loose) & solid
    assert kept[4:18].sum() == solid[4:18].sum()
    assert not kept[28:].any()
    assert (lattice.attached() & solid)[28:].any()


def test_large_pieces_stay_and_crumbs_go():
    solid = np.zeros((40, 40, 40), bool)
    solid[4:16, 4:16, 4:16] = True  # 1728 points
    solid[28:32, 28:32, 28:32] = True  # 64 points, another object
    solid[30:31, 4:6, 4:5] = True  # two points: a crumb
    lattice = Lattice.filled(solid, 10.0, 16, np.zeros(3), np.ones(3))
    kept = lattice.attached() & solid
    assert kept[4:16, 4:16, 4:16].all()
    assert kept[28:32, 28:32, 28:32].all()
    assert not kept[30, 4:6, 4].any()


def test_a_cropped_lattice_has_its_points_where_they_were():
    there = np.zeros((20, 30, 40), bool)
    there[8:12, 3:9, 21:35] = True
    center, radius = np.array([0.1, -0.2, 0.3]), np.array([1.0, 0.8, 0.4])
    lattice = Lattice.filled(there, 1.0, 16, center, radius)
    lattice.density[:-1] = np.arange(lattice.count)
    small, keep = lattice.cropped(there)
    assert small.links.shape == (8, 10, 18)
    assert keep.sum() == there.sum()

    def places(of):
        field = VoxelField(of.links, of.density[:-1], np.zeros((of.count, 3, 1), np.float32),
                           of.center, of.radius)
        return field.lattice_points()

    assert np.allclose(places(small), places(lattice), atol=1e-6)
    fine = small.refined((16, 20, 36), keep)
    assert 4 * there.sum() < fine.count < 14 * there.sum()


@pytest.mark.slow  # trains once more
def test_the_room_can_be_kept(tmp_path):
    ball_capture(count=6, size=24).save(tmp_path / "capture")
    figures = Reconstruct(tmp_path / "capture", tmp_path / "field.npz", keep_background=True,
                          quiet=True, config=ReconstructConfig(
                              resolutions=(16,), rays=(0.01,), mvs_init=False)).run()
    assert figures["voxels"] > 0
    assert VoxelField.load(tmp_path / "field.npz").background is not None


# Trainings of one width of rows are enough: the kernel for another takes ten seconds to compile.
@pytest.mark.parametrize("degree", [2, pytest.param(1, marks=pytest.mark.slow),
                                    pytest.param(0, marks=pytest.mark.slow)])
def test_a_ball_is_reconstructed(degree):
    capture = ball_capture()
    field, figures = reconstruct_with_figures(capture, replace(TINY, sh_degree=degree))
    assert field.basis == (degree + 1) ** 2
    assert figures["test"]["psnr"] > 27
    assert figures["test"]["views"] == 3
    assert figures["train"]["rays"] > 100_000
    # Empty space is clean: nothing is seen around the ball.
    view = int(capture.testing()[0])
    alpha = field.render(capture.cameras, view).alpha
    truth = capture.alphas[view] / 255.0
    assert alpha[truth == 0].mean() < 0.02
    assert alpha[truth == 1].min() > 0.85


@pytest.mark.slow  # trains once more
def test_densities_below_zero_put_the_outline_between_lattice_points():
    capture = ball_capture()
    config = replace(TINY, resolutions=(16, 24))
    plain, cut_off = (reconstruct_with_figures(capture, replace(config, density_floor=floor))
                      for floor in (0.0, 0.1))
    assert plain[0].density.min() >= 0
    assert -0.1001 <= (cut_off[0].density.min() * cut_off[0].spacing.mean()) < 0
    assert cut_off[1]["test"]["psnr"] > plain[1]["test"]["psnr"] + 1.0


def test_small_voxels_keep_their_densities_above_zero():
    def floor(finest, pixel, **more):
        config = ReconstructConfig(resolution=finest, **more)
        return config.resolved(room=False, distance=4.0, pixel=pixel).density_floor

    assert floor(256, 0.005) == 0.1
    assert floor(256, 0.006) == 0.0
    assert floor(256, 0.006, density_floor=0.2) == 0.2
    assert ReconstructConfig().resolved(room=True, distance=4.0).density_floor == 0.3


@pytest.mark.slow  # trains once more
def test_a_ball_without_mattes_is_reconstructed_on_white(monkeypatch):
    monkeypatch.setitem(_ROOM, "lr_sigma", 3.0)
    capture = ball_capture(alpha=False)
    config = replace(TINY, background_nlayers=0, mvs_init=False, near_clip=0.0)
    _, figures = reconstruct_with_figures(capture, config)
    assert figures["test"]["psnr"] > 24


def test_the_same_seed_gives_the_same_bytes_and_a_resumed_run_does_too(tmp_path, monkeypatch):
    monkeypatch.setattr("lfportrait.field.training.trainer._SAVE_EVERY", 0.0)
    capture = ball_capture(count=8, size=32)
    config = ReconstructConfig(resolutions=(16, 24), rays=(0.03, 0.05), batch=(2048,))
    first, _ = reconstruct_with_figures(capture, config)
    checkpoint = tmp_path / "state.npz"

    class Stop(Exception):
        pass

    class Interrupt:
        total, done = 0, 0

        def update(self, done, note=""):
            if done > 600:
                raise Stop

        def say(self, line):
            pass

        def show(self, field):
            pass

    with pytest.raises(Stop):
        reconstruct_with_figures(capture, config, Interrupt(), checkpoint=checkpoint)
    assert checkpoint.is_file()
    damaged = tmp_path / "damaged.npz"
    damaged.write_bytes(checkpoint.read_bytes()[:500])
    again, _ = reconstruct_with_figures(capture, config, checkpoint=damaged)  # starts anew
    assert np.array_equal(first.density, again.density)
    second, figures = reconstruct_with_figures(capture, config, checkpoint=checkpoint)
    assert np.array_equal(first.links, second.links)
    assert np.array_equal(first.density, second.density)
    assert np.array_equal(first.sh, second.sh)
    assert figures["train"]["rays"] == 2048 * (round(0.03e6 / 2048) + round(0.05e6 / 2048))


@pytest.mark.parametrize("at", [
    pytest.param(10, marks=pytest.mark.slow),
    21])  # some of the states that are averaged are behind
def test_a_run_stopped_in_the_middle_of_a_level_goes_on_from_there(tmp_path, monkeypatch, at):
    capture = ball_capture(count=8, size=32)
    config = ReconstructConfig(resolutions=(16, 24), rays=(0.03, 0.05), batch=(2048,))
    first, _ = reconstruct_with_figures(capture, config)
    checkpoint = tmp_path / "state.npz"
    steps = []

    def stop(trainer):
        trainer.save()
        steps.append((trainer.level, trainer.step))
        if trainer.level == 1 and trainer.step == at:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Trainer, "save_now_and_then", stop)
        with pytest.raises(KeyboardInterrupt):
            reconstruct_with_figures(capture, config, checkpoint=checkpoint)
    trained = []
    monkeypatch.setattr(Trainer, "save_now_and_then",
                        lambda trainer: trained.append((trainer.level, trainer.step)))
    second, figures = reconstruct_with_figures(capture, config, checkpoint=checkpoint)
    assert steps[-1] == (1, at)
    assert trained[0] == (1, at + 1)
    assert np.array_equal(first.links, second.links)
    assert np.array_equal(first.density, second.density)
    assert np.array_equal(first.sh, second.sh)
    assert figures["train"]["rays"] == 2048 * (round(0.03e6 / 2048) + round(0.05e6 / 2048))


def test_curves_are_measured_and_logged(tmp_path):
    _, figures = reconstruct_with_figures(ball_capture(), TINY, curves=Curves(
        tmp_path / "logs" / "curves.csv", measure_every=0.3))
    curve = figures["curve"]
    assert len(curve) >= 2
    for before, after in itertools.pairwise(curve[:-1]):
        assert after["seconds"] > before["seconds"]
        assert after["rays"] > before["rays"]
        # Seconds are written to the millisecond, the rate is of the time that passed.
        passed = (after["rays"] - before["rays"]) / after["rays_per_second"]
        assert passed == pytest.approx(after["seconds"] - before["seconds"], abs=0.0011)
    assert curve[0]["psnr"] < curve[-1]["psnr"]
    assert curve[-1]["held_out_psnr"] == figures["test"]["psnr"]
    with open(tmp_path / "logs" / "curves.csv", encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [{name: float(text) if text else None for name, text in row.items()}
            for row in rows] == curve
    assert float(rows[-1]["rays"]) == figures["train"]["rays"]


def test_a_run_that_goes_on_adds_to_the_curves(tmp_path):
    point = {"seconds": 1.0, "rays": 9, "rays_per_second": 9.0, "loss": 0.5, "psnr": 3.0,
             "voxels": 8, "resolution": 2, "held_out_psnr": None}
    for _ in range(2):
        file = CurveFile(tmp_path / "curves.csv")
        file.write(point)
        # On the disk while the file is still open.
        assert (tmp_path / "curves.csv").read_text("utf-8").endswith("9,9.0,0.5,3.0,8,2,\n")
        file.close()
    lines = (tmp_path / "curves.csv").read_text("utf-8").splitlines()
    assert len(lines) == 3 and lines[0].startswith("seconds,rays,")


def test_curves_that_can_not_be_written_are_told(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(UserError, match="can't write the log"):
        CurveFile(tmp_path / "file" / "curves.csv")


@pytest.mark.slow  # trains once more
def test_a_field_that_is_wrong_from_part_to_part_tells_no_exposures():
    capture = ball_capture(40)
    field = reconstruct(capture, TINY)
    # Stripes that are too bright and too dark, eight of them across the ball, and brighter on one
    # side: photos differ in what they show of them, as they would by their exposures.
    z, y, x = np.nonzero(field.links >= 0)
    factor = np.empty(len(field.density))
    factor[field.links[z, y, x]] = np.where(y // 4 % 2, 1.4, 0.7) * np.where(
        x < field.links.shape[2] // 2, 1.1, 0.9)
    half = np.float32(0.5 / 0.28209479)  # a color of zero is grey
    sh = field.sh.copy()
    sh[..., 0] += half
    sh *= factor[:, None, None].astype(np.float32)
    sh[..., 0] -= half
    wrong = field.with_sh(sh)
    views = capture.training()
    assert matte_gains(wrong, capture, views) is None
    gains = matte_gains(wrong, capture, views, least=0.0)
    assert gains is not None and np.log(gains).mean(axis=1).std() > 0.02


@pytest.mark.slow  # trains once more; exposures: test_head_surface.py
def test_exposures_of_photos_with_mattes_are_found():
    capture = ball_capture(count=28)
    _, plain = reconstruct_with_figures(capture, TINY)
    assert "psnr_without_exposure" not in plain["test"]
    gains = np.exp(np.random.default_rng(1).normal(0, 0.15, (28, 1))) * np.ones(3)
    photos = [np.uint8(np.clip(image * gain, 0, 255) + 0.5)
              for image, gain in zip(capture.images, gains / gains.max())]
    spread = replace(capture, images=photos)
    _, without = reconstruct_with_figures(spread, replace(TINY, exposure=False))
    _, found = reconstruct_with_figures(spread, TINY)
    assert found["test"]["psnr"] > without["test"]["psnr"] + 3
    assert found["test"]["psnr"] > plain["test"]["psnr"] - 2.0
    assert found["test"]["psnr_without_exposure"] < found["test"]["psnr"]


def test_the_finest_level_follows_the_pixels():
    config = ReconstructConfig()
    assert config.resolved(False, 4.0, 0.0041).resolutions == (64, 128, 256)
    assert config.resolved(False, 4.0, 0.0025).resolutions == (104, 208, 416)
    assert config.resolved(False, 4.0, 0.0001).resolutions[-1] == 512
    assert config.resolved(True, 4.0, 0.0001).resolutions == (96, 192)
    own = replace(config, resolution=128, time_budget=60.0).resolved(False, 4.0, 0.0001)
    assert own.resolutions == (32, 64, 128)
    assert np.isinf(own.rays[-1])
    assert sum(own.shares()) == pytest.approx(1.0)
    assert own.shares() == pytest.approx((0.04, 0.16, 0.8))
    with pytest.raises(UserError, match="--resolution"):
        replace(config, resolution=3).resolved(False, 4.0, 0.0041)


@pytest.mark.slow  # a budget ends a training above
def test_a_time_budget_is_used_up_and_a_coarse_level_has_its_share():
    config = ReconstructConfig(resolutions=(24, 40), batch=(4096,))
    reconstruct(ball_capture(), replace(config, rays=(0.01, 0.01)))  # compiles the kernels
    # Ten thousand rays are cast in no time.
    _, figures = reconstruct_with_figures(ball_capture(), replace(
        config, rays=(0.01, float("inf")), time_budget=2.0))
    assert figures["test"]["psnr"] > 22
    assert 1.6 < figures["seconds"]["train"] < 30
    assert figures["levels"][0]["seconds"] > 0.2


def test_levels_and_rays_by_default():
    portrait = ReconstructConfig().resolved(room=False, distance=4.0, pixel=0.01)
    assert portrait.resolutions == (64, 128, 256) and portrait.rays == (1.0, 5.0, 12.0)
    assert portrait.shares() == pytest.approx((1 / 18, 5 / 18, 12 / 18))
    timed = ReconstructConfig(time_budget=60.0).resolved(room=False, distance=4.0, pixel=0.002)
    assert timed.resolutions == (128, 256, 512) and timed.rays == pytest.approx((1.6, 8.0, np.inf))
    assert timed.paced and timed.shares() == pytest.approx((0.04, 0.16, 0.8))
    assert ReconstructConfig(resolution=32).resolved(False, 4.0).resolutions == (16, 32)
    room = ReconstructConfig().resolved(room=True, distance=4.0)
    assert room.resolutions == (96, 192) and room.rays == (4.0, 8.0)
    for levels in ((32,), (32, 64), (32, 64, 128, 256)):
        chosen = ReconstructConfig(resolutions=levels, time_budget=9.0).resolved(False, 4.0, 0.01)
        assert len(chosen.rays) == len(levels) and chosen.rays[-1] == np.inf
        assert sum(chosen.shares()) == pytest.approx(1.0) and min(chosen.shares()) > 0


def test_a_time_budget_ends_with_a_usable_field():
    _, figures = reconstruct_with_figures(ball_capture(), ReconstructConfig(
        resolutions=(24, 40), rays=(50.0, 50.0), batch=(4096,), time_budget=2.0))
    assert figures["test"]["psnr"] > 20
    assert figures["seconds"]["train"] < 30


def test_bad_parameters_and_captures_are_the_users_mistake():
    with pytest.raises(UserError, match="one a level"):
        reconstruct_with_figures(ball_capture(4),
                                 ReconstructConfig(resolutions=(8,), rays=(1.0, 2.0)))
    with pytest.raises(UserError, match="too few"):
        reconstruct_with_figures(ball_capture(2))
    capture = ball_capture(6)
    for alpha in capture.alphas:
        alpha[:] = 0
    with pytest.raises(UserError, match="mattes"):
        reconstruct_with_figures(capture)


def test_a_saved_field_renders_the_same_bytes(tmp_path):
    capture = ball_capture(count=8, size=32)
    field = reconstruct(capture, ReconstructConfig(resolutions=(24,), rays=(0.05,), batch=(2048,)))
    field.save(tmp_path / "field.npz")
    again = VoxelField.load(tmp_path / "field.npz")
    assert np.array_equal(field.render(capture.cameras, 1).color,
                          again.render(capture.cameras, 1).color)
