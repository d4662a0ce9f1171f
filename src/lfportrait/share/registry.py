"""The one list of all kinds of export: ours, and those of other packages."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import UserError
from ..plugins import blamed, gathered
from .config import ExportConfig
from .exporter import Export, ExportContext
from .kinds import KINDS

if TYPE_CHECKING:
    from ..field import VoxelField

__all__ = ["EXPORTS", "export_field", "export_of", "exports", "own_exports"]

EXPORTS = "lfportrait.exports"
"""Group of entry points with classes above `Export`."""


def exports() -> dict[str, Export]:
    """All kinds of export by their names, in the order in which they are shown.

    Those of other packages are the last; a broken one is left out with a warning.
    """
    return gathered(EXPORTS, Export, KINDS)  # type: ignore[type-abstract]


def own_exports() -> list[Export]:
    """Our own kinds alone: entry points take a while to read."""
    return [kind() for kind in KINDS]


def export_of(path: Path, kind: str = "auto") -> Export:
    """The kind of export that a file's name asks for, or of ``kind`` (`Export.contents`).

    Raises
    ------
    UserError
        If nothing is written under such a name, or not of this kind.
    """
    known = [one for one in exports().values() if one.command == "export"]
    suffix, name = path.suffix.lower(), path.name
    if kind != "auto":
        alike = [one for one in known if kind in (one.kind, one.name)]
        if not alike:
            raise UserError(f"there is no kind {kind!r}; the kinds are "
                            f"{', '.join(dict.fromkeys(one.kind for one in known))}")
        fitting = [one for one in alike if suffix in one.written]
        if not fitting:
            all_of = " or ".join(dict.fromkeys(end for one in alike for end in one.written))
            raise UserError(f"{kind} {'are' if kind.endswith('s') else 'is'} written as {all_of}, "
                            f"not {suffix or name}")
        return fitting[0]
    claims = {}
    for one in known:
        with blamed(one):
            claims[one] = one.claim(path)
    best = max(known, key=claims.__getitem__)
    if claims[best]:
        return best
    marks = [f"{one.mark} ({one.title})" for one in known if one.mark and suffix in one.written]
    if marks:
        raise UserError(f"can't tell what {name} is to hold: end the name in {', '.join(marks)}")
    ends = list(dict.fromkeys(end for one in known for end in one.written))
    raise UserError(f"can't export to {name}: its name must end in {', '.join(ends[:-1])} or "
                    f"{ends[-1]}; lfportrait formats lists what they hold")


def export_field(field: VoxelField, path: Path, parameters: Any = None,
                 context: ExportContext | None = None) -> dict[str, Any]:
    """Write a field as the kind of file that its name asks for.

    Parameters
    ----------
    field, path
        The field and the file (`lfportrait formats` lists the names).
    parameters
        `ExportConfig`, whose ``kind`` may say what a 3D file is to hold; `FrameConfig`,
        `PageConfig`, or what another kind has.
    context
        Placement, display and progress.

    Returns
    -------
    figures
        ``kind``, ``bytes`` of the file with those beside it, ``out``, and what belongs to the kind:
        ``points``, ``faces``, ``splats`` and their ``psnr``, ``views``, ``parallax_percent``.

    Raises
    ------
    UserError
        If the name asks for nothing known, or the parameters do not go with it.
    """
    export = export_of(path, parameters.kind if isinstance(parameters, ExportConfig) else "auto")
    if parameters is not None and not isinstance(parameters, export.parameters):
        raise TypeError(f"{path.name} takes {export.parameters.__name__}, "
                        f"not {type(parameters).__name__}")
    return export.make(field, path, parameters, context)
