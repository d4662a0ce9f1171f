"""The embedded data: a modelled head as photos, as a field and painted; other portraits."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from ..arrays import Array, Float64, UInt8
from ..capture import Capture
from ..errors import UserError
from ..example import Exemplar, Sitting
from ..face import read_landmarks
from ..field import C0, VoxelField
from ..files import read_json, write_json
from ..media.pictures import read_image
from ..temporary import temporary_folder
from .styles import demo_styles

DATA = Path(__file__).parent / "data"
"""The folder of them; `scripts/make_demo_data.py` writes it."""


def resized(picture: Array, width: int, height: int) -> Array:
    """A picture [H, W], [H, W, 3] or [H, W, 4] at another size in pixels.

    Alpha is straight, and colors count by it.
    """
    if picture.shape[:2] == (height, width):
        return picture
    smaller = height < picture.shape[0]
    kind = Image.Resampling.BOX if smaller else Image.Resampling.BICUBIC
    return np.array(Image.fromarray(picture).resize((width, height), kind))


SIZE, VIEWS = 384, 60  # Width and height of the photos in pixels, and their number.
LEAST_SIZE, LEAST_VIEWS = 16, 4


def demo_landmarks() -> Float64:
    """The 68 landmarks of the embedded capture's head, float64 [68, 3], in its world."""
    return np.array(read_json(DATA / "capture" / "transforms.json")["landmarks"])


def demo_capture(size: int = SIZE, views: int = VIEWS) -> Capture:
    """The embedded capture.

    Its cameras stand on four arcs about the head, from below to far above; the one at eye level
    reaches from yaw -105 to 105 degrees. Fewer views are spread evenly over all arcs.

    Parameters
    ----------
    size : Width and height of the pictures in pixels, at most 384.
    views : Number of cameras, at most 60; every 8th is held out.

    Returns
    -------
    capture : With straight alpha and the 68 landmarks; its frame is the portrait frame
        (identity).

    Raises
    ------
    UserError : If there are no such photos.
    """
    if not LEAST_VIEWS <= views <= VIEWS:
        raise UserError(f"the demo has {VIEWS} photos; give a number from {LEAST_VIEWS} to {VIEWS} "
                        f"with --views, not {views}")
    if not LEAST_SIZE <= size <= SIZE:
        raise UserError(f"the demo's photos are {SIZE} pixels wide; give a size from {LEAST_SIZE} "
                        f"to {SIZE} with --size, not {size}")
    chosen = ((np.arange(views) + 0.5) * VIEWS / views).astype(int)
    whole, folder = read_json(DATA / "capture" / "transforms.json"), DATA / "capture"
    # A capture of these alone: to decode all photos would take half a second.
    with temporary_folder() as fewer:
        frames = [whole["frames"][view] for view in chosen]
        write_json(fewer / "transforms.json", {**whole, "frames": [
            {**frame, "file_path": str(folder / frame["file_path"])} for frame in frames]})
        taken = Capture.load(fewer)
    assert taken.alphas is not None
    images, alphas = [], []
    for image, alpha in zip(taken.images, taken.alphas):
        picture = resized(np.dstack([image, alpha]), size, size)
        alphas.append(np.ascontiguousarray(picture[..., 3]))
        images.append(picture[..., :3] * (picture[..., 3:] > 0))
    return replace(taken, cameras=taken.cameras.scaled(size / SIZE), images=images, alphas=alphas,
                   names=[Path(name).stem for name in taken.names],
                   held_out=np.arange(views) % 8 == 4)


HEAD = DATA / "head.npz"
"""The file of `demo_head`."""


def demo_head() -> VoxelField:
    """The head of the embedded capture as a field of degree 0, made of its exact distances.

    In the portrait frame: a shell of five layers of voxels, the outermost clear.
    """
    with np.load(HEAD, allow_pickle=False) as data:
        side = int(data["side"])
        filled = np.unpackbits(data["filled"], count=side ** 3).reshape(side, side, side) > 0
        density = data["density"] * (np.float32(data["highest"]) / np.float32(255))
        color = data["color"] / 255.0
        radius = np.asarray(data["radius"], np.float64)
    links = np.full(filled.shape, -1, np.int32)
    links[filled] = np.arange(len(density), dtype=np.int32)
    return VoxelField(links, density, ((color - 0.5) / C0)[:, :, None].astype(np.float32),
                      np.zeros(3), radius)


def demo_exemplar(name: str = "", width: int = 768, height: int = 1024) -> Exemplar:
    """A painted portrait with its 68 landmarks and the mask of the person.

    By its name, empty = the first of `demo_styles`; at another size in pixels than 768 x 1024 it is
    resized. Raises `UserError` if there is no such style.
    """
    names = demo_styles()
    name = name or names[0]
    if name not in names:
        raise UserError(f"no built-in style {name!r}; there are: {', '.join(names)}")
    painted = Exemplar.load(DATA / "paintings" / f"{name}.jpg")
    assert painted.mask is not None
    rows, columns = painted.image.shape[:2]
    return replace(painted, image=resized(painted.image, width, height),
                   landmarks=painted.landmarks * (width / columns, height / rows),
                   mask=np.clip(resized(painted.mask, width, height), 0, 1))


def _portrait(path: Path, height: int) -> tuple[UInt8, Float64]:
    """A cut-out photo, uint8 [H, 3/4 H, 4], and its landmarks."""
    picture = read_image(path)
    points = np.asarray(read_landmarks(path.with_suffix(".landmarks.txt")), np.float64)
    width = height * 3 // 4
    scale = width / picture.shape[1], height / picture.shape[0]
    return resized(picture, width, height), points * scale


def demo_photo(height: int = 1024) -> tuple[UInt8, Float64]:
    """The head of the embedded capture, seen from eight degrees to its left; with its landmarks.

    The photo is uint8 [H, W, 4] with straight alpha, of 1024 rows at first, and three quarters as
    wide; landmarks are float64 [68, 2], in pixels.
    """
    return _portrait(DATA / "people" / "sitter.webp", height)


def embedded_sittings(count: int, height: int, seed: int) -> list[Sitting]:
    """Photos of modelled heads with landmarks: 16 people in turn, backgrounds at random.

    They are ``height`` pixels high, and three quarters as wide.
    """
    random = np.random.default_rng(seed)
    files = sorted((DATA / "people").glob("person_*.webp"))
    order = random.permutation(len(files))
    made = []
    for number in range(count):
        picture, points = _portrait(files[order[number % len(order)]], height)
        alpha = picture[..., 3:].astype(np.float32) / 255
        ground = random.uniform(40, 240, 3) + random.normal(0, 4, picture[..., :3].shape)
        photo = np.clip(picture[..., :3] * alpha + ground * (1 - alpha), 0, 255).astype(np.uint8)
        made.append((photo, points))
    return made
