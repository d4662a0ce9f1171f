"""The commands `batch` and `study` take what is written for them, whatever things are called."""

import shlex
from pathlib import Path

import pytest

from lfportrait.files import write_json
from lfportrait.job.batch import jobs_file, load_jobs
from lfportrait.studio import batches
from lfportrait.studio.versions import Versions
from lfportrait_eval.study.design import entries_of

from .conftest import jpeg

SMILE = "Mona's \"smile\""


@pytest.fixture
def sitters(page):
    """Two sitters with photos; two versions of each in a painting, and one that mixes more."""
    folder = page.desk.projects.folder
    (folder / "paintings").mkdir()
    for seed, name in enumerate((SMILE, "portrait", "ken")):
        (folder / "paintings" / f"{name}.jpg").write_bytes(jpeg(seed))
    for name in ("lee", "Mary O'Hara"):
        (folder / name / "photos").mkdir(parents=True)
        (folder / name / "photos/one.jpg").write_bytes(jpeg(7))
    return folder


def version(page, sitter: str, painting: str, name: str, mix: dict | None = None,
            fine: bool = False) -> list[str]:
    """A version that was made here: ids of its sitter and of itself."""
    project = next(one for one in page.desk.projects.all() if one.folder.name == sitter)
    style = next(one.id for one in page.desk.styles.all(project) if one.name == painting)
    made = page.do("POST", f"/api/projects/{project.id}/versions", {
        "name": name, "style": style, "mix": mix or {}})["id"]
    if fine:
        found = Versions(project).get(made)
        for file in ("styled.npz", "lightfield.png", "sweep.mp4"):
            (found.folder / file).write_bytes(b"made")
        write_json(found.folder / "version.json", {**found.data, "fine": found.wanted()})
    return [project.id, made]


def test_a_batch_paints_what_each_version_mixes(page, sitters):
    versions = [version(page, "lee", "ken", "Plain"),
                version(page, "lee", "ken", "Half: a/b", {"strength": 0.5, "keep": ["hair"]}),
                version(page, "Mary O'Hara", "ken", "Half too", {
                    "strength": 0.5, "keep": ["hair"]}),
                version(page, "Mary O'Hara", SMILE, "More", {"identity": 0.3, "strength": 0.8}),
                version(page, "lee", "portrait", "Taken")]
    found = page.do("POST", "/api/batch", {"versions": versions})
    jobs = load_jobs(Path(found["file"]))
    assert [*jobs.sitters] == ["lee", "Mary O'Hara"] and len(jobs.styles) == 4
    painted = {sitter: sorted(
        (Path(jobs.styles[name].painting).stem,
         config.stylize.strength, config.stylize.keep)
        for name in one.styles for config in [jobs.parameters(sitter, name)])
        for sitter, one in jobs.sitters.items()}
    assert painted == {
        "lee": [("ken", 0.5, ("hair",)), ("ken", 1.0, ()), ("portrait", 1.0, ())],
        "Mary O'Hara": [(SMILE, 0.8, ()), ("ken", 0.5, ("hair",))]}
    assert "ken at 50 percent but hair" in jobs.styles
    # What a batch can't do is said.
    (note,) = found["notes"]
    assert "More" in note and "identity" in note
    *_, file, option, out = shlex.split(found["command"])
    assert (file, option, out) == (found["file"], "--out", found["out"])
    assert all(one.source.is_dir() for one in jobs.sitters.values())


def test_no_entry_has_the_name_of_a_file_that_the_batch_writes():
    for name in (*jobs_file.TAKEN, "quilt_x"):
        free = batches._folder(name, [])
        assert free not in jobs_file.TAKEN and not free.startswith("quilt_")


def test_a_batch_begins_with_photos(page, sitters):
    one = version(page, "lee", "ken", "Plain")
    (sitters / "lee/photos/one.jpg").unlink()
    project = page.desk.projects.get(one[0])
    project.change(demo=True)
    assert page.error("POST", "/api/batch", {"versions": [one]}) == "not_ready"
    assert not list(sitters.glob("jobs*"))


def test_a_study_takes_what_can_be_compared(page, sitters):
    def fine(*about):
        return version(page, *about, fine=True)

    first, second = fine("lee", SMILE, "A: b"), fine("lee", SMILE, "A= b")
    alone, other = fine("lee", "ken", "Alone"), fine("Mary O'Hara", SMILE, "A: b")
    for wrong in ([first], [first, alone], [first, other], [first, second, alone]):
        answer = page.ask("POST", "/api/study", {"versions": wrong}).json()["error"]
        assert answer["code"] == "bad_request"
    assert "Alone of lee has nothing" in answer["message"] and not list(sitters.glob("study*"))
    last = fine("Mary O'Hara", SMILE, "C")
    found = page.do("POST", "/api/study", {"versions": [first, second, other, last]})
    words = shlex.split(found["command"])
    assert words[:2] == ["lfportrait", "study"]
    where = words.index("--out")
    pictures = words[words.index("--pictures") + 1:]
    entries = entries_of(words[2:where], [Path(one) for one in pictures])
    assert sorted((one.sitter, one.style, one.method) for one in entries) == [
        ("Mary O'Hara", SMILE, "A  b"), ("Mary O'Hara", SMILE, "C"),
        ("lee", SMILE, "A  b"), ("lee", SMILE, "A  b-2")]
    assert found["page"] == str(Path(words[where + 1]) / "index.html")
    assert Path(found["file"]).read_text() == found["text"]


@pytest.mark.parametrize("alike", [True, False])
def test_a_study_shows_one_painting_under_a_name(page, sitters, alike):
    pairs = []
    for number, sitter in enumerate(("lee", "Mary O'Hara")):
        (sitters / sitter / "paintings").mkdir()
        (sitters / sitter / "paintings/own.jpg").write_bytes(jpeg(20 if alike else 20 + number))
        pairs += [version(page, sitter, "own", name, fine=True) for name in ("A", "B")]
    answer = page.ask("POST", "/api/study", {"versions": pairs}).json()
    if not alike:
        assert answer["error"]["code"] == "bad_name" and not list(sitters.glob("study*"))
        return
    words = shlex.split(answer["command"])
    pictures = [Path(one) for one in words[words.index("--pictures") + 1:]]
    assert len(pictures) == 1 and len(entries_of(words[2:words.index("--out")], pictures)) == 4


def test_a_sitter_called_like_a_painting_keeps_her_photo_in_a_study(page, sitters):
    (sitters / "ken/photos").mkdir(parents=True)
    pairs = [version(page, "ken", "ken", name, fine=True) for name in ("A", "B")]
    project = next(one for one in page.desk.projects.all() if one.folder.name == "ken")
    for _, made in pairs:
        (Versions(project).get(made).folder / "photo.jpg").write_bytes(jpeg(30))
    words = shlex.split(page.do("POST", "/api/study", {"versions": pairs})["command"])
    where = words.index("--pictures")
    for one in entries_of(words[2:words.index("--out")], [Path(words[where + 1])]):
        assert one.style == "ken" and one.photo is not None
        assert one.photo.tobytes() != one.painting.tobytes()
