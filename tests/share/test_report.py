"""The report: complete, escaped, self-contained."""

import base64
import io
import re
from html.parser import HTMLParser

import numpy as np
from PIL import Image

from lfportrait.share import Picture, Report, Section, Table, write_report, write_video


class Page(HTMLParser):
    """Checks that tags nest, and collects addresses and text."""

    VOID = frozenset({"meta", "img", "br", "link"})

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.addresses: list[str] = []
        self.text = ""
        self.tags: list[str] = []
        self.feed(text)
        assert not self.open, self.open

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.addresses += [value for name, value in attrs if name in ("src", "href")]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


def page_of(tmp_path, report: Report) -> Page:
    write_report(tmp_path / "report.html", report)
    return Page((tmp_path / "report.html").read_text("utf-8"))


def embedded(address: str) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(address.split(",", 1)[1]))))


def test_a_report_holds_everything_and_nothing_from_elsewhere(tmp_path):
    picture = np.random.default_rng(0).random((40, 60, 3))
    Image.fromarray(np.uint8(picture * 255)).save(tmp_path / "photo.png")
    write_video(tmp_path / "sweep.mp4", [picture] * 3, 30)
    report = Report(
        "Ann & <Bob>", "by \"example\"", Picture(picture, "hero"), [("dB", "34.1")],
        [Section("Inputs", "One.\n\nTwo.", [Picture(tmp_path / "photo.png", "a <photo>")],
                 layout="strip"),
         Section("Film", video=tmp_path / "sweep.mp4"),
         Section("Times", tables=[Table([("encode", 2.5), ("share", 10.0), ("skip", None)],
                                        ("stage", "seconds"), bars=1)])])
    page = page_of(tmp_path, report)
    for address in page.addresses:
        assert address.startswith(("data:", "#")), address[:80]
    assert "script" not in page.tags and "link" not in page.tags
    for text in ("Ann & <Bob>", 'by "example"', "a <photo>", "One.", "Two.", "34.1", "encode"):
        assert text in page.text
    assert "bob" not in page.tags and "photo" not in page.tags
    assert page.tags.count("img") == 2 and page.tags.count("video") == 1
    anchors = [address[1:] for address in page.addresses if address.startswith("#")]
    text = (tmp_path / "report.html").read_text("utf-8")
    assert len(anchors) == 3 and all(f'id="{anchor}"' in text for anchor in anchors)
    widths = [float(width) for width in re.findall(r'style="width:([\d.]+)%"', text)]
    assert widths == [25.0, 100.0, 0.0]


def test_missing_parts_are_left_out(tmp_path):
    missing = Picture(tmp_path / "missing.png")
    page = page_of(tmp_path, Report("T", hero=missing, sections=[
        Section("Nothing"), Section("No film", video=tmp_path / "missing.mp4"),
        Section("No picture", pictures=[missing]), Section("Something", "text", [missing])]))
    for title in ("Nothing", "No film", "No picture"):
        assert title not in page.text
    assert "Something" in page.text
    assert "img" not in page.tags and "video" not in page.tags


def test_exact_pictures_keep_every_pixel_and_large_ones_shrink(tmp_path):
    generator = np.random.default_rng(1)
    coded = generator.integers(0, 256, (50, 900, 3), dtype=np.uint8)
    page = page_of(tmp_path, Report("T", sections=[Section("S", pictures=[
        Picture(coded, exact=True), Picture(coded, width=300),
        Picture(np.arange(12.0).reshape(3, 4) / 12), Picture(np.eye(5, dtype=bool))])]))
    pictures = [embedded(address) for address in page.addresses if address.startswith("data:")]
    assert np.array_equal(pictures[0], coded)
    assert pictures[1].shape == (17, 300, 3)
    assert pictures[2].shape == (3, 4, 3) and pictures[3].shape == (5, 5, 3)


def test_a_picture_of_noise_can_be_shown(tmp_path):
    noise = np.random.default_rng(1).integers(0, 256, (400, 400, 3), dtype=np.uint8)
    page = page_of(tmp_path, Report("T", sections=[Section("S", pictures=[Picture(noise)])]))
    shown, = (embedded(address) for address in page.addresses if address.startswith("data:image"))
    assert shown.shape == noise.shape


def test_numbers_are_rounded_for_reading(tmp_path):
    page = page_of(tmp_path, Report("T", sections=[Section("S", tables=[Table([
        ("a", 1234567, 0.123456, 34.14159, float("inf"), None, True, 123.456, 98765.4)])])]))
    for text in ("1\u202f234\u202f567", "0.123", "34.1", "\u221e", "yes", "123.5", "98\u202f765"):
        assert text in page.text


def test_the_same_report_gives_the_same_bytes(tmp_path):
    report = Report("T", hero=Picture(np.random.default_rng(2).random((20, 20, 3))))
    write_report(tmp_path / "a.html", report)
    write_report(tmp_path / "b.html", report)
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()
