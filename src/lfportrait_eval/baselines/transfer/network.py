"""A network trained on one style (Futschik et al. 2019), for comparison: slow to train, then fast.

A teacher (guided patch synthesis, or StyleBlit) paints many portraits in one style; a full-frame
image-to-image network learns to turn the photos into the paintings (`unet`). Then a photo needs no
guides. What the network has not seen it can't paint: train it on a folder with hundreds of
portraits. Without a folder the embedded heads, and the photo to be painted, stand in.
"""

from __future__ import annotations

import hashlib
import json
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from lfportrait.arrays import Float32, UInt8
from lfportrait.device import device_name, torch_device
from lfportrait.errors import UserError
from lfportrait.example.exemplar import Exemplar, face_size
from lfportrait.example.transfers import Transfer
from lfportrait.files import atomic_write
from lfportrait.media.pictures import read_image
from lfportrait.plugins import Sitting, provided_sittings

from ..config import NetworkConfig, Painted
from .facestyle import FaceStyle

FORMAT = "lfportrait style network 1"
LEARNING_RATE = 5e-4
"""Step of Adam."""
ADVERSARIAL = 0.5
"""Weight of the discriminator, 0 to 1: higher is sharper and less faithful."""


@dataclass
class _Trained:
    """A network and what is to be known of it."""

    painter: Any
    facts: dict[str, Any] = field(default_factory=dict)


class StyleNetwork:
    """One exemplar's network, read from its checkpoint or trained.

    ``own`` are photos with landmarks to train on besides; e.g. the one to be painted.
    """

    def __init__(self, exemplar: Exemplar, config: NetworkConfig | None = None,
                 own: list[Sitting] | None = None) -> None:
        self.exemplar = exemplar
        self.config = config or NetworkConfig()
        self._device = torch_device(self.config.device)
        start = time.perf_counter()
        path = self.config.checkpoint
        if path is not None and path.exists():
            self._trained = _load(path, _digest(exemplar), self._device.place)
        else:
            self._trained = self._train(own or [])
            if path is not None:
                _save(path, self._trained)
        self.seconds = time.perf_counter() - start

    @property
    def facts(self) -> dict[str, Any]:
        """Width, steps, loss, number of pairs, seconds of teacher and training."""
        return dict(self._trained.facts)

    def apply(self, image: UInt8, landmarks: NDArray[np.floating]) -> Painted:
        """Stylise one photo uint8 [H, W, 3]; the landmarks [68, 2] only give the face's size."""
        from .unet import run

        start = time.perf_counter()
        photo = np.ascontiguousarray(image[..., :3])
        height, width = photo.shape[:2]
        scale = self._trained.facts["face"] / face_size(landmarks)
        # A tiny face in a large picture must not fill the memory.
        scale = min(scale, 3 * self._trained.facts["size"] / max(height, width))
        size = max(round(width * scale), 16), max(round(height * scale), 16)
        small = Image.fromarray(photo).resize(size, Image.Resampling.LANCZOS)
        prepared = time.perf_counter()
        made = run(self._trained.painter, np.asarray(small))
        planes = [np.asarray(Image.fromarray(np.ascontiguousarray(made[..., c])).resize(
            (width, height), Image.Resampling.BICUBIC)) for c in range(3)]
        end = time.perf_counter()
        return Painted(np.clip(np.stack(planes, axis=-1), 0, 1).astype(np.float32),
                       {"precalculation_seconds": self.seconds, "guides_seconds": prepared - start,
                        "synthesis_seconds": end - prepared},
                       {"input": np.asarray(small), "output": made})

    def _train(self, own: list[Sitting]) -> _Trained:
        """Let the teacher paint, and train."""
        from .unet import train

        config = self.config
        start = time.perf_counter()
        pairs, faces = self._examples(own)
        painted = time.perf_counter()
        painter, steps, loss = train(
            pairs, config.width, steps=config.length, seconds=config.budget, rate=LEARNING_RATE,
            adversarial=ADVERSARIAL, seed=config.seed,
            place=self._device.place)
        return _Trained(painter, {
            "format": FORMAT, "style": _digest(self.exemplar), "width": config.width,
            "size": config.size, "face": faces, "pairs": len(pairs), "steps": steps, "loss": loss,
            "teacher": config.teacher, "teacher_seconds": painted - start,
            "training_seconds": time.perf_counter() - painted,
            "device": device_name(self._device)})

    def _examples(self, own: list[Sitting],
                  ) -> tuple[list[tuple[UInt8, Float32]], float]:
        """Photos and their paintings, and the mean size of the faces."""
        config = self.config
        random = np.random.default_rng(config.seed)
        if config.photos is not None:
            sittings = folder_sittings(config.photos) + own
        else:
            # Half of the examples show the photo itself, where there is one.
            heads = config.pairs - config.pairs // 2 if own else config.pairs
            sittings = provided_sittings(heads, config.size, config.seed)
            sittings += [own[n % len(own)] for n in range(config.pairs // 2)] if own else []
        style = _reduced(self.exemplar, 2 * config.size)
        teacher: Any = FaceStyle(style) if config.teacher == "facestyle" else Transfer(style)
        pairs, faces = [], []
        for n in range(max(config.pairs, len(sittings) if config.photos is None else 1)):
            photo, landmarks = varied(sittings[n % len(sittings)], config.size, random)
            pairs.append((photo, teacher.apply(photo, landmarks).image))
            faces.append(face_size(landmarks))
        return pairs, float(np.mean(faces))


def _reduced(exemplar: Exemplar, side: int) -> Exemplar:
    """The exemplar with its longer side at most ``side`` pixels: the teacher is quicker."""
    height, width = exemplar.image.shape[:2]
    scale = side / max(height, width)
    if scale >= 1:
        return exemplar
    size = max(round(width * scale), 16), max(round(height * scale), 16)
    picture = np.asarray(Image.fromarray(exemplar.image).resize(size, Image.Resampling.LANCZOS))
    mask = None
    if exemplar.mask is not None:
        mask = np.asarray(Image.fromarray(exemplar.mask).resize(size, Image.Resampling.BILINEAR))
    points = exemplar.landmarks * (np.array(size) / (width, height))
    return replace(exemplar, image=picture, landmarks=points, mask=mask)


def _digest(exemplar: Exemplar) -> str:
    """A hash that identifies the style."""
    digest = hashlib.sha256(exemplar.image.tobytes())
    digest.update(np.round(exemplar.landmarks, 2).tobytes())
    return digest.hexdigest()


def _save(path: Path, trained: _Trained) -> None:
    from safetensors.torch import save

    tensors = {name: value.cpu().contiguous()
               for name, value in trained.painter.state_dict().items()}
    with atomic_write(path) as stream:
        stream.write(save(tensors, metadata={"facts": json.dumps(trained.facts)}))


def _load(path: Path, style: str, place: str) -> _Trained:
    import torch
    from safetensors import SafetensorError, safe_open

    from .unet import Painter

    try:
        with safe_open(path, "pt") as stored:
            facts = json.loads((stored.metadata() or {})["facts"])
            if facts["format"] != FORMAT:
                raise KeyError(FORMAT)
            painter: Any = Painter(int(facts["width"]))
            names = stored.keys()
            painter.load_state_dict({name: stored.get_tensor(name) for name in names})
    except (SafetensorError, OSError, KeyError, ValueError, RuntimeError, TypeError) as error:
        raise UserError(f"{path} is not a style network, or damaged; remove it to train a new "
                        "one") from error
    if facts["style"] != style:
        raise UserError(f"the network in {path} was trained on another style; name another "
                        "--network.checkpoint")
    # In the layout that it was trained in: other layouts round differently.
    return _Trained(painter.eval().to(place, memory_format=torch.channels_last), facts)


SUFFIXES = {".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tif", ".tiff"}


def folder_sittings(folder: Path) -> list[Sitting]:
    """The photos of a folder in which a face is found."""
    from lfportrait.face import detect_landmarks

    if not folder.is_dir():
        raise UserError(f"no such folder of photos to train on: {folder}")
    found = []
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() not in SUFFIXES:
            continue
        photo = np.ascontiguousarray(read_image(path)[..., :3])
        landmarks = detect_landmarks(photo)
        if landmarks is not None:
            found.append((photo, landmarks))
    if not found:
        raise UserError(f"no photo in {folder} shows a face; give a folder with portraits")
    return found


def varied(sitting: Sitting, side: int, random: np.random.Generator) -> Sitting:
    """A photo with a small random rotation, shift and zoom, its longer side ``side`` pixels."""
    photo, landmarks = sitting
    height, width = photo.shape[:2]
    scale = side / max(height, width)
    size = max(round(width * scale), 16), max(round(height * scale), 16)
    angle, zoom = np.radians(random.uniform(-8, 8)), scale * random.uniform(0.9, 1.15)
    turn = zoom * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    middle = np.array([width, height]) / 2
    goal = np.array(size) / 2 + random.uniform(-0.04, 0.04, 2) * size
    back = np.linalg.inv(turn)
    offset = middle - back @ goal
    # Halving first keeps the bilinear look-up from skipping pixels.
    half = max(1, int(1 / zoom))
    small = Image.fromarray(photo).reduce(half) if half > 1 else Image.fromarray(photo)
    # What lies beyond the border is its reflection.
    border = max(size) // 2
    padded = np.pad(np.asarray(small), ((border, border), (border, border), (0, 0)), "reflect" if
                    min(small.size) > border else "edge")
    coefficients = np.column_stack([back, offset]) / half
    coefficients[:, 2] += border
    turned = Image.fromarray(padded).transform(
        size, Image.Transform.AFFINE, tuple(coefficients.ravel()), Image.Resampling.BICUBIC)
    return np.asarray(turned), (landmarks - middle) @ turn.T + goal
