"""A portrait from photos to the coded picture, by the page's requests alone, on a small head."""

from __future__ import annotations

import hashlib
import io
import os
import re
import shlex
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from lfportrait.demo import demo_capture, demo_exemplar
from lfportrait.face import read_landmarks
from lfportrait.files import read_json
from lfportrait.job import make
from lfportrait.media.pictures import read_image
from lfportrait_eval.study.design import entries_of
from tests.job.test_pipeline import CONFIG, PANEL

from .conftest import opened

pytestmark = pytest.mark.slow  # whole portraits; parts: work/, test_jobs.py, test_previews.py

# Without refinement no process imports torch.
SMALL = replace(CONFIG, stylize=replace(CONFIG.stylize, steps=0))

PARAMETERS = {
    "reconstruct.resolutions": [24, 48], "reconstruct.rays": [0.03, 0.06],
    "reconstruct.batch": [1024], "stylize.pixels": 48.0,
    "stylize.fit_iterations": 2, "stylize.steps": 0, "stylize.content_network": "embedded",
    "stylize.style_network": "embedded", "sweep_size": 48}


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    before = os.environ.get("LFPORTRAIT_MODELS")
    folder = tmp_path_factory.mktemp("studio")
    yield from opened(folder)
    assert os.environ.get("LFPORTRAIT_MODELS") == before


@pytest.fixture(scope="module")
def project(page):
    """A sitter with photos whose cameras are known, a small panel, and small parameters."""
    panel = page.do("POST", "/api/displays", {"name": "tiny", "text": PANEL.to_toml()})
    made = page.do("POST", "/api/projects", {"name": "Anna"})["id"]
    photos = page.desk.projects.get(made).photos
    photos.rmdir()
    demo_capture(size=72, views=16).save(photos)
    page.do("PATCH", f"/api/projects/{made}", {
        "display": panel["id"], "options": {"parameters": PARAMETERS, "pixels": 48.0}})
    return made


@pytest.fixture(scope="module")
def head(page, project):
    """The head, whose process is killed while it trains."""
    job = page.do("POST", "/api/jobs", {"kind": "head", "project": project})["id"]
    until = time.monotonic() + 120
    while time.monotonic() < until:
        found = page.get(f"/api/jobs/{job}")
        states = {one["name"]: one["state"] for one in found["stages"]}
        if states.get("reconstruct") == "running" or found["state"] != "running":
            break
        time.sleep(0.005)
    page.desk.jobs._children[job]._signal(9)
    found = page.wait(job)
    assert found["state"] == "failed" and found["error"]["code"] == "killed"
    page.do("POST", f"/api/jobs/{job}/resume")
    found = page.wait(job)
    assert found["state"] == "done", found
    return found


@pytest.fixture(scope="module")
def style(page, project):
    exemplar = demo_exemplar(width=120, height=160)
    buffer = io.BytesIO()
    Image.fromarray(exemplar.image).save(buffer, "PNG")
    found = page.do("PUT", f"/api/styles?name=Ken.png&project={project}", buffer.getvalue())
    again = page.ask("PUT", f"/api/styles?name=Other.png&project={project}", buffer.getvalue())
    assert again.status_code == 200 and again.json()["id"] == found["id"]
    path = page.desk.projects.get(project).folder / "paintings/Ken.png"
    points = exemplar.landmarks.tolist()
    written = page.do("PUT", f"/api/styles/{found['id']}/landmarks?project={project}",
                      {"points": points})
    assert written["edited"] and len(written["lines"]) == 9
    kept = read_landmarks(path.with_suffix(".landmarks.txt"))
    assert np.abs(kept - exemplar.landmarks).max() < 0.006
    return found["id"]


def test_the_head_is_made_and_was_not_begun_again(page, project, head):
    states = [one["state"] for one in head["stages"]]
    assert [one["name"] for one in head["stages"]] == ["capture", "reconstruct", "surface"]
    assert states == ["skipped", "done", "done"]
    folder = page.desk.projects.get(project).folder
    assert (folder / "portrait/field.npz").is_file()
    for stage in head["stages"]:
        answer = page.ask("GET", stage["picture"])
        picture = Image.open(io.BytesIO(answer.content))
        assert picture.format == "JPEG" and min(picture.size) >= 300
    has = page.get(f"/api/projects/{project}")["has"]
    assert has == {"photos": True, "checked": False, "capture": True, "field": True,
                   "styled": False}


def test_photos_are_judged_and_placed(page, project, head):
    before = page.get(f"/api/projects/{project}/photos")
    assert not before["checked"] and {one["grade"] for one in before["photos"]} == {"none"}
    job = page.wait(page.do("POST", f"/api/projects/{project}/check")["id"])
    assert job["state"] == "done", job
    sheet = page.get(f"/api/projects/{project}/photos")
    assert sheet["checked"] and sheet["arc"]["placed"] and len(sheet["photos"]) == 16
    assert all(one["placed"] and one["sharpness"] > 0 for one in sheet["photos"])
    yaws = sorted(one["placed"]["yaw"] for one in sheet["photos"] if one["grade"] != "red")
    assert sheet["arc"]["reach"] == [yaws[0], yaws[-1]]
    photo = sheet["photos"][0]
    path = f"/api/projects/{project}/photos/{photo['id']}"
    assert page.error("PATCH", path, {"left_out": True}) == "exists", "it has a camera"


def shown(answer):
    assert answer.status_code == 200, answer.text
    return np.asarray(Image.open(io.BytesIO(answer.content)), np.float32)


@pytest.fixture(scope="module")
def negative(page, project, style):
    """The same painting in the opposite colors, of the user's own: for all sitters."""
    folder = page.desk.projects.get(project).folder
    buffer = io.BytesIO()
    Image.fromarray(255 - read_image(folder / "paintings/Ken.png")).save(buffer, "PNG")
    found = page.do("PUT", "/api/styles?name=Negative.png", buffer.getvalue())
    assert found["kind"] == "mine"
    page.do("PUT", f"/api/styles/{found['id']}/landmarks", {"points": read_landmarks(
        folder / "paintings/Ken.landmarks.txt").tolist()})
    return found["id"]


def test_a_job_that_makes_the_head_finds_the_painting_that_is_chosen(page, project, style):
    def found():
        return page.desk.projects.get(project).settings().get("painting")

    page.do("PATCH", f"/api/projects/{project}", {"style": style})
    assert found().endswith("paintings/Ken.png")
    page.do("PATCH", f"/api/projects/{project}", {"style": None})
    assert found() is None


def test_previews_follow_landmarks_mixes_and_cameras(page, project, head, style, negative):
    path = f"/api/projects/{project}/preview"

    def picture(**data):
        return shown(page.ask("POST", path, {"style": style, "size": 96, **data}))

    plain = picture()
    assert plain.shape == (96, 96, 3) and plain.std() > 10
    assert np.array_equal(plain, picture()), "the same again"
    kept = page.get(f"/api/styles?project={project}")["styles"]
    preview = next(one["preview"] for one in kept if one["id"] == style)
    assert np.array_equal(shown(page.ask("GET", preview)), plain)
    assert picture(cameras=[{"yaw": -40}, {"yaw": 40, "zoom": 2}]).shape == (96, 192, 3)
    photo = shown(page.ask("POST", path, {"style": None, "size": 96}))
    half, none = picture(mix={"strength": 0.5}), picture(mix={"strength": 0.0})
    # A mix lies between photo and painting.
    assert np.abs(none - plain).mean() > 1.8 * np.abs(half - none).mean() > 1
    assert np.abs(none - photo).mean() < np.abs(none - plain).mean() / 2
    mixed = picture(mix={"regions": {"skin": {"style": negative, "strength": 1.0}}})
    assert np.abs(mixed - plain).mean() > 1, "another painting on the skin alone"
    points = read_landmarks(page.desk.projects.get(project).folder
                            / "paintings/Ken.landmarks.txt")
    moved = picture(landmarks=(points + np.array([12.0, 0.0])).tolist())
    assert np.abs(moved - plain).mean() > 0.5, "landmarks that are not saved are shown"
    assert np.array_equal(picture(landmarks=points.tolist()), plain)
    for wrong in ({"size": 1e9}, {"mix": {"strength": 2}}, {"mix": {"regions": {"evil": 1}}},
                  {"mix": {"regions": {"hair": 9}}}, {"cameras": []}, {"landmarks": [[0, 0]]},
                  {"landmarks": [[float("inf"), 0]] * 68}):
        assert page.ask("POST", path, {"style": style, **wrong}).status_code == 400, wrong
    assert page.error("POST", path, {"style": "own-nobody"}) == "not_found"


@pytest.mark.slow  # `tests/job/test_session.py` tries landmarks, tests/runner ends processes
def test_previews_after_the_same_moves_are_those_of_a_fresh_process(page, project, head, style):
    """A process that is lost comes back, and says the same.

    What was found in the painting for the first landmarks serves for those close by.
    """
    path = f"/api/projects/{project}/preview"
    points = read_landmarks(page.desk.projects.get(project).folder
                            / "paintings/Ken.landmarks.txt")

    def moved(number, by):
        there = points.copy()
        there[number] += by
        answer = page.ask("POST", path, {"style": style, "size": 96, "slot": "editor",
                                         "landmarks": there.tolist()})
        return answer.status_code, answer.content

    def in_a_fresh_process():
        os.kill(page.desk.previews.process, 9)
        assert moved(30, 8.0)[0] in (200, 503)  # it may find the process gone
        return [moved(number, by) for number, by in ((30, 8.0), (48, -5.0), (30, 3.0))]

    assert moved(8, 9.0)[0] == 200
    kept = in_a_fresh_process()
    assert {status for status, _ in kept} == {200} and len({data for _, data in kept}) == 3
    assert in_a_fresh_process() == kept
    assert page.ask("POST", path, {"style": None, "size": 64}).status_code == 200


def test_a_fine_version_has_the_bytes_of_make(page, project, head, style):
    versions = f"/api/projects/{project}/versions"
    first = page.do("POST", versions, {"name": "First: try", "style": style})
    half = page.do("POST", versions, {"name": "Half", "style": style, "mix": {"strength": 0.5}})
    assert not first["fine"] and first["name"] == "First: try"
    before = page.desk.events.number
    assert shown(page.ask("GET", first["thumbnail"])).shape == (320, 320, 3)
    assert any("event: project\n" in line for line in page.desk.events.after(before)), (
        "it is the sitter's picture, too")
    job = page.wait(page.do("POST", f"{versions}/{first['id']}/fine")["id"])
    assert job["state"] == "done", job
    # The same by `make`, which goes on from the studio's head.
    folder = page.desk.projects.get(project).folder
    panel = page.desk.displays.of(page.desk.projects.get(project)).source
    run = make(folder / "photos", folder / "paintings/Ken.png", folder / "portrait", panel, SMALL,
               offline=True, first_look=False)
    assert run["resumed"] == ["capture", "reconstruct"]
    target = folder / "versions/First- try"
    for name in ("styled.npz", "lightfield.png", "portrait.html", "sweep.mp4"):
        assert digest(target / name) == digest(folder / "portrait" / name), name
    # An export of it, too, whose file is only ever saved.
    export = page.do("POST", f"/api/projects/{project}/exports", {
        "kind": "coded", "version": first["id"], "name": "Anna"})
    assert page.wait(export["id"])["state"] == "done"
    (entry,) = wait_for(lambda: page.get(f"/api/projects/{project}/exports")["exports"])
    answer = page.ask("GET", entry["file"])
    assert answer.content == (folder / "portrait/lightfield.png").read_bytes()
    assert answer.headers["content-type"] == "application/octet-stream"
    assert answer.headers["content-disposition"].startswith("attachment")
    assert entry["fine"] and entry["name"] == "Anna.png"
    # Another mix of the same painting does not paint again.
    job = page.wait(page.do("POST", f"{versions}/{half['id']}/fine")["id"])
    assert [one["state"] for one in job["stages"]] == ["skipped", "done", "done"]
    states = wait_for(lambda: {one["id"]: one["fine"] for one in page.get(versions)["versions"]
                               } if page.get(versions)["versions"][2]["fine"] else None)
    assert states == {"portrait": True, first["id"]: True, half["id"]: True}
    assert digest(folder / "versions/Half/lightfield.png") != digest(target / "lightfield.png")
    # A study of both has the photo that it asks about.
    study = shlex.split(page.do("POST", "/api/study", {"versions": [
        [project, first["id"]], [project, half["id"]]]})["command"])
    end = study.index("--out")
    for one in entries_of(study[2:end], [Path(study[study.index("--pictures") + 1])]):
        assert one.photo is not None and one.photo.std() > 10
    changed = page.do("PATCH", f"{versions}/{half['id']}", {"mix": {"strength": 0.6}})
    assert not changed["fine"]
    assert read_json(target / "run.json")["style"] == "Ken"


def wait_for(ask):
    """What is noted a moment after a job has ended."""
    until = time.monotonic() + 60
    while not (found := ask()) and time.monotonic() < until:
        time.sleep(0.02)
    return found


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.slow  # test_jobs.py has the queue, with work that takes no time
def test_a_file_waits_for_the_fine_version_that_it_is_of(page, project, head, style):
    versions, files = (f"/api/projects/{project}/{name}" for name in ("versions", "exports"))
    version = page.do("POST", versions, {"name": "Later", "style": style,
                                         "mix": {"strength": 0.7}})["id"]
    order = {"kind": "coded", "version": version, "name": "later", "fine": True}
    # Its fine version is not finished: no preview is taken for it.
    asked = page.do("POST", files, order)
    export = asked["id"]
    assert asked["title"] == "later.png" and asked["quality"] == "fine"
    assert page.get(f"/api/jobs/{export}")["state"] == "waiting"
    fine = next(one for one in page.get("/api/jobs")["jobs"]
                if one["kind"] == "fine" and one["version"] == version)["id"]
    page.do("POST", f"/api/jobs/{fine}/cancel")
    assert page.wait(export)["error"]["code"] == "not_ready"
    # It goes on with a fine version, for which another file waits, too.
    again = page.do("POST", f"/api/jobs/{export}/resume")
    assert again["state"] == "waiting" and again["after"] not in (None, fine)
    page.do("POST", f"/api/jobs/{export}/cancel")
    asked = page.do("POST", f"{versions}/{version}/fine")
    fine = asked["id"]
    assert asked["title"] == "Later" and again["after"] == fine
    for export in [page.do("POST", files, order)["id"] for _ in range(2)]:
        assert page.wait(export)["state"] == "done"
    assert page.get(f"/api/jobs/{fine}")["state"] == "done"
    folder = page.desk.projects.get(project).folder
    names = {"later.png", "later-2.png"}

    def there():
        found = {one["name"]: one for one in page.get(files)["exports"]}
        return found if names <= set(found) else None

    made = wait_for(there)
    for name in names:
        assert made[name]["fine"]
        assert digest(Path(made[name]["path"])) == digest(folder / "versions/Later/lightfield.png")


def test_the_viewer_runs_nothing_but_its_own_script(page, project, head, style):
    path = f"/api/projects/{project}/viewer"
    found = page.do("POST", path, {"style": style, "mix": {"identity": 0.5}})
    assert found["styles"] == ["Ken"] and "hair" in found["regions"] and not found["fine"]
    answer = page.ask("GET", found["page"])
    policy = answer.headers["content-security-policy"]
    script = re.search(r"<script>(.*?)</script>", answer.text, re.DOTALL)[1]
    import base64

    name = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"script-src 'sha256-{name}';" in policy and "frame-ancestors 'self'" in policy
    assert "unsafe-inline" not in policy.partition("style-src")[0]
    for wrong in ("x.html", "0" * 32 + ".html", "0" * 32, "..%2fstudio.json"):
        assert page.ask("GET", f"/view/{project}/{wrong}").status_code == 404


def test_depth_eye_and_patterns(page, project, head, style):
    version = page.do("POST", f"/api/projects/{project}/versions", {
        "name": "Shown", "style": style})["id"]
    found = page.do("POST", f"/api/projects/{project}/budget", {"version": version})
    assert found["sharp"][0] < 0 < found["sharp"][1] and found["lines"]
    far = page.do("POST", f"/api/projects/{project}/budget", {
        "version": version, "placement": {"focus": 0.2}})
    assert far["placement"]["focus"] == pytest.approx(found["placement"]["focus"] + 0.2)
    path = f"/api/projects/{project}/eye"
    left, right = (shown(page.ask("POST", path, {"version": version, "eye": [x, 0],
                                                 "width": 128})) for x in (-0.5, 0.5))
    assert left.shape == (96, 128, 3) and np.abs(left - right).mean() > 0.5
    # A preview has its painted ground on a panel, as a fine version has.
    black, painted = (shown(page.ask("POST", path, {
        "version": version, "width": 128, "placement": {"ground": ground, "size": 0.5}}))
        for ground in ("black", "painted"))
    for corner in (np.s_[:12, :12], np.s_[:12, -12:]):
        assert black[corner].max() < 12 and painted[corner].max(axis=-1).min() > 60
    coded = page.do("POST", f"/api/projects/{project}/full", {"version": version})["picture"]
    assert shown(page.ask("GET", coded)).shape == (96, 128, 3)
    display = page.get("/api/projects/" + project)["display"]
    for kind in ("views", "slant", "fringe", "depth"):
        picture = page.ask("GET", f"/api/displays/{display}/pattern?kind={kind}")
        assert shown(picture).shape == (96, 128, 3)
    for wrong in ({"placement": {"size": -1}}, {"placement": {"evil": 1}}, {"eye": [1e9, 0]},
                  {"display": "../tiny"}):
        assert page.ask("POST", path, {"version": version, **wrong}).status_code in (400, 404)


def test_a_preview_stands_before_the_ground_that_a_fine_version_has(page, project, head, style):
    version = page.do("POST", f"/api/projects/{project}/versions", {
        "name": "Before a ground", "style": style})["id"]

    def corners(placement):
        seen = shown(page.ask("POST", f"/api/projects/{project}/eye", {
            "version": version, "placement": placement, "width": 128}))
        return float(seen[:8, [*range(8), *range(-8, 0)]].mean())

    black = corners({"ground": "black"})
    assert black < 3 and corners({}) > black + 20 and corners({"ground": "white"}) > black + 20
    file = page.desk.projects.get(project).folder / "exports" / "ground.png"
    job = page.do("POST", f"/api/projects/{project}/exports", {
        "kind": "coded", "version": version, "name": "ground"})["id"]
    assert page.wait(job)["state"] == "done"
    assert read_image(file)[:8, :8].mean() > black + 20


def test_regions_are_found_painted_over_and_forgotten(page, project, head, style):
    path = f"/api/styles/{style}/regions?project={project}"
    found = page.get(path)
    assert not found["painted"] and found["labels"][0] == "auto"
    seen = Image.open(io.BytesIO(page.ask("GET", found["found"]).content))
    assert seen.size == (found["width"], found["height"]) == (120, 160)
    values = np.zeros((160, 120), np.uint8)
    values[:40] = found["labels"].index("hair")
    buffer = io.BytesIO()
    Image.fromarray(values).save(buffer, "PNG")
    assert page.do("PUT", path, buffer.getvalue())["painted"]
    kept = page.desk.projects.get(project).folder / "paintings/Ken.regions.png"
    assert np.array_equal(read_image(kept)[..., 0], values)
    assert page.error("PUT", path, b"no picture") == "bad_request"
    small = io.BytesIO()
    Image.fromarray(values[:10]).save(small, "PNG")
    assert page.error("PUT", path, small.getvalue()) == "bad_request"
    assert not page.do("DELETE", path)["painted"] and not kept.exists()


def test_a_style_is_copied_into_the_project(page, project, negative):
    style = f"/api/styles/{negative}/landmarks?project={project}"
    found = page.get(style)
    assert len(found["points"]) == 68 and found["mirror"][36] == 45
    built_in = f"/api/styles/builtin-charcoal/landmarks?project={project}"
    assert page.error("PUT", built_in, {"points": found["points"]}) == "exists"
    fresh = page.do("POST", f"/api/styles/{negative}/copy?project={project}")
    assert fresh["kind"] == "project" and fresh["landmarks"] == "file"
    copied = page.get(f"/api/styles/{fresh['id']}/landmarks?project={project}")
    assert np.abs(np.subtract(copied["points"], found["points"])).max() < 0.01
    renamed = page.do("PATCH", f"/api/styles/{fresh['id']}?project={project}", {"name": "New"})
    assert renamed["name"] == "New" and renamed["landmarks"] == "file"
    page.do("DELETE", f"/api/styles/{renamed['id']}?project={project}")
    names = [one["name"] for one in page.get(f"/api/styles?project={project}")["styles"]]
    assert "New" not in names and "Negative" in names


def test_a_selection_becomes_a_batch_and_a_study(page, project, head, style):
    from lfportrait.job.batch import load_jobs

    found = page.do("POST", "/api/batch", {"projects": [project], "styles": [
        style, "builtin-charcoal"], "displays": ["generic-4k"]})
    jobs = load_jobs(Path(found["file"]))
    assert list(jobs.sitters) == ["Anna"] and list(jobs.styles) == ["Ken", "charcoal"]
    assert list(jobs.panels) == ["generic-4k"] and found["command"].startswith("lfportrait batch")
    assert page.error("POST", "/api/batch", {"projects": [project]}) == "bad_request"
    assert page.error("POST", "/api/study", {"versions": [[project, "portrait"]]}) == "bad_request"
