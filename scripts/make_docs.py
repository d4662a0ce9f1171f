"""Write docs/parameters.md from the configuration classes: parameter, default and meaning of each.

The classes are the one place where parameters are described: the command line shows the same texts.

Run: python scripts/make_docs.py            writes the page
     python scripts/make_docs.py --check    exit code 1 if the page is not up to date
"""

import ast
import dataclasses
import inspect
import sys
import textwrap
import typing
from pathlib import Path

from lfportrait.capture import CalibrateConfig
from lfportrait.example import BlitConfig, SkinConfig, TableConfig, TransferConfig
from lfportrait.field import ReconstructConfig
from lfportrait.job import MakeConfig
from lfportrait.job.batch import BatchConfig
from lfportrait.lightfield import Display, EncodeConfig, InterlaceConfig
from lfportrait.lightfield.prints import PrintConfig
from lfportrait.share import ExportConfig, FrameConfig, PageConfig, SequenceConfig
from lfportrait.share.kinds import LoopConfig
from lfportrait.stylize import MixConfig, StylizeConfig
from lfportrait_eval.baselines.config import FaceBlitConfig, FaceStyleConfig, NetworkConfig
from lfportrait_eval.baselines.field import ArfConfig, RefNprConfig, StylizedNerfConfig
from lfportrait_eval.study import StudyConfig
from lfportrait_eval.tables import TablesConfig

PAGE = Path(__file__).resolve().parents[1] / "docs" / "parameters.md"

SECTIONS = [
    ("Calibrate", CalibrateConfig, "`lfportrait calibrate`; in `make`: `--calibrate.NAME`."),
    ("Reconstruct", ReconstructConfig,
     "`lfportrait reconstruct`; in `make`: `--reconstruct.NAME`."),
    ("Stylize", StylizeConfig, "`lfportrait stylize`; in `make`: `--stylize.NAME`."),
    ("Painting on the skin", SkinConfig, "`lfportrait stylize`: `--skin.NAME`."),
    ("ARF", ArfConfig, "`lfportrait stylize --method arf`: `--arf.NAME`."),
    ("StylizedNeRF", StylizedNerfConfig,
     "`lfportrait stylize --method stylized-nerf`: `--stylized-nerf.NAME`."),
    ("Ref-NPR", RefNprConfig, "`lfportrait stylize --method ref-npr`: `--ref-npr.NAME`."),
    ("Restyle", MixConfig, "`lfportrait restyle`."),
    ("Transfer by example", TransferConfig,
     "`lfportrait transfer`; in `stylize`: `--transfer.NAME`; in `make`: "
     "`--stylize.transfer.NAME`."),
    ("Look-up table", TableConfig, "In `transfer`: `--table.NAME`."),
    ("Synthesis (StyleBlit)", BlitConfig, "In `transfer`: `--blit.NAME`."),
    ("FaceBlit", FaceBlitConfig, "`lfportrait transfer --method faceblit`: `--faceblit.NAME`."),
    ("FaceStyle", FaceStyleConfig, "`lfportrait transfer --method facestyle`: `--facestyle.NAME`."),
    ("Network", NetworkConfig, "`lfportrait transfer --method network`: `--network.NAME`."),
    ("Export", ExportConfig, "`lfportrait export`."),
    ("Export for frames", FrameConfig,
     "`lfportrait export` to quilts, packages, pairs, videos ([frames](frames.md))."),
    ("Loop", LoopConfig,
     "`lfportrait export` to `NAME_loop.mp4`, `.webp`, `.gif`: `--loop.NAME` "
     "([messengers](frames.md#a-loop-for-messengers))."),
    ("Page", PageConfig,
     "`lfportrait export FIELD --out portrait.html`, `lfportrait view`; in `make`: `--page.NAME`."),
    ("Encode", EncodeConfig, "`lfportrait encode`; in `make`: `--encode.NAME`."),
    ("Encode with motion", SequenceConfig, "`lfportrait encode --frames N`."),
    ("Print", PrintConfig, "`lfportrait print` ([how](prints.md))."),
    ("Interlace", InterlaceConfig, "`lfportrait interlace`."),
    ("Tables", TablesConfig, "`lfportrait evaluate tables` ([what and how](comparisons.md))."),
    ("User study", StudyConfig, "`lfportrait study` ([how](user-study.md))."),
    ("Make", MakeConfig, "`lfportrait make`, besides the stages' own."),
    ("Batch", BatchConfig, "`lfportrait batch`, besides its file's ([batches](batches.md))."),
]

HEAD = """# Parameters

Written by `scripts/make_docs.py` from the configuration classes; don't edit this page.
`lfportrait COMMAND --help` shows the common ones, `lfportrait COMMAND --help-all` all of them.
"""


def field_docs(config: type) -> dict[str, str]:
    """The docstring below each field of a data class; those of its base classes come first."""
    docs: dict[str, str] = {}
    for above in reversed(config.__mro__):
        if dataclasses.is_dataclass(above):
            docs |= own_field_docs(above)
    return docs


def own_field_docs(config: type) -> dict[str, str]:
    """The docstrings of the fields that a data class names itself."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(config))).body[0]
    assert isinstance(tree, ast.ClassDef)
    docs, name = {}, ""
    for node in tree.body:
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            name = node.target.id
        elif (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
                and isinstance(node.value.value, str) and name):
            docs[name] = " ".join(node.value.value.split())
            name = ""
        else:
            name = ""
    return docs


def attribute_docs(owner: type) -> dict[str, str]:
    """The attributes that a docstring lists, several by one line where they share it."""
    text = inspect.cleandoc(owner.__doc__ or "").split("Attributes\n----------\n", 1)[1]
    docs: dict[str, str] = {}
    names: list[str] = []
    for line in text.splitlines():
        if line.startswith(" "):
            docs |= {name: f"{docs[name]} {line.strip()}" for name in names}
        else:
            shared, _, meaning = line.strip().partition(" : ")
            names = shared.split(", ")
            docs |= dict.fromkeys(names, meaning)
    return docs


def shown(value: object) -> str:
    """A default as one writes it on the command line."""
    if value is None:
        return "auto"
    if isinstance(value, (tuple, list)):
        return " ".join(map(shown, value)) or "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:g}" if isinstance(value, float) else str(value) or '""'


def written_type(config: type, name: str) -> str:
    """A field's type as its class has it; once tyro has read a class, the field has the type."""
    return next(str(vars(one)["__annotations__"][name]) for one in config.__mro__
                if name in vars(one).get("__annotations__", {}))


def rows_of(config: type, docs: dict[str, str], flags: bool) -> list[str]:
    """The table of one class; parameters that are classes themselves have their own section."""
    rows = ["| parameter | default | meaning |", "| --- | --- | --- |"]
    for entry in dataclasses.fields(config):
        if (entry.default_factory is not dataclasses.MISSING
                and dataclasses.is_dataclass(entry.default_factory())):
            continue
        default = ("required" if entry.default is dataclasses.MISSING
                   and entry.default_factory is dataclasses.MISSING
                   else f"`{shown(entry.default)}`")
        kind = written_type(config, entry.name)
        choice = ""
        if kind in ("tyro.conf.Suppress[tuple[Any, ...]]", "tyro.conf.Suppress[bool]"):  # no option
            continue
        if kind.startswith("Annotated[str, Choice("):
            hints = typing.get_type_hints(config, include_extras=True)
            options = hints[entry.name].__metadata__[0].choices
            choice = "One of " + ", ".join(f"`{option}`" for option in options) + ". "
        if kind.startswith("Literal["):
            options = ast.literal_eval(kind.removeprefix("Literal"))
            choice = "One of " + ", ".join(f"`{option}`" for option in options) + ". "
        name = entry.name
        if kind == "MadeFrom":  # an option of another name
            choices, option = typing.get_args(typing.get_type_hints(
                config, include_extras=True)[entry.name])
            choice = "One of " + ", ".join(
                f"`{one}`" for one in typing.get_args(choices)) + ". "
            name = option.name if flags else name
        name = f"--{name.replace('_', '-')}" if flags else name
        meaning = (choice + docs[entry.name]).replace("|", "\\|")
        rows.append(f"| `{name}` | {default} | {meaning} |")
    return rows


def page() -> str:
    """The whole page."""
    parts = [HEAD]
    for title, config, text in SECTIONS:
        summary = (config.__doc__ or "").split("\n\n")[0].strip()
        parts += [f"## {title}\n", f"{' '.join(summary.split())} {text}\n",
                  *rows_of(config, field_docs(config), True), ""]
    parts += ["## Display files (TOML)\n", "What `lfportrait display show NAME` prints; in a file, "
              "the slant may also be given in degrees, as `slant_degrees`.\n",
              *rows_of(Display, attribute_docs(Display), False), ""]
    return "\n".join(parts)


def main() -> int:
    if "--check" in sys.argv[1:]:
        same = PAGE.is_file() and PAGE.read_text("utf-8") == page()
        print(f"{PAGE.name} is {'up to date' if same else 'out of date: run make_docs.py'}")
        return 0 if same else 1
    PAGE.parent.mkdir(exist_ok=True)
    PAGE.write_text(page(), "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
