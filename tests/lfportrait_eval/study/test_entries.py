"""What is compared: videos, jobs, names; and what people do wrong with them."""

import numpy as np
import pytest

from lfportrait.capture import Camera, Capture
from lfportrait.cli import main
from lfportrait.errors import UserError
from lfportrait.files import read_json, write_image, write_json
from lfportrait.share import write_video
from lfportrait_eval.study import StudyConfig, entries_of, questions_of, write_study


def job(folder, key="a" * 32, method="skin", style="ink"):
    """The files of a finished job that a study reads."""
    write_json(folder / "run.json", {"style": style, "stylize": {"method": method}})
    write_json(folder / ".stages" / "capture.json", {"key": key})
    write_video(folder / "sweep.mp4", np.zeros((4, 16, 16, 3), np.uint8), 10)
    images = [np.full((24, 24, 3), shade, np.uint8) for shade in (10, 200, 30)]
    cameras = Camera.arc(np.array([-40.0, 2.0, 40.0]), distance=3.0, width=24, height=24,
                         focal=30.0)
    Capture(cameras, images, None, ["a.png", "b.png", "c.png"],
            np.zeros(3, bool)).save(folder / "capture")
    return folder


@pytest.fixture
def ink(tmp_path):
    write_image(tmp_path / "ink.png", np.full((30, 20, 3), 77, np.uint8))
    return tmp_path / "ink.png"


def test_videos_are_named_by_their_place(videos):
    found = entries_of([str(video) for video in videos])
    assert [(each.sitter, each.style, each.method) for each in found[:4]] == [
        ("anna", "ink", "arf"), ("anna", "ink", "paper"), ("anna", "ink", "skin"),
        ("anna", "oil", "arf")]
    assert found[0].painting[0, 0].tolist() == [60, 60, 60]
    assert found[0].photo[0, 0].tolist() == [90, 90, 90]


def test_jobs_tell_method_style_and_sitter(tmp_path, ink):
    jobs = [str(job(tmp_path / "1")), f"plain={job(tmp_path / '2')}",
            f"paper:Ben={job(tmp_path / '3', 'b' * 32)}", str(job(tmp_path / "4", "b" * 32))]
    with pytest.raises(UserError, match=r"--pictures ink\.png"):
        entries_of(jobs)
    found = entries_of(jobs, [ink])
    assert [(each.sitter, each.method) for each in found] == [
        ("Ben", "paper"), ("sitter 1", "plain"), ("sitter 1", "skin"), ("sitter 2", "skin")]
    assert found[1].photo.mean() == pytest.approx(200, abs=2)  # the frontal one
    assert found[1].painting[0, 0, 0] == 77


def test_a_built_in_style_needs_no_picture(tmp_path, monkeypatch):
    from lfportrait import example, plugins

    made = example.Exemplar(np.full((30, 20, 3), 5, np.uint8), np.zeros((68, 2)))
    monkeypatch.setattr(plugins, "provided_styles", lambda: {"ink": lambda: made})
    monkeypatch.setattr(example.Exemplar, "load", staticmethod(lambda style: made))
    found = entries_of([str(job(tmp_path / "1")), f"other={job(tmp_path / '2')}"])
    assert found[0].painting[0, 0, 0] == 5


@pytest.mark.parametrize("words, told", [
    (["nowhere"], "no folder or file nowhere"), (["x=nowhere"], "no folder or file nowhere"),
    (["{}"], "not a finished job"), (["{}/ink.png"], "neither a job's folder nor a video"),
    (["{}/torn.mp4", "x={}/torn.mp4"], "torn.mp4"),
    (["{}/one.mp4", "{}/one.mp4"], "say which is which"),
    (["{}/one.mp4", "x:somebody={}/one.mp4"], "nothing to compare"),
    (["a:b:c:d={}/one.mp4"], "METHOD:SITTER:STYLE=PATH"), ([], "name the portraits")])
def test_mistakes_are_told_in_one_line(tmp_path, ink, capsys, words, told):
    write_video(tmp_path / "one.mp4", np.zeros((4, 16, 16, 3), np.uint8), 10)
    write_image(tmp_path / "painting.png", np.zeros((8, 8, 3), np.uint8))
    (tmp_path / "torn.mp4").write_bytes(b"no video at all")
    assert main(["study", *(word.format(tmp_path) for word in words), "--quiet",
                 "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err.strip()
    assert told in error and len(error.splitlines()) == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("options, told", [
    ({"pairs_per_person": 99}, "pairs-per-person"), ({"repeats": 13}, "repeats"),
    ({"questions": "nowhere.txt"}, "nowhere.txt")])
def test_wrong_numbers(videos, tmp_path, options, told):
    with pytest.raises(UserError, match=told):
        write_study([str(video) for video in videos], tmp_path / "out", StudyConfig(**options))
    assert not (tmp_path / "out").exists()


def test_questions_of_ones_own(tmp_path):
    file = tmp_path / "questions.txt"
    file.write_text("# two\nwarm: Which is warmer?\n\ncold : Which is colder: left or right?\n")
    assert [(each.name, each.text) for each in questions_of(str(file))] == [
        ("warm", "Which is warmer?"), ("cold", "Which is colder: left or right?")]
    assert [each.name for each in questions_of("paper")] == ["style"]
    for text, told in (("no name", "line 1"), ("a: b\na: c", "already"), ("#", "no question")):
        file.write_text(text)
        with pytest.raises(UserError, match=told):
            questions_of(str(file))


def test_the_same_command_gives_the_same_files(videos, study, tmp_path):
    words = [str(video) for video in videos]
    title = read_json(study / "study.json")["title"]
    write_study(words, tmp_path / "again", StudyConfig(title=title))
    for name in ("index.html", "study.json"):
        assert (tmp_path / "again" / name).read_bytes() == (study / name).read_bytes()
    write_study(words, tmp_path / "again", StudyConfig(title=title))  # over itself: fine
    with pytest.raises(UserError, match="another study"):
        write_study(words, tmp_path / "again", StudyConfig(title="Other"))


def test_names_of_methods_are_not_in_names_of_files(videos, tmp_path):
    write_study([str(video) for video in videos], tmp_path / "out", StudyConfig(max_embedded=0))
    names = [path.name for path in (tmp_path / "out" / "media").iterdir()]
    assert len(names) == 12 and not any(method in "".join(names)
                                        for method in ("arf", "paper", "skin"))


def test_other_formats_are_coded_anew_and_unlike_videos_are_told(tmp_path):
    from PIL import Image

    place = tmp_path / "anna" / "ink"
    write_image(place / "painting.png", np.zeros((8, 8, 3), np.uint8))
    pictures = [Image.fromarray(np.full((16, 24, 3), 20 * k, np.uint8)) for k in range(5)]
    pictures[0].save(place / "gif.gif", save_all=True, append_images=pictures[1:], duration=100)
    write_video(place / "full.mp4", np.zeros((9, 16, 16, 3), np.uint8), 10, coding="444")
    with pytest.warns(UserWarning) as warned:
        write_study([str(place / "gif.gif"), str(place / "full.mp4")], tmp_path / "out",
                    StudyConfig(max_embedded=0))
    assert ["16x16, 24x16" in str(each.message) for each in warned] == [True, False]
    assert "0.5 to 0.9 s" in str(warned[1].message)
    import av

    for path in (tmp_path / "out" / "media").iterdir():
        with av.open(str(path)) as container:
            assert container.streams.video[0].codec_context.pix_fmt == "yuv420p"
