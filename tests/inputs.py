"""Small valid inputs of every reader, and the readers: what `scripts/fuzz_readers.py` damages.

Each builder writes into an empty folder; each reader is given the folder.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from lfportrait.capture import Capture, is_calibrated, read_photos, read_source, video_frames
from lfportrait.errors import UserError
from lfportrait.example import Exemplar
from lfportrait.example.skin.sitter import Skin
from lfportrait.example.skin.storage import load_skin, save_skin
from lfportrait.face import read_landmarks
from lfportrait.field import VoxelField
from lfportrait.files import write_image
from lfportrait.job.batch import load_jobs
from lfportrait.job.batch.journal import read_events
from lfportrait.lightfield import Display, QuiltLayout, layout_for, layout_of_file
from lfportrait.media.depth import read_depth
from lfportrait.media.pictures import read_image, read_mask
from lfportrait.share import write_quilt, write_video
from lfportrait_eval.study import read_answers
from lfportrait_eval.study.design import clip_of
from lfportrait_eval.study.results import write_results
from tests.capture import depth_files
from tests.capture.test_camera import rig
from tests.capture.test_capture import colmap_model, make_capture, write_transforms
from tests.capture.test_formats import write_llff, write_nsvf
from tests.capture.test_phones import polycam, record3d
from tests.capture.test_programs import (
    bundler,
    centred,
    meshroom,
    metashape,
    openmvg,
    photos,
    reality_capture,
    visualsfm,
)
from tests.fields import head_field, shell_field
from tests.lfportrait_eval.study.people import answer
from tests.portraits import HEAD_LANDMARKS

JOBS = b"""[defaults]
seed = 3
stylize.strength = 0.5
[[sitter]]
name = "anna"
photos = "anna"
styles = ["soft"]
sweeps = true
[[style]]
name = "soft"
painting = "fauve"
[[display]]
panel = "generic-1080p"
encode.size = 0.6
"""
DESIGN: dict[str, Any] = {
    "format": "lfportrait study", "study": "s1",
    "questions": [{"name": "style", "text": "Which is more like the painting?"}],
    "entries": [{"sitter": "anna", "style": "ink", "method": name} for name in ("skin", "arf")],
    "pairs": [[0, 1]], "sheets": [[[0, 0]]], "repeats": 1}


@dataclass(frozen=True)
class Kind:
    """A kind of input: what writes one into a folder, and what reads it from there."""

    write: Callable[[Path], None]
    read: tuple[Callable[[Path], object], ...]


def landmarks_text(random, low, high):
    return "\n".join(f"{x} {y}" for x, y in random.uniform(low, high, (68, 2)).round(2))


def noise(height=12, width=16, channels=3):
    return np.random.default_rng(7).integers(0, 256, (height, width, channels), np.uint8)


# -- pictures -------------------------------------------------------------------------------------


def phone_jpeg() -> bytes:
    """A photo with a camera's EXIF and an XMP packet."""
    exif = Image.Exif()
    exif[0x010F], exif[0x0110], exif[0x0112] = "Apple", "iPhone 12", 6
    exif.get_ifd(0x8769).update({0x920A: 4.2, 0xA405: 26, 0x9003: "2024:01:02 03:04:05",
                                 0xA20E: 300.0, 0xA210: 3})
    return depth_files.noted(depth_files.encoded(noise(), "JPEG", exif=exif.tobytes()),
                             depth_files.RDF.format("").encode())


def jpegs_with_depth(folder):
    ramp, plain = noise(24, 32)[..., 0], depth_files.jpeg()
    notes = {"Format": "RangeInverse", "Near": "0.5", "Far": "4", "Units": "m"}
    depth = depth_files.encoded(ramp)
    apple = depth_files.noted(depth_files.encoded(ramp, "JPEG"),
                              depth_files.apple_notes(0.25, 2.0, "absolute"))
    for name, data in {
            "gdepth": depth_files.gdepth(plain, depth, notes, depth),
            "extended": depth_files.gdepth(plain, depth, notes, apart=True),
            "dynamic": depth_files.dynamic_depth(
                plain, {"android/depthmap": depth},
                notes | {"DepthURI": "android/depthmap"}),
            "container": depth_files.container(plain, [("Depth", apple)]),
            "apple": depth_files.multi_picture(plain, [apple])}.items():
        (folder / f"{name}.jpg").write_bytes(data)


def heic_with_depth(folder):
    notes = depth_files.representation(1, d_min=1.0, d_max=9.0)
    (folder / "photo.heic").write_bytes(depth_files.heic(
        noise(96, 128), noise(48, 64)[..., 0], notes, 3,
        packet=depth_files.MATTE + depth_files.apple_notes(0.25, 2.0)))


def tiffs(folder):
    Image.fromarray(noise()).save(folder / "a.tif")
    Image.fromarray(noise()[..., 0].astype(np.uint16) * 250).save(folder / "deep.tif",
                                                                 compression="tiff_deflate")


def pngs(folder):
    Image.fromarray(noise(channels=4)).save(folder / "alpha.png")
    Image.fromarray(noise()).quantize(16).save(folder / "palette.png", transparency=3)
    Image.fromarray(noise()).save(folder / "text.png", pnginfo=None, dpi=(72, 72))


def saved(name, **options):
    """A builder of a picture by Pillow."""
    return lambda folder: Image.fromarray(noise()).save(folder / name, **options)


def of_each(read):
    """A reader of each file of a folder."""
    return lambda folder: [attempt(read, path) for path in sorted(folder.iterdir())]


def attempt(read, path):
    """One file's result; what is wrong with it does not keep the next from being read."""
    try:
        return read(path)
    except UserError as error:
        return error


PICTURE_READERS = (of_each(read_image), of_each(read_depth), read_photos)


def masks(folder):
    gray = noise(channels=3)[..., 0] // 128 * 255
    Image.fromarray(gray).save(folder / "gray.png")
    Image.fromarray(gray).convert("1").save(folder / "bits.png")
    Image.fromarray(np.dstack([noise(), gray])).save(folder / "alpha.png")
    Image.fromarray(gray // 255).save(folder / "ones.png")
    Image.fromarray(noise()).quantize(2).save(folder / "palette.png")


# -- cameras --------------------------------------------------------------------------------------


def nerf(folder):
    for name, first in (("train", 0), ("test", 2)):
        write_transforms(folder, rig(8, 5)[first:first + 2 + (name == "train")],
                         {"camera_angle_x": 0.7}, name=f"transforms_{name}.json", first=first)


def nerfstudio(folder):
    write_transforms(folder, rig(8, 3), {"fl_x": 110, "fl_y": 110, "cx": 40, "cy": 30, "w": 80,
                                         "h": 60, "k1": 0.1, "camera_model": "OPENCV"})
    write_image(folder / "masks" / "000.png", np.full((60, 80, 3), 255, np.uint8))
    file = folder / "transforms.json"
    data = json.loads(file.read_text("utf-8"))
    data["frames"][0]["mask_path"] = "masks/000.png"
    data["train_filenames"] = [frame["file_path"] for frame in data["frames"][:2]]
    file.write_text(json.dumps(data), "utf-8")


def colmap(text):
    def write(folder):
        colmap_model(folder / "sparse" / "0", "OPENCV", rig(3, 3), text)
        for view in range(3):
            write_image(folder / "images" / f"a photo {view:02d}.png",
                        np.zeros((60, 80, 3), np.uint8))
    return write


def of_program(write_cameras):
    def write(folder):
        photos(folder, centred())
        write_cameras(folder, centred())
    return write


def of_phone(write_cameras):
    return lambda folder: write_cameras(folder, centred(), False)


def llff(folder):
    write_llff(folder, rig(3, 3), 80, 60)
    for view in range(3):
        write_image(folder / "images" / f"{view}.png", np.zeros((60, 80, 3), np.uint8))


def nsvf(folder):
    write_nsvf(folder, rig(3, 3))
    (folder / "bbox.txt").write_text("-1 -1 -1 1 1 1 0.4\n")


def of_program_file(folder):
    """The file itself is named, as on the command line."""
    return [attempt(Capture.load, path) for path in sorted(folder.iterdir())
            if path.is_file() and path.name != "list.txt"]


CAPTURE_READERS = (is_calibrated, Capture.load)


# -- the rest -------------------------------------------------------------------------------------


def film(folder):
    frames = np.full((8, 48, 64, 3), 40, np.uint8)
    for time, frame in enumerate(frames):
        frame[10:30, 2 * time:2 * time + 16] = noise(20, 16)
    write_video(folder / "film.mp4", frames, 10, preset="superfast")


def read_frames(folder):
    return len(list(video_frames(folder / "film.mp4")[1]))


def quilts(folder):
    layout = QuiltLayout(3, 2, 0.75)
    for name in ("a.png", "b.jpg", "c.webp"):
        write_quilt(folder / name, noise(64, 72), layout, beside=name == "a.png")
    Image.fromarray(noise(64, 72)).save(folder / "d_qs3x2a0.75.png")


def read_layouts(folder):
    return [attempt(read, folder / name)
            for name in ("a.png", "b.jpg", "c.webp", "d_qs3x2a0.75.png")
            for read in (layout_of_file, lambda path: layout_for(path, None))]


def panel(folder):
    Display.preset("lookingglass-16").save(folder / "panel.toml")


def calibration(folder):
    entries = Display.preset("lookingglass-16").looking_glass()
    entries |= {"serial": "LKG-E01234", "defaultQuilt": json.dumps(
        {"tileX": 11, "tileY": 6, "quiltX": 4092, "quiltY": 4092}),
        "subpixelCells": [{f"{color}Offset{axis}": 0.1 for color in "RGB" for axis in "XY"}],
        "CellPatternMode": 0}
    (folder / "visual.json").write_text(json.dumps(entries), "utf-8")


def landmarks(folder):
    (folder / "a.landmarks.txt").write_text(landmarks_text(np.random.default_rng(6), 0, 500))


def exemplar(folder):
    write_image(folder / "a.png", noise(40, 30))
    (folder / "a.landmarks.txt").write_text(landmarks_text(np.random.default_rng(12), 5, 25))
    write_image(folder / "a.mask.png", np.full((40, 30, 3), 255, np.uint8))


def field(folder):
    shell_field(size=8).save(folder / "f.npz")


def skin(folder):
    found = Skin.of(head_field(24), HEAD_LANDMARKS, pixels=20.0, networks=False)
    save_skin(found, folder / "f.skin.npz", "key")


def read_skin(folder):
    found = load_skin(folder / "f.skin.npz", "key")
    return found is None or found.labels


def jobs(folder):
    write_image(folder / "anna" / "0.png", noise())
    (folder / "jobs.toml").write_bytes(JOBS)


def study(folder):
    (folder / "study.json").write_text(json.dumps(DESIGN))
    (folder / "a.json").write_text(json.dumps(answer(DESIGN, 0, lambda *_: "left")))


def read_study(folder):
    read_answers([folder / "a.json"], folder)


def results_of_study(folder):
    write_results([folder / "a.json"], folder / "out")


def journal(folder):
    (folder / ".batch").mkdir()
    rows = [{"event": "plan", "time": 1.0, "tasks": 3}, {"event": "done", "task": "a"}]
    (folder / ".batch" / "journal.jsonl").write_text("\n".join(map(json.dumps, rows)) + "\n")


def capture(folder):
    make_capture(3).save(folder / "capture")


KINDS = {
    "JPEG with EXIF and XMP": Kind(lambda folder: (folder / "a.jpg").write_bytes(phone_jpeg()),
                                   PICTURE_READERS),
    "JPEG with depth": Kind(jpegs_with_depth, PICTURE_READERS),
    "HEIC with depth": Kind(heic_with_depth, PICTURE_READERS),
    "PNG": Kind(pngs, PICTURE_READERS),
    "WebP": Kind(saved("a.webp"), PICTURE_READERS),
    "TIFF": Kind(tiffs, PICTURE_READERS),
    "BMP": Kind(saved("a.bmp"), PICTURE_READERS),
    "GIF": Kind(saved("a.gif"), PICTURE_READERS),
    "AVIF": Kind(saved("a.avif"), PICTURE_READERS),
    "masks": Kind(masks, (of_each(read_mask),)),
    "transforms of NeRF": Kind(nerf, CAPTURE_READERS),
    "transforms of nerfstudio": Kind(nerfstudio, CAPTURE_READERS),
    "COLMAP, binary": Kind(colmap(False), CAPTURE_READERS),
    "COLMAP, text": Kind(colmap(True), CAPTURE_READERS),
    "Metashape": Kind(of_program(metashape), (*CAPTURE_READERS, of_program_file)),
    "RealityCapture": Kind(of_program(reality_capture), (*CAPTURE_READERS, of_program_file)),
    "Meshroom": Kind(of_program(meshroom), (*CAPTURE_READERS, of_program_file)),
    "OpenMVG": Kind(of_program(openmvg), (*CAPTURE_READERS, of_program_file)),
    "Bundler": Kind(of_program(bundler), (*CAPTURE_READERS, of_program_file)),
    "VisualSfM": Kind(of_program(visualsfm), (*CAPTURE_READERS, of_program_file)),
    "Polycam": Kind(of_phone(polycam), CAPTURE_READERS),
    "Record3D": Kind(of_phone(record3d), CAPTURE_READERS),
    "LLFF": Kind(llff, CAPTURE_READERS),
    "NSVF": Kind(nsvf, CAPTURE_READERS),
    "captures of our own": Kind(capture, (lambda folder: is_calibrated(folder / "capture"),
                                          lambda folder: Capture.load(folder / "capture"))),
    "videos": Kind(film, (lambda folder: read_source(folder / "film.mp4", 32, 4), read_frames,
                          lambda folder: clip_of(folder / "film.mp4"))),
    "quilts": Kind(quilts, (read_layouts,)),
    "display files": Kind(panel, (lambda folder: Display.load(folder / "panel.toml"),)),
    "visual.json": Kind(calibration, (lambda folder: Display.load(folder / "visual.json"),)),
    "landmarks": Kind(landmarks, (lambda folder: read_landmarks(folder / "a.landmarks.txt"),)),
    "exemplars": Kind(exemplar, (lambda folder: Exemplar.load(folder / "a.png"),)),
    "fields": Kind(field, (lambda folder: VoxelField.load(folder / "f.npz"),)),
    "skins": Kind(skin, (read_skin,)),
    "jobs.toml": Kind(jobs, (lambda folder: load_jobs(folder / "jobs.toml"),)),
    "journals": Kind(journal, (read_events,)),
    "studies": Kind(study, (read_study, results_of_study)),
}
