"""The network of one style: its training pictures, learning, checkpoints, and the command."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import gaussian_filter

from lfportrait.cli import main
from lfportrait.demo import embedded_sittings
from lfportrait.errors import UserError
from lfportrait.example import prepare
from lfportrait.face import write_landmarks
from lfportrait.files import read_json, write_image
from lfportrait.media.pictures import read_image
from lfportrait_eval.baselines.config import NetworkConfig
from lfportrait_eval.baselines.transfer import StyleNetwork
from lfportrait_eval.baselines.transfer.network import folder_sittings, varied
from lfportrait_eval.bench import METHODS
from tests.other_memory import PLACE
from tests.portraits import drawn_face

TINY = NetworkConfig(teacher="styleblit", pairs=3, steps=2, size=64, width=4)


def test_embedded_heads_differ_and_have_their_landmarks():
    (first, points), (second, _) = embedded_sittings(2, 96, 0)
    assert first.shape == (96, 72, 3) and points.shape == (68, 2)
    assert np.abs(first.astype(float) - second).mean() > 10
    assert (points > 0).all() and (points < (72, 96)).all()
    assert np.array_equal(first, embedded_sittings(2, 96, 0)[0][0])


def test_varied_photos_take_their_landmarks_along():
    """A dot at every landmark is found where the landmark goes."""
    image = np.zeros((200, 160, 3), np.uint8)
    points = np.array([[60.5, 70.5], [100.5, 90.5], [80.5, 130.5]])
    for x, y in points.astype(int):
        image[y - 4:y + 5, x - 4:x + 5] = 255
    image = gaussian_filter(image, (2, 2, 0))
    for seed in range(4):
        turned, moved = varied((image, points), 120, np.random.default_rng(seed))
        assert turned.shape == (120, 96, 3)
        for x, y in moved:
            assert turned[int(y), int(x), 0] > 150
        bright = turned[..., 0] / turned[..., 0].sum(dtype=float)
        y, x = np.mgrid[:120, :96] + 0.5
        centre = np.array([(bright * x).sum(), (bright * y).sum()])
        assert np.abs(centre - moved.mean(axis=0)).max() < 0.3


@pytest.mark.slow  # the same seed trains, too, below
def test_training_learns_the_colors_of_one_pair():
    from lfportrait_eval.baselines.transfer.unet import run, train

    photo = drawn_face(64, 48).image
    wanted = (1 - photo[..., ::-1] / 255).astype(np.float32)
    painter, steps, loss = train([(photo, wanted)], 8, steps=60, seconds=0, rate=3e-3,
                                 adversarial=0.1, seed=0)
    assert steps == 60 and loss < 0.12
    made = run(painter, photo)
    assert made.shape == photo.shape and made.min() >= 0 and made.max() <= 1
    assert np.abs(made - wanted).mean() < 0.4 * np.abs(photo / 255 - wanted).mean()


def test_the_same_seed_gives_the_same_network_and_the_budget_ends_the_training():
    from lfportrait_eval.baselines.transfer.unet import run, train

    photo = drawn_face(40, 36).image
    pair = photo, photo.astype(np.float32) / 255
    results = [run(train([pair], 4, steps=2, seconds=0, rate=1e-3, adversarial=0.5,
                         seed=seed)[0], photo) for seed in (1, 1, 2)]
    assert results[0].tobytes() == results[1].tobytes() != results[2].tobytes()
    _, steps, _ = train([pair], 4, steps=0, seconds=0.1, rate=1e-3, adversarial=0, seed=0)
    assert steps >= 1


@pytest.mark.slow  # tests/stylize/test_stylize.py computes elsewhere, too
def test_training_on_another_device_gives_the_same(other_device):
    from lfportrait_eval.baselines.transfer.unet import run, train

    photo = drawn_face(40, 36).image
    pair = photo, photo.astype(np.float32) / 255
    here, there = (run(train([pair], 4, steps=2, seconds=0, rate=1e-3, adversarial=0.5, seed=1,
                             place=place)[0], photo) for place in ("cpu", PLACE))
    assert np.allclose(here, there, atol=1e-4)


@pytest.mark.slow  # tests/stylize/test_stylize.py computes elsewhere, too
def test_a_checkpoint_goes_from_device_to_device(tmp_path, other_device):
    style, photo = drawn_face(96, 72, skin=(120, 90, 200)), drawn_face(90, 80, seed=1)
    config = replace(TINY, checkpoint=tmp_path / "style.safetensors", device=other_device)
    trained = StyleNetwork(style, config)
    read = StyleNetwork(style, replace(config, device="cpu"))
    assert read.facts["device"] == "gpu: Other 9 (Test)"
    first, second = (one.apply(photo.image, photo.landmarks).image for one in (trained, read))
    assert np.allclose(first, second, atol=1e-4)


@pytest.mark.slow  # only for comparisons
def test_a_checkpoint_is_written_read_and_checked(tmp_path):
    style, photo = drawn_face(96, 72, skin=(120, 90, 200)), drawn_face(90, 80, seed=1)
    path = tmp_path / "style.safetensors"
    config = replace(TINY, checkpoint=path)
    made = prepare(style, config, [(photo.image, photo.landmarks)]).apply(
        photo.image, photo.landmarks)
    assert made.image.shape == photo.image.shape and path.exists()
    facts = StyleNetwork(style, config).facts
    assert facts["pairs"] == 3 and facts["steps"] == 2 and facts["teacher_seconds"] > 0
    again = StyleNetwork(style, config).apply(photo.image, photo.landmarks)
    assert again.image.tobytes() == made.image.tobytes()
    with pytest.raises(UserError, match="another style"):
        StyleNetwork(photo, config)
    path.write_bytes(path.read_bytes()[:500])
    with pytest.raises(UserError, match="damaged"):
        StyleNetwork(style, config)


def test_folders_without_faces_are_refused(tmp_path):
    with pytest.raises(UserError, match="no such folder"):
        folder_sittings(tmp_path / "nowhere")
    (tmp_path / "note.txt").write_text("no picture")
    with pytest.raises(UserError, match="shows a face"):
        folder_sittings(tmp_path)


def test_torch_is_not_imported_for_the_other_methods():
    code = "import sys, lfportrait.example; print('torch' in sys.modules)"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True,
                           check=True).stdout
    assert found.strip() == "False"


@pytest.mark.parametrize("method", [
    pytest.param(name, marks=() if name == "facestyle" else pytest.mark.slow) for name in METHODS])
def test_every_method_is_a_choice_of_the_command(method, tmp_path, monkeypatch):
    style, photo = drawn_face(128, 96, skin=(120, 90, 200)), drawn_face(100, 90, seed=1)
    Image.fromarray(style.image).save(tmp_path / "style.png")
    write_landmarks(tmp_path / "style.landmarks.txt", style.landmarks)
    write_image(tmp_path / "photo.png", photo.image)
    # No detector is needed to see that the command does what it says.
    monkeypatch.setattr("lfportrait.face.detect_landmarks", lambda image: photo.landmarks)
    options = {"facestyle": ["--facestyle.steps", "1", "--facestyle.passes", "1"],
               "network": ["--network.pairs", "2", "--network.steps", "1", "--network.size", "48",
                           "--network.width", "4", "--network.teacher", "styleblit",
                           "--network.checkpoint", str(tmp_path / "net.safetensors")]}
    code = main(["transfer", str(tmp_path / "photo.png"), "--style", str(tmp_path / "style.png"),
                 "--method", method, "--out", str(tmp_path / "out.png"), "--dump",
                 str(tmp_path / "dump"), "--json", str(tmp_path / "run.json"),
                 *options.get(method, [])])
    assert code == 0
    assert read_image(tmp_path / "out.png").shape == (100, 90, 3)
    assert read_image(tmp_path / "dump" / "result.png").shape == (100, 90, 3)
    assert read_json(tmp_path / "run.json")["method"] == method
    assert (tmp_path / "net.safetensors").exists() == (method == "network")
