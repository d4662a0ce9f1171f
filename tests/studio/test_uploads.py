"""Photos on their way: streamed, resumed, known by their hash, refused where they are no photos."""

import asyncio
import hashlib
import os
import time

import pytest
from starlette.requests import ClientDisconnect

from lfportrait.files import write_json
from lfportrait.studio import photos
from lfportrait.studio.answers import Refusal
from lfportrait.studio.photos import VIDEO_FRAME, check_key

from .conftest import jpeg, run_apart


@pytest.fixture
def project(page):
    return page.do("POST", "/api/projects", {"name": "Anna"})["id"]


def announced(page, project, *files):
    return page.do("POST", f"/api/projects/{project}/uploads", {"files": list(files)})["files"]


def entry(name, data):
    return {"name": name, "size": len(data), "sha256": hashlib.sha256(data).hexdigest()}


def test_a_photo_lies_where_the_commands_look_for_it(page, project):
    data = jpeg(1)
    assert page.send(project, "IMG 1.jpg", data)["state"] == "send"
    folder = page.desk.projects.folder / "Anna" / "photos"
    assert (folder / "IMG 1.jpg").read_bytes() == data
    assert [path.name for path in folder.iterdir()] == ["IMG 1.jpg"]
    photos = page.get(f"/api/projects/{project}/photos")["photos"]
    assert [one["name"] for one in photos] == ["IMG 1.jpg"] and photos[0]["grade"] == "none"
    picture = page.ask("GET", photos[0]["picture"])
    assert picture.headers["content-type"] == "image/jpeg"
    assert page.ask("GET", photos[0]["picture"], headers={
        "if-none-match": picture.headers["etag"]}).status_code == 304


def test_a_sitter_who_goes_while_a_small_picture_is_made_leaves_the_name_free(page, project,
                                                                              monkeypatch):
    page.send(project, "1.jpg", jpeg(1))
    picture = page.get(f"/api/projects/{project}/photos")["photos"][0]["picture"]
    projects, write = page.desk.projects, photos.write_image
    trash = []

    def late(path, *rest, **more):
        trash.append(projects.remove(projects.get(project)))
        write(path, *rest, **more)

    monkeypatch.setattr(photos, "write_image", late)
    page.ask("GET", picture)
    assert [path.name for path in (projects.folder / "Anna").iterdir()] == [".studio"]
    assert page.do("POST", "/api/trash", {"name": trash[0]})["name"] == "Anna"
    assert (projects.folder / "Anna" / "photos" / "1.jpg").is_file()
    monkeypatch.setattr(photos, "write_image", write)
    page.do("DELETE", f"/api/projects/{project}", {"confirm": "Anna"})
    (projects.folder / "Anna" / ".studio").mkdir(parents=True)
    page.do("POST", "/api/projects", {"name": "Anna"})
    # A folder that holds anything else is somebody's.
    (projects.folder / "Bob").mkdir()
    (projects.folder / "Bob" / "letter.txt").write_text("keep")
    assert page.error("POST", "/api/projects", {"name": "Bob"}) == "exists"


def test_a_photo_that_is_here_is_not_sent_again(page, project):
    data = jpeg(1)
    page.send(project, "one.jpg", data)
    found = announced(page, project, entry("another name.jpg", data), entry("two.jpg", jpeg(2)))
    assert [one["state"] for one in found] == ["have", "send"]
    assert found[0]["upload"] is None and found[0]["photo"]
    # Two pages send the same at the same time: it is kept once.
    twice = [announced(page, project, entry(f"{n}.jpg", jpeg(3)))[0]["upload"] for n in (1, 2)]
    for upload in twice:
        page.ask("PUT", f"/api/projects/{project}/uploads/{upload}?offset=0", jpeg(3))
    assert len(page.get(f"/api/projects/{project}/photos")["photos"]) == 2


def test_a_broken_upload_goes_on_where_it_broke(page, project):
    data = jpeg(4, (300, 200))
    (found,) = announced(page, project, entry("a.jpg", data))
    path = f"/api/projects/{project}/uploads/{found['upload']}"
    half = len(data) // 2

    def broken():
        yield data[:half]

    answer = page.ask("PUT", f"{path}?offset=0", b"", content=broken(),
                      headers={"content-length": str(len(data))})
    assert answer.status_code == 400
    (found,) = announced(page, project, entry("a.jpg", data))
    assert (found["state"], found["offset"]) == ("resume", half)
    path = f"/api/projects/{project}/uploads/{found['upload']}"
    assert page.error("PUT", f"{path}?offset={half - 1}", data[half - 1:]) == "exists"
    assert page.ask("PUT", f"{path}?offset={half}", data[half:]).status_code == 201
    assert (page.desk.projects.folder / "Anna/photos/a.jpg").read_bytes() == data
    assert not list((page.desk.projects.folder / "Anna/.studio/uploads").iterdir())


def test_what_was_damaged_on_its_way_is_not_kept(page, project):
    data = jpeg(5)
    (found,) = announced(page, project, entry("a.jpg", data))
    path = f"/api/projects/{project}/uploads/{found['upload']}"
    assert page.error("PUT", f"{path}?offset=0", b"x" + data[1:]) == "bad_hash"
    assert page.get(f"/api/projects/{project}/photos")["photos"] == []
    (found,) = announced(page, project, entry("a.jpg", data))
    assert (found["state"], found["offset"]) == ("send", 0)


def test_what_is_longer_or_shorter_than_announced_is_refused(page, project):
    data = jpeg(6)
    (found,) = announced(page, project, entry("a.jpg", data))
    path = f"/api/projects/{project}/uploads/{found['upload']}?offset=0"
    assert page.error("PUT", path, data + b"more") == "bad_request"
    answer = page.ask("PUT", path, data + b"more", headers={"content-length": str(len(data))})
    assert answer.json()["error"]["code"] == "too_large"
    assert page.get(f"/api/projects/{project}/photos")["photos"] == []


@pytest.mark.parametrize("name, code", [
    ("../a.jpg", "bad_name"), ("..\\a.jpg", "bad_name"), ("C:a.jpg", "bad_name"),
    ("/etc/a.jpg", "bad_name"), (".hidden.jpg", "bad_name"), ("a\0.jpg", "bad_name"),
    ("con.jpg", "bad_name"), ("", "bad_name"), ("a.jpg.", "bad_name"), ("a\u202egpj.exe",
                                                                        "bad_name"),
    ("a.exe", "bad_type"), ("a.svg", "bad_type"), ("a.html", "bad_type"), ("a", "bad_type"),
    ("a.dng", "bad_type"), ("a" * 200 + ".jpg", "bad_name")])
def test_odd_names_and_other_files_are_refused(page, project, name, code):
    found, good = announced(page, project, entry(name, b"data"), entry("good.jpg", jpeg(7)))
    assert found["state"] == "refused" and found["error"]["code"] == code
    assert good["state"] == "send", "one bad name does not stop the others"


def test_too_much_is_refused(page, project, monkeypatch):
    large = {"name": "a.jpg", "size": (128 << 20) + 1, "sha256": "0" * 64}
    assert announced(page, project, large)[0]["error"]["code"] == "too_large"
    monkeypatch.setattr(photos, "free_disk_bytes", lambda _: 1000)
    found = announced(page, project, entry("a.jpg", jpeg(8)))[0]["error"]
    assert found["code"] == "disk_full" and found["about"]["free_bytes"] == 1000
    assert page.error("POST", f"/api/projects/{project}/uploads", {"files": [large] * 501}
                      ) == "bad_request"


def test_a_disk_that_fills_up_on_the_way_is_said(page, project, monkeypatch):
    data = jpeg(9)
    (found,) = announced(page, project, entry("a.jpg", data))

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(photos.os, "replace", full)
    path = f"/api/projects/{project}/uploads/{found['upload']}?offset=0"
    assert page.error("PUT", path, data) == "disk_full"
    monkeypatch.undo()
    (found,) = announced(page, project, entry("a.jpg", data))
    assert found["offset"] == len(data), "nothing that came is lost"
    page.do("PUT", f"/api/projects/{project}/uploads/{found['upload']}?offset={len(data)}", b"")
    assert len(page.get(f"/api/projects/{project}/photos")["photos"]) == 1


@pytest.mark.parametrize("how", ["slow", "gone"])
def test_an_upload_that_hardly_moves_or_breaks_off_keeps_what_came(page, project, monkeypatch, how):
    """Asked directly: the test client sends a body at once."""
    if how == "slow":
        monkeypatch.setattr(photos, "_WITHIN", 0.05)
    data = jpeg(10, (400, 300))
    (found,) = announced(page, project, entry("a.jpg", data))

    async def dripping():
        for place in range(0, 5000, 100):
            yield data[place:place + 100]
            await asyncio.sleep(0.01 if how == "slow" else 0)
        raise ClientDisconnect

    with pytest.raises(Refusal if how == "slow" else ClientDisconnect) as error:
        run_apart(page.desk.uploads.receive(page.desk.projects.get(project), found["upload"], 0,
                                            len(data), dripping()))
    assert how == "gone" or error.value.code == "too_slow"
    (found,) = announced(page, project, entry("a.jpg", data))
    assert found["state"] == "resume" and 0 < found["offset"] <= 5000
    path = f"/api/projects/{project}/uploads/{found['upload']}?offset={found['offset']}"
    page.do("PUT", path, data[found["offset"]:])
    assert (page.desk.projects.folder / "Anna/photos/a.jpg").read_bytes() == data


def test_a_project_has_photos_or_one_video(page, project):
    page.send(project, "a.jpg", jpeg(11))
    video = {"name": "a.mp4", "size": 1000, "sha256": "1" * 64}
    assert announced(page, project, video)[0]["error"]["code"] == "exists"
    # Neither does one come back beside the other.
    folder = page.desk.projects.folder / "Anna"
    (folder / "left-out").mkdir(exist_ok=True)
    (folder / "left-out" / "b.mp4").write_bytes(b"film")
    clip = next(one for one in page.get(f"/api/projects/{project}/photos")["photos"]
                if one["video"])
    assert clip["picture"] is None, "it has none before it is checked"
    path = f"/api/projects/{project}/photos/{clip['id']}"
    assert page.error("PATCH", path, {"left_out": False}) == "exists"
    page.do("DELETE", path)
    assert [one["name"] for one in page.get(f"/api/projects/{project}/photos")["photos"]] == [
        "a.jpg"]


def test_a_video_shows_its_own_frame_and_where_its_frames_were_taken(page, project):
    folder = page.desk.projects.folder / "Anna"
    video, small = folder / "photos" / "a.mp4", folder / ".studio" / "small"
    video.write_bytes(b"film")
    small.mkdir(parents=True, exist_ok=True)
    (small / VIDEO_FRAME).write_bytes(jpeg(1))
    facts = {str(n): {"yaw": yaw, "wrong": wrong} for n, (yaw, wrong) in enumerate(
        [(20.0, ""), (-10.0, ""), (40.0, "blurred"), (None, "")])}
    project_ = page.desk.projects.get(project)
    write_json(folder / ".studio" / "check.json", {
        "key": check_key(project_), "facts": facts, "faces": 3, "useless": 1})
    found = page.get(f"/api/projects/{project}/photos")
    assert (found["looked"], found["arc"]["yaws"]) == (4, [-10.0, 20.0])
    assert page.ask("GET", found["photos"][0]["picture"]).status_code == 200
    assert page.get(f"/api/projects/{project}")["thumbnail"]
    # The frame of a video that was there before is not shown for this one.
    later = time.time() + 10
    os.utime(video, (later, later))
    assert page.get(f"/api/projects/{project}/photos")["photos"][0]["picture"] is None


def test_a_photo_is_left_out_and_taken_in_again(page, project):
    page.send(project, "a.jpg", jpeg(12))
    (photo,) = page.get(f"/api/projects/{project}/photos")["photos"]
    path = f"/api/projects/{project}/photos/{photo['id']}"
    assert page.do("PATCH", path, {"left_out": True})["grade"] == "grey"
    folder = page.desk.projects.folder / "Anna"
    assert not list((folder / "photos").iterdir()) and (folder / "left-out/a.jpg").is_file()
    assert announced(page, project, entry("b.jpg", jpeg(12)))[0]["state"] == "have"
    page.do("PATCH", path, {"left_out": False})
    assert (folder / "photos/a.jpg").is_file()
    page.do("DELETE", path)
    assert page.get(f"/api/projects/{project}/photos")["photos"] == []
    assert page.error("GET", photo["picture"]) == "not_found"


def test_a_damaged_photo_has_no_picture_but_a_word(page, project):
    page.send(project, "a.jpg", b"\xff\xd8 no picture")
    (photo,) = page.get(f"/api/projects/{project}/photos")["photos"]
    assert page.error("GET", photo["picture"]) == "user_error"


def test_a_figure_that_is_no_number_does_not_take_the_sheet_away(page, project):
    folder = page.desk.projects.get(project).folder
    (folder / "photos" / "a.jpg").write_bytes(jpeg(1))
    write_json(folder / ".studio" / "check.json", {
        "key": check_key(page.desk.projects.get(project)), "facts": {"a.jpg": {
            "wrong": "", "fair": "", "brightness": float("nan"), "sharpness": 1.0}}})
    (photo,) = page.get(f"/api/projects/{project}/photos")["photos"]
    assert photo["brightness"] is None and photo["sharpness"] == 1.0
