"""One photo: painted in the manner of an exemplar, in two dimensions.

Key concepts: `transfer`, landmarks (68 points of a face, iBUG order), a matte of the person.
Writes photo.png: painting, photo and result side by side.

Run: python examples/01_portrait.py && python examples/02_photo.py
"""

from pathlib import Path

import numpy as np

import lfportrait as lf


def main(out: Path = Path("example-out")) -> None:
    # Any picture of one face will do: lf.read_image("me.jpg"), with no landmarks and no matte, if
    # the networks that find them are installed (`lfportrait models fetch portrait`). This one is
    # the frontal photo of a capture, whose landmarks are known in space.
    capture = lf.Capture.load(out / "capture")
    away = np.abs(capture.cameras.position[:, :2]).sum(axis=1)
    front = int(np.argmin(away))
    matte = np.float32(capture.alphas[front]) / 255
    photo = np.uint8(255 * capture.image_float(front))
    points = capture.cameras.project(capture.landmarks)[0][front]

    exemplar = lf.Exemplar.load("fauve")
    # "fast" takes hundredths of a second; "best" paints all but the face with patches that agree.
    config = lf.TransferConfig(quality="best")
    result = lf.transfer(photo, exemplar, config, landmarks=points, mask=matte)
    print({step: f"{seconds * 1000:.0f} ms" for step, seconds in result.seconds.items()})

    # The painting at the photo's height.
    apart = len(exemplar.image) / len(photo)
    rows, columns = (np.int64(np.arange(0, side, apart)) for side in exemplar.image.shape[:2])
    painting = exemplar.image[np.ix_(rows[:len(photo)], columns)]
    lf.write_image(out / "photo.png", np.concatenate(
        [painting / 255, photo / 255, result.image], axis=1))


if __name__ == "__main__":
    main()
