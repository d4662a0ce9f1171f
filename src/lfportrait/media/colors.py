"""What the numbers of a picture mean: every picture becomes eight-bit sRGB.

Phones photograph in Display P3, cameras in Adobe RGB, printers' files are CMYK or LAB. A file says
so in one of several ways; the first that it has counts:

1. PNG's ``cICP`` chunk;
2. an ICC profile (relative colorimetric, by LittleCMS);
3. the numbers of HEIC's and AVIF's ``nclx`` box: primaries and transfer (ITU-T H.273);
4. PNG's ``sRGB``, or ``gAMA`` and ``cHRM`` chunks;
5. EXIF's note for Adobe RGB: ``ColorSpace`` 65535 with the interoperability index ``R03`` (DCF
   2.0), or ``ColorSpace`` 2, as some cameras have it.

Everything else is sRGB. Sixteen bits a channel and floating-point numbers become eight bits, not
black or white.
"""

import contextlib
import io
import os
import warnings
from dataclasses import dataclass, field, replace
from typing import Any, BinaryIO

import numpy as np
from PIL import Image, ImageOps

from .. import color
from ..arrays import Float32, Float64, UInt8, UInt16

_PROFILED = ("L", "RGB", "CMYK", "LAB")  # Pillow's modes that LittleCMS converts.
_D65, _DCI_WHITE, _C = (0.3127, 0.3290), (0.314, 0.351), (0.310, 0.316)
_P3 = (0.680, 0.320, 0.265, 0.690, 0.150, 0.060)
_ADOBE = (0.640, 0.330, 0.210, 0.710, 0.150, 0.060, *_D65)
_PRIMARIES: dict[int, tuple[float, ...]] = {
    4: (0.67, 0.33, 0.21, 0.71, 0.14, 0.08, *_C),
    8: (0.681, 0.319, 0.243, 0.692, 0.145, 0.049, *_C),
    9: color.BT2020, 11: (*_P3, *_DCI_WHITE), 12: (*_P3, *_D65)}
"""By the number of ITU-T H.273, where they differ from sRGB's by more than players heed."""
_NAMES = {1: "BT.709", 4: "BT.470 M", 8: "film", 9: "BT.2020", 11: "DCI-P3", 12: "Display P3"}
_CURVES = {1: "bt709", 4: "2.2", 5: "2.8", 6: "bt709", 8: "1", 14: "bt709", 15: "bt709",
           16: "pq", 17: "2.6", 18: "hlg"}
"""By the number of H.273's transfers; others are taken for sRGB's."""
_UNSAID = 2  # H.273's number of what a file does not say.


@dataclass(frozen=True)
class ColorSpace:
    """What the numbers of a picture mean."""

    name: str = "sRGB"  # For people.
    primaries: tuple[float, ...] = color.SRGB  # Chromaticities as in `lfportrait.color.SRGB`.
    # ``"srgb"``, ``"bt709"``, ``"pq"``, ``"hlg"``, or an exponent as text ("2.2", "1" is linear).
    curve: str = "srgb"
    # What says so, for people; empty where nothing does.
    source: str = field(default="", compare=False)

    @property
    def is_srgb(self) -> bool:
        """Whether nothing is to be converted."""
        return self.primaries == color.SRGB and self.curve in ("srgb", "bt709")


def coded_space(primaries: int, transfer: int) -> ColorSpace:
    """The color space that the numbers of ITU-T H.273 name; unknown ones are sRGB's.

    Gray values of pictures with BT.709's curve are kept, as players keep them.
    """
    curve = _CURVES.get(transfer, "srgb")
    known = _PRIMARIES.get(primaries, color.SRGB)
    if curve in ("pq", "hlg") and primaries in (0, 2):
        known = color.BT2020
    name = _NAMES.get(primaries, "sRGB") if known is not color.SRGB else "sRGB"
    shown = {"srgb": "", "bt709": "", "pq": " PQ", "hlg": " HLG"}.get(curve, f" gamma {curve}")
    if known is color.BT2020 and curve in ("pq", "hlg"):
        name = "BT.2100"
    return ColorSpace(name + shown, known, curve)


def from_space(values: UInt8 | UInt16, space: ColorSpace) -> UInt8:
    """Values [H, W, 3] of a color space, full range, as sRGB, uint8 [H, W, 3]."""
    most = float(np.iinfo(values.dtype).max)
    if _coded(space):
        deep = values if values.dtype == np.uint16 else values.astype(np.uint16) * 257
        return color.tone_mapped(np.asarray(deep, np.uint16),
                                 "pq" if space.curve == "pq" else "hlg", space.primaries)
    if space.is_srgb:
        return np.asarray(values if most == 255 else values / 257 + 0.5, np.uint8)
    codes = np.arange(int(most) + 1) / most
    light = _light(codes, space.curve).astype(np.float32)[values]
    light = light @ color.primaries_to_srgb(space.primaries).T.astype(np.float32)
    # Near black, where it is steepest, the curve rises by a twentieth of a level a step.
    shown = (_signal(np.linspace(0.0, 1.0, 1 << 16), space.curve) * 255 + 0.5).astype(np.uint8)
    return shown[(np.clip(light, 0.0, 1.0) * 65535 + 0.5).astype(np.uint16)]


def _light(codes: Float64, curve: str) -> Float64:
    if curve == "srgb":
        return color.linear_light(codes)
    if curve == "bt709":
        return np.where(codes < 0.081, codes / 4.5, ((codes + 0.099) / 1.099) ** (1 / 0.45))
    return np.asarray(codes ** float(curve))


def _signal(light: Float64, curve: str) -> Float64:
    """What is shown: gray values of BT.709's curve are kept, all other light is coded as sRGB."""
    if curve == "bt709":
        return np.where(light < 0.018, 4.5 * light, 1.099 * np.maximum(light, 1e-9) ** 0.45 - 0.099)
    return color.srgb_values(light)


def color_space(picture: Image.Image, stream: BinaryIO | None = None) -> ColorSpace:
    """What a picture's file says of its colors, an ICC profile aside.

    ``picture`` is as Pillow opens it, ``stream`` its file, for what Pillow does not read.
    """
    numbers = _numbers(picture, stream)
    if numbers is not None and numbers != (_UNSAID, _UNSAID):
        return replace(coded_space(*numbers), source="its nclx box")
    kind = picture.format
    if kind == "PNG":
        found = _png_space(picture, stream)
        if found is not None:
            return found
    if _notes_adobe(picture):
        return ColorSpace("Adobe RGB", _ADOBE, "2.19921875", "its EXIF")
    return ColorSpace(source="its sRGB chunk" if kind == "PNG" and "srgb" in picture.info else "")


def named_colors(picture: Image.Image, stream: BinaryIO | None = None) -> tuple[str, str]:
    """By what a picture's numbers are read, such as "Display P3", and what says so, for people.

    The latter is such as "its ICC profile", and empty where nothing says. Nothing is decoded. As
    `srgb` does: a profile that fits counts, but for high dynamic range.
    """
    space, profile = color_space(picture, stream), picture.info.get("icc_profile")
    if profile and not _coded(space):
        # Only the mode counts: what is converted has eight bits a channel and no alpha.
        mode = "L" if picture.mode.startswith(("I", "F", "LA")) and picture.mode != "LAB" else (
            picture.mode if picture.mode in _PROFILED else "RGB")
        found = _profile(mode, profile)
        if found is not None:
            return found[0] or "a nameless profile", "its ICC profile"
        return "sRGB", "its ICC profile does not fit and is left out"
    plain = space.is_srgb and not space.source and picture.mode in ("CMYK", "LAB")
    return picture.mode if plain else space.name, space.source


def _numbers(picture: Image.Image, stream: BinaryIO | None) -> tuple[int, int] | None:
    """Primaries and transfer as HEIC and AVIF number them; None where there are none."""
    nclx = picture.info.get("nclx_profile")
    if isinstance(nclx, dict):
        return (int(nclx.get("color_primaries", _UNSAID)),
                int(nclx.get("transfer_characteristics", _UNSAID)))
    return _colr_box(stream) if picture.format == "AVIF" and stream is not None else None


def _notes_adobe(picture: Image.Image) -> bool:
    """Whether EXIF says Adobe RGB."""
    try:
        exif = picture.getexif()
        space = exif.get_ifd(0x8769).get(0xA001)
        index = exif.get_ifd(0xA005).get(1) if space == 65535 else ""
    except (KeyError, TypeError, ValueError, SyntaxError, OSError, AttributeError):
        return False
    text = index.decode("latin-1") if isinstance(index, bytes) else str(index or "")
    return space == 2 or text.strip(" \0").upper() == "R03"


def _head(stream: BinaryIO, most: int) -> bytes:
    place = stream.tell()
    try:
        stream.seek(0, os.SEEK_SET)
        return stream.read(most)
    finally:
        stream.seek(place)


def _colr_box(stream: BinaryIO) -> tuple[int, int] | None:
    """Primaries and transfer of the ``colr`` box in the file's head (ISO/IEC 23008-12)."""
    head = _head(stream, 1 << 16)
    at = head.find(b"colrnclx")
    if at < 4 or at + 12 > len(head) or b"colrprof" in head or b"colrrICC" in head:
        return None
    return (int.from_bytes(head[at + 8:at + 10], "big"),
            int.from_bytes(head[at + 10:at + 12], "big"))


def _png_space(picture: Image.Image, stream: BinaryIO | None) -> ColorSpace | None:
    """The color space by PNG's chunks (PNG 3rd edition, 4.3); None where there are none."""
    if stream is not None:
        head = _head(stream, 1 << 16)
        at = head.find(b"cICP", 8)
        if 0 < at < head.find(b"IDAT") and at + 6 <= len(head):
            return replace(coded_space(head[at + 4], head[at + 5]), source="its cICP chunk")
    if "srgb" in picture.info or picture.info.get("icc_profile"):
        return None
    gamma, points = picture.info.get("gamma"), picture.info.get("chromaticity")
    curve = "srgb"
    primaries: tuple[float, ...] = color.SRGB
    if isinstance(gamma, float) and 0.1 < gamma < 2 and abs(gamma * 2.2 - 1) > 0.05:
        curve = f"{1 / gamma:.6g}"
    if isinstance(points, tuple) and len(points) == 8:
        # White comes first in the chunk.
        moved = (*map(float, points[2:]), *map(float, points[:2]))
        if min(moved[1::2]) > 0 and max(abs(a - b) for a, b in zip(moved, color.SRGB)) > 0.005:
            primaries = moved
    if curve == "srgb" and primaries == color.SRGB:
        return None
    try:
        color.primaries_to_srgb(primaries)
    except np.linalg.LinAlgError:
        return None
    return ColorSpace("by gAMA and cHRM", primaries, curve, "its gAMA and cHRM chunks")


def srgb(picture: Image.Image, stream: BinaryIO | None = None) -> Image.Image:
    """A picture upright by its EXIF orientation, in sRGB of eight bits a channel.

    ``RGB``, or ``RGBA`` (straight alpha) where there is transparency. ``picture`` is as Pillow
    opens it, of any mode, ``stream`` its file. Damaged data raise `OSError`, `ValueError` or
    `SyntaxError`.
    """
    return srgb_from(picture, picture.info.get("icc_profile"), color_space(picture, stream))


def srgb_from(picture: Image.Image, profile: bytes | None, space: ColorSpace) -> Image.Image:
    """`srgb` of a picture of any mode whose color space is known: of a reduced copy, for example.

    Its ICC profile counts unless the space (`color_space`) is not sRGB.
    """
    upright: Image.Image = _in_eight_bits(ImageOps.exif_transpose(picture))
    # LAB's second channel is called A as well.
    alpha = upright.mode != "LAB" and ("A" in upright.getbands() or "a" in upright.getbands()
                                       or "transparency" in upright.info)
    if not alpha:
        return _converted(upright, profile, space)
    whole = upright.convert("LA" if upright.mode == "LA" else "RGBA")
    colors = _converted(whole.convert("L" if whole.mode == "LA" else "RGB"), profile, space)
    colors.putalpha(whole.getchannel("A"))
    values = np.asarray(colors)
    if looks_premultiplied(values):
        warnings.warn("a cut-out's colors are multiplied by its alpha channel; they are divided by "
                      "it", stacklevel=3)
        return Image.fromarray(straight(values))
    return colors


def looks_premultiplied(picture: UInt8) -> bool:
    """Whether the colors of a picture [H, W, 4] seem to be multiplied by its alpha.

    Then none is larger than the alpha beside it, and at soft edges they fall with it. Those of a
    straight cut-out do not, though a black person's are smaller than most alpha as well.
    """
    alpha = picture[..., 3]
    edge = (alpha > 8) & (alpha < 247)
    values, colors = alpha[edge].astype(np.int32), picture[edge][:, :3].max(axis=1)
    faint, dense = values < 96, values > 160
    if min(faint.sum(), dense.sum()) < 20 or (colors > values + 2).any():
        return False
    return bool(colors[faint].mean() < 0.7 * colors[dense].mean())


def premultiplied(picture: UInt8) -> Float32:
    """A picture [H, W, 4] with its colors multiplied by alpha, float32: for resampling."""
    values = picture.astype(np.float32)
    values[..., :3] *= values[..., 3:] * np.float32(1 / 255)
    return values


def straight(values: UInt8 | Float32) -> UInt8:
    """A picture [H, W, 4] with its colors divided by alpha, uint8; black where nothing is."""
    colors = values.astype(np.float32)
    # A resampled alpha overshoots beside edges, as the colors do that it multiplies.
    alpha = colors[..., 3:]
    colors[..., :3] *= np.where(alpha > 0.5, 255 / np.maximum(alpha, 0.5), 0)
    return np.asarray(np.clip(colors, 0, 255) + 0.5, np.uint8)


def _converted(picture: Image.Image, profile: bytes | None, space: ColorSpace) -> Image.Image:
    """The picture as RGB, by its color space, or by the profile if it has one that fits."""
    whole = _by_profile(picture, None if profile and not space.is_srgb and _coded(space)
                        else profile)
    if space.is_srgb or (profile and not _coded(space)):
        return whole
    return Image.fromarray(from_space(np.asarray(whole), space))


def _coded(space: ColorSpace) -> bool:
    """Whether a space is of high dynamic range, which no profile describes as well."""
    return space.curve in ("pq", "hlg")


def _in_eight_bits(picture: Image.Image) -> Image.Image:
    """The same with eight bits a channel; Pillow's own conversion cuts off what is above."""
    if not picture.mode.startswith(("I", "F")):
        return picture
    values = np.asarray(picture, np.float64)
    values = np.where(np.isfinite(values), values, 0.0)
    # Sixteen bits, or thirty-two of which sixteen are used; floating point from 0 to 1.
    most = 65535.0 if picture.mode.startswith("I") else 1.0
    if values.max(initial=0.0) > most:
        most = float(values.max())
    return Image.fromarray(color.to_uint8(values / most))


def _profile(mode: str, profile: bytes) -> tuple[str, Any | None] | None:
    """A profile's name, and how LittleCMS converts this mode by it to sRGB.

    The transform is None where the profile is sRGB itself. None instead of both for a damaged
    profile, or one of another kind of picture.
    """
    from PIL import ImageCms

    try:
        source = ImageCms.ImageCmsProfile(io.BytesIO(profile))
        name = ImageCms.getProfileDescription(source).strip()
        if "srgb" in name.lower():
            return name, None
        return name, ImageCms.buildTransform(
            source, ImageCms.createProfile("sRGB"), mode, "RGB",
            renderingIntent=ImageCms.Intent.RELATIVE_COLORIMETRIC)
    except (ImageCms.PyCMSError, OSError, ValueError, TypeError):
        return None


def _by_profile(picture: Image.Image, profile: bytes | None) -> Image.Image:
    """The picture as RGB, by the profile if it has one that fits."""
    if picture.mode == "RGB" and not profile:
        return picture
    from PIL import ImageCms

    if picture.mode not in _PROFILED:  # a palette's colors have the file's profile, too
        picture = picture.convert("RGB")
    named = _profile(picture.mode, profile) if profile else None
    if named is not None and named[1] is not None:
        with contextlib.suppress(ImageCms.PyCMSError, OSError, ValueError, TypeError):
            changed = ImageCms.applyTransform(picture, named[1])
            if changed is not None:
                return changed
    if picture.mode == "LAB":
        lab = ImageCms.createProfile("LAB")
        found = ImageCms.profileToProfile(picture, lab, ImageCms.createProfile("sRGB"),
                                          outputMode="RGB")
        return found if found is not None else picture.convert("L").convert("RGB")
    return picture.convert("RGB")


