"""What people's folders hold: pictures of all kinds, twins, junk, and names of any spelling."""

import unicodedata
import warnings

import numpy as np
import pytest
from PIL import Image

from lfportrait.capture import read_photos
from lfportrait.cli import dispatch
from lfportrait.errors import UserError
from lfportrait.job.batch.jobs_file import load_jobs
from lfportrait.job.graph import look_at, source_files, source_key
from lfportrait.lightfield import Display
from lfportrait.lightfield.interlacing import read_views
from lfportrait.media.folders import (
    Finder,
    files_below,
    is_junk,
    list_pictures,
    natural_key,
    say_left_out,
)

JUNK = ["._X.jpg", "@eaDir/a.jpg", "__MACOSX/._a.jpg", "__MACOSX/a.jpg", ".thumbnails/a.jpg",
        "Thumbs.db", "desktop.ini", ".DS_Store", "@eaDir/a.jpg/SYNOPHOTO_THUMB_M.jpg",
        "$RECYCLE.BIN/b.jpg", ".Trashes/c.jpg"]

PANEL = Display(90, 48, views=12, pitch=7.3, slant=0.15, offset=2.1, cone=50, distance=3,
                quilt=(4, 3), quilt_size=(240, 96), name="small")


def picture(path, seed=0, **options):
    path.parent.mkdir(parents=True, exist_ok=True)
    values = np.random.default_rng(seed).integers(0, 256, (12, 16, 3), np.uint8)
    Image.fromarray(values).save(path, **options)
    return path


def pictures(folder, *names):
    """Pictures that differ, of the kinds that their names end in."""
    for seed, name in enumerate(names):
        picture(folder / name, seed, **({"format": "JPEG"} if name.endswith(".jfif") else {}))
    return folder


def junk(folder):
    for name in JUNK:
        path = folder / name
        if any(parent.is_file() for parent in path.parents):
            continue
        if path.suffix == ".jpg" and not path.name.startswith("."):
            picture(path, 99)
        else:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(b"\0\5\x16\7" + bytes(90))


def names(listing):
    return [path.name for path in listing.files]


def test_numbers_count_as_numbers(tmp_path):
    wanted = [f"view_{number}.png" for number in range(1, 13)]
    pictures(tmp_path, *wanted)
    assert names(list_pictures(tmp_path)) == wanted
    assert [photo.name for photo in read_photos(tmp_path)] == wanted
    assert sorted(["a10", "A9", "é2", "1", "a", "٣", "²", "b01", "b1"], key=natural_key)[:4] == [
        "1", "a", "A9", "a10"]


def test_views_go_in_in_natural_order(tmp_path):
    for number in range(1, 13):
        Image.new("RGB", (8, 8), (20 * number, 0, 0)).save(tmp_path / f"view_{number}.png")
    assert [int(view[0, 0, 0]) for view in read_views(tmp_path, PANEL)[0]] == [
        20 * number for number in range(1, 13)]


def test_equal_views_are_all_kept(tmp_path):
    for number in range(6):
        Image.new("RGB", (8, 8), "white").save(tmp_path / f"frame_{number:04d}.jpg")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(read_views(tmp_path, PANEL)[0]) == 6


def test_mixed_kinds_are_all_taken(tmp_path):
    pytest.importorskip("pillow_heif").register_heif_opener()
    wanted = ["a.webp", "b.jfif", "c.heic", "d.gif", "e.tiff", "f.JPG", "g.bmp", "h.avif", "i.jpe"]
    pictures(tmp_path, *wanted)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert [photo.name for photo in read_photos(tmp_path)] == wanted


def test_junk_is_no_picture(tmp_path):
    pictures(tmp_path, "a.jpg", "b.jpg", "c.jpg")
    key, files = source_key(tmp_path), source_files(tmp_path)
    junk(tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert [photo.name for photo in read_photos(tmp_path)] == ["a.jpg", "b.jpg", "c.jpg"]
    assert source_files(tmp_path) == files and source_key(tmp_path) == key
    assert [path.name for path in files_below(tmp_path)] == ["a.jpg", "b.jpg", "c.jpg"]
    assert is_junk(tmp_path / "@EADIR") and not is_junk(tmp_path / "eadir.jpg")


def test_a_cameras_folder_beside_junk_is_found(tmp_path):
    pictures(tmp_path / "DCIM" / "100APPLE", "a.jpg", "b.jpg")
    junk(tmp_path)
    junk(tmp_path / "DCIM")
    assert [photo.name for photo in read_photos(tmp_path)] == ["a.jpg", "b.jpg"]


TWINS = [
    (["IMG_1.HEIC", "IMG_1.JPG"], ["IMG_1.HEIC"], "another format"),
    (["IMG_1.HEIC", "IMG_1.JPG", "IMG_2.JPG"], ["IMG_1.JPG", "IMG_2.JPG"], "another format"),
    (["IMG_1.jpg", "IMG_1-edited.jpg"], ["IMG_1.jpg"], "edited"),
    (["IMG_1.jpg", "IMG_1-bearbeitet.jpg", "IMG_1-edited(1).jpg"], ["IMG_1.jpg"], "edited"),
    (["IMG_E1234.HEIC", "IMG_1234.HEIC"], ["IMG_1234.HEIC"], "edited"),
    (["PXL_1.PORTRAIT-01.COVER.jpg", "PXL_1.PORTRAIT-02.ORIGINAL.jpg"],
     ["PXL_1.PORTRAIT-02.ORIGINAL.jpg"], "another format")]


@pytest.mark.parametrize(("given", "taken", "reason"), TWINS)
def test_of_twins_one_is_taken_and_one_line_says_so(tmp_path, given, taken, reason):
    if any(name.endswith("HEIC") for name in given):
        pytest.importorskip("pillow_heif").register_heif_opener()
    pictures(tmp_path, *given)
    with pytest.warns(UserWarning, match=reason) as told:
        assert [photo.name for photo in read_photos(tmp_path)] == taken
    assert len(told) == 1


def test_copies_of_the_same_bytes(tmp_path):
    pictures(tmp_path, "a.jpg", "b.jpg")
    for name in ("a copy.jpg", "a (1).jpg"):
        (tmp_path / name).write_bytes((tmp_path / "a.jpg").read_bytes())
    with pytest.warns(UserWarning, match=r"2 of .*copies of other photos") as told:
        found = [photo.name for photo in read_photos(tmp_path)]
    assert len(told) == 1 and len(found) == 2 and "b.jpg" in found


@pytest.mark.parametrize("given", [
    ["img01.jpg", "img1.jpg"], ["DSC_0001.JPG", "DSC_0001_2.JPG"],
    ["photo (1).jpg", "photo (2).jpg"], ["photo.jpg", "photo (1).jpg", "photo-1.jpg"],
    ["IMG_E1234.jpg", "IMG_1235.jpg"], ["a-edited.jpg", "b-edited.jpg"], ["edited.jpg", "e.jpg"],
    ["credited.jpg", "cr.jpg"], ["me_edit1.jpg", "you_edit1.jpg"], ["Zoé.jpg", "Zoe.jpg"]])
def test_no_false_twins(tmp_path, given):
    pictures(tmp_path, *given)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert sorted(photo.name for photo in read_photos(tmp_path)) == sorted(given)


def test_what_is_left_out_is_said_once(tmp_path):
    pictures(tmp_path, "a.jpg", "b.jpg")
    (tmp_path / "c.dng").write_bytes(b"II*\0" + bytes(50))
    (tmp_path / "d.mp4").write_bytes(b"\0\0\0\x14ftypisom" + bytes(50))
    (tmp_path / "e.psd").write_bytes(b"8BPS" + bytes(50))
    (tmp_path / "notes.txt").write_text("x")
    with pytest.warns(UserWarning) as told:
        say_left_out(list_pictures(tmp_path), tmp_path)
    said = sorted(str(one.message) for one in told)
    assert len(said) == 3 and all("1 of" in one for one in said)
    assert not any("notes" in one for one in said)


def test_a_command_says_once_what_it_leaves_out(tmp_path, capsys):
    """Its stages read the same folder one after another."""
    pictures(tmp_path, "a.jpg", "b.jpg", "c.jpg")
    (tmp_path / "d.dng").write_bytes(b"II*\0" + bytes(50))
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        warnings.showwarning = dispatch._warner()
        look_at(tmp_path)
        read_photos(tmp_path)
    assert capsys.readouterr().err.count("d.dng") == 1


def test_photos_of_several_people_are_asked_about(tmp_path):
    picture(tmp_path / "left" / "a.jpg", 1)
    picture(tmp_path / "right" / "a.jpg", 1)
    with pytest.raises(UserError, match=r"several folders \(left, right\)"):
        read_photos(tmp_path)


def test_a_batchs_pattern_takes_no_junk_for_people(tmp_path):
    for number in (2, 10):
        pictures(tmp_path / "people" / f"sitter_{number}", "a.jpg", "b.jpg", "c.jpg")
    junk(tmp_path / "people")
    style = picture(tmp_path / "style.png")
    (tmp_path / "jobs.toml").write_text(
        f"[[sitter]]\nphotos = \"people/*\"\n[[style]]\npainting = \"{style}\"\n"
        "[[display]]\npanel = \"generic-4k\"\n")
    jobs = load_jobs(tmp_path / "jobs.toml")
    assert [sitter.source.name for sitter in jobs.sitters.values()] == ["sitter_2", "sitter_10"]


def test_a_cameras_raw_photos_beside_their_developed_ones_need_no_word(tmp_path):
    pictures(tmp_path, "a.jpg", "b.jpg")
    for name in ("a.CR2", "B.cr2"):
        (tmp_path / name).write_bytes(b"II*\0" + bytes(50))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(read_photos(tmp_path)) == 2


def test_a_folder_with_nothing_is_one_line(tmp_path):
    junk(tmp_path)
    with pytest.raises(UserError, match="no photos in it") as told:
        read_photos(tmp_path)
    assert "\n" not in str(told.value)


SPELLINGS = [("a.jpg", "a.JPG"), ("A.JPG", "a.jpg"), ("a.jpeg", "a.jpg"), ("a.jpg", "a.JPEG"),
             ("Zoé.jpg", "ZOÉ.JPG"), ("images/a.jpg", "Images\\A.JPG"), ("a.jpg", "./a.jpg"),
             ("images/a.jpg", "images/../images/a.jpg"), ("a.tiff", "a.tif")]


@pytest.mark.parametrize("form", ["NFC", "NFD"])
@pytest.mark.parametrize(("there", "noted"), SPELLINGS)
def test_names_as_people_write_them(tmp_path, there, noted, form):
    other = "NFD" if form == "NFC" else "NFC"
    path = tmp_path / unicodedata.normalize(form, there)
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(b"x")
    found = Finder().find(tmp_path, unicodedata.normalize(other, noted))
    assert found is not None and found.samefile(path)


def test_a_name_of_its_own_goes_first_and_two_of_a_kind_are_none(tmp_path):
    for name in ("a.jpg", "A.jpg"):
        (tmp_path / name).write_bytes(b"x")
    if len(list(tmp_path.iterdir())) < 2:
        pytest.skip("this disk takes both names for one")
    finder = Finder()
    assert finder.find(tmp_path, "A.jpg") == tmp_path / "A.jpg"
    assert finder.find(tmp_path, "a.JPG") is None
    assert finder.find(tmp_path, "none.jpg") is None
    assert finder.find(tmp_path, "a\0.jpg") is None and finder.find(tmp_path, "x" * 999) is None
    assert finder.find(tmp_path, "") is None
