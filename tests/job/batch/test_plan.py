"""The graph: work is shared, a change redoes what depends on it, and nothing more is wanted."""

import os
import shutil
import sys
import time
from collections import Counter

import pytest

from lfportrait import models
from lfportrait.errors import UserError
from lfportrait.files import tells_changes
from lfportrait.job.batch import load_jobs, prepare_batch
from lfportrait.job.batch.plan import Fingerprints, cores_of_a_task, draw_plan
from lfportrait.job.graph import STAGES, source_key


def planned(folder, text, name="changed.toml"):
    (folder / name).write_text(text)
    jobs = load_jobs(folder / name)
    return draw_plan(jobs, {style: (style, "points") for style in jobs.styles})


@pytest.fixture
def jobs_text(studio):
    return (studio / "jobs.toml").read_text()


def changed(before, after):
    """Names of the tasks whose keys are not the same."""
    return {name for name, task in after.tasks.items()
            if name not in before.tasks or before.tasks[name].key != task.key}


def test_one_capture_field_and_skin_serve_all_styles(studio, jobs_text):
    plan = planned(studio, jobs_text)
    assert Counter(task.stage for task in plan.tasks.values()) == {
        "capture": 2, "field": 2, "skin": 2, "stylize": 4, "encode": 8, "page": 4}
    seen = set()
    for task in plan.tasks.values():
        assert set(task.needs) <= seen, "a task comes after those that it needs"
        seen.add(task.name)
    assert {task.stage for task in plan.wanted()} == {"encode", "page"}
    before = {"anna/ken/page", "anna/ken/styled", "anna/skin-48", "anna/field", "anna/capture"}
    every = {task.name for task in plan.wanted()} - {"anna/ken/page"}
    assert {task.name for task in plan.to_do(every)} == before


@pytest.mark.parametrize("old, new, stages", [
    ('steps = 1', 'steps = 2', {"stylize", "encode", "page"}),
    ('encode.size = 0.6', 'encode.size = 0.7', {"encode"}),
    ('[defaults.reconstruct]', '[defaults.reconstruct]\nsh_degree = 1',
     set(STAGES) - {"capture", "sweep", "share"}),
    ('[defaults]', '[defaults]\npage.title = "She"', {"page"}),
    ('pixels = 48.0', 'pixels = 40.0', {"skin", "stylize", "encode", "page"})])
def test_a_change_redoes_what_depends_on_it(studio, jobs_text, old, new, stages):
    before, after = planned(studio, jobs_text), planned(studio, jobs_text.replace(old, new))
    assert {after.tasks[name].stage for name in changed(before, after)} == stages


def test_one_sitters_parameters_are_nobody_elses(studio, jobs_text):
    text = jobs_text.replace('photos = "sittings/*"', 'photos = "sittings/anna"\n'
                             'reconstruct.sh_degree = 1\n[[sitter]]\nphotos = "sittings/bert"')
    found = changed(planned(studio, jobs_text), planned(studio, text))
    assert found and all(name.startswith("anna/") for name in found)
    assert "anna/capture" not in found


def test_the_lattice_is_as_fine_as_the_finest_display_shows(studio, jobs_text):
    text = jobs_text.replace("resolutions = [16, 32]\nrays = [0.04, 0.08]\n", "")
    fine = text + '[[display]]\nname = "large"\npanel = "generic-8k"\n'
    before, after = planned(studio, text), planned(studio, fine)
    assert before.tasks["anna/field"].config.reconstruct.max_resolution == 256
    assert 256 < after.tasks["anna/field"].config.reconstruct.max_resolution < 512
    assert "anna/capture" not in changed(before, after)
    # A head that takes a third of the panel is shown by a third of its pixels.
    small = fine.replace('panel = "generic-8k"', 'panel = "generic-8k"\nencode.size = 0.25')
    assert planned(studio, small).tasks["anna/field"].key == before.tasks["anna/field"].key


def test_photos_that_change_redo_their_sitter(studio, jobs_text):
    jobs = load_jobs(studio / "jobs.toml")
    paintings = dict.fromkeys(jobs.styles, ("a", "b"))
    one, two = (draw_plan(jobs, paintings, lambda path, version=version:
                          version if path.name == "bert" else "same") for version in "12")
    assert {name.partition("/")[0] for name in changed(one, two)} == {"bert"}


def test_pages_and_sweeps_are_made_where_wanted(studio, jobs_text):
    text = jobs_text.replace("[defaults]", "[defaults]\npages = false\nsweeps = true")
    assert {task.stage for task in planned(studio, text).wanted()} == {"encode", "sweep"}


def test_methods_without_skin_need_none(studio, jobs_text):
    text = jobs_text.replace('painting = "chalk.png"',
                             'painting = "chalk.png"\nstylize.method = "arf"')
    plan = planned(studio, text)
    assert plan.tasks["anna/chalk/styled"].needs == ("anna/capture", "anna/field")
    assert "anna/skin-48" in plan.tasks["anna/ken/styled"].needs


def test_a_folder_without_photos_refuses_its_sitter_alone(studio, jobs_text, tmp_path):
    folder = shutil.copytree(studio, tmp_path / "studio")
    (folder / "sittings" / "cora").mkdir()
    (folder / "sittings" / "cora" / "notes.txt").write_text("no photo")
    plan = planned(folder, jobs_text)
    assert list(plan.refused) == ["cora"] and "no photos" in plan.refused["cora"]
    assert len(plan.tasks) == 22


def test_only_what_leads_to_something_missing_is_done(small, studio, tmp_path):
    copy = shutil.copytree(small[0], tmp_path / "results")
    found = prepare_batch(studio / "one.toml", copy)
    assert not found.plan.to_do(found.done)
    # What is only on the way may be thrown away.
    for name in ("field.npz", "skin-48.npz", "ken/styled.npz"):
        (copy / "anna" / name).unlink()
    found = prepare_batch(studio / "one.toml", copy)
    assert not found.plan.to_do(found.done)
    (copy / "anna/ken/desk.png").unlink()
    found = prepare_batch(studio / "one.toml", copy)
    assert [task.name for task in found.plan.to_do(found.done)] == [
        "anna/field", "anna/skin-48", "anna/ken/styled", "anna/ken/display-desk"]


@pytest.mark.slow  # of one sitter alone: above
def test_of_many_only_what_leads_to_something_missing_is_done(made, studio, tmp_path):
    copy = shutil.copytree(made[0], tmp_path / "results")
    for name in ("field.npz", "skin-48.npz", "ken/styled.npz", "ken/desk.png"):
        (copy / "anna" / name).unlink()
    found = prepare_batch(studio / "jobs.toml", copy)
    assert [task.name for task in found.plan.to_do(found.done)] == [
        "anna/field", "anna/skin-48", "anna/ken/styled", "anna/ken/display-desk"]


def test_heads_are_fitted_to_faces_where_the_file_does_not_say_otherwise(studio, jobs_text,
                                                                         tmp_path):
    folder = shutil.copytree(studio, tmp_path / "studio")

    def ways(text):
        (folder / "jobs.toml").write_text(text)
        found = prepare_batch(folder / "jobs.toml", tmp_path / "results", made_from="face")
        return {found.jobs.parameters(name).made_from for name in found.jobs.sitters}

    assert ways(jobs_text) == {"face"}
    assert ways(jobs_text.replace("[defaults]", '[defaults]\nfrom = "photos"')) == {"photos"}


def test_photos_are_read_once(tmp_path, monkeypatch):
    monkeypatch.setattr("lfportrait.files._SOON", -1)  # as if they had been here for long
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "one.jpg").write_bytes(b"one")
    read = []

    def compute(path):
        read.append(path)
        return source_key(path)

    prints = Fingerprints(tmp_path / "kept.json", compute)
    first = prints(tmp_path / "photos")
    prints.keep()
    again = Fingerprints(tmp_path / "kept.json", compute)
    assert again(tmp_path / "photos") == first and len(read) == 1
    (tmp_path / "photos" / "one.jpg").write_bytes(b"other")
    assert again(tmp_path / "photos") != first and len(read) == 2


def test_a_photo_whose_size_and_time_are_kept_is_another(tmp_path, monkeypatch):
    photo = tmp_path / "photos" / "one.jpg"
    photo.parent.mkdir()
    photo.write_bytes(b"one")
    times = photo.stat().st_atime_ns, photo.stat().st_mtime_ns
    prints = Fingerprints(tmp_path / "kept.json", source_key)
    just_now = prints(photo.parent)  # the next change may be within the clock's same step
    photo.write_bytes(b"two")
    os.utime(photo, ns=times)
    second = prints(photo.parent)
    assert second != just_now
    monkeypatch.setattr("lfportrait.files._SOON", -1)
    assert prints(photo.parent) == second
    time.sleep(0.05)
    photo.write_bytes(b"six")
    os.utime(photo, ns=times)
    assert prints(photo.parent) not in (just_now, second)


@pytest.mark.parametrize("changed", [1_600_000_000_000_000_000, 1_600_000_000_120_000_000])
def test_a_cards_times_tell_nothing(changed):
    assert not tells_changes((1, changed, changed, 1))
    assert tells_changes((1, changed, changed + 1, 1)) == (sys.platform != "win32")


@pytest.mark.parametrize("cores, each", [(1, 1), (2, 1), (4, 2), (64, 8)])
def test_few_sitters_get_more_cores_each(studio, jobs_text, cores, each):
    assert cores_of_a_task(planned(studio, jobs_text), cores) == each


def test_the_networks_of_a_method_are_asked_for_before_the_first_task(studio, jobs_text, tmp_path,
                                                                      monkeypatch):
    monkeypatch.delenv("LFPORTRAIT_MIRROR", raising=False)
    monkeypatch.setenv("LFPORTRAIT_MODELS", str(tmp_path))
    monkeypatch.setattr(models, "cache_folder", lambda: tmp_path)
    text = jobs_text.replace('painting = "chalk.png"',
                             'painting = "chalk.png"\nstylize.method = "stylized-nerf"')
    (studio / "rival.toml").write_text(text)
    with pytest.raises(UserError, match="wct_se_16x_relu4_1"):
        prepare_batch(studio / "rival.toml", tmp_path / "results", offline=True)
