"""The command ``studio``: the local page in the browser."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import UserError
from .common import Common


@dataclass
class Studio(Common):
    """Open the studio in the browser: photos, making, styles, mixes, panels and exports.

    A page on this machine alone, for people who paint and do not type. Its projects are folders
    that the other commands read. Ctrl-C ends it; what was being made goes on the next time.
    """

    folder: Path = Path("portraits")
    """Folder of the projects, one folder a sitter; made if it does not exist."""
    port: int = 0
    """Port on the loopback address; by default a free one."""
    browser: bool = True
    """Open the browser; otherwise only print the address."""

    def run(self) -> dict[str, Any]:
        """Serve until it is ended."""
        try:
            from ..studio import run
        except ModuleNotFoundError as error:
            package = (error.name or "").partition(".")[0]
            if package not in ("starlette", "uvicorn"):
                raise
            raise UserError(f"the studio needs {package}: pip install "
                            "'lfportrait[studio]'") from error
        run(self.folder, self.port, browse=self.browser, quiet=self.quiet)
        return {"folder": self.folder}
