"""Stylised fields whose strength and style can be changed, also per region, without training.

Density is the same for the photo and for every painting: only the color of each lattice row
differs. What is shown is mixed from them, row by row, in a fraction of a second.

The file is a field's (`lfportrait.field.storage`), with the mixed colors as its own: svox2 and all
commands that take a field show the mix. Beside them stand ``painted`` and ``photo`` as uint8,
rounded by at most half of a level of an 8-bit picture, and the same at each further saving.
``painted_texels`` hold the textures (`lfportrait.field.SurfaceTexture`) of all styles where the mix
shows anything else than the first.

Colors are planes, float32 [3, ...], sRGB in [0, 1]. Luma is Rec. 601's, and chroma the difference
of a color from the grey of its luma. A texture holds differences, so that a share of a painting
takes the same share of its texture; what takes the painting's luma away takes that of its texture.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import tyro

from ..arrays import Array, Float32, Float64, Int8, Int32, UInt8
from ..color import LUMA, to_uint8
from ..errors import UserError
from ..field import C0, SurfaceTexture, VoxelField, read_arrays, save_field
from ..labels import (
    PICTURE_LABELS,
    RegionStyle,
    RegionValue,
    members,
    number,
    one_of,
    read_regions,
    read_value,
)

BINS = 1024
"""Bins of a histogram of luma; matched values are finer, as they are interpolated in it."""


def luma(planes: Float32) -> Float32:
    """Rec. 601 luma of colors [3, ...], float32 [...]."""
    red, green, blue = LUMA
    return red * planes[0] + green * planes[1] + blue * planes[2]


def tone_histogram(values: Float32, weights: Float32) -> Float64:
    """Weighted histogram of values in [0, 1], float64 [BINS]."""
    index = np.minimum((values * np.float32(BINS)).astype(np.int32), BINS - 1)
    return np.asarray(np.bincount(index, weights, BINS), np.float64)


def matching_curve(source: Float64, target: Float64) -> Float32:
    """The rising curve that gives values of one `tone_histogram` the distribution of another.

    float32 [BINS], for `toned`: what values at the middle of each bin become; the values themselves
    where one of the histograms is empty.
    """
    middles = (np.arange(BINS) + 0.5) / BINS
    if source.sum() <= 0 or target.sum() <= 0:
        return middles.astype(np.float32)
    # A bin stands for the middle of its share: many equal values get the median of the tones that
    # they take up, not the darkest of them.
    ranks = (np.cumsum(source) - 0.5 * source) / source.sum()
    below = np.concatenate([[0.0], np.cumsum(target) / target.sum()])
    wanted = np.interp(ranks, below, np.arange(BINS + 1) / BINS)
    # Empty bins say nothing of their own; what lies at a full one's edge leans on them, though.
    held = source > 0
    return np.interp(middles, middles[held], wanted[held]).astype(np.float32)


def toned(values: Float32, curve: Float32) -> Float32:
    """Values in [0, 1] by a curve of `matching_curve`, linear between its points."""
    place = np.clip(values * np.float32(BINS) - np.float32(0.5), 0, BINS - 1)
    index = np.minimum(place.astype(np.int32), BINS - 2)
    return curve[index] + (place - index.astype(np.float32)) * np.diff(curve)[index]


def colored(light: Float32, chroma: Float32) -> Float32:
    """Colors, float32 [3, ...] in [0, 1], of a luma [...] and of chroma, colors less it, [3, ...].

    Chroma that leads out of the range of colors is drawn in, all channels alike: unlike clipping
    each for itself this keeps the luma and the hue.
    """
    least = np.float32(1e-6)
    up = np.maximum(np.maximum(chroma[0], chroma[1]), chroma[2])
    down = np.minimum(np.minimum(chroma[0], chroma[1]), chroma[2])
    share = np.minimum((1 - light) / np.maximum(up, least), light / np.maximum(-down, least))
    return np.clip(light + np.minimum(share, np.float32(1)) * chroma, 0, 1)

BLOCK = 4  # Texels across a block, which takes its shares in a mix from one lattice row.
_BAND = 32  # Rows of blocks mixed at a time.


def mixed_texels(texels: Int8, rows: Int32, amounts: Mapping[int, Any],
                 identity: float = 0.0, luma_alone: bool = False) -> Int8:
    """Texels of a mix, int8 [H, W, 3], of S styles' at full strength, int8 [S, H, W, 3].

    ``rows`` are int32 [H / 4, W / 4], rounded up: the lattice row of each block; ``amounts`` how
    much of each style, by its number: a number, or one a row. ``identity`` is the share of the luma
    that gives way to the photo's; ``luma_alone`` leaves out all chroma.
    """
    used = {n: amount for n, amount in amounts.items() if np.any(amount)}
    if len(used) == 1 and identity == 0 and not luma_alone:
        [(n, amount)] = used.items()
        if np.all(amount == 1):
            return texels[n]
    out = np.zeros(texels.shape[1:], np.int8)
    for first in range(0, len(rows), _BAND):
        band = slice(BLOCK * first, BLOCK * (first + _BAND))
        mixed = np.zeros(out[band].shape, np.float32)
        for n, amount in used.items():
            mixed += _shares(amount, rows[first:first + _BAND], mixed.shape) * texels[n, band]
        if identity > 0 or luma_alone:
            light = (mixed @ LUMA)[..., None]
            kept = np.float32(1 - identity) * light
            mixed = np.broadcast_to(kept, mixed.shape) if luma_alone else mixed - light + kept
        out[band] = np.clip(np.rint(mixed), -127, 127)
    return out


def _shares(amount: Any, rows: Int32, shape: tuple[int, ...]) -> Any:
    """A number, or what texels [H, W, ...] take by the rows of their blocks, float32 [H, W, 1]."""
    if np.ndim(amount) == 0:
        return np.float32(amount)
    share = np.asarray(amount, np.float32)[rows].repeat(BLOCK, 0).repeat(BLOCK, 1)
    return share[:shape[0], :shape[1], None]

_Words = tyro.conf.UseAppendAction[tuple[tuple[str, ...], ...]]
"""Words of an option that may be given several times, and several words at a time."""


@dataclass(frozen=True)
class MixConfig:
    """Mix of the photo's and the paintings' colors in a stylised field."""

    strength: float = 1.0
    """0 leaves the photo's colors, 1 gives the painting's."""
    identity: float = 0.0
    """Share of the photo's own light and shade in the painting, with the painting's tones and
    colors: 0 (none) to 1."""
    region: _Words = ()
    """Strength or style of one region: NAME=NUMBER multiplies its strength (0 keeps the
    photo, above 1 exaggerates, 4 at most), NAME=STYLE or NAME=STYLE:NUMBER paints it in another
    style of the file, e.g. hair=2 lips=0.5; where regions overlap, the last one wins."""
    style: str = ""
    """Style of all other regions; by default the first in the file."""
    keep_colors: bool = False
    """Keep the photo's colors: use only light and shade of the painting."""
    keep: _Words = ()
    """Regions that stay as in the photo, e.g. eyes lips."""

    def arguments(self) -> dict[str, Any]:
        """The same as arguments of `StyledField.mix`.

        Raises `UserError` if a region is not of the form NAME=VALUE.
        """
        regions: dict[str, RegionValue] = dict(read_regions(self.region))
        return {"strength": self.strength, "identity": self.identity, "regions": regions,
                "keep_colors": self.keep_colors, "style": self.style or None,
                "keep": tuple(name for words in self.keep for name in words)}


def plain(choices: Mapping[str, RegionStyle]) -> dict[str, Any]:
    """Choices as `StyledField.mix` takes them and a JSON file holds them."""
    return {name: [choice.style, choice.strength] if choice.style else choice.strength
            for name, choice in choices.items()}


_BLOCK = 32768
"""Rows mixed at a time: few enough that all that is computed for them stays in the cache."""
_KEYS = ("style_names", "painted", "photo", "labels", "region_names", "mix")
_TEXTURE_KEYS = ("texel_rows", "painted_texels")


@dataclass(kw_only=True)
class StyledField(VoxelField):
    """A field with photographed and painted colors that shows a mix of them.

    Attributes
    ----------
    painted : float32 [S, N, 3], sRGB in [0, 1]: colors of the lattice rows in each of S styles,
        at full strength, the same from all sides.
    styles : Names of the S styles.
    photo : float32 [N, 3], sRGB in [0, 1]: the real field's mean colors.
    labels : uint8 [N, R], how far a row lies in each of R regions; 255 is wholly inside.
    regions : Names of the R regions.
    mixture : The arguments of `mix` that `sh` was made with.
    painted_texels : int8 [S, H, W, 3], the texture's texels in each style at full strength, or
        None.
    texel_rows : int32 [H / 4, W / 4], rounded up: the lattice row whose shares in a mix a block
        of 4x4 texels takes; or None.
    """

    painted: Float32
    styles: tuple[str, ...]
    photo: Float32
    labels: UInt8
    regions: tuple[str, ...]
    mixture: dict[str, Any] = field(default_factory=dict)
    painted_texels: Int8 | None = None
    texel_rows: Int32 | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        count = len(self.density)
        if not self.styles or len({*self.styles}) < len(self.styles) or (
                self.painted.shape != (len(self.styles), count, 3)):
            raise ValueError(f"{count} rows in the styles {self.styles} need one name for each and "
                             f"colors [S, N, 3], not {self.painted.shape}")
        if self.photo.shape != (count, 3):
            raise ValueError(f"{count} rows need colors [N, 3] of the photo, "
                             f"not {self.photo.shape}")
        if (self.labels.shape != (count, len(self.regions)) or self.labels.dtype != np.uint8
                or len({*self.regions}) < len(self.regions)):
            raise ValueError(f"{count} rows in the regions {self.regions} need one name for each "
                             f"and labels uint8 [N, R], not {self.labels.dtype} "
                             f"{self.labels.shape}")
        if self.painted_texels is not None:
            self._check_texels(self.painted_texels)

    def _check_texels(self, texels: Int8) -> None:
        """Raise ValueError if texels, texture and rows do not fit together."""
        rows = self.texel_rows
        shape = None if self.texture is None else self.texture.texels.shape
        if (rows is None or shape is None or texels.dtype != np.int8
                or texels.shape != (len(self.styles), *shape) or rows.dtype.kind != "i"
                or rows.shape != (-(-shape[0] // 4), -(-shape[1] // 4))
                or rows.min(initial=0) < 0 or rows.max(initial=0) >= len(self.density)):
            raise ValueError("a textured field needs texels int8 [S, H, W, 3] of its texture's "
                             "size, and a row for each block of 4x4 of them")

    @staticmethod
    def of(real: VoxelField, painted: Array, styles: Collection[str], photo: Array,
           labels: UInt8, regions: Collection[str] | None = None,
           textures: Sequence[SurfaceTexture] = (), texel_rows: Int32 | None = None) -> StyledField:
        """A field that shows its first style at full strength.

        Parameters
        ----------
        real : The field, with which densities, cube and background are shared.
        painted, styles, photo, labels, regions : As the attributes; colors are clipped to [0,
            1]. By default the regions are `lfportrait.labels.PICTURE_LABELS`.
        textures, texel_rows : One texture for each style, all of the same places, and the
            attribute of that name; or neither.

        Raises
        ------
        UserError : If two styles have one name.
        ValueError : If the arrays do not fit together, or hold values that are not finite.
        """
        if regions is None:
            regions = PICTURE_LABELS
        twice = sorted({name for name in styles if list(styles).count(name) > 1})
        if twice:
            raise UserError(f"two styles have the name {twice[0]}: rename one of the pictures")
        if not (np.isfinite(painted).all() and np.isfinite(photo).all()):
            raise ValueError("the colors of a styled field must be finite")
        styled = StyledField(
            real.links, real.density, np.zeros((len(real.density), 3, 1), np.float32), real.center,
            real.radius, real.frame, real.background, textures[0] if textures else None,
            painted=np.clip(painted, 0.0, 1.0).astype(np.float32), styles=tuple(styles),
            photo=np.clip(photo, 0.0, 1.0).astype(np.float32), labels=labels,
            regions=tuple(regions), texel_rows=texel_rows, cone=real.cone,
            painted_texels=np.stack([one.texels for one in textures]) if textures else None)
        styled.take_lattice(real)
        return styled.mix()

    def mix(self, strength: float = 1.0, identity: float = 0.0,
            regions: Mapping[str, RegionValue] | None = None, keep_colors: bool = False,
            keep: Collection[str] = (), style: str | None = None) -> StyledField:
        """The field in other colors, always from the photo and the paintings, whatever it shows.

        Parameters
        ----------
        strength : 0 leaves the photo's colors, 1 gives the painting's; linear between.
        identity : 0 to 1: so much of the painting's luma gives way to the photo's, which a
            rising curve has given the distribution of the painting's (rows count by their
            opacity). Light and shade are then the person's, tones and chroma the painting's.
        regions : What regions get: a number that multiplies the strength in it, the name of
            another style, or both, as a pair or as text (``"STYLE:0.5"``). Numbers above 1, up
            to 4, go on beyond the painting, away from the photo, and are clipped to [0, 1].
            Regions are mixed by their soft labels; where they overlap, the later one counts.
        keep_colors : Take the luma of all this alone, with the photo's chroma.
        keep : Regions that stay as in the photo, whatever else is said of them.
        style : Style of everything else; None takes the first.

        Returns
        -------
        styled : A field with other `sh`, degree 0; everything else is shared.

        Raises
        ------
        UserError : If a region or a style is unknown, or a number out of range.
        """
        strength = number(strength, "the strength", 1.0)
        identity = number(identity, "the identity", 1.0)
        style = self.styles[0] if style is None else one_of(style, "style", self.styles)
        kept = (keep,) if isinstance(keep, str) else tuple(keep)
        for name in (*kept, *(regions or ())):
            members(name, self.regions)
        choices = {name: read_value(name, value, self.styles)
                   for name, value in (regions or {}).items()}
        mixture = {"strength": strength, "identity": identity, "regions": plain(choices),
                   "keep_colors": bool(keep_colors), "keep": list(kept), "style": style}
        wanted = [*choices.values(), *(RegionStyle(name, "", 0.0) for name in kept)]
        curves = self._curves({style, *(choice.style or style for choice in wanted)}
                              if identity > 0 else set())
        coefficients = np.empty((len(self.density), 3, 1), np.float32)
        for start in range(0, len(coefficients), _BLOCK):
            rows = slice(start, start + _BLOCK)
            photo = np.ascontiguousarray(self.photo[rows].T)
            mixed = photo.copy()
            for name, amount in self._amounts(rows, wanted, style, strength).items():
                mixed += amount * (self._painting(rows, name, photo, curves.get(name), identity)
                                   - photo)
            np.clip(mixed, 0, 1, out=mixed)
            if keep_colors:
                mixed = colored(luma(mixed), photo - luma(photo))
            coefficients[rows, :, 0] = ((mixed - np.float32(0.5)) * np.float32(1 / C0)).T
        mixed_field = replace(
            self, sh=coefficients, mixture=mixture, texture=self._mixed_texture(
                self._amounts(slice(None), wanted, style, strength), identity, keep_colors))
        mixed_field.take_lattice(self)
        return mixed_field

    def _mixed_texture(self, amounts: Mapping[str, Any], identity: float,
                       keep_colors: bool) -> SurfaceTexture | None:
        """The texture by so much of each style, one number or one for each row."""
        if self.texture is None or self.painted_texels is None or self.texel_rows is None:
            return None
        numbers = {self.styles.index(name): amount for name, amount in amounts.items()}
        return self.texture.with_texels(mixed_texels(
            self.painted_texels, self.texel_rows, numbers, identity, keep_colors))

    def _amounts(self, rows: slice, choices: list[RegionStyle], style: str, strength: float,
                 ) -> dict[str, Any]:
        """How much each style changes rows: a number, or one for each row."""
        amounts: dict[str, Any] = {}
        room: Any = np.float32(1)
        # The last has its whole label, the ones before it what is left. At the seam of two regions
        # their labels add up to 1, and nothing of what the rest of the field gets shows there.
        for choice in reversed(choices):
            parts = [self.regions.index(name) for name in members(choice.region, self.regions)]
            label = self.labels[rows, parts[0]] if len(parts) == 1 else (
                self.labels[rows][:, parts].sum(axis=1, dtype=np.int32))
            share = np.minimum(label * np.float32(1 / 255), room)
            room = room - share
            name = choice.style or style
            amounts[name] = amounts.get(name, 0) + np.float32(strength * choice.strength) * share
        amounts[style] = amounts.get(style, 0) + np.float32(strength) * room
        return amounts

    def _painting(self, rows: slice, style: str, photo: Float32, curve: Float32 | None,
                  identity: float) -> Float32:
        """Rows in a style, shaded by the photo: float32 [3, rows]."""
        painted = np.ascontiguousarray(self.painted[self.styles.index(style), rows].T)
        if curve is None:
            return painted
        light = luma(painted)
        shaded = light + np.float32(identity) * (toned(luma(photo), curve) - light)
        return colored(shaded, painted - light)

    def _curves(self, styles: Collection[str]) -> dict[str, Float32]:
        """The curve that gives the photo's luma the distribution of each style's."""
        if not styles:
            return {}
        # Light taken by a step of one voxel: rows of thin air have colors that nobody sees.
        voxel = float((2.0 * self.radius / self.links.shape[::-1]).mean())
        photo = np.zeros(BINS)
        paintings = {name: np.zeros(BINS) for name in styles}
        for start in range(0, len(self.density), _BLOCK):
            rows = slice(start, start + _BLOCK)
            opacity = -np.expm1(np.maximum(self.density[rows], 0.0) * np.float32(-voxel))
            photo += tone_histogram(luma(self.photo[rows].T), opacity)
            for name, histogram in paintings.items():
                colors = self.painted[self.styles.index(name), rows]
                histogram += tone_histogram(luma(colors.T), opacity)
        return {name: matching_curve(photo, histogram) for name, histogram in paintings.items()}

    def save(self, path: Any) -> None:
        """Write the field with all its styles as an ``.npz`` that svox2 reads, too.

        Parameters
        ----------
        path : File name, ending in ``.npz``.

        Raises
        ------
        UserError : If the file has another ending or can't be written.
        """
        more: dict[str, Any] = {}
        if self.texture is not None and self.painted_texels is not None:
            more["texel_rows"] = self.texel_rows
            # A single painting as it is stands in the field's texture already.
            if len(self.styles) > 1 or not np.array_equal(self.painted_texels[0],
                                                          self.texture.texels):
                more["painted_texels"] = self.painted_texels
        save_field(self, path, deflated=("labels", "painted", "photo", *more), **more,
                   style_names=np.array(self.styles, np.str_),
                   painted=to_uint8(self.painted), photo=to_uint8(self.photo), labels=self.labels,
                   region_names=np.array(self.regions, np.str_),
                   mix=np.str_(json.dumps(self.mixture, ensure_ascii=False)))

    @staticmethod
    def load(path: Any, shown: VoxelField | None = None) -> StyledField:
        """Read a field that `save` wrote.

        Parameters
        ----------
        path : The file.
        shown : The same file as `VoxelField.load` reads it, where it has been read already.

        Raises
        ------
        UserError : If the file is missing, damaged, or a field without colors to mix.
        """
        plain_field = VoxelField.load(path) if shown is None else shown
        arrays = read_arrays(path, (*_KEYS, *_TEXTURE_KEYS))
        texture, rows = plain_field.texture, arrays.get("texel_rows")
        texels = arrays.get("painted_texels")
        if texels is None and texture is not None and rows is not None:
            texels = texture.texels[None]
        if "painted" not in arrays:
            raise UserError(f"{path} holds no colors to mix: it was not written by this version's "
                            "`lfportrait stylize`; run that again")
        missing = [name for name in _KEYS if name not in arrays]
        if missing:
            raise UserError(f"{path} is damaged: it has no {', '.join(missing)}")
        wrong = [name for name in ("painted", "photo", "labels") if arrays[name].dtype != np.uint8]
        wrong += [name for name in ("style_names", "region_names", "mix")
                  if arrays[name].dtype.kind != "U"]
        if wrong:
            raise UserError(f"{path} is damaged: {', '.join(wrong)} can't be of the type "
                            f"{', '.join(str(arrays[name].dtype) for name in wrong)}")
        try:
            mixture = json.loads(str(arrays["mix"]))
            if not isinstance(mixture, dict):
                raise ValueError("it does not record what it was mixed from")
            styled = StyledField(
                plain_field.links, plain_field.density, plain_field.sh, plain_field.center,
                plain_field.radius, plain_field.frame, plain_field.background, texture,
                plain_field.backdrop, plain_field.cone,
                painted=_floats(arrays["painted"]), photo=_floats(arrays["photo"]),
                styles=tuple(map(str, arrays["style_names"].ravel())), labels=arrays["labels"],
                regions=tuple(map(str, arrays["region_names"].ravel())), mixture=mixture,
                painted_texels=texels, texel_rows=rows)
        except ValueError as error:
            raise UserError(f"{path} is damaged: {error}") from error
        styled.take_layouts(plain_field)
        return styled


def load_styled(path: Any, shown: VoxelField | None = None) -> VoxelField:
    """Read a field with all its colors, where it has any to mix: else it is a plain `VoxelField`.

    ``shown`` is the same file as `VoxelField.load` reads it, where it has been read already; what
    is laid out of it is used. Raises `UserError` if the file is missing, damaged or not a field.
    """
    plain_field = VoxelField.load(path) if shown is None else shown
    mixable = "painted" in read_arrays(path, ("painted",))
    return StyledField.load(path, plain_field) if mixable else plain_field


def _floats(colors: UInt8) -> Float32:
    """The inverse of `to_uint8`."""
    return np.divide(colors, np.float32(255), dtype=np.float32)
