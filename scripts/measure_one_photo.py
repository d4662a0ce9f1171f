"""Measure heads from one photo beside simpler ones: by angle, against true photos of the person.

The baselines: a flat card, the matte inflated as a whole, the generic head, the statistical head's
mean. Fields and true photos are aligned by the landmarks of brows, eyes, nose and mouth; the true
head down to the chin counts, on white, at one gain a channel, moved by a few pixels where that fits
better. A head that is too large loses nothing by that, so PSNR is printed over both outlines, too,
white where a head is not.

Landmarks turn the cameras by as much as the fitted face's depth is tilted. Where the photo is one
of the truth's, a second line a method turns them as the photo's own camera was: 20 degrees are then
20 degrees from the photo.

Run: python scripts/measure_one_photo.py PHOTO TRUTH [RESOLUTION] [--focal]
         PHOTO: a photo (or a folder of a few), TRUTH: a capture of many photos of the same person
         (`lfportrait calibrate`); --focal: the photo knows the focal length of the truth's camera,
         as those do that cameras write
     python scripts/measure_one_photo.py demo [RESOLUTION]
         the modelled woman and man of the demo, from the front
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial.transform import Rotation

from lfportrait.capture import Camera, Capture, Photo, read_photos
from lfportrait.face.head_prior import HeadPrior, generic_prior, head_prior
from lfportrait.face.one_photo.parts import clean_colors, signed_distance
from lfportrait.face.one_photo.piece import inflated
from lfportrait.face.one_photo.portrait import portrait_capture, portrait_field
from lfportrait.field import ReconstructConfig
from modelled_head import PAINTED, SITTER, landmarks, photograph

Float64 = NDArray[np.float64]
Drawn = tuple[NDArray[np.floating], NDArray[np.floating]]
Draw = Callable[[Camera], Drawn]

ANGLES = range(-40, 41, 10)
NEAR = 22.0
"""Degrees up to which views are near."""
SIDE = 200
"""Cells to the width of the picture that an outline is inflated on."""


def aligned(true: Capture, mine: Capture) -> tuple[Float64, Float64, float]:
    """Rotation, shift and scale from the truth's frame to another capture's (Umeyama 1991)."""
    one, two = (np.asarray(each.landmarks, np.float64)[17:] for each in (true, mine))
    left, right = one - one.mean(axis=0), two - two.mean(axis=0)
    u, sizes, v = np.linalg.svd(right.T @ left)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ v))])
    rotation = u @ np.diag(signs) @ v
    scale = float((sizes * signs).sum() / (left ** 2).sum())
    return rotation, two.mean(axis=0) - scale * rotation @ one.mean(axis=0), scale


def aligned_by_camera(true: Capture, mine: Capture, own: int) -> tuple[Float64, Float64, float]:
    """The same, turned as the photo's camera was: view ``own`` of the truth is the photo.

    Landmarks say how large the face is in the pictures, and where it is.
    """
    cameras = true.cameras[own], mine.cameras[0]
    places = [np.asarray(each.landmarks, np.float64)[17:] for each in (true, mine)]
    size = [float((camera.project(points)[1] * camera.width / camera.focal[:, :1]).mean())
            for camera, points in zip(cameras, places, strict=True)]
    rotation = cameras[1].pose[0, :3, :3] @ cameras[0].pose[0, :3, :3].T
    scale = size[1] / size[0]
    shift = places[1].mean(axis=0) - scale * rotation @ places[0].mean(axis=0)
    return rotation, shift, scale


def chosen_views(true: Capture) -> dict[int, float]:
    """The views nearest to the angles, and their yaws in degrees."""
    eye = true.cameras.position - np.asarray(true.landmarks, np.float64)[27:36].mean(axis=0)
    yaw = np.degrees(np.arctan2(eye[:, 0], eye[:, 2]))
    pitch = np.degrees(np.arctan2(eye[:, 1], np.hypot(eye[:, 0], eye[:, 2])))
    views = [int(np.argmin(np.abs(yaw - angle) + 0.5 * np.abs(pitch))) for angle in ANGLES]
    return {view: float(yaw[view]) for view, angle in zip(views, ANGLES, strict=True)
            if abs(yaw[view] - angle) < 6}


def compared(true: Capture, view: int, drawn: Drawn) -> tuple[float, float, float]:
    """PSNR in dB, overlap of the outlines, and PSNR over both, of a picture and a true photo."""
    assert true.alphas is not None and true.landmarks is not None
    camera = true.cameras[view]
    alpha = true.alphas[view].astype(np.float32) / 255
    photo = true.image_float(view)[..., :3] * alpha[..., None] + 1 - alpha[..., None]
    face = camera.project(np.asarray(true.landmarks, np.float64))[0][0]
    turns = upright(face)
    low = int(np.clip(chin_row(face, turns, alpha.shape), 8, alpha.shape[turns % 2]))
    photo, alpha, color, cover = (
        np.ascontiguousarray(np.rot90(np.asarray(each, np.float32), turns))
        for each in (photo, alpha, *drawn))
    return max(_compared(photo[:low], alpha[:low] > 0.5, each[:low], solid[:low])
               for each, solid in ((color, cover), _moved(photo, color, cover, low)))


def upright(face: Float64) -> int:
    """Quarter turns (`numpy.rot90`) that bring landmarks [68, 2] upright: cameras are rolled."""
    x, y = face[8] - face[27]  # from between the eyes to the chin
    return round(float(np.arctan2(-x, y)) / (np.pi / 2)) % 4


def chin_row(face: Float64, turns: int, shape: tuple[int, ...]) -> float:
    """The row of the chin of landmarks [68, 2], in a picture [H, W] after quarter turns."""
    height, width = shape[:2]
    x, y = (float(each) for each in face[8])
    return (y, width - x, height - y, x)[turns]


def _moved(photo: NDArray[np.float32], color: NDArray[np.float32], cover: NDArray[np.float32],
           low: int) -> Drawn:
    """A picture moved to where a photo shows the same."""
    start = np.eye(2, 3, dtype=np.float32)
    try:
        move = cv2.findTransformECC(
            photo[:low].mean(axis=2), color[:low].mean(axis=2), start, cv2.MOTION_TRANSLATION,
            (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-6), None, 5)[1]
    except cv2.error:
        return color, cover
    if np.abs(move[:, 2]).max() > 0.03 * photo.shape[1]:
        return color, cover
    size = photo.shape[1::-1]
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return (cv2.warpAffine(color, move, size, flags=flags, borderValue=(1, 1, 1)),
            cv2.warpAffine(cover, move, size, flags=flags))


def _compared(photo: NDArray[np.float32], head: NDArray[np.bool_], color: NDArray[np.floating],
              cover: NDArray[np.floating]) -> tuple[float, float, float]:
    gain = (color * photo)[head].sum(axis=0) / np.maximum((color ** 2)[head].sum(axis=0), 1e-6)
    error = ((color * gain) - photo) ** 2
    solid = cover > 0.5
    # Beside the head a photo is white, and so is a picture, whatever the gain is.
    share = np.asarray(cover, np.float32)[..., None]
    over = (color - 1 + share) * gain + 1 - share - photo
    inner, both = float(error[head].mean()), float((over[head | solid] ** 2).mean())
    overlap = float((head & solid).sum() / (head | solid).sum())
    return -10 * float(np.log10(inner)), overlap, -10 * float(np.log10(both))


def _read(photo: Path, noted: float | None) -> list[Photo]:
    """Photos; ``noted`` is their focal length over their width where their camera wrote one."""
    photos = read_photos(photo)
    if noted is None:
        return photos
    return [replace(one, focal=noted * one.image.shape[1]) for one in photos]


def fitted(prior: HeadPrior | None, resolution: int | None, noted: float | None = None,
           ) -> Callable[[Path], tuple[Capture, Draw]]:
    """A head that is fitted to the photo, with a prior of one's own."""
    def made(photo: Path) -> tuple[Capture, Draw]:
        capture, _ = portrait_capture(_read(photo, noted), prior=prior)
        field, _ = portrait_field(capture, ReconstructConfig(resolution=resolution))

        def draw(camera: Camera) -> Drawn:
            view = field.render(camera, 0)
            return np.clip(view.color, 0, 1), view.alpha
        return capture, draw
    return made


def relief(depth: Callable[[Capture], Float64], noted: float | None = None,
           ) -> Callable[[Path], tuple[Capture, Draw]]:
    """The photo's own pixels at depths [H, W] in front of its camera."""
    def made(photo: Path) -> tuple[Capture, Draw]:
        capture, _ = portrait_capture(_read(photo, noted))
        assert capture.alphas is not None
        height, width = capture.alphas[0].shape
        rows, columns = np.mgrid[:2 * height, :2 * width] / 2 + 0.25
        z = cv2.resize(depth(capture), (2 * width, 2 * height))
        matte = capture.alphas[0].astype(np.float32) / 255
        shown = cv2.resize(matte, (2 * width, 2 * height)) > 0.5
        colors = cv2.resize(clean_colors(capture.images[0], matte), (2 * width, 2 * height))[shown]
        origin, ray = capture.cameras.rays(0, np.stack([columns[shown], rows[shown]], axis=1))
        ray = ray / (ray @ capture.cameras.pose[0, :3, 2])[:, None]
        points = origin + ray * z[shown][:, None]
        return capture, lambda camera: _splatted(points, colors, camera)
    return made


def _splatted(points: Float64, colors: NDArray[np.float32], camera: Camera) -> Drawn:
    """Points [N, 3] as a picture on white, its small gaps closed."""
    height, width = int(camera.height[0]), int(camera.width[0])
    pixels, depth = (each[0] for each in camera.project(points))
    column, row = np.floor(pixels).astype(int).T
    within = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    order = np.flatnonzero(within)[np.argsort(-depth[within])]  # the nearest one is drawn last
    color = np.ones((height, width, 3), np.float32)
    cover = np.zeros((height, width), np.float32)
    color[row[order], column[order]] = colors[order]
    cover[row[order], column[order]] = 1.0
    kernel = np.ones((5, 5))
    closed = cv2.morphologyEx(cover, cv2.MORPH_CLOSE, kernel)
    gaps = (closed > 0) & (cover == 0)
    share = np.maximum(cv2.blur(cover, (5, 5)), 1e-6)[..., None]
    color[gaps] = (cv2.blur(color * cover[..., None], (5, 5)) / share)[gaps]
    return color, closed


def flat(capture: Capture) -> Float64:
    """Depths of a card through the face."""
    depth = capture.cameras.project(np.asarray(capture.landmarks, np.float64)[17:])[1][0]
    return np.full(capture.images[0].shape[:2], float(depth.mean()))


def blown_up(capture: Capture) -> Float64:
    """Depths of the matte, inflated as a whole; its middle is as far as the ears."""
    assert capture.alphas is not None
    height, width = capture.alphas[0].shape
    factor = SIDE / width
    matte = cv2.resize(capture.alphas[0].astype(np.float32) / 255, (SIDE, round(height * factor)),
                       interpolation=cv2.INTER_AREA)
    inside = signed_distance(matte)
    ears = float(capture.cameras.project(
        np.asarray(capture.landmarks, np.float64)[[0, 16]])[1].mean())
    cell = ears / float(capture.cameras.focal[0, 0]) / factor
    thick = np.sqrt(np.maximum(inflated(inside > 0, inside, cell, source=4.0), 0))
    return np.asarray(ears - cv2.resize(thick, (width, height)), np.float64)


def measure(photo: Path, truth: Capture, resolution: int | None, *, focal: bool = False) -> None:
    """Print a line a method, and two where the photo is one of the truth's."""
    prior = head_prior()
    mean = replace(prior, identity=prior.identity[:0])
    own = next((view for view, name in enumerate(truth.names) if Path(name).stem == photo.stem),
               None)
    noted = None
    if focal:
        if own is None:
            sys.exit(f"{photo.name} is none of the truth's photos: its focal length is not known")
        noted = float(truth.cameras.focal[own, 0] / truth.cameras.width[own])
    methods = {"flat card": relief(flat, noted), "matte inflated": relief(blown_up, noted),
               "generic head": fitted(generic_prior(), resolution, noted),
               "mean of the prior": fitted(mean, resolution, noted),
               "fitted head": fitted(None, resolution, noted)}
    for name, method in methods.items():
        mine, draw = method(photo)
        by_landmarks = aligned(truth, mine)
        print(f"{name}: {_line(truth, draw, by_landmarks)}", flush=True)
        if own is not None:
            by_camera = aligned_by_camera(truth, mine, own)
            turn = Rotation.from_matrix(by_landmarks[0] @ by_camera[0].T).magnitude()
            print(f"{name}, by the photo's camera, which landmarks turn by "
                  f"{np.degrees(turn):.1f} degrees: {_line(truth, draw, by_camera)}", flush=True)


def _line(truth: Capture, draw: Draw, place: tuple[Float64, Float64, float]) -> str:
    """What is measured of a head that lies in the truth's frame so."""
    rotation, shift, scale = place
    found = {}
    for view, yaw in chosen_views(truth).items():
        camera = truth.cameras[view]
        pose = camera.pose.copy()
        pose[0, :3, :3] = rotation @ pose[0, :3, :3]
        pose[0, :3, 3] = scale * rotation @ pose[0, :3, 3] + shift
        found[yaw] = compared(truth, view, draw(replace(camera, pose=pose)))
    by_angle = ", ".join(f"{yaw:.0f}: {found[yaw][0]:.1f} {found[yaw][1]:.3f} "
                         f"{found[yaw][2]:.1f}" for yaw in sorted(found))
    near, far = ([value for yaw, value in found.items() if (abs(yaw) <= NEAR) == inner]
                 for inner in (True, False))
    means = "; ".join(f"{what} {np.mean([one[0] for one in part]):.2f} dB "
                      f"{np.mean([one[1] for one in part]):.3f}, over both outlines "
                      f"{np.mean([one[2] for one in part]):.2f} dB"
                      for what, part in (("near", near), ("beyond", far)) if part)
    return f"{means} ({by_angle})"


def demo(resolution: int | None) -> None:
    """The modelled people, whose true photos are drawn here."""
    camera = Camera.arc(np.array([0.0, -40.0, -20.0, 20.0, 40.0]), distance=4.4, width=512,
                        height=512, focal=998.0, target=(0, -0.05, 0), pitch=1.0)
    for name, person in (("woman", SITTER), ("man", PAINTED)):
        photos = [photograph(person, camera, view).image for view in range(5)]
        truth = Capture(camera, [np.ascontiguousarray(one[..., :3]) for one in photos],
                        [np.ascontiguousarray(one[..., 3]) for one in photos],
                        [str(view) for view in range(5)], np.zeros(5, bool), np.eye(4),
                        landmarks(person))
        with TemporaryDirectory() as folder:
            path = Path(folder) / "0.png"
            Image.fromarray(photos[0]).save(path)
            print(name)
            measure(path, truth, resolution)


if __name__ == "__main__":
    given = [word for word in sys.argv[1:] if word != "--focal"]
    if given[:1] == ["demo"] and "--focal" not in sys.argv:
        demo(int(given[1]) if len(given) > 1 else None)
    elif len(given) in (2, 3):
        measure(Path(given[0]), Capture.load(given[1]), int(given[2]) if len(given) > 2 else None,
                focal="--focal" in sys.argv)
    else:
        sys.exit(__doc__)
