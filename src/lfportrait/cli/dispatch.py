"""The command line: one command per stage, built from the stages' configuration classes.

Each command is a data class whose fields are its options (tyro), with a method ``run`` that returns
the figures for ``--json``. A command's module is imported only when it is called, so that a quick
command does not wait for the libraries of a slow one.

Commands of other packages are found by their entry points (`lfportrait.plugins`). Reading these
takes longer than all of ``--help``, so they are read only for a word that is not in `COMMANDS`,
which also lists the commands of the evaluation package.
"""

import gc
import importlib
import os
import sys
import time
import warnings
from collections.abc import Callable, Container
from typing import Any

from ..errors import UserError
from ..measure import keep_memory, limit_threads
from ..version import __version__

ALLOCATIONS = 20_000
"""Objects between two garbage collections; with Python's 700, each import scans all of Numba."""

_LAB = "lfportrait_eval.commands"
COMMANDS: dict[str, tuple[str, str, str]] = {
    "demo": ("make", "Demo", "run all stages on the embedded capture and exemplar"),
    "studio": ("make", "Studio", "open the studio: everything on a page in the browser"),
    "make": ("make", "Make", "photos + painting -> coded light field, all stages"),
    "batch": ("make", "BatchCommand", "make many portraits from one jobs file, locally or on Ray"),
    "batch status": ("make", "BatchStatus", "how far a batch is"),
    "inspect": ("doctor", "Inspect", "what files and folders are, and how they are read"),
    "capture-check": ("reconstruction", "CaptureCheck", "check photos before calibration"),
    "calibrate": ("reconstruction", "Calibrate", "photos -> capture (cameras, mattes, landmarks)"),
    "reconstruct": ("reconstruction", "Reconstruct", "capture -> radiance field"),
    "transfer": ("stylization", "TransferPhoto", "stylise one photo by example (2D)"),
    "stylize": ("stylization", "Stylize", "radiance field + exemplar -> stylised field"),
    "restyle": ("stylization", "Restyle", "change a stylised field's strength or style"),
    "styles": ("presets", "Styles", "list the installed exemplars"),
    "styles list": ("presets", "Styles", "the same"),
    "styles add": ("presets", "StylesAdd", "find a painting's landmarks, to be corrected by hand"),
    "styles check": ("presets", "StylesCheck", "a page about a painting before it is used"),
    "render": ("reconstruction", "Render", "field -> pictures or a video"),
    "export": ("export", "Export", "field -> page, 3D file, quilt, stereo pair, flat video"),
    "formats": ("export", "Formats", "list the formats of exports and captures"),
    "view": ("export", "View", "show a field in the browser"),
    "encode": ("panels", "Encode", "field -> coded light-field picture for a display"),
    "print": ("export", "Print", "field -> lenticular print, one ray per printed pixel"),
    "interlace": ("panels", "Interlace", "quilt or folder of views -> coded picture for a display"),
    "deinterlace": ("panels", "Deinterlace", "coded picture -> quilt or folder of views"),
    "simulate": ("panels", "Simulate", "simulate the view of an eye in front of the display"),
    "cast": ("panels", "Cast", "show quilts on a Looking Glass, by Bridge or on its drive"),
    "show": ("panels", "Show", "show a coded picture full screen on an attached panel, unscaled"),
    "display": ("presets", "DisplayList", "list the display presets"),
    "display list": ("presets", "DisplayList", "the same"),
    "display show": ("presets", "DisplayShow", "a display's parameters and depth budget"),
    "display pattern": ("presets", "DisplayPattern", "a test pattern, coded for a display"),
    "display import": ("presets", "DisplayImport", "a display file from a calibration file"),
    "evaluate": (_LAB, "Evaluate", "metrics of a finished job or of two folders of pictures"),
    "evaluate tables": (_LAB, "Tables", "tables that compare methods, as in the paper"),
    "bench": (_LAB, "Bench", "measure speed: of single stages, or of whole jobs"),
    "study": (_LAB, "Study", "make a user study page"),
    "study results": (_LAB, "StudyResults", "evaluate the answers"),
    "devices": ("doctor", "Devices", "list the GPUs, which of them is used, what is missing"),
    "doctor": ("doctor", "Doctor", "check the installation and suggest fixes"),
    "models": ("doctor", "Models", "list the pretrained networks"),
    "models list": ("doctor", "Models", "the same"),
    "models fetch": ("doctor", "ModelsFetch", "download some"),
    "models add": ("doctor", "ModelsAdd", "take files that you downloaded"),
}


def _usage() -> str:
    shown = {name: text for name, (_, _, text) in COMMANDS.items() if text != "the same"}
    width = max(map(len, shown))
    lines = [f"lfportrait {__version__}: a stylised 3D portrait for a light-field display, "
             "from photos and one painting", "",
             "usage: lfportrait COMMAND ...        (lfportrait COMMAND --help for its options,",
             "                                      --help-all for all of them)", ""]
    lines += [f"  {name:<{width}}  {text}" for name, text in shown.items()]
    lines += ["", "Start with:  lfportrait demo --out demo-out"]
    return "\n".join(lines)


def _split(words: list[str]) -> tuple[str, list[str]] | None:
    """The command that these words begin with, and the words after it; None if there is none."""
    def among(known: Container[str]) -> tuple[str, list[str]] | None:
        ways = ((" ".join(words[:count]), words[count:]) for count in (2, 1))
        return next((way for way in ways if way[0] in known), None)

    def provided() -> Container[str]:
        from ..plugins import offered

        return {name.replace(".", " ") for name in offered("lfportrait.commands")}

    return among(COMMANDS) or among(provided())


def _command_class(name: str) -> Any:
    if name not in COMMANDS:
        from ..plugins import offered

        return offered("lfportrait.commands")[name.replace(" ", ".")]
    module, class_name, _ = COMMANDS[name]
    try:
        return getattr(importlib.import_module(
            module if "." in module else f".{module}", __package__), class_name)
    except ModuleNotFoundError as error:
        if error.name is None or error.name != module.partition(".")[0]:
            raise
        raise UserError(f"{name} is a command of the evaluation package: pip install "
                        "lfportrait-eval (in a checkout: pip install -e src/lfportrait_eval)"
                        ) from error


def _execute(name: str, arguments: list[str]) -> int:
    from ..device import check_device
    from ..files import write_json
    from ..measure import peak_memory_bytes
    from .common import parsed

    command = parsed(_command_class(name), arguments, f"lfportrait {name}")
    check_device(command.device)
    start = time.perf_counter()
    figures = command.run()
    target = getattr(command, "json", None)
    if target is not None:
        seconds = figures.get("seconds")
        if not isinstance(seconds, dict):
            seconds = {} if seconds is None else {"stage": seconds}
        figures["seconds"] = {"wall": round(time.perf_counter() - start, 3), **seconds}
        figures.setdefault("peak_memory_bytes", peak_memory_bytes())
        figures.setdefault("device", "cpu")
        figures["version"] = __version__
        write_json(target, figures)
    return int(command.exit_code(figures))


def _warner() -> Callable[..., None]:
    """What prints a command's warnings, each on one line, without its place in the code.

    Stages that read the same folder find the same in it: it is said once.
    """
    said: set[str] = set()

    def warn(message: Warning | str, *_: Any, **__: Any) -> None:
        line = f"warning: {' '.join(str(message).split())}"
        if line not in said:
            said.add(line)
            print(line, file=sys.stderr)

    return warn


def main(arguments: list[str] | None = None) -> int:
    """Run the command line (``sys.argv[1:]`` by default); its exit code.

    0: success. 1: internal error, with a traceback to report. 2: user error, reported on one line
    on standard error. 3: some jobs of a batch failed, all others are done. 130: interrupted; run
    the same command again to resume.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    if not words or words[0] in ("-h", "--help", "help"):
        print(_usage())
        return 0
    if words[0] in ("--version", "version"):
        print(__version__)
        return 0
    found = _split(words)
    if found is None:
        print(f"lfportrait: unknown command {words[0]!r}; the commands are "
              f"{', '.join(COMMANDS)}", file=sys.stderr)
        return 2
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            warnings.filterwarnings("always", category=UserWarning, module=r"lfportrait\w*\.")
            warnings.showwarning = _warner()
            return _execute(*found)
    except KeyboardInterrupt:
        print("lfportrait: interrupted; run the same command again to resume", file=sys.stderr)
        return 130
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:
        from ..runner import failure_of

        failure = failure_of(error)
        if failure.code != "internal":
            print(f"lfportrait: {failure.message}", file=sys.stderr)
            return 2
        print(f"{failure.trace}lfportrait: internal error; please report it with the lines above",
              file=sys.stderr)
        return 1


def _set_up() -> None:
    """Set up this process for one command; the user's environment variables take precedence."""
    # NumPy's products are small here: waking a second thread takes longer than it saves. What is
    # large is shared out by kernels, or computed by torch.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    limit_threads(os.environ)
    gc.set_threshold(ALLOCATIONS)
    keep_memory()


def program() -> int:
    """Run the command line in a process of its own; returns its exit code."""
    _set_up()
    code = main()
    gc.freeze()  # The process ends: no further garbage collection is needed.
    return code
