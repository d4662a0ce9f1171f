"""The drive of a frame that stands alone: what lies on it, and what happens where it can't."""

import errno
import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from lfportrait.cli import main
from lfportrait.errors import UserError
from lfportrait.lightfield import Display, EncodeConfig, QuiltLayout
from lfportrait.share import DrivePlan, fill_drive, write_quilt
from lfportrait.share.frames import quilts as drives
from lfportrait.share.frames.files import safe_names
from tests.share.frames.fields import ball_x, marked_field
from tests.share.frames.test_quilts import tiles_of, user_comment

FAT_FORBIDDEN = set('"*/:<>?\\|') | {chr(code) for code in range(32)}


@pytest.fixture
def drive(tmp_path):
    folder = tmp_path / "GO"
    folder.mkdir()
    return folder


@pytest.fixture
def small(tmp_path):
    """A frame with small quilts, so that tests are short."""
    panel = Display.preset("lookingglass-go")
    path = tmp_path / "frame.toml"
    Display(**{**{name: getattr(panel, name) for name in panel.__dataclass_fields__},
               "quilt": (3, 2), "quilt_size": (108, 128)}).save(path)
    return str(path)


def quilt(path, shade=90, columns=2, rows=2):
    path.parent.mkdir(exist_ok=True)
    write_quilt(path, np.full((40, 30, 3), shade, np.uint8), QuiltLayout(columns, rows, 0.5625))
    return path


def played(drive):
    """What the frame plays: from currentlyPlaying.json through the playlist to the pictures."""
    playing = json.loads((drive / "currentlyPlaying.json").read_text())
    assert (playing["model"], playing["schema"]) == ("toolkit", "0.1")
    found = []
    for entry in playing["playlists"]:
        assert entry["path"].startswith("/")
        playlist = drive / entry["path"].lstrip("/")
        lines = playlist.read_text("ascii").splitlines()
        assert all((playlist.parent / line).is_file() for line in lines)
        found += [playlist.parent / line for line in lines]
    return playing["playlists"][0]["title"], found


def test_portraits_and_quilts_are_put_on_the_drive(tmp_path, drive, small, capsys):
    (tmp_path / "anna").mkdir()
    marked_field().save(tmp_path / "anna" / "styled.npz")
    other = quilt(tmp_path / "ben_qs2x2a0.5625.jpg")
    assert main(["cast", str(tmp_path / "anna" / "styled.npz"), str(other), "--drive", str(drive),
                 "--display", small, "--title", "Großeltern", "--seconds", "7",
                 "--json", str(tmp_path / "run.json")]) == 0
    title, pictures = played(drive)
    assert title == "Großeltern"
    assert [picture.name for picture in pictures] == ["anna_qs3x2a0.5625.png",
                                                      "ben_qs2x2a0.5625.jpg"]
    assert pictures[1].read_bytes() == other.read_bytes()
    for picture, views in zip(pictures, (6, 4)):
        side = json.loads(Path(f"{picture}.json").read_text())
        assert side["quilt_settings"]["viewTotal"] == views and side["duration"] == 7
        assert side["quilt_settings"]["aspect"] == 0.5625
        assert user_comment(picture)["LKGNumViews"] == views
    with Image.open(pictures[0]) as picture:
        places = [ball_x(tile) for tile in tiles_of(np.asarray(picture), 3, 2)]
    assert places[0] > 0 > places[-1]
    # Nothing else is left there: no temporary file, no folder.
    assert len(list(drive.iterdir())) == 6
    figures = json.loads((tmp_path / "run.json").read_text())
    assert [entry["views"] for entry in figures["quilts"]] == [6, 4]
    assert "eject" in capsys.readouterr().out


def test_the_frames_own_list_is_kept_once(drive, tmp_path):
    (drive / "currentlyPlaying.json").write_text('{"own": 1}')
    for name in ("a", "b"):
        fill_drive(DrivePlan(drive, [quilt(tmp_path / f"{name}_qs2x2a0.5625.png")]))
    assert (drive / "currentlyPlaying.json.before").read_text() == '{"own": 1}'
    assert [picture.name for picture in played(drive)[1]] == ["b_qs2x2a0.5625.png"]


def test_the_calibration_on_the_drive_is_the_frames(drive, tmp_path):
    assert DrivePlan(drive, []).panel().name == Display.preset("lookingglass-go").name
    (drive / "LKG_calibration").mkdir()
    calibration = Display.preset("lookingglass-portrait").looking_glass()
    calibration["serial"] = "LKG-P01234"
    (drive / "LKG_calibration" / "visual.json").write_text(json.dumps(calibration))
    panel = DrivePlan(drive, []).panel()
    assert panel.name == "LKG-P01234" and panel.quilt == (8, 6)


def test_a_quilt_without_a_layout_in_its_name_gets_one(drive, tmp_path):
    source = quilt(tmp_path / "plain.png", columns=3)
    fill_drive(DrivePlan(drive, [source]))
    assert played(drive)[1][0].name == "plain_qs3x2a0.5625.png"


def test_a_layout_in_capitals_is_not_put_into_the_name_twice(drive, tmp_path):
    source = quilt(tmp_path / "ben_QS2X2A0.5625.jpg")
    fill_drive(DrivePlan(drive, [source]))
    assert played(drive)[1][0].name == "ben_qs2x2a0.5625.jpg"


def test_names_are_safe_on_any_drive():
    names = safe_names(["Jürgen", 'a:b?"*<>|', "李", "CON", "anna", "ANNA", "x" * 300, "...", "a. ",
                        "nul.txt"])
    assert names[0] == "Jurgen" and len({name.lower() for name in names}) == len(names)
    for name in names:
        assert name.isascii() and not set(name) & FAT_FORBIDDEN and len(name) <= 104
        assert name == name.strip(". ") and name.split(".")[0].lower() not in ("con", "nul", "")


@pytest.mark.parametrize(("number", "complaint"), [
    (errno.ENOSPC, "is full"), (errno.EROFS, "can only be read"), (errno.EIO, "still plugged in"),
    (errno.EFBIG, "a file this large")])
def test_a_drive_that_fails_midway_keeps_what_it_had(drive, tmp_path, monkeypatch, number,
                                                     complaint):
    fill_drive(DrivePlan(drive, [quilt(tmp_path / "old_qs2x2a0.5625.png")]))
    before = {path.name: path.read_bytes() for path in drive.iterdir()}
    copies = []

    def fail(source, target, length):
        copies.append(source)
        if len(copies) == 3:
            raise OSError(number, os.strerror(number))
        target.write(source.read())

    monkeypatch.setattr(drives.shutil, "copyfileobj", fail)
    sources = [quilt(tmp_path / f"{name}_qs2x2a0.5625.png") for name in ("new", "newer")]
    with pytest.raises(UserError, match=complaint) as told:
        fill_drive(DrivePlan(drive, sources))
    assert str(drive) in str(told.value) and "--out" not in str(told.value)
    assert {path.name: path.read_bytes() for path in drive.iterdir()} == before


def test_a_drive_without_chmod_and_rename_over(drive, tmp_path, monkeypatch):
    """As memory cards and some network drives are mounted."""
    def refuse(*_, **__):
        raise OSError(errno.EPERM, "not permitted")

    sources = [quilt(tmp_path / str(shade) / "a_qs2x2a0.5625.png", shade) for shade in (10, 200)]
    monkeypatch.setattr(os, "chmod", refuse)
    replace = os.replace
    monkeypatch.setattr(os, "replace", lambda old, new: (
        refuse() if Path(new).exists() else replace(old, new)))
    for source in sources:
        fill_drive(DrivePlan(drive, [source]))
    with Image.open(played(drive)[1][0]) as picture:
        assert picture.getpixel((3, 3)) == (200, 200, 200)
    assert len(list(drive.iterdir())) == 4


def test_too_little_room_is_told_before_anything_is_written(drive, tmp_path, monkeypatch):
    usage = drives.shutil.disk_usage
    monkeypatch.setattr(drives.shutil, "disk_usage", lambda path: (
        usage(path)._replace(free=1000) if path == drive else usage(path)))
    with pytest.raises(UserError, match="nothing was written"):
        fill_drive(DrivePlan(drive, [quilt(tmp_path / "a_qs2x2a0.5625.png")]))
    assert list(drive.iterdir()) == []
    monkeypatch.undo()
    monkeypatch.setattr(drives, "_FAT_FILE", 100)
    with pytest.raises(UserError, match="a file this large"):
        fill_drive(DrivePlan(drive, [quilt(tmp_path / "a_qs2x2a0.5625.png")]))
    assert list(drive.iterdir()) == []


@pytest.mark.parametrize(("options", "complaint"), [
    ("size=64k", "is full"), ("size=8m,ro", "can only be read")])
def test_a_real_drive_that_is_full_or_locked(drive, tmp_path, small, options, complaint):
    marked_field().save(tmp_path / "head.npz")
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", options, "x", str(drive)], check=False,
                             capture_output=True)
    if mounted.returncode:
        pytest.skip("file systems can't be mounted here")
    try:
        with pytest.raises(UserError, match=complaint):
            fill_drive(DrivePlan(drive, [tmp_path / "head.npz"], display=small))
        assert list(drive.iterdir()) == []
    finally:
        subprocess.run(["umount", str(drive)], check=True)


@pytest.mark.parametrize(("words", "complaint"), [
    (["a_qs2x2a0.5625.png", "--drive", "nowhere"], "no such drive"),
    (["--drive", "GO"], "name the portraits"), (["none.npz", "--drive", "GO"], "no such file"),
    (["plain.webp", "--drive", "GO"], "PNG and JPEG only"),
    (["plain.png", "--drive", "GO"], "nothing gives the layout"),
    (["text.png", "--drive", "GO"], "neither a field"),
    (["a_qs2x2a0.5625.png", "--drive", "GO", "--list"], "--drive needs no Bridge"),
    (["a_qs2x2a0.5625.png", "--drive", "GO", "--seconds", "0"], "--seconds"),
    (["a_qs2x2a0.5625.png", "--drive", "GO", "--display", "none"], "no display")])
def test_mistakes_are_told_in_one_line(tmp_path, drive, capsys, monkeypatch, words, complaint):
    monkeypatch.chdir(tmp_path)
    quilt(tmp_path / "a_qs2x2a0.5625.png")
    Image.new("RGB", (8, 8)).save(tmp_path / "plain.png")
    Image.new("RGB", (8, 8)).save(tmp_path / "plain.webp")
    (tmp_path / "text.png").write_text("no picture")
    assert main(["cast", *words]) == 2
    lines = [line for line in capsys.readouterr().err.splitlines() if "lfportrait:" in line]
    assert len(lines) == 1 and complaint in lines[0]
    assert list(drive.iterdir()) == []


def test_the_heads_placement_is_used(drive, tmp_path, small):
    marked_field().save(tmp_path / "head.npz")

    def covered(size):
        plan = DrivePlan(drive, [tmp_path / "head.npz"], display=small,
                         encode=EncodeConfig(size=size))
        fill_drive(plan)
        with Image.open(played(drive)[1][0]) as picture:
            return (np.asarray(picture).max(axis=-1) > 50).mean()

    assert covered(0.4) < 0.5 * covered(0.8)
