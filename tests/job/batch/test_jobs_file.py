"""Files of jobs: what they ask for, which parameters win, and one clear line for each mistake."""

import numpy as np
import pytest
from PIL import Image

from lfportrait.errors import UserError
from lfportrait.job.batch import load_jobs
from lfportrait.job.batch.jobs_file import checked, overlaid
from lfportrait.job.graph import MakeConfig

HEAD = '[[style]]\npainting = "charcoal"\n[[display]]\npanel = "generic-4k"\n'


@pytest.fixture
def load(tmp_path):
    (tmp_path / "anna").mkdir()
    (tmp_path / "week" / "bert").mkdir(parents=True)
    (tmp_path / "week" / "cora.mp4").write_bytes(b"")
    (tmp_path / "week" / "notes.txt").write_bytes(b"")

    def written(text, head=HEAD):
        (tmp_path / "jobs.toml").write_text(f"{text}\n{head}")
        return load_jobs(tmp_path / "jobs.toml")

    return written


def test_names_come_from_the_files(load, tmp_path):
    jobs = load('[[sitter]]\nphotos = "anna"\n[[sitter]]\nphotos = "week/*"\n')
    assert list(jobs.sitters) == ["anna", "bert", "cora"]
    assert jobs.sitters["cora"].source == tmp_path / "week" / "cora.mp4"
    assert list(jobs.styles) == ["charcoal"] and list(jobs.panels) == ["generic-4k"]
    assert jobs.sitters["anna"].styles == ("charcoal",)
    assert jobs.sitters["anna"].pages and not jobs.sitters["anna"].sweeps


def test_a_sitter_goes_before_a_style_and_that_before_the_defaults(load):
    jobs = load("""
        [defaults]
        seed = 3
        stylize.strength = 0.9
        stylize.steps = 4
        reconstruct.max_voxels = 2
        [[style]]
        name = "soft"
        painting = "fauve"
        stylize.strength = 0.5
        stylize.steps = 5
        [[display]]
        name = "wall"
        panel = "generic-1080p"
        encode.size = 0.6
        [[sitter]]
        name = "anna"
        photos = "anna"
        styles = ["soft"]
        sweeps = true
        stylize.strength = 0.2
        [[sitter]]
        name = "bert"
        photos = "week/bert"
        seed = 7
        """)
    assert jobs.sitters["anna"].seed == 3 and jobs.sitters["bert"].seed == 7
    assert jobs.sitters["anna"].styles == ("soft",) and jobs.sitters["anna"].sweeps
    assert jobs.parameters("anna").reconstruct.max_voxels == 2.0
    assert jobs.parameters("bert", "charcoal").stylize.strength == 0.9
    assert jobs.parameters("bert", "soft").stylize.strength == 0.5
    assert jobs.parameters("anna", "soft").stylize.strength == 0.2
    assert jobs.parameters("anna", "soft").stylize.steps == 5
    assert jobs.parameters("bert", "soft", "wall").encode.size == 0.6
    assert jobs.parameters("bert", "soft", "generic-4k").encode == MakeConfig().encode


def test_photos_are_sitters_where_a_pattern_names_nothing_else(load, tmp_path):
    (tmp_path / "people").mkdir()
    for name in ("dora.png", "emil.png"):
        Image.fromarray(np.zeros((4, 4, 3), np.uint8)).save(tmp_path / "people" / name)
    Image.fromarray(np.zeros((4, 4, 3), np.uint8)).save(tmp_path / "week" / "x.png")
    jobs = load('[defaults]\nfrom = "photos"\n[[sitter]]\nphotos = "people/*"\nfrom = "face"\n'
                '[[sitter]]\nphotos = "week/*"\n')
    assert list(jobs.sitters) == ["dora", "emil", "bert", "cora"]
    assert jobs.sitters["dora"].source == tmp_path / "people" / "dora.png"
    assert jobs.parameters("emil").made_from == "face"
    assert jobs.parameters("bert", "charcoal").made_from == "photos"


def test_parameters_of_another_packages_method(load):
    jobs = load("""
        [defaults.stylize.ref_npr]
        steps = 3
        [[style]]
        painting = "fauve"
        stylize.method = "ref-npr"
        stylize.ref_npr.views = 5
        [[sitter]]
        photos = "anna"
        """)
    config = jobs.parameters("anna", "fauve").stylize
    found = config.parameters_of(config.other)
    assert (found.steps, found.views) == (3, 5) and len(config.parameters) == 1
    assert config.maker == "lfportrait_eval.baselines.field.methods"


@pytest.mark.parametrize("text, told", [
    ("sitter = 3", "double brackets"),
    ("[[siter]]", "no siter; did you mean sitter?"),
    ("", r"no \[\[sitter\]\]"),
    ("[[sitter]]", "one of photos, video and capture, not none"),
    ('[[sitter]]\nphotos = "anna"\nvideo = "x"', "not photos and video"),
    ('[[sitter]]\nphotos = 3', "photos = 3 is not a text"),
    ('[[sitter]]\nphotos = "nowhere"', "no folder or file .*nowhere"),
    ('[[sitter]]\nphotos = "none/*"', r"matches none/\*"),
    ('[[sitter]]\nphotos = "anna"\nfrom = "nose"', "'nose' is none of auto, face, photos"),
    ('[[sitter]]\nphotos = "week/*"\nname = "x"', "leave out name"),
    ('[[sitter]]\nphotos = "anna"\nname = "a/b"', "can't be a folder's name"),
    ('[[sitter]]\nphotos = "anna"\nname = "portrait"', "taken by the batch"),
    ('[[sitter]]\nphotos = "anna"\n[[sitter]]\nphotos = "anna"', "the name anna is used twice"),
    ('[[sitter]]\nphotos = "anna"\n[[sitter]]\nphotos = "anna"\nname = "Anna"',
     "'anna' and 'Anna' are one folder on some systems"),
    ('[[sitter]]\nphotos = "anna"\n[[sitter]]\nphotos = "anna"\nname = "anna. "', "one folder"),
    ('[[sitter]]\nphotos = "anna"\nname = "zo\u00eb"\n'
     '[[sitter]]\nphotos = "anna"\nname = "zoe\u0308"', "one folder"),
    ('[[sitter]]\nphotos = "anna"\nname = "Portrait"', "taken by the batch"),
    ('[[sitter]]\nphotos = "anna"\nname = " ."', "can't be a folder's name"),
    ('[[sitter]]\nphotos = "anna"\nstyles = ["charcaol"]', "did you mean charcoal"),
    ('[[sitter]]\nphotos = "anna"\nstylize.stregth = 1', r"sitter anna.stylize: .*mean strength"),
    ('[[sitter]]\nphotos = "anna"\nstylize.strength = "x"', "strength = 'x' is not a number"),
    ('[[sitter]]\nphotos = "anna"\nstylize.method = "oil"', "none of skin, paper, arf"),
    ('[[sitter]]\nphotos = "anna"\nstylize.arf.step = 1', "anna.stylize.arf: .*mean steps"),
    ('[[sitter]]\nphotos = "anna"\nstylize.arf = 3', "arf = 3 is not a table"),
    ('[[sitter]]\nphotos = "anna"\nstylize.parameters = []', "there is no parameters"),
    ('[[sitter]]\nphotos = "anna"\nstylize = 3', "stylize = 3 is not a table"),
    ('[[sitter]]\nphotos = "anna"\nreconstruct.rays = 3', "rays = 3 is not a list"),
    ('[[style]]\npainting = "fauve"\nreconstruct.max_voxels = 1', "there is no reconstruct"),
    ('[[display]]\npanel = "holodeck"', "display 1: panel: there is no display"),
    ('[[display]]\nname = "x"', "display 1 .x. lacks panel"),
    ("x =", "not valid TOML")])
def test_a_mistake_is_one_line_with_file_and_entry(load, text, told):
    with pytest.raises(UserError, match=told) as error:
        load(text)
    assert "jobs.toml" in str(error.value) and "\n" not in str(error.value)


def test_nothing_to_be_made_is_a_mistake(load):
    with pytest.raises(UserError, match="no output is requested"):
        load('[defaults]\npages = false\n[[sitter]]\nphotos = "anna"\n',
             '[[style]]\npainting = "charcoal"\n')


def test_a_missing_file(tmp_path):
    with pytest.raises(UserError, match="can't read the jobs"):
        load_jobs(tmp_path / "none.toml")


def test_values_keep_their_types():
    config = overlaid(MakeConfig(), {"reconstruct": {"rays": [1, 2.5]}, "sweep_size": 64}, "here")
    assert config.reconstruct.rays == (1.0, 2.5) and config.sweep_size == 64
    assert checked(2, float | None, "here") == 2.0
    assert checked([1, 2], tuple[int, int], "here") == (1, 2)
    with pytest.raises(UserError, match="list of 2"):
        checked([1], tuple[int, int], "here")
    with pytest.raises(UserError, match="no seed"):
        overlaid(MakeConfig(), {"reconstruct": {"seed": 3}}, "here")
