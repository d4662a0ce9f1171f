"""Moving light fields: what each frame shows, files, and going on after an interruption."""

import dataclasses
import math

import av
import numpy as np
import pytest

from lfportrait.cli import main
from lfportrait.errors import UserError
from lfportrait.lightfield import Display, EncodeConfig, ViewMask, encode, read_coded
from lfportrait.media.pictures import read_image
from lfportrait.metrics import psnr
from lfportrait.share import SequenceConfig, each_frame, write_sequence
from tests.fields import shell_field

# Odd sides, and mirrored: what is sent differs from what is seen.
PANEL = Display(63, 41, views=12, pitch=7.3, slant=math.radians(9), cone=40, distance=4,
                flip_x=True, name="panel")
START = EncodeConfig(turn=-20.0)
MOTION = SequenceConfig(frames=4, turn_to=20.0, focus_to=0.2, motion="once")


@pytest.fixture(scope="module")
def field():
    return shell_field(basis=1, size=20, density=40.0)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def decoded(path):
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        assert float(stream.average_rate) == 30
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]


def test_the_motion_runs_from_the_start_to_the_end_and_back_without_a_seam():
    once = [MOTION.at(START, frame) for frame in range(4)]
    assert (once[0].turn, once[0].focus) == (-20, 0)
    assert (once[3].turn, once[3].focus) == (pytest.approx(20), pytest.approx(0.2))
    loop = SequenceConfig(frames=40, turn_to=20.0)
    turns = np.array([loop.at(START, frame).turn for frame in range(41)])
    assert turns[0] == pytest.approx(-20) and turns[20] == pytest.approx(20)
    assert turns[40] == pytest.approx(turns[0])
    assert np.abs(np.diff(turns)).max() < 3.2
    assert {loop.at(START, frame).focus for frame in range(40)} == {0.0}
    assert SequenceConfig(frames=1, turn_to=5.0, motion="once").at(START, 0).turn == -20


def test_frames_are_what_encode_gives(field):
    frames = list(each_frame(field, PANEL, START, MOTION))
    assert len(frames) == 4
    mask = ViewMask.build(PANEL, cache=False)
    for number, turn, focus in ((0, -20.0, 0.0), (3, 20.0, 0.2)):
        config = dataclasses.replace(START, turn=turn, focus=focus)
        assert np.array_equal(frames[number], encode(field, PANEL, config, mask=mask))
    assert not np.array_equal(frames[0], frames[1])


def test_a_lossless_video_holds_every_sub_pixel_as_the_panel_wants_it(field, folder):
    done = []
    figures = write_sequence(field, PANEL, START, MOTION, "a.mkv", lambda: done.append(1))
    assert figures["frames"] == len(done) == 4
    for shown, wanted in zip(decoded("a.mkv"), each_frame(field, PANEL, START, MOTION),
                             strict=True):
        assert np.array_equal(shown, wanted[:, ::-1])
    write_sequence(field, PANEL, START, MOTION, "b.mkv")
    assert (folder / "a.mkv").read_bytes() == (folder / "b.mkv").read_bytes()


def test_a_smaller_video_is_near_to_what_was_coded(field, folder):
    write_sequence(field, PANEL, START, MOTION, "a.mkv")
    write_sequence(field, PANEL, START, dataclasses.replace(MOTION, video="444"), "b.mkv")
    assert (folder / "b.mkv").stat().st_size < 0.8 * (folder / "a.mkv").stat().st_size
    for shown, wanted in zip(decoded("b.mkv"), decoded("a.mkv"), strict=True):
        assert psnr(shown / 255.0, wanted / 255.0) > 33


def test_a_folder_is_gone_on_with(field, folder):
    out = folder / "frames"

    class Stop(Exception):
        pass

    def stop_after_two():
        if len(list(out.glob("*.png"))) == 2:
            raise Stop

    with pytest.raises(Stop):
        write_sequence(field, PANEL, START, MOTION, out, stop_after_two)
    first = {path.name: path.stat().st_mtime_ns for path in out.glob("*.png")}
    assert sorted(first) == ["0000.png", "0001.png"]
    assert write_sequence(field, PANEL, START, MOTION, out) == {"frames": 4, "kept": 2}
    assert all((out / name).stat().st_mtime_ns == when for name, when in first.items())
    for number, wanted in enumerate(each_frame(field, PANEL, START, MOTION)):
        assert np.array_equal(read_coded(out / f"{number:04d}.png", PANEL), wanted)
        assert np.array_equal(read_image(out / f"{number:04d}.png"), wanted[:, ::-1])
    assert write_sequence(field, PANEL, START, MOTION, out)["kept"] == 4
    # Another motion, panel or field must not be mixed with what is there.
    others = [(field, PANEL, EncodeConfig(), MOTION),
              (field, dataclasses.replace(PANEL, offset=1.0), START, MOTION),
              (field, PANEL, START, dataclasses.replace(MOTION, frames=5)),
              (shell_field(basis=1, size=20, seed=1), PANEL, START, MOTION)]
    for other in others:
        with pytest.raises(UserError, match="another sequence"):
            write_sequence(*other, out)


def test_an_interrupted_video_leaves_nothing(field, folder):
    def stop():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_sequence(field, PANEL, START, MOTION, folder / "a.mp4", stop)
    assert not list(folder.iterdir())


def test_other_pictures_are_left_alone(field, folder):
    (folder / "holiday.png").write_bytes(b"mine")
    with pytest.raises(UserError, match="other pictures"):
        write_sequence(field, PANEL, START, MOTION, folder)
    assert [path.name for path in folder.iterdir()] == ["holiday.png"]


def test_the_command(field, folder, capsys):
    field.save(folder / "field.npz")
    PANEL.save(folder / "panel.toml")
    words = ["encode", "field.npz", "--display", "panel.toml", "--quiet"]
    moving = [*words, "--frames", "3", "--turn", "-10", "--turn-to", "10", "--json", "run.json"]
    assert main([*moving, "--out", "a.mp4"]) == 0
    assert len(decoded("a.mp4")) == 3
    assert '"frames": 3' in (folder / "run.json").read_text()
    assert main([*moving, "--out", "frames"]) == 0
    capsys.readouterr()
    for wrong, text in (([*moving, "--out", "a.png"], "to a video"),
                        ([*moving, "--quilt", "q.png"], "leave out --frames"),
                        ([*words, "--frames", "-1"], "0 to 100000"),
                        ([*words, "--fps", "0", "--frames", "2"], "--fps"),
                        ([*words, "--frames", "2", "--turn-to", "190"], "-180 to 180"),
                        ([*words, "--frames", "2", "--focus-to", "nan"], "a number"),
                        ([*words, "--focus-to", "0.2"], "number of --frames"),
                        ([*words, "--out", "still.mp4"], "every sub-pixel")):
        assert main(wrong) == 2
        errors = capsys.readouterr().err.strip().splitlines()
        assert len(errors) == 1 and text in errors[0]
    assert main([*words, "--frames", "2", "--out", "same.mkv"]) == 0
    assert "all frames will be the same" in capsys.readouterr().err
