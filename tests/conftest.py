"""Fixtures that several test files share, and how the test processes share the cores."""

import functools
import gc
import importlib
import inspect
import os
import re
import sys
from contextlib import suppress
from pathlib import Path
from types import ModuleType

import hypothesis
import pytest

# What Hypothesis draws and tests is the same on a busy machine, where both take longer.
hypothesis.settings.register_profile("any pace", deadline=None, suppress_health_check=[
    hypothesis.HealthCheck.too_slow])
hypothesis.settings.load_profile("any pace")

# Tests start a hundred processes: each would compile what it imports of the sources once more.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# Before anything loads OpenMP. Several processes test at once. With as many threads each as there
# are cores, threads that spin while they wait for work take the cores from those that have some (a
# test of the network took 97 s instead of 2). Those of torch and the BLAS are not ours to test, and
# what they get here are pictures of a few dozen pixels.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
os.environ.setdefault("OMP_NUM_THREADS", "1")
# No test asks the internet for networks; those of downloads have a server of their own.
os.environ.setdefault("LFPORTRAIT_MIRROR", "http://127.0.0.1:9")

# What is made while tests are collected stays: nothing of it is garbage, then or later. A process
# that only hands tests out to others collects none, and stays without.
gc.disable()


def pytest_collection_finish() -> None:
    """Set up a process that tests, now that it has imported them.

    Garbage is looked for among what tests make, and more seldom than by default: Numba compiles two
    hundred functions here, and makes little. Memory is kept, as by a command. The processes share
    the threads for kernels: on two cores to wake a second takes a tenth of its time. In continuous
    integration it has all, so that a kernel whose result depends on them is found out.
    """
    import numba

    from lfportrait.measure import keep_memory

    keep_memory()
    if "PYTEST_XDIST_WORKER" in os.environ and not all_run():
        workers = int(os.environ["PYTEST_XDIST_WORKER_COUNT"])
        numba.set_num_threads(max(1, numba.get_num_threads() // workers))
    gc.freeze()
    gc.set_threshold(10_000, 10, 10)
    gc.enable()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """How many processes test: as many as there are cores, two to four.

    Each imports all tests, for ten seconds of a core. Where slow ones are run there is one more:
    one waits for a browser, a graphics driver or a job most of the time.
    """
    return min(max(os.cpu_count() or 1, 2), 4) + all_run()


FIRST = ("job/batch/test_batch.py", "studio/web/test_access.py", "share/page/test_in_browser.py",
         "job/batch/test_ray.py", "lfportrait_eval/bench/test_bench.py",
         "job/test_style_check.py", "project/test_object_scene.py",
         "lightfield/screens/test_live.py", "studio/test_portrait.py",
         "lightfield/gpu/test_coding_on_gpu.py", "lfportrait_eval/tables/test_tables.py",
         "share/test_splats.py", "example/worn/test_spectacles.py", "field/test_cutout.py",
         "job/test_first_look.py", "project/test_modelled_people.py", "capture/test_calibrate.py",
         "field/test_field.py", "lfportrait_eval/baselines/transfer/test_network.py",
         "studio/test_jobs.py", "test_mutations.py", "field/test_poses.py",
         "project/test_examples.py", "stylize/test_stylize.py",
         "capture/calibration/test_head_motion.py", "lfportrait_eval/baselines/field/test_arf.py",
         "job/test_session.py", "job/test_photo_check.py", "gpu/test_process.py",
         "field/gpu/training/test_training.py", "job/test_pipeline.py",
         "field/test_clean_plates.py", "share/test_textured_mesh.py", "field/test_head_surface.py",
         "lightfield/prints/test_prints.py", "example/worn/test_hat.py", "stylize/test_on_skin.py",
         "example/test_painted_turned.py", "face/one_photo/test_hair.py", "studio/test_server.py",
         "lfportrait_eval/baselines/field/test_ref_npr.py", "example/test_transfers.py",
         "lightfield/gpu/test_live.py", "lightfield/test_lightfield.py",
         "lightfield/test_slices.py")
"""Files that take long, longest first, for a first run: later ones know what each took (`SECONDS`).
The first of all need no kernels but those that were compiled before them."""
SECONDS = "lfportrait/seconds"
"""Where pytest's cache keeps how long each file took when all tests were run last."""


def file_of(nodeid: str) -> str:
    """A test's file, by its name under ``tests``."""
    return nodeid.partition("::")[0].removeprefix("tests/")


def seconds_of_files(config: pytest.Config) -> dict[str, float]:
    """How long each file takes, by its name under ``tests``; by its place in `FIRST` if unknown."""
    guessed = {name: float(len(FIRST) - number) for number, name in enumerate(FIRST)}
    cache = getattr(config, "cache", None)  # a run may go without
    return guessed | (cache.get(SECONDS, {}) if cache is not None else {})


def all_run() -> bool:
    """Whether slow tests are run, too: ``make test-all``, and continuous integration."""
    return os.environ.get("LFPORTRAIT_SLOW") == "1"


def wholly_slow(path: Path) -> bool:
    """Whether all tests of a file are slow, by its mark, and none of them is to run."""
    if all_run():
        return False
    return re.search(r"^pytestmark = .*\bpytest\.mark\.slow\b", path.read_text("utf-8"),
                     re.MULTILINE) is not None


def pytest_ignore_collect(collection_path: Path) -> bool | None:
    """Leave files out whose tests are all slow: some take seconds to import, in each process."""
    if collection_path.suffix != ".py" or not wholly_slow(collection_path):
        return None
    LEFT_OUT.files.add(str(collection_path))
    return True


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Put the long files first, and leave slow tests out.

    xdist hands out files in this order: no process sits on a long one when the others are done.
    """
    seconds = seconds_of_files(config)
    items.sort(key=lambda item: -seconds.get(file_of(item.nodeid), 0.0))
    if not all_run():
        slow = [item for item in items if item.get_closest_marker("slow")]
        items[:] = [item for item in items if not item.get_closest_marker("slow")]
        LEFT_OUT.tests.update(item.nodeid for item in slow)
        config.hook.pytest_deselected(items=slow)


class LeftOut:
    """What is left out as slow: tests one by one, and files without any other."""

    def __init__(self) -> None:
        self.tests: set[str] = set()
        self.files: set[str] = set()


LEFT_OUT = LeftOut()


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Let the process that hands out tests know what this one has left out of its own."""
    if hasattr(session.config, "workeroutput"):
        session.config.workeroutput["left out"] = sorted(LEFT_OUT.tests), sorted(LEFT_OUT.files)


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node, error) -> None:
    """Take what a test process has left out; all of them leave out the same."""
    tests, files = getattr(node, "workeroutput", {}).get("left out", ((), ()))
    LEFT_OUT.tests.update(tests)
    LEFT_OUT.files.update(files)


@pytest.hookimpl(trylast=True)
def pytest_terminal_summary(terminalreporter, config: pytest.Config) -> None:
    """Say at the end what was left out, and how to run it."""
    asked = [(config.invocation_params.dir / word.partition("::")[0]).resolve()
             for word in config.args]
    files = [path for path in map(Path, LEFT_OUT.files)
             if any(path.is_relative_to(place) for place in asked)]
    if LEFT_OUT.tests or files:
        terminalreporter.write_line(
            f"Left out as slow: {len(LEFT_OUT.tests)} tests, and {len(files)} whole files (pages "
            "in a browser, shaders, jobs from end to end, examples).\n"
            "`make test-all` runs these, too; LFPORTRAIT_SLOW=1 pytest FILE those of one file.")


TOGETHER = (("studio/web/", "lfportrait_eval/study/"), ("share/page/",),
            ("lfportrait_eval/baselines/", "stylize/test_stylize.py"),
            ("project/test_architecture.py", "project/test_house.py"))
"""Folders and files that one process runs, as they share what takes long: a browser, a studio, a
trained field and torch's optimizers, the imports of all sources."""


def scope_of(nodeid: str) -> str:
    """Tests of one scope run one after the other in one process: those of a file, or `TOGETHER`."""
    name = file_of(nodeid)
    return next((folders[0] for folders in TOGETHER if name.startswith(folders)), name)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log):
    """xdist's own for files, but for those that go together."""
    if config.getvalue("dist") != "loadfile":
        return None
    from xdist.scheduler import LoadFileScheduling

    class Scheduling(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return scope_of(nodeid)

    return Scheduling(config, log)


class Clock:
    """Notes how long each file takes, for the order of the next run.

    Only where all tests are run, by several processes: what else a run has in mind, it leaves some
    of a file's tests out.
    """

    def __init__(self, config: pytest.Config) -> None:
        self.config = config
        self.seconds: dict[str, float] = {}

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        name = file_of(report.nodeid)
        self.seconds[name] = self.seconds.get(name, 0.0) + report.duration

    def pytest_sessionfinish(self, exitstatus: int) -> None:
        if exitstatus in (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED):
            self.config.cache.set(SECONDS, {name: round(seconds, 1)
                                            for name, seconds in self.seconds.items()})


def pytest_configure(config: pytest.Config) -> None:
    """Watch the clock in the process that hands out the tests.

    The filter is not in pyproject.toml: for its class pytest would load Numba and OpenBLAS before
    this file has set their threads. Hypothesis reads sources when the tests are collected.
    """
    config.addinivalue_line("filterwarnings",
                            "ignore::numba.core.errors.NumbaPerformanceWarning")
    if not all_run():
        no_constants()
    option = config.option
    if (config.args_source is pytest.Config.ArgsSource.TESTPATHS
            and getattr(option, "numprocesses", None) and getattr(config, "cache", None)
            and not (option.keyword or option.markexpr or option.lf or option.maxfail)):
        config.pluginmanager.register(Clock(config))


@pytest.fixture(autouse=True, scope="session")
def no_pauses():
    """What is asked for in vain is asked again at once."""
    from lfportrait import models

    before, models.PAUSE = models.PAUSE, 0.0
    yield
    models.PAUSE = before


@pytest.fixture(autouse=True)
def kept_folder(tmp_path_factory, request):
    """A folder for what the user's cache would keep: what was found in a picture serves all tests.

    A test that changes anything, or looks into the folder, has a new one: none believes what
    another made of other code. What source files say stays in the user's own, as each run would
    read all of them for seconds.
    """
    from lfportrait.cache import user_cache

    folder = tmp_path_factory.getbasetemp()
    if {"monkeypatch", "other_device"} & set(request.fixturenames) or "kept_folder" in (
            inspect.signature(request.function).parameters):
        folder /= f"kept/{abs(hash(request.node.nodeid))}"
    else:
        folder = folder.parent / "kept" if "PYTEST_XDIST_WORKER" in os.environ else folder / "kept"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("lfportrait.cache.user_cache",
                      lambda kind: user_cache(kind) if kind == "code" else folder / kind)
        yield folder


@pytest.fixture(scope="session")
def adapter():
    """A WebGPU adapter of this machine, the software one if it has that."""
    from lfportrait.gpu import adapters
    from lfportrait.graphics import lacking

    found = sorted(adapters(), key=lambda one: one.real)
    if found:
        return found[0]
    why = "; ".join(f"{lack.what}: {lack.remedy}" for lack in lacking()) or "no adapter is found"
    if os.environ.get("LFPORTRAIT_REQUIRE_GPU") == "1":
        pytest.fail(f"LFPORTRAIT_REQUIRE_GPU=1 asks for a GPU, but {why}")
    pytest.skip(why)


@pytest.fixture(scope="session")
def gpu_children(adapter):
    """Gives a process of a device, the same one to several tests: its start takes a second.

    Drivers in software do not live long, so that each thirtieth use gets a new process, as does one
    after a loss. A new one compiles its shaders, for seconds.
    """
    from lfportrait.gpu import GpuProcess

    kept, uses = [GpuProcess(adapter)], [0]

    def child():
        uses[0] += 1
        if uses[0] % 30 == 0 or kept[0].starts > 1:
            kept[0].close()
            kept[0] = GpuProcess(adapter)
        return kept[0]

    yield child
    kept[0].close()


@pytest.fixture
def gpu_child(gpu_children):
    """A process of a device that tests before this one may have used, and later ones will."""
    return gpu_children()


@pytest.fixture
def other_device(monkeypatch):
    """A choice of ``--device`` by which torch computes elsewhere (`tests.other_memory`)."""
    from lfportrait import device
    from tests.other_memory import PLACE, OtherMemory

    monkeypatch.setattr(device, "gpu_adapters", list)
    monkeypatch.setattr(device, "torch_devices",
                        lambda: (device.TorchDevice(PLACE, "Other 9", "Test"),))
    device.torch_device.cache_clear()
    with OtherMemory():
        yield "gpu:other"
    device.torch_device.cache_clear()


@pytest.fixture(scope="session")
def coarse_distances():
    """`modelled_head.studio.distances` at half as many places each way; all heads are kept."""
    from modelled_head import studio

    @functools.cache
    def distances(model):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(studio, "_GRID", 129)
            return bake(model)

    bake = studio.distances.__wrapped__
    return distances


@pytest.fixture(scope="module")
def coarse_heads(coarse_distances):
    """Modelled heads as fine as pictures of a hundred pixels, in a fifth of the time."""
    from modelled_head import lattice, painting, studio

    with pytest.MonkeyPatch.context() as patch:
        for user in (studio, lattice):
            patch.setattr(user, "distances", coarse_distances)
        painting._sitting.cache_clear()
        yield
    painting._sitting.cache_clear()


STAGES = "reconstruct", "encode", "transfer", "stylize", "mattes"
"""Kernels are compiled in this order before the tests: two processes end at about the same time."""
DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Real captures and exemplars, kept beside the checkout; tests that need them skip without."""
    if not DATA.is_dir():
        pytest.skip("no real data beside the checkout (../shared/data)")
    return DATA


@pytest.fixture(scope="session")
def shared_weights(shared_data: Path) -> Path:
    """Folder with pretrained weights."""
    folder = shared_data / "weights"
    if not folder.is_dir():
        pytest.skip("no pretrained weights beside the checkout (../shared/data/weights)")
    return folder


@pytest.fixture(scope="session")
def playwright():
    """What drives a browser; one a process, as it has a loop of its own."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as started:
        yield started


@pytest.fixture(scope="session")
def browser(playwright):
    """A running browser with WebGL2."""
    from tests.share.page.browser import chromium

    with chromium(playwright) as running:
        yield running


@pytest.fixture(scope="session")
def plain_browser(playwright):
    """A running browser for pages that draw little by WebGL."""
    from tests.share.page.browser import PLAIN, chromium

    with chromium(playwright, *PLAIN) as running:
        yield running


def no_constants() -> None:
    """Let Hypothesis try no numbers that stand in the sources, as it does where all tests are run.

    It reads every source for them: in a new checkout three seconds of a core.
    """
    with suppress(ImportError):  # where this version of Hypothesis has that elsewhere
        from hypothesis.internal.conjecture import providers

        vars(providers)["is_local_module_file"] = lambda path: False


def read_constants(root: Path, share: slice) -> None:
    """Find the constants in a share of the sources, for Hypothesis in all processes."""
    with suppress(ImportError):
        from hypothesis.internal.constants_ast import constants_from_module

        for path in sorted(path for folder in ("src", "scripts")
                           for path in (root / folder).rglob("*.py"))[share]:
            module = ModuleType(path.stem)
            module.__file__ = str(path)
            constants_from_module(module)


def import_a_share(config: pytest.Config) -> None:
    """Read some of the sources and import some of the test files: of each process others.

    In a new checkout each test file is rewritten for its asserts, which takes longer than all else
    before the tests, and Hypothesis looks for constants in each source (`no_constants`). What
    another process has written is read.
    """
    number = int(os.environ["PYTEST_XDIST_WORKER"].removeprefix("gw"))
    share = slice(number, None, int(os.environ["PYTEST_XDIST_WORKER_COUNT"]))
    if all_run():
        read_constants(config.rootpath, share)
    for folder in config.getini("testpaths"):
        paths = sorted((config.rootpath / folder).rglob("test_*.py"))
        paths = [path for path in paths if not wholly_slow(path)]
        for path in paths[share]:
            # Whatever is wrong with one, or missing for it, is told when it is collected.
            with suppress(Exception, pytest.skip.Exception):
                importlib.import_module(".".join(
                    path.relative_to(config.rootpath).with_suffix("").parts))


@pytest.hookimpl(tryfirst=True)
def pytest_collection(session: pytest.Session) -> None:
    """Share out, before all tests are collected, what each process would read for itself."""
    if ("PYTEST_XDIST_WORKER" in os.environ
            and session.config.args_source is pytest.Config.ArgsSource.TESTPATHS):
        import_a_share(session.config)


def pytest_sessionstart(session: pytest.Session) -> None:
    """Compile the stages' kernels once, on all cores, before the test processes begin.

    Each would compile for itself what both need. A run of one process compiles what it comes by.
    """
    if not getattr(session.config.option, "numprocesses", None):
        return
    from lfportrait.job.warmup import FUNCTIONS, Warmup
    from lfportrait.progress import Progress

    stages = sorted(FUNCTIONS, key=STAGES.index)
    with Warmup(stages) as warmup, Progress("kernels") as progress:
        warmup.wait(stages, progress)
