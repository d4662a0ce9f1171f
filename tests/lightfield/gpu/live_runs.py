"""What the tests of live light fields run beside a device, in its process."""

import dataclasses
import os
import warnings

import numpy as np

from lfportrait.lightfield import EncodeConfig
from lfportrait.lightfield.gpu import live as module
from lfportrait.lightfield.gpu.live import Blit, LiveCoder, pixels_of
from lfportrait.lightfield.screens.live import Live, OffscreenWindow, check_pixels


def settled(device, field, display, wanted, photo=None, page=None):
    """Exact pictures of (configuration, share), one after the other, and bytes on the device."""
    coder = LiveCoder(device, field, display, photo, **({} if page is None else {"page": page}))
    pictures = []
    for config, share in wanted:
        coder.settle(config, share)
        pictures.append(coder.read())
    coder.close()
    return pictures


def coarse(device, field, display, config, other):
    """What a device that is too slow shows of something that moves, and then stands still.

    Returns the picture before ``other`` is asked for, the first of it, how many rows each of that
    one's stand for, the last picture, and how many steps it took.
    """
    before, module._PICTURE = module._PICTURE, 1e-9  # no device is fast enough for that
    try:
        return _coarse(LiveCoder(device, field, display), config, other)
    finally:
        module._PICTURE = before


def _coarse(coder, config, other):
    """As above, of a device that is taken for slow."""
    coder.settle(config)
    before = coder.read()
    coder.step(other)
    first, apart, steps = coder.read(), coder.picture.apart, 0
    shown = first
    assert not coder.exact
    while not coder.exact:
        new = coder.step(other)
        steps += 1
        # Nothing half finished is seen.
        assert new or np.array_equal(coder.read(), shown)
        shown = coder.read()
    coder.close()
    return before, first, apart, shown, steps


def played(device, field, panel, config, script, frames, photo=None, seconds=0.0, exact=True):
    """Pictures of a script, what was said, figures, and whether it was over."""
    said = []
    live = Live(device, field, config, panel, panel, photo, seconds=seconds,
                say=lambda line, stays: said.append(line))
    screen = OffscreenWindow((panel.width, panel.height), script, frames, exact=exact)
    screen.run(device, panel, live)
    live.close()
    return screen.pictures, said, live.figures(), live.over


def drawn(device, display, picture, format):
    """A picture's pixels after `Blit`, and whether a changed one is found out."""
    buffer = device.buffer(picture)
    words = picture.shape[1] // 4
    shown = module.LivePicture(buffer, words, picture.shape[0], 1)
    target = device.texture((display.width, display.height), format, drawn=True)
    Blit(device, display, format).draw(shown, target.create_view())
    pixels = pixels_of(device, target)
    check_pixels(device, target, display, shown)
    turned = dataclasses.replace(display, flip_x=not display.flip_x)
    try:
        check_pixels(device, target, turned, shown)
    except Exception as error:
        return pixels, str(error)
    return pixels, ""


def resident():
    """Bytes of memory that this process takes."""
    with open("/proc/self/statm", encoding="ascii") as stream:
        return int(stream.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def hundred(device, field, panel):
    """Bytes of memory and objects of wgpu's after 20 and after 120 small pictures."""
    import wgpu

    live = Live(device, field, EncodeConfig(), panel, panel)
    found = []
    for frames in (20, 100):
        screen = OffscreenWindow((panel.width, panel.height), {}, frames, keep=False)
        screen.run(device, panel, live)
        device.wait()
        counts = wgpu.diagnostics.object_counts.get_dict()
        found.append((resident(), {name: entry["count"] for name, entry in counts.items()}))
    live.close()
    return found, live.frames


def quietly(device, function, *arguments):
    """A function of this module, without warnings."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return globals()[function](device, *arguments)
