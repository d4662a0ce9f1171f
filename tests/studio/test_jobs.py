"""The queue: one heavy job after the other, paused, cancelled, killed, gone on with."""

import json
import os
import time
from pathlib import Path

import pytest

from lfportrait.files import atomic_path
from lfportrait.runner import processes
from lfportrait.studio import desk, jobs
from lfportrait.studio.exports import forget_unfinished
from lfportrait.studio.jobs import Jobs, JobState, StageState
from lfportrait.studio.routes import start
from lfportrait.temporary import part_name

from .conftest import jpeg, opened


@pytest.fixture(autouse=True)
def slow_work(monkeypatch):
    monkeypatch.setattr(Jobs, "ENTRY", "tests.studio.slow_work:serve")


def sitter(page, name, *marks):
    """A project with photos, whose jobs do what the marks say."""
    project = page.do("POST", "/api/projects", {"name": name})["id"]
    folder = page.desk.projects.get(project).folder
    for number in range(3):
        (folder / "photos" / f"{number}.jpg").write_bytes(jpeg(number))
    for mark in marks:
        (folder / mark).touch()
    return project, folder


def head(page, project):
    return page.do("POST", "/api/jobs", {"kind": "head", "project": project})["id"]


def pids(folder):
    """Numbers of a job's process and of the one that it has started."""
    until = time.monotonic() + 60
    while time.monotonic() < until:
        if (folder / "steps.txt").exists():
            return [int(word) for word in (folder / "pids.txt").read_text().split()]
        time.sleep(0.02)
    raise AssertionError("the job's process did not begin")


def under_way(page, job):
    """Wait until the server has heard of a job's first steps: its process has gone on by then."""
    until = time.monotonic() + 60
    while not page.get(f"/api/jobs/{job}")["progress"]:
        assert time.monotonic() < until, "nothing was heard of the job"
        time.sleep(0.02)


def alive(pid):
    """Whether a process runs: not ended, and not ended without having been waited for."""
    try:
        with open(f"/proc/{pid}/stat") as stream:
            return stream.read().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def stopped(pid):
    """Whether a process stands still; where nothing tells, it is taken to."""
    if not os.path.exists("/proc/self/stat"):
        return True
    with open(f"/proc/{pid}/stat") as stream:
        return stream.read().rpartition(")")[2].split()[0] == "T"


def gone(*numbers):
    until = time.monotonic() + 60
    while any(map(alive, numbers)) and time.monotonic() < until:
        time.sleep(0.02)
    return not any(map(alive, numbers))


def test_a_job_goes_through_its_stages(page):
    project, folder = sitter(page, "Anna")
    job = page.wait(head(page, project))
    assert job["state"] == "done" and job["result"] == {"kind": "head"} and job["error"] is None
    assert [one["state"] for one in job["stages"]] == ["done", "skipped"]
    assert job["notes"] == ["a warning"] and job["progress"] == 1.0
    assert page.ask("GET", job["stages"][0]["picture"]).content == b"\xff\xd8"
    turning = page.ask("GET", job["stages"][0]["page"])
    assert "a head" in turning.text and "script-src 'sha256-" in (
        turning.headers["content-security-policy"])
    assert job["stages"][1]["page"] is None
    assert job["stages"][1]["picture"] is None
    assert gone(*map(int, (folder / "pids.txt").read_text().split()))
    assert page.get("/api/state")["jobs"] == [job]
    page.do("DELETE", f"/api/jobs/{job['id']}")
    assert page.get("/api/jobs")["jobs"] == []
    assert not list((page.desk.projects.own / "jobs").glob("j-*"))


def test_what_is_missing_is_said_before_a_job_is_made(page):
    project = page.do("POST", "/api/projects", {"name": "Anna"})["id"]
    answer = page.ask("POST", "/api/jobs", {"kind": "head", "project": project})
    assert answer.status_code == 409 and answer.json()["error"]["about"] == {"needs": "photos"}
    for data in ({"kind": "export", "project": project}, {"kind": "head", "project": "bob"},
                 {"kind": "head"}, {"project": project},
                 {"kind": "head", "project": project, "options": {"evil": 1}}):
        assert page.ask("POST", "/api/jobs", data).status_code in (400, 404)
    assert page.get("/api/jobs")["jobs"] == []


def test_sitters_queue_and_one_can_be_cancelled(page):
    sitters = [sitter(page, name, "wait") for name in ("Anna", "Bob", "Carl", "Dora")]
    jobs = [head(page, project) for project, _ in sitters]
    assert page.error("POST", "/api/jobs", {"kind": "head", "project": sitters[1][0]}) == "busy"
    numbers = pids(sitters[0][1])
    under_way(page, jobs[0])  # else what is told of its begin comes in between below
    states = {job["id"]: (job["state"], job["place"]) for job in page.get("/api/jobs")["jobs"]}
    assert [states[job] for job in jobs] == [("running", 0), ("waiting", 0), ("waiting", 1),
                                             ("waiting", 2)]
    order = page.do("POST", f"/api/jobs/{jobs[3]}/move", {"place": 0})["jobs"]
    assert [job["id"] for job in order] == [jobs[0], jobs[3], jobs[1], jobs[2]]
    before = page.desk.events.number
    assert page.do("POST", f"/api/jobs/{jobs[1]}/cancel")["state"] == "cancelled"
    told = [json.loads(line.split("data: ")[1]) for line in page.desk.events.after(before)
            if "event: job\n" in line]
    assert [(job["id"], job["place"]) for job in told] == [(jobs[1], 0), (jobs[2], 1)], "moved up"
    assert page.do("POST", f"/api/jobs/{jobs[0]}/cancel")["state"] == "cancelled"
    assert gone(*numbers), "its children end with it"
    others = pids(sitters[3][1])
    assert page.get(f"/api/jobs/{jobs[3]}")["state"] == "running"
    assert not (sitters[1][1] / "pids.txt").exists()
    for _, folder in sitters:
        (folder / "wait").unlink()
    assert page.wait(jobs[3])["state"] == page.wait(jobs[2])["state"] == "done"
    assert gone(*others)
    again = page.do("POST", f"/api/jobs/{jobs[0]}/resume")
    assert again["state"] in ("waiting", "running") and page.wait(jobs[0])["state"] == "done"


def test_a_stage_that_takes_longer_makes_those_that_wait_longer_too():
    stages = [StageState("capture", "running", need=30, begun=time.time() - 15),
              StageState("reconstruct", need=60), StageState("surface", need=10)]
    job = JobState("j-1", "head", state="running", stages=stages)
    assert job.left() == pytest.approx(85, abs=1) and job.progress() == pytest.approx(.15, abs=.01)
    stages[0].begun -= 285  # ten times as long as it should
    assert job.left() == pytest.approx(700, abs=9), "the others will be as slow"
    assert job.progress() == pytest.approx(.3, abs=.01), "nearly done it is not"
    stages[0].state, stages[0].seconds = "done", 15.0
    assert job.left() == pytest.approx(70, abs=1), "a quick stage promises nothing"


@pytest.mark.slow  # who may pause: below
@pytest.mark.skipif(not hasattr(os, "killpg"), reason="this system can't pause processes")
def test_a_paused_job_stands_still_and_goes_on(page):
    project, folder = sitter(page, "Anna", "wait")
    other, _ = sitter(page, "Bob")
    job, waits = head(page, project), head(page, other)
    numbers = pids(folder)
    under_way(page, job)
    assert page.do("POST", f"/api/jobs/{job}/pause")["state"] == "paused"
    until = time.monotonic() + 60
    while not all(map(stopped, numbers)) and time.monotonic() < until:
        time.sleep(0.02)
    before = (folder / "steps.txt").read_text()
    time.sleep(0.2)
    assert all(map(stopped, numbers)) and (folder / "steps.txt").read_text() == before
    # What it said before is heard to its end; then nothing changes any more.
    shown = [("nothing", "yet"), None]
    while shown[0] != shown[1] and time.monotonic() < until:
        time.sleep(0.2)
        found = page.get(f"/api/jobs/{job}")
        shown = [(found["progress"], found["left"]), shown[0]]
    assert shown[0] == shown[1] and shown[0][0] > 0
    assert page.get(f"/api/jobs/{waits}")["state"] == "waiting"
    assert page.error("POST", f"/api/jobs/{job}/pause") == "busy"
    assert page.do("POST", f"/api/jobs/{job}/resume")["state"] == "running"
    (folder / "wait").unlink()
    assert page.wait(job)["state"] == page.wait(waits)["state"] == "done"
    # A job that is paused ends with the rest, too.
    (folder / "wait").touch()
    (folder / "steps.txt").unlink()
    job = head(page, project)
    numbers = pids(folder)
    page.do("POST", f"/api/jobs/{job}/pause")
    page.do("POST", f"/api/jobs/{job}/cancel")
    assert gone(*numbers)


@pytest.mark.parametrize("how", ["fail", *(
    pytest.param(how, marks=pytest.mark.slow) for how in ("die", "kill", "full"))])
def test_a_job_that_fails_says_why_and_can_go_on(page, how):
    project, folder = sitter(page, "Anna", *(["wait"] if how == "kill" else [how]))
    job = head(page, project)
    if how == "kill":
        os.kill(pids(folder)[0], 9)
    found = page.wait(job)
    assert found["state"] == "failed"
    code = {"die": "killed", "kill": "killed", "fail": "user_error", "full": "disk_full"}[how]
    assert found["error"]["code"] == code and found["error"]["message"]
    assert found["stages"][0]["state"] == "failed" and found["left"] is None
    assert gone(*map(int, (folder / "pids.txt").read_text().split()))
    (folder / "wait").unlink(missing_ok=True)
    page.do("POST", f"/api/jobs/{job}/resume")
    found = page.wait(job)
    assert found["state"] == "done" and found["error"] is None


@pytest.mark.slow  # jobs that go on: above
def test_a_server_that_is_started_again_goes_on(page, tmp_path):
    folder = tmp_path / "other"
    first = opened(folder)
    other = next(first)
    sitters = [sitter(other, name, "wait") for name in ("Anna", "Bob")]
    jobs = [head(other, project) for project, _ in sitters]
    numbers = pids(sitters[0][1])
    with pytest.raises(StopIteration):
        next(first)
    assert gone(*numbers), "no process stays behind"
    (sitters[0][1] / "steps.txt").unlink()
    second = opened(folder)  # it closes when nobody holds it
    again = next(second)
    assert gone(*numbers) and pids(sitters[0][1]) != numbers
    states = [job["state"] for job in again.get("/api/jobs")["jobs"]]
    assert states == ["running", "waiting"]
    for _, place in sitters:
        (place / "wait").unlink()
    assert all(again.wait(job)["state"] == "done" for job in jobs)


def test_photos_are_checked_by_themselves(page, monkeypatch):
    project = page.do("POST", "/api/projects", {"name": "Anna"})["id"]
    for number in range(3):
        # Only after the last one there is a pause, however slow this machine is.
        monkeypatch.setattr(desk, "_QUIET", 0.1 if number == 2 else 600.0)
        page.send(project, f"{number}.jpg", jpeg(number))
    until = time.monotonic() + 60
    while not (jobs := page.get("/api/jobs")["jobs"]) and time.monotonic() < until:
        time.sleep(0.05)
    assert [job["kind"] for job in jobs] == ["check"]
    assert page.wait(jobs[0]["id"])["state"] == "done"


def test_a_project_with_a_job_is_not_removed(page):
    project, folder = sitter(page, "Anna", "wait")
    job = head(page, project)
    pids(folder)
    path = f"/api/projects/{project}"
    assert page.error("DELETE", path, {"confirm": "Bob"}) == "bad_request"
    assert page.error("DELETE", path, {"confirm": "Anna"}) == "busy"
    page.do("POST", f"/api/jobs/{job}/cancel")
    page.do("DELETE", path, {"confirm": "Anna"})
    assert page.get("/api/projects") == {"projects": []} and page.get("/api/jobs") == {"jobs": []}
    assert (page.desk.projects.folder / ".trash/Anna/photos/0.jpg").is_file()
    assert page.error("POST", "/api/jobs", {"kind": "head", "project": project}) == "not_found"


def version_of(page):
    """A sitter with a head, a version of it, and the files that a fine one has."""
    project, folder = sitter(page, "Anna", "wait")
    own = page.desk.projects.get(project)
    (own.job / "capture").mkdir(parents=True)
    for name in ("field.npz", "capture/transforms.json"):
        (own.job / name).write_bytes(b"")
    version = page.do("POST", f"/api/projects/{project}/versions", {
        "name": "First", "style": "builtin-charcoal"})["id"]
    for name in ("styled.npz", "lightfield.png"):
        (folder / "versions/First" / name).write_bytes(b"")
    return project, folder, version


def exported(page, project, version, **more):
    return page.do("POST", f"/api/projects/{project}/exports", {
        "kind": "field", "version": version, "name": "out", **more})


@pytest.mark.slow  # an export: below
def test_an_export_waits_for_its_fine_version(page):
    project, folder, version = version_of(page)
    export = exported(page, project, version, fine=True)
    assert export["quality"] == "fine" and export["state"] == "waiting"
    (fine,) = (one for one in page.get("/api/jobs")["jobs"] if one["kind"] == "fine")
    assert export["after"] == fine["id"]
    pids(folder)
    assert page.get(f"/api/jobs/{export['id']}")["state"] == "waiting"
    (folder / "wait").unlink()
    assert page.wait(fine["id"])["state"] == page.wait(export["id"])["state"] == "done"
    (entry,) = page.get(f"/api/projects/{project}/exports")["exports"]
    assert entry["quality"] == "fine" and entry["fine"]
    assert page.ask("GET", entry["file"]).content == b"styled"
    # What is fine already does not wait.
    again = exported(page, project, version, fine=True)
    assert again["after"] is None and page.wait(again["id"])["state"] == "done"


def test_an_export_says_that_it_is_a_preview(page):
    project, folder, version = version_of(page)
    fine = page.do("POST", f"/api/projects/{project}/versions/{version}/fine")
    pids(folder)
    export = exported(page, project, version)
    assert export["quality"] == "preview" and export["after"] is None
    page.wait(export["id"], "running")
    (folder / "wait").unlink()
    assert page.wait(export["id"])["state"] == page.wait(fine["id"])["state"] == "done"


@pytest.mark.slow  # one that says so: above
def test_an_export_does_not_take_a_preview_for_the_fine_version(page):
    project, folder, version = version_of(page)
    export = exported(page, project, version, fine=True)
    pids(folder)
    page.do("POST", f"/api/jobs/{export['after']}/cancel")
    found = page.wait(export["id"])
    assert found["state"] == "failed" and found["error"]["code"] == "not_ready"
    # It goes on when the version is fine, which is made first.
    again = page.do("POST", f"/api/jobs/{export['id']}/resume")
    assert again["state"] == "waiting" and again["after"] not in (None, export["after"])
    fine = page.get(f"/api/jobs/{again['after']}")
    assert fine["kind"] == "fine" and fine["version"] == version
    assert page.get(f"/api/jobs/{export['id']}")["state"] == "waiting"
    (folder / "wait").unlink()
    assert page.wait(export["id"])["state"] == "done"
    (entry,) = page.get(f"/api/projects/{project}/exports")["exports"]
    assert page.ask("GET", entry["file"]).content == b"styled"


@pytest.mark.slow  # one that waits: above
def test_a_cancelled_export_goes_on_with_its_fine_version(page):
    project, folder, version = version_of(page)
    export = exported(page, project, version, fine=True)
    pids(folder)
    for one in (export["id"], export["after"]):
        page.do("POST", f"/api/jobs/{one}/cancel")
    again = page.do("POST", f"/api/jobs/{export['id']}/resume")
    assert again["state"] == "waiting" and again["after"] not in (None, export["after"])
    (folder / "wait").unlink()
    assert page.wait(export["id"])["state"] == "done"


def test_a_full_disk_does_not_stop_the_queue(page, monkeypatch):
    from lfportrait.errors import UserError

    def full(*_):
        raise UserError("can't write: No space left on device")

    project, _ = sitter(page, "Anna")
    monkeypatch.setattr(jobs, "write_json", full)
    assert page.wait(head(page, project))["state"] == "done"


def test_pausing_is_offered_where_the_system_can(page, monkeypatch):
    assert page.get("/api/state")["features"]["pause"] == hasattr(os, "killpg")
    monkeypatch.setattr(processes, "CAN_PAUSE", False)
    monkeypatch.setattr(start, "CAN_PAUSE", False)
    assert page.get("/api/state")["features"]["pause"] is False
    project, folder = sitter(page, "Anna", "wait")
    job = head(page, project)
    pids(folder)
    page.wait(job, "running")
    answer = page.ask("POST", f"/api/jobs/{job}/pause")
    assert answer.status_code == 422 and "cancel the job" in answer.json()["error"]["message"]
    assert page.get(f"/api/jobs/{job}")["state"] == "running"
    (folder / "wait").unlink()
    assert page.wait(job)["state"] == "done"


def test_a_file_that_is_cancelled_leaves_nothing_behind(page):
    project, folder, version = version_of(page)
    export = exported(page, project, version, name="a")
    page.wait(export["id"], "running")
    target = folder / "exports" / export["title"]
    # What is there when a process is killed in the middle; another file is being written, too.
    writing = [atomic_path(target), atomic_path(target.with_name(f"a.b{target.suffix}"))]
    unfinished, other = (one.__enter__() for one in writing)
    page.do("POST", f"/api/jobs/{export['id']}/cancel")
    assert not unfinished.exists() and other.exists()


def test_a_fine_version_that_is_cancelled_leaves_no_half_of_a_file(page):
    project, folder, version = version_of(page)
    job = page.do("POST", f"/api/projects/{project}/versions/{version}/fine")["id"]
    page.wait(job, "running")
    (place,) = (path.parent for path in (folder / "versions").glob("*/version.json"))
    (place / ".stages").mkdir(exist_ok=True)
    writing = atomic_path(place / "sweep.mp4")
    unfinished = writing.__enter__()
    page.do("POST", f"/api/jobs/{job}/cancel")
    assert not unfinished.exists()
    assert (place / ".stages").is_dir() and (place / "version.json").is_file()


def test_what_a_person_has_put_beside_a_version_stays(page):
    project, folder, version = version_of(page)
    place = folder / "versions/First"
    # Names like those of half-written files.
    (place / ".sweep.original.mp4").write_bytes(b"mine")
    os.utime(place / ".sweep.original.mp4", (1e9, 1e9))
    job = page.do("POST", f"/api/projects/{project}/versions/{version}/fine")["id"]
    page.wait(job, "running")
    (place / ".sketches.original").mkdir()
    page.do("POST", f"/api/jobs/{job}/cancel")
    assert (place / ".sweep.original.mp4").is_file() and (place / ".sketches.original").is_dir()


def test_a_quilt_that_is_cancelled_leaves_nothing_behind(page):
    project, folder, version = version_of(page)
    export = exported(page, project, version, kind="quilt", name="a")
    page.wait(export["id"], "running")
    place = folder / "exports"
    # A quilt's name goes on with its layout, and its settings lie beside it.
    writing = [atomic_path(place / f"a_{name}") for name in (
        "qs8x6a0.75.png", "qs8x6a0.75.png.json", "qs.b.png")]
    *unfinished, other = (one.__enter__() for one in writing)
    page.do("POST", f"/api/jobs/{export['id']}/cancel")
    assert not any(one.exists() for one in unfinished) and other.exists()


def test_a_leftover_that_cannot_be_removed_stops_nothing(tmp_path, monkeypatch):
    target, remove, held = tmp_path / "a.png", Path.unlink, []
    for _ in range(2):
        part_name(target).write_bytes(b"half")

    def unlink(path, *given, **more):
        if not held:  # the first one is open in another program, on Windows
            held.append(path)
            raise PermissionError(13, "in use")
        remove(path, *given, **more)

    monkeypatch.setattr(Path, "unlink", unlink)
    forget_unfinished(target)
    assert list(tmp_path.iterdir()) == held
