"""The studio: a local page in the browser for people who paint and do not type.

`app` answers the page's requests, behind a guard; `projects` are the sitters' folders, `photos`
fills the first screens, `jobs` runs what takes long, `previews` what must be there at
once, `styles`, `versions`, `displays` and `exports` are the other screens. All of these run in the
server's process, which imports neither torch nor Numba: the work itself is done by processes of
`work/`. The page is in `web/`.

It takes Starlette and uvicorn (``pip install 'lfportrait[studio]'``).
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
