"""Other colors for a page that is open are those of the renderer's."""

import numpy as np
import pytest

from lfportrait.share import OpenPage, PageConfig, orbit_cameras, recolored, write_page
from tests.share.page.browser import decibels

SIZE = 128

PUT = """async (sets) => {
  const { renderer } = lfportrait, { header } = renderer, first = header.sets.length;
  sets.forEach(({ bands, streams, texels }, index) => {
    const number = first + index;
    header.sets[number] = { name: "", kind: "mix", bands };
    if (header.texture) header.texture.sets[number] = texels !== null;
    const parts = { [`set${number}.0`]: streams["0"], [`texels${number}`]: texels };
    for (const [name, data] of Object.entries(parts)) {
      if (data === null) continue;
      const kept = document.createElement("script");
      kept.type = "application/octet-stream";
      kept.dataset.stream = name;
      kept.textContent = data;
      document.body.append(kept);
    }
  });
  renderer.slots = [null, null];
  return first;
}"""


@pytest.mark.slow  # in a browser; what it reads is below
@pytest.mark.parametrize("mix", [
    {"strength": 0.6}, {"identity": 0.7}, {"keep_colors": True},
    {"regions": {"hair": 2.0, "skin": 0.3}}, {"strength": 0.0}], ids=lambda mix: next(iter(mix)))
def test_a_mix_is_what_the_renderer_shows(opened, page, head, mix):
    other = recolored(OpenPage.of(page.read_bytes()), head.mix(**mix))
    cameras = orbit_cameras(5, SIZE, head)
    first = opened.run(PUT, [other])
    opened.run("(n) => lfportrait.renderer.show(n, n, 0, true)", first)
    for view in (0, 2):
        seen = head.mix(**mix).render(cameras, view, background=0.0, anisotropic=False)
        drawn = opened.view(cameras, view)[..., :3]
        assert decibels(drawn, np.clip(seen.color, 0, 1)) > 42
    assert opened.complaints == []


@pytest.mark.slow  # in a browser
def test_between_two_mixes_lies_the_mix_between(opened, page, head):
    """What a slider shows while it is moved: seeing adds colors up, so that it is nearly exact."""
    ends = [recolored(OpenPage.of(page.read_bytes()), head.mix(regions={"skin": value}))
            for value in (0.0, 2.0)]
    cameras = orbit_cameras(5, SIZE, head)
    first = opened.run(PUT, ends)
    opened.run("(n) => lfportrait.renderer.show(n, n + 1, 0.25, true)", first)
    seen = head.mix(regions={"skin": 0.5}).render(cameras, 1, background=0.0, anisotropic=False)
    assert decibels(opened.view(cameras, 1)[..., :3], np.clip(seen.color, 0, 1)) > 36


def test_a_coarser_page_takes_none(head, tmp_path):
    from lfportrait.share.page.packing import Lattice, coarser, color_sets

    write_page(head, tmp_path / "page.html", PageConfig())
    page = OpenPage.of((tmp_path / "page.html").read_bytes())
    assert recolored(page, head) is not None
    lattice = coarser(Lattice.of(head.links, head.density, color_sets(head), head.center,
                                 head.radius), 0.8)
    assert recolored(OpenPage(lattice.filled), head) is None


def test_a_file_that_is_no_page_is_refused():
    from lfportrait.errors import UserError

    with pytest.raises(UserError, match="no page of a portrait"):
        OpenPage.of(b"<html></html>")
