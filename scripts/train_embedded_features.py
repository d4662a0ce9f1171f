"""Train the embedded feature network to reproduce a teacher's features on given pictures.

    python scripts/train_embedded_features.py FOLDER [FOLDER ...] --minutes 8

The teacher is ``vgg19-se`` from the model registry; the student (seven convolutions, below 1 MB as
float16) learns its conv3_1 and conv3_4 maps from random crops. One picture in eight is held out;
the similarity printed at the end, and stored in the file's header, is measured on those.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import save
from torch.nn import functional

from lfportrait.files import atomic_write
from lfportrait.media.pictures import read_image
from lfportrait.models import fetch
from lfportrait.stylize.losses import _read, _vgg19_se, embedded_features

WIDTHS = (24, 48, 48, 96, 96, 96, 96)


def initial_weights(generator: torch.Generator) -> dict[str, torch.Tensor]:
    weights, before = {}, 3
    for layer, width in enumerate(WIDTHS):
        scale = (2.0 / (9 * before)) ** 0.5
        weights[f"conv{layer}.weight"] = scale * torch.randn(width, before, 3, 3,
                                                             generator=generator)
        weights[f"conv{layer}.bias"] = torch.zeros(width)
        before = width
    weights["read.weight"] = (2.0 / before) ** 0.5 * torch.randn(128, before, 1, 1,
                                                                 generator=generator)
    weights["read.bias"] = torch.zeros(128)
    return weights


def load_pictures(folders: list[Path]) -> list[np.ndarray]:
    pictures = []
    for folder in folders:
        for path in sorted(folder.rglob("*")):
            if path.suffix.lower() not in (".png", ".jpg", ".jpeg"):
                continue
            picture = read_image(path)
            if picture.shape[2] == 4:
                alpha = picture[..., 3:] / 255.0
                picture = np.uint8(picture[..., :3] * alpha + 255 * (1 - alpha))
            if min(picture.shape[:2]) >= 128:
                pictures.append(np.ascontiguousarray(picture))
    return pictures


def crop(picture: np.ndarray, random: np.random.Generator, size: int = 96) -> torch.Tensor:
    # A crop of one to three times the size, reduced: strokes and faces at many scales.
    edge = min(int(size * random.uniform(1.0, 3.0)), *picture.shape[:2])
    y = int(random.integers(0, picture.shape[0] - edge + 1))
    x = int(random.integers(0, picture.shape[1] - edge + 1))
    piece = torch.from_numpy(picture[y:y + edge, x:x + edge].astype(np.float32) / 255.0)
    piece = functional.interpolate(piece.permute(2, 0, 1)[None], size=(size, size), mode="bilinear",
                                   antialias=True)
    if random.random() < 0.5:
        piece = piece.flip(-1)
    gain = torch.from_numpy(random.uniform(0.7, 1.3, (1, 3, 1, 1)).astype(np.float32))
    return (piece * gain + random.uniform(-0.1, 0.1)).clamp(0, 1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--minutes", type=float, default=8.0)
    parser.add_argument("--out", type=Path,
                        default=Path("src/lfportrait/stylize/embedded.safetensors"))
    options = parser.parse_args()
    random = np.random.default_rng(0)
    pictures = load_pictures(options.folders)
    held, learned = pictures[::8], [p for i, p in enumerate(pictures) if i % 8]
    print(f"{len(learned)} pictures to learn from, {len(held)} held out")
    teacher = _vgg19_se(_read(fetch("vgg19-se")))

    def wanted(batch: torch.Tensor) -> list[torch.Tensor]:
        with torch.no_grad():
            maps = teacher(batch)
        return [maps[0], maps[3]]

    probe = torch.cat([crop(held[int(random.integers(len(held)))], random) for _ in range(48)])
    truth = wanted(probe)
    scales = [float(values.square().mean().sqrt()) for values in truth]
    weights = initial_weights(torch.Generator().manual_seed(0))
    for value in weights.values():
        value.requires_grad_(True)
    optimiser = torch.optim.Adam(list(weights.values()), lr=2e-3)
    start = time.perf_counter()
    step, share = 0, 0.0
    while share < 1.0:
        batch = torch.cat([crop(learned[int(random.integers(len(learned)))], random)
                           for _ in range(8)])
        for group in optimiser.param_groups:
            group["lr"] = 2e-3 * 0.5 * (1 + np.cos(np.pi * min(share, 1.0))) + 1e-6
        got = embedded_features(weights)(batch)
        loss = sum((a - b / s).square().mean() for a, b, s in zip(got, wanted(batch), scales))
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        step += 1
        share = (time.perf_counter() - start) / (60 * options.minutes)
        if step % 200 == 0:
            print(f"step {step}: {float(loss):.4f}", flush=True)
    with torch.no_grad():
        got = embedded_features(weights)(probe)
    report = {}
    for name, a, b, s in zip(("conv3_1", "conv3_4"), got, truth, scales):
        b = b / s
        explained = 1.0 - float((a - b).square().mean() / (b - b.mean((0, 2, 3), keepdim=True)
                                                           ).square().mean())
        cosine = float(functional.cosine_similarity(a, b, dim=1).mean())
        report[name] = f"explained variance {explained:.3f}, cosine {cosine:.3f}"
        print(f"held out, {name}: {report[name]}")
    header = {"teacher": "vgg19-se", "reproduces": "conv3_1, conv3_4", "steps": str(step), **report}
    data = save({name: value.detach().half() for name, value in weights.items()}, header)
    with atomic_write(options.out) as stream:
        stream.write(data)
    print(f"{options.out}: {len(data) / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
