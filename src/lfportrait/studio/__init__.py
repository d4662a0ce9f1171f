"""The studio: a local page in the browser for people who paint and do not type.

`app` answers the page's requests, behind `guard`; `projects` are the sitters' folders, `uploads`
and `photos` fill the first screens, `jobs` runs what takes long, `previews` what must be there at
once, `styles`, `versions`, `displays` and `exports` are the other screens. All of these run in the
server's process, which imports neither torch nor Numba: the work itself is done by processes of
`work/`. The page is in `web/`.

It takes Starlette and uvicorn (``pip install 'lfportrait[studio]'``).
"""

from typing import TYPE_CHECKING

from ..lazy import attach

if TYPE_CHECKING:
    from .app import run

__all__ = ["run"]

__getattr__, __dir__ = attach(__name__, __file__)
