"""A session: a head that stays in memory to try styles on it (docs/examples/style.md).

A first preview reads field and surface, prepares a painting and lays out the lattice; after that a
new painting takes under a second and a mixture hundredths.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..arrays import UInt8
from ..cache import user_cache
from ..capture import Capture
from ..demo import HEAD, demo_capture, demo_head
from ..errors import UserError
from ..example import Exemplar, Skin
from ..field import VoxelField
from ..files import file_state
from ..lightfield import Display, encode
from ..progress import Progress
from ..stylize import (
    NearbyPainters,
    Painters,
    StyledField,
    StylizeConfig,
    kept_skin,
    stylize_with_figures,
)

_EXEMPLARS = 16  # Paintings that are kept.


class Session:
    """A field, its surface and its painters, kept from one style to the next.

    Parameters
    ----------
    field : The real field, or its file; beside a file the surface is kept (`kept_skin`).
    capture : Its capture, or the capture's folder.
    config : Parameters of all styles, unless a call brings its own.
    painters : What keeps prepared paintings, a hundred MB each; by default eight of them.

    Attributes
    ----------
    field, capture, config : As above.
    shown : The last stylised or mixed field, or None.
    figures : Of the last stylisation.

    Raises
    ------
    UserError : If a file can't be read, or the capture has no landmarks.
    """

    def __init__(self, field: VoxelField | str | Path, capture: Capture | str | Path,
                 config: StylizeConfig | None = None, painters: Painters | None = None) -> None:
        self.config = config or StylizeConfig()
        self.config.check()
        self.capture = capture if isinstance(capture, Capture) else Capture.load(capture)
        self.field = field if isinstance(field, VoxelField) else VoxelField.load(field)
        self.shown: StyledField | None = None
        self.figures: dict[str, Any] = {}
        self._file = None if isinstance(field, VoxelField) else Path(field)
        self._skins: dict[float, Skin] = {}
        self._painters = painters or Painters()
        self._tried = NearbyPainters(self._painters)
        self._exemplars: dict[tuple[str, tuple[int, ...] | None], Exemplar] = {}
        if self.capture.landmarks is None:
            raise UserError("the capture has no facial landmarks; run `lfportrait calibrate` on "
                            "the photos")

    def preview(self, style: str | Path | Exemplar, config: StylizeConfig | None = None, *,
                keep: bool = True) -> StyledField:
        """The field in a style at half the resolution, without fit and refinement."""
        return self.stylize(style, replace(config or self.config, preview=True), keep=keep)

    def preview_all(self, styles: Sequence[str | Path | Exemplar],
                    config: StylizeConfig | None = None) -> StyledField:
        """A preview in several styles at once, for mixes of them; it shows the first."""
        return self.stylize(styles, replace(config or self.config, preview=True))

    def stylize(self, style: str | Path | Exemplar | Sequence[str | Path | Exemplar],
                config: StylizeConfig | None = None, progress: Progress | None = None, *,
                keep: bool = True) -> StyledField:
        """The field in a style.

        Parameters
        ----------
        style : A picture's path, a built-in style's name, an `Exemplar`, or several of these:
            the field shows the first.
        config : Parameters; by default the session's.
        progress : Progress line.
        keep : Keep the prepared painting, for the next time; not of one that is only tried: for
            a preview of that what its landmarks were before may serve, if they lie close by
            (`NearbyPainters`).

        Raises
        ------
        UserError : As `lfportrait.stylize`.
        """
        config = config or self.config
        skin = self.skin(config.pixels) if config.on_skin else None
        styles = [style] if isinstance(style, (str, Path, Exemplar)) else style
        tried = self._tried if config.preview else Painters()
        self.shown, self.figures = stylize_with_figures(
            self.field, self.capture, [self.exemplar(one) for one in styles], config, progress,
            skin=skin, painters=self._painters if keep else tried)
        return self.shown

    def mix(self, **choices: Any) -> StyledField:
        """Change the mix of photo and painting of the shown field (`StyledField.mix`).

        Raises
        ------
        UserError : If nothing is shown yet, or a choice makes no sense.
        """
        self.shown = self._shown().mix(**choices)
        return self.shown

    def encode(self, display: Any, config: Any = None) -> UInt8:
        """The shown field, coded for a display: uint8 [H, W, 3].

        Parameters
        ----------
        display : A `Display`, a preset's name, or a display or calibration file.
        config : `lfportrait.lightfield.EncodeConfig`.
        """
        panel = display if isinstance(display, Display) else Display.resolve(display)
        return encode(self._shown(), panel, config)

    def exemplar(self, style: str | Path | Exemplar) -> Exemplar:
        """A painting, read once; a file that changed is read again."""
        if isinstance(style, Exemplar):
            return style
        path = Path(style)
        key = str(style), file_state(path) if path.is_file() else None
        if key not in self._exemplars:
            self._exemplars[key] = Exemplar.load(style)
            while len(self._exemplars) > _EXEMPLARS:
                del self._exemplars[next(iter(self._exemplars))]
        return self._exemplars[key]

    def skin(self, pixels: float) -> Skin:
        """The head's surface at ``pixels`` per world unit."""
        if pixels not in self._skins:
            assert self.capture.landmarks is not None
            self._skins[pixels] = (
                Skin.of(self.field, self.capture.landmarks, self.capture.cameras, pixels)
                if self._file is None else
                kept_skin(self._file, self.field, self.capture, pixels))
        return self._skins[pixels]

    def _shown(self) -> StyledField:
        if self.shown is None:
            raise UserError("nothing is stylised yet; call preview or stylize first")
        return self.shown


def preview_head(pixels: float, cache: Path | None = None) -> tuple[VoxelField, Capture, Skin]:
    """The embedded head, its capture of 12 small photos, and its skin, ``pixels`` a world unit.

    The skin is kept in ``cache``, by default the user's. If nothing can be written there, it is
    drawn each time.
    """
    field, capture = demo_head(), demo_capture(size=256, views=12)
    kept = (cache or user_cache("heads")) / "embedded.skin.npz"
    return field, capture, kept_skin(HEAD, field, capture, pixels, kept)
