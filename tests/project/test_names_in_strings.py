"""What is called by its name in a string is there: modules that were moved are found out here."""

import ast
import importlib
import re
import tomllib

import pytest

from house import LABORATORY, ROOT, module_files
from lfportrait.cli.dispatch import COMMANDS

FILES = {**module_files(), **module_files(LABORATORY)}
ORDER = re.compile(r"([a-z_]\w*(?:\.\w+)*):([A-Za-z_]\w*)")
OTHERS = {"gpu:NAME", "numba:compile"}
"""Look like orders and are none: the choice of a device, and an event."""


def written_orders(name, path):
    """The orders ``module:function`` in a module, each with the constant that it begins with.

    What a function adds to the end of one when it runs is left out, with the colon before it.
    """
    text = path.read_text("utf-8")
    # An order ends its string, or something is put into what follows the colon.
    waiting = [ast.parse(text)] if re.search(r"[\w}]:(?:[A-Za-z_]\w*)?[\"'{]", text) else []
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.JoinedStr):
            first, *rest = node.values
            if isinstance(first, ast.FormattedValue) and isinstance(first.value, ast.Name):
                base = getattr(importlib.import_module(name), first.value.id, None)
                end = rest[0].value if rest and isinstance(rest[0], ast.Constant) else ""
                if str(base).startswith("lfportrait") and ":" in end:
                    yield f"{base}{end}".rstrip(":")
            continue
        if (isinstance(node, ast.Constant) and isinstance(node.value, str)
                and ORDER.fullmatch(node.value) and node.value not in OTHERS):
            yield node.value
        waiting += ast.iter_child_nodes(node)


def resolved(order, package):
    """What an order stands for; its module may be named from a package on."""
    module, _, function = order.partition(":")
    if not module.startswith("lfportrait"):
        module = f"{package}.{module}"
    found = importlib.import_module(module)
    return getattr(found, function) if function else found


def lost_orders(files):
    """Orders that lead nowhere, and how many there are in all."""
    lost, count = [], 0
    for name, path in files.items():
        package = name if path.name == "__init__.py" else name.rpartition(".")[0]
        for order in written_orders(name, path):
            count += 1
            try:
                resolved(order, package)
            except (ImportError, AttributeError) as error:
                lost.append(f"{name} names {order}: {error}")
    return lost, count


def test_every_order_by_name_finds_its_function():
    lost, count = lost_orders(FILES)
    assert lost == [] and count > 25


@pytest.mark.parametrize("text", [
    'writer = "frames.export:write_nothing"', 'writer = "nowhere.export:write_pair"',
    'call("lfportrait.gpu:nothing")', 'call(f"{_STAGE}.nowhere:upload")',
    'call(f"{_STAGE}.atlas:nothing")', 'call(f"{_STAGE}.nowhere:{name}")'])
def test_an_order_that_leads_nowhere_is_found(tmp_path, text):
    module = "lfportrait.field.gpu.atlas" if "_STAGE" in text else "lfportrait.share.kinds"
    (tmp_path / "kinds.py").write_text(text)
    lost, count = lost_orders({module: tmp_path / "kinds.py"})
    assert count == 1 and len(lost) == 1


def test_every_command_and_entry_point_is_there():
    for module, name, _ in COMMANDS.values():
        resolved(f"{module}:{name}", "" if "." in module else "lfportrait.cli")
    for folder in (ROOT, LABORATORY):
        project = tomllib.loads((folder / "pyproject.toml").read_text("utf-8"))["project"]
        groups = [project.get("scripts", {}), *project.get("entry-points", {}).values()]
        for order in [order for group in groups for order in group.values()]:
            resolved(order, "")
