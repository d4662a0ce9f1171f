"""Paint a photo in the manner of an exemplar (2D).

Key concepts: `Exemplar` (a painting with its 68 landmarks), `Transfer` (prepared once, applied to
many pictures), guides. Writes transfer.png: painting, photo and result side by side.

Run: python examples/02_transfer.py
"""

from pathlib import Path

import numpy as np
from PIL import Image

from lfportrait.demo import demo_exemplar, demo_photo
from lfportrait.example import Transfer
from lfportrait.files import write_image


def main(out: Path = Path("example-out"), size: int = 512) -> None:
    # Exemplar.load("painting.png") reads your own; its landmarks lie beside it or are detected.
    exemplar = demo_exemplar()

    # A photo of the embedded head. Of your own photos, face.detect_landmarks finds the landmarks.
    shot, points = demo_photo(size)
    alpha = shot[..., 3:] / 255.0
    photo = np.uint8(shot[..., :3] * alpha + 230 * (1 - alpha))

    # The look-up table (Eq. 6) is made here, once per painting ...
    transfer = Transfer(exemplar)
    # ... and used here, for every photo.
    result = transfer.apply(photo, points, mask=np.float32(alpha[..., 0]))
    print({name: f"{seconds * 1000:.0f} ms" for name, seconds in result.seconds.items()})

    painting = np.asarray(Image.fromarray(exemplar.image).resize(
        (size * exemplar.image.shape[1] // exemplar.image.shape[0], size)))
    write_image(out / "transfer.png", np.concatenate(
        [painting / 255.0, photo / 255.0, result.image], axis=1))


if __name__ == "__main__":
    main()
