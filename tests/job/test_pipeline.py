"""The main job on a small capture, undisturbed and killed in each stage: the same files."""

import hashlib
import json
import os
import pickle
import shutil
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import torch  # noqa: F401 - for `jobs`: what it forks would import it once more each

from lfportrait.demo import demo_capture, demo_exemplar
from lfportrait.errors import UserError
from lfportrait.field import ReconstructConfig
from lfportrait.job.graph import fitted
from lfportrait.job.pipeline import MakeConfig, make
from lfportrait.job.warmup import Warmup
from lfportrait.lightfield import (
    Display,
    EncodeConfig,
    QuiltLayout,
    deinterlace,
    layout_of_file,
    render_view,
)
from lfportrait.media.pictures import read_image
from lfportrait.simd.host import watched_compilations
from lfportrait.stylize import StylizeConfig
from tests.job.forking import Forker

PANEL = Display(128, 96, views=16, pitch=7.3, slant=0.15, cone=40, quilt=(3, 2),
                quilt_size=(192, 128), name="tiny")
CONFIG = MakeConfig(
    # With as many coefficients as usual: rows of another width have kernels of their own.
    reconstruct=ReconstructConfig(resolutions=(24, 48), rays=(0.03, 0.06), batch=(1024,)),
    stylize=StylizeConfig(pixels=48.0, fit_iterations=2, steps=2, content_network="embedded",
                          style_network="embedded"),
    sweep_size=48)
STAGES = "transfer", "reconstruct", "stylize", "encode"
FILES = ("field.npz", "styled.npz", "lightfield.png", "portrait.html", "sweep.mp4")


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    """A capture on disk and a display file, as a user would have them."""
    folder = tmp_path_factory.mktemp("inputs")
    demo_capture(size=72, views=16).save(folder / "capture")
    PANEL.save(folder / "tiny.toml")
    # Drawing it takes each of the processes below longer than most stages.
    (folder / "exemplar.pickle").write_bytes(pickle.dumps(demo_exemplar(width=180, height=240)))
    return folder


def run_job(inputs: str, out: str) -> None:
    """What processes of their own do: the job. Beside its folder they leave what they told."""
    exemplar = pickle.loads((Path(inputs) / "exemplar.pickle").read_bytes())
    with Warmup(STAGES) as warmup:
        warmup.wait(STAGES)
    compiled: list[str] = []
    with watched_compilations(compiled.append):
        run = make(Path(inputs) / "capture", exemplar, Path(out), Path(inputs) / "tiny.toml",
                   CONFIG, offline=True)
    (Path(out).parent / "told.json").write_text(json.dumps([run, compiled]))


@pytest.fixture(scope="module")
def jobs():
    """Begins such processes."""
    if not hasattr(os, "fork"):
        yield None
        return
    forker = Forker("tests.job.test_pipeline", "run_job")
    yield forker
    forker.close()


@pytest.fixture(scope="module")
def told(inputs, jobs, tmp_path_factory):
    """The job's folder, its figures, and what it compiled although all was compiled ahead."""
    out = tmp_path_factory.mktemp("job") / "out"
    if jobs is None:
        run_job(str(inputs), str(out))
    else:
        assert jobs.start(str(inputs), str(out)).wait() == 0
    return out, *json.loads((out.parent / "told.json").read_text())


@pytest.fixture(scope="module")
def undisturbed(told):
    return told[:2]


def digests(out: Path) -> dict[str, str]:
    names = [*FILES, *(path.name for path in out.glob("quilt_*.png"))]
    return {name: hashlib.sha256((out / name).read_bytes()).hexdigest() for name in names}


def test_all_files_are_there(undisturbed, tmp_path):
    out, run = undisturbed
    for name in (*FILES, "report.html", "run.json", "capture/transforms.json"):
        assert (out / name).is_file(), name
    assert (out / "quilt_qs3x2a1.333.png").is_file()
    renamed = shutil.copy(out / "quilt_qs3x2a1.333.png", tmp_path / "renamed.png")
    assert layout_of_file(renamed) == QuiltLayout(3, 2, 1.333)
    assert run == json.loads((out / "run.json").read_text())
    assert set(run["seconds"]) == {"total", "capture", "reconstruct", "stylize", "encode", "share"}
    assert run["reconstruct"]["test"]["psnr"] > 15
    assert run["encode"]["subpixels"] == 3 * 128 * 96
    assert run["peak_memory_bytes"] > 1e7


@pytest.mark.timeout(900)  # run alone, in a fresh clone, it compiles all stages
@pytest.mark.skipif(not hasattr(os, "fork"), reason="this process may have compiled them")
def test_a_job_compiles_nothing_that_was_not_compiled_ahead(told):
    assert told[2] == []


def test_the_report_opens_offline(undisturbed):
    text = (undisturbed[0] / "report.html").read_text()
    assert "data:image" in text
    assert "src=\"http" not in text
    assert "href=\"http" not in text
    for title in ("Photos and painting", "Radiance field", "Light field", "Figures"):
        assert title in text


def test_the_coded_picture_is_made_of_the_views(undisturbed):
    from lfportrait.field import VoxelField

    out, _ = undisturbed
    image = read_image(out / "lightfield.png")
    styled = VoxelField.load(out / "styled.npz")
    for view in (0, 7, 15):
        direct = render_view(styled, PANEL, view, CONFIG.encode)
        picture, owned = deinterlace(image, PANEL, view)
        assert np.array_equal(picture[owned], direct[owned])


def test_no_finer_lattice_than_the_display_shows():
    def points(display, **encode):
        config = fitted(MakeConfig(), [(Display.preset(display), EncodeConfig(**encode))])
        return config.reconstruct.max_resolution

    assert points("generic-4k") == points("lookingglass-portrait") == 256
    assert 320 <= points("generic-8k") < points("lookingglass-32-portrait") == 512
    assert points("generic-4k", size=2.0) > 256, "a head that is cropped by the panel"
    own = MakeConfig(reconstruct=ReconstructConfig(max_resolution=300))
    fit = fitted(own, [(Display.preset("lookingglass-32-portrait"), EncodeConfig())])
    assert fit.reconstruct.max_resolution == 300


def test_a_second_run_does_nothing_again(undisturbed, inputs):
    out, _ = undisturbed
    before = {path: path.stat().st_mtime_ns for path in out.iterdir() if path.name in FILES}
    run = make(inputs / "capture", demo_exemplar(width=180, height=240), out,
               inputs / "tiny.toml", CONFIG, offline=True)
    assert run["resumed"] == ["capture", "reconstruct", "stylize", "encode", "share"]
    assert before == {path: path.stat().st_mtime_ns for path in out.iterdir() if path.name in FILES}


@pytest.mark.slow  # tests/studio/test_portrait.py kills a training, tests/test_stages.py the rest
@pytest.mark.skipif(sys.platform != "linux", reason="forks, and reads /proc")
def test_killed_in_every_stage_it_ends_with_the_same_files(inputs, undisturbed, jobs, tmp_path):
    out = tmp_path / "out"
    # Wait for a stage's record, then kill in the middle of the next stage.
    for stage in ("", "capture", "reconstruct", "stylize", "encode"):
        process = jobs.start(str(inputs), str(out))
        wanted = out / ".stages" / f"{stage}.json" if stage else out / ".stages"
        deadline = time.time() + 120
        while not wanted.exists() and process.running() and time.time() < deadline:
            time.sleep(0.01)
        if stage and process.running():
            time.sleep(0.05)
        process.kill()
        process.wait()
    assert jobs.start(str(inputs), str(out)).wait() == 0
    assert digests(out) == digests(undisturbed[0])
    run = json.loads((out / "run.json").read_text())
    assert "capture" in run["resumed"]
    left = [path.name for path in out.rglob(".*") if path.name != ".stages"]
    assert all(name.startswith((".sweep", ".field", ".styled", ".lightfield", ".capture",
                                ".quilt", ".report", ".hero", ".portrait", ".first-look"))
               for name in left)


@pytest.mark.slow  # tests/job/test_first_look.py changes the painting, too
def test_another_style_keeps_capture_and_field(undisturbed, inputs, tmp_path):
    import shutil

    out = tmp_path / "out"
    shutil.copytree(undisturbed[0], out)
    run = make(inputs / "capture", demo_exemplar("charcoal", width=180, height=240), out,
               inputs / "tiny.toml", CONFIG, offline=True)
    assert run["resumed"] == ["capture", "reconstruct"]
    assert digests(out)["field.npz"] == digests(undisturbed[0])["field.npz"]
    assert digests(out)["styled.npz"] != digests(undisturbed[0])["styled.npz"]


def test_wrong_inputs_are_told_before_anything_is_made(inputs, tmp_path):
    exemplar = demo_exemplar(width=180, height=240)
    with pytest.raises(UserError, match="no folder or file"):
        make(tmp_path / "nowhere", exemplar, tmp_path / "out", PANEL, CONFIG)
    with pytest.raises(UserError, match="there is no display"):
        make(inputs / "capture", exemplar, tmp_path / "out", "nothing", CONFIG)
    with pytest.raises(UserError):
        make(inputs / "capture", tmp_path / "none.png", tmp_path / "out", PANEL, CONFIG)
    assert not (tmp_path / "out").exists()
