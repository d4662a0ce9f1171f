"""Pictures with depth, byte by byte as phones write them."""

import base64
import hashlib
import io
import struct

import numpy as np
from PIL import Image

RDF = ('<x:xmpmeta xmlns:x="adobe:ns:meta/">'
       '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">{}</rdf:RDF></x:xmpmeta>')
GDEPTH = 'xmlns:GDepth="http://ns.google.com/photos/1.0/depthmap/"'
ANDROID = ('xmlns:Device="http://ns.google.com/photos/dd/1.0/device/" '
           'xmlns:Camera="http://ns.google.com/photos/dd/1.0/camera/" '
           'xmlns:DepthMap="http://ns.google.com/photos/dd/1.0/depthmap/" '
           'xmlns:Container="http://ns.google.com/photos/dd/1.0/container/" '
           'xmlns:Item="http://ns.google.com/photos/dd/1.0/item/"')
APPLE = ('<rdf:Description xmlns:apdi="http://ns.apple.com/pixeldatainfo/1.0/" '
         'xmlns:depthData="http://ns.apple.com/depthData/1.0/">'
         "<apdi:IntMaxValue>255</apdi:IntMaxValue><apdi:IntMinValue>0</apdi:IntMinValue>"
         "<apdi:NativeFormat>{format}</apdi:NativeFormat>"
         "<apdi:FloatMaxValue>{high}</apdi:FloatMaxValue>"
         "<apdi:FloatMinValue>{low}</apdi:FloatMinValue>"
         "<depthData:Accuracy>{accuracy}</depthData:Accuracy></rdf:Description>")
DISPARITY = int.from_bytes(b"hdis", "big")
MATTE = (RDF.format('<rdf:Description xmlns:apdi="http://ns.apple.com/pixeldatainfo/1.0/">'
                    "<apdi:NativeFormat>1278226488</apdi:NativeFormat>"
                    "<apdi:AuxiliaryImageType>depth</apdi:AuxiliaryImageType>"
                    "</rdf:Description>")).encode()


def apple_notes(low: float, high: float, accuracy: str = "relative",
                pixel_format: int = DISPARITY) -> bytes:
    return RDF.format(APPLE.format(low=low, high=high, accuracy=accuracy,
                                   format=pixel_format)).encode()


def encoded(numbers: np.ndarray, kind: str = "PNG", **options) -> bytes:
    stream = io.BytesIO()
    Image.fromarray(numbers).save(stream, kind, **options)
    return stream.getvalue()


def jpeg(width: int = 64, height: int = 48, orientation: int = 1, **options) -> bytes:
    colors = np.random.default_rng(0).integers(0, 255, (height, width, 3)).astype(np.uint8)
    exif = Image.Exif()
    exif[0x0112] = orientation
    return encoded(colors, "JPEG", exif=exif.tobytes(), **options)


def segment(number: int, content: bytes) -> bytes:
    assert len(content) <= 65533
    return struct.pack(">BBH", 0xFF, number, len(content) + 2) + content


def noted(picture: bytes, packet: bytes) -> bytes:
    """A JPEG with an XMP packet as its first segment."""
    return (picture[:2] + segment(0xE1, b"http://ns.adobe.com/xap/1.0/\0" + packet)
            + picture[2:])


def extended(packet: bytes) -> tuple[str, bytes]:
    """MD5 and segments of extended XMP."""
    name = hashlib.md5(packet).hexdigest().upper()
    return name, b"".join(
        segment(0xE1, b"http://ns.adobe.com/xmp/extension/\0" + name.encode()
                + struct.pack(">II", len(packet), start) + packet[start:start + 65000])
        for start in range(0, len(packet), 65000))


def gdepth(picture: bytes, depth: bytes, notes: dict[str, str],
           confidence: bytes | None = None, apart: bool = False) -> bytes:
    """A JPEG with GDepth, its data in extended XMP where they lie apart."""
    texts = {"Data": base64.b64encode(depth).decode()}
    if confidence is not None:
        texts["Confidence"] = base64.b64encode(confidence).decode()

    def described(values: dict[str, str], more: str = "") -> bytes:
        text = " ".join(f'GDepth:{name}="{value}"' for name, value in values.items())
        return RDF.format(f"<rdf:Description {GDEPTH} {more} {text}/>").encode()

    if not apart:
        return noted(picture, described(notes | texts))
    name, segments = extended(described(texts))
    more = f'xmlns:xmpNote="http://ns.adobe.com/xmp/note/" xmpNote:HasExtendedXMP="{name}"'
    result = noted(picture, described(notes, more))
    return result[:2] + segments + result[2:]


def dynamic_depth(picture: bytes, files: dict[str, bytes], notes: dict[str, str],
                  padding: int = 0, between: bytes = b"") -> bytes:
    """A JPEG with Dynamic Depth; the files by their addresses."""
    items = "".join(
        f'<rdf:li><Container:Item Item:Mime="image/png" Item:Length="{len(data)}" '
        f'Item:DataURI="{name}"/></rdf:li>' for name, data in files.items())
    values = "".join(f"<DepthMap:{name}>{value}</DepthMap:{name}>"
                     for name, value in notes.items())
    body = (f"<rdf:Description {ANDROID}><Device:Container><Container:Directory><rdf:Seq>"
            f'<rdf:li><Container:Item Item:Mime="image/jpeg" Item:Length="0" '
            f'Item:Padding="{padding}" Item:DataURI="primary"/></rdf:li>{items}'
            "</rdf:Seq></Container:Directory></Device:Container>"
            '<Device:Cameras><rdf:Seq><rdf:li rdf:parseType="Resource"><Camera:DepthMap '
            f'rdf:parseType="Resource">{values}</Camera:DepthMap></rdf:li></rdf:Seq>'
            "</Device:Cameras></rdf:Description>")
    return (noted(picture, RDF.format(body).encode()) + b"\0" * padding + between
            + b"".join(files.values()))


def container(picture: bytes, files: list[tuple[str, bytes]], notes: str = "") -> bytes:
    """A JPEG with Google's later container; the files with their meanings."""
    items = "".join(
        f'<rdf:li rdf:parseType="Resource"><Container:Item Item:Mime="image/jpeg" '
        f'Item:Semantic="{name}" Item:Length="{len(data)}"/></rdf:li>'
        for name, data in [("Primary", b""), *files])
    body = ('<rdf:Description xmlns:Container="http://ns.google.com/photos/1.0/container/" '
            f'xmlns:Item="http://ns.google.com/photos/1.0/container/item/" {GDEPTH} {notes}>'
            f"<Container:Directory><rdf:Seq>{items}</rdf:Seq></Container:Directory>"
            "</rdf:Description>")
    return noted(picture, RDF.format(body).encode()) + b"".join(data for _, data in files)


def multi_picture(picture: bytes, pictures: list[bytes], order: str = ">") -> bytes:
    """A JPEG with further ones behind it, listed by the Multi-Picture Format."""
    head = b"MM\0*" if order == ">" else b"II*\0"
    count = 1 + len(pictures)
    directory = head + struct.pack(f"{order}IH", 8, 3) + struct.pack(
        f"{order}HHI4s", 0xB000, 7, 4, b"0100") + struct.pack(
        f"{order}HHII", 0xB001, 4, 1, count) + struct.pack(
        f"{order}HHIII", 0xB002, 7, 16 * count, 50, 0)
    base = 2 + 4 + 4  # where the directory's header lies: after SOI, the marker and "MPF\0"
    first = len(picture) + 8 + len(directory) + 16 * count
    rows, place = struct.pack(f"{order}IIIHH", 0, first, 0, 0, 0), first
    for one in pictures:
        rows += struct.pack(f"{order}IIIHH", 0, len(one), place - base, 0, 0)
        place += len(one)
    return (picture[:2] + segment(0xE2, b"MPF\0" + directory + rows) + picture[2:]
            + b"".join(pictures))


def _boxes(data: bytes, start: int, end: int) -> dict[bytes, tuple[int, int]]:
    """Start and end of the boxes in a part of a file, by their names; the last of each."""
    found = {}
    while start + 8 <= end:
        size, name = struct.unpack_from(">I4s", data, start)
        found[name] = start, start + size
        start += size
    return found


def _box(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I4s", len(content) + 8, name) + content


class _Bits:
    """Numbers as H.265 writes them."""

    def __init__(self) -> None:
        self.text = ""

    def put(self, number: int, count: int) -> None:
        self.text += f"{number:0{count}b}"

    def golomb(self, number: int) -> None:
        text = f"{number + 1:b}"
        self.text += "0" * (len(text) - 1) + text

    def real(self, number: float) -> None:
        mantissa, exponent = np.frexp(number)
        self.put(0, 1)
        self.put(int(exponent) - 1 + 31, 7)
        self.put(31, 5)
        self.put(int((2 * mantissa - 1) * 2 ** 32), 32)

    def bytes(self) -> bytes:
        text = self.text + "1"
        text += "0" * (-len(text) % 8)
        return int(text, 2).to_bytes(len(text) // 8, "big")


def representation(kind: int, **values: float) -> bytes:
    """H.265's "depth representation information" with z_near, z_far, d_min and d_max."""
    bits = _Bits()
    names = ("z_near", "z_far", "d_min", "d_max")
    for name in names:
        bits.put(name in values, 1)
    bits.golomb(kind)
    if "d_min" in values or "d_max" in values:
        bits.golomb(0)
    for name in names:
        if name in values:
            bits.real(values[name])
    message = bits.bytes()
    unit = bytes([39 << 1, 1, 177, len(message)]) + message
    content = struct.pack(">I", len(unit)) + unit
    return struct.pack(">I", len(content)) + content


def heic(picture: np.ndarray, depth: np.ndarray, notes: bytes = b"", turns: int = 0,
         depth_turns: int | None = None, packet: bytes = b"") -> bytes:
    """A HEIC whose second picture is made the depth of its first.

    Both are turned counter-clockwise by quarter turns (``irot``) when they are shown.
    """
    import pillow_heif

    pillow_heif.register_heif_opener()
    stream = io.BytesIO()
    Image.fromarray(picture).save(stream, "HEIF", save_all=True, quality=95,
                                  append_images=[Image.fromarray(depth)])
    data = stream.getvalue()
    start, end = _boxes(data, 0, len(data))[b"meta"]
    inside = _boxes(data, start + 12, end)
    properties = _boxes(data, inside[b"iprp"][0] + 8, inside[b"iprp"][1])
    listed = data[properties[b"ipco"][0] + 8:properties[b"ipco"][1]]
    count, place = 0, 0
    while place < len(listed):
        place += struct.unpack_from(">I", listed, place)[0]
        count += 1
    listed += _box(b"auxC", bytes(4) + b"urn:mpeg:hevc:2015:auxid:2\0" + notes)
    listed += _box(b"irot", bytes([turns]))
    listed += _box(b"irot", bytes([turns if depth_turns is None else depth_turns]))
    used = data[properties[b"ipma"][0] + 8:properties[b"ipma"][1]]
    first = 8 + 3 + used[10]
    of_picture, of_depth = used[8:first], used[first:]
    of_picture = of_picture[:2] + bytes([of_picture[2] + 1]) + of_picture[3:] + bytes(
        [0x80 | count + 2])
    of_depth = of_depth[:2] + bytes([of_depth[2] + 2]) + of_depth[3:] + bytes(
        [0x80 | count + 1, 0x80 | count + 3])
    iprp = _box(b"iprp", _box(b"ipco", listed) + _box(b"ipma", used[:8] + of_picture + of_depth))
    # The second picture belongs to the first.
    iref = _box(b"iref", bytes(4) + _box(b"auxl", struct.pack(">HHH", 2, 1, 1)))
    # It is hidden: no picture of its own.
    iinf = bytearray(data[slice(*inside[b"iinf"])])
    entry = 14 + struct.unpack_from(">I", iinf, 14)[0]
    iinf[entry + 11] = 1
    grown = (len(iprp) - (inside[b"iprp"][1] - inside[b"iprp"][0])) + len(iref)
    iloc = bytearray(data[slice(*inside[b"iloc"])])
    for number in range(2):
        base = 16 + 18 * number + 4
        struct.pack_into(">I", iloc, base, struct.unpack_from(">I", iloc, base)[0] + grown)
    meta = _box(b"meta", data[start + 8:start + 12] + data[slice(*inside[b"hdlr"])] + bytes(iloc)
                + bytes(iinf) + data[slice(*inside[b"pitm"])] + iref + iprp)
    return data[:start] + meta + data[end:] + (_box(b"mdat", packet) if packet else b"")
