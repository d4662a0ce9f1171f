"""Transfer to a video: seeds are carried from frame to frame, so that strokes are stable.

Chunks lie in an anchor plane. In a video it is carried along by optical flow (`Flow`): a pixel gets
the anchor of the place it came from. Where the flow can't be trusted, or the plane is torn, it is
restarted. Landmarks and the masks of person and hair are carried, too, and corrected slowly by
those that are found every few frames: their jitter is larger than what a frame's flow is off.

The flow is OpenCV's DIS on a picture of half the size. Where the two directions disagree it can't
be trusted; where they do nearly everywhere, the scene was cut.

A painted frame knows for each pixel which shift from the anchor plane to the exemplar it copies
with. The next frame copies the same strokes from their new places, without guides, seeds and
chunks; where it shows what the one before did not, its guided place serves.
"""

import queue
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import cv2
import numba
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ..arrays import Bool, Float32, Float64, Floats, UInt8
from .exemplar import Exemplar, face_size
from .guides.color_segmentation import resize
from .guides.filters import enlarged
from .guides.position import anchor_scale, pixel_centres
from .guides.regions import Regions, find_regions
from .kernels.video import carry, carry_shifts, repair, squared_changes, to_bytes, trust, unfold
from .kernels.vote import blend, vote
from .styleblit import TransferResult, shift_planes
from .transfers import Transfer, face_landmarks

Item = TypeVar("Item")
Made = TypeVar("Made")


def ahead(items: Iterator[Item], count: int = 2,
          start: Callable[[], Any] | None = None) -> Iterator[Item]:
    """The same items, made on another thread up to ``count`` of them ahead.

    Parameters
    ----------
    items : What is taken on that thread; what it raises is raised here.
    count : How many may wait.
    start : Called first on that thread.

    Closing this iterator, or leaving a loop over it, ends the thread.
    """
    waiting: queue.Queue[tuple[bool, Any]] = queue.Queue(count)
    closed = threading.Event()

    def put(entry: tuple[bool, Any]) -> bool:
        while not closed.is_set():
            try:
                waiting.put(entry, timeout=0.1)
                return True
            except queue.Full:
                continue
        return False

    def work() -> None:
        try:
            if start is not None:
                start()
            for item in items:
                if not put((True, item)):
                    break
            else:
                put((False, None))
        except BaseException as error:
            put((False, error))
        finally:
            close = getattr(items, "close", None)
            if close is not None:
                close()

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    try:
        while True:
            more, item = waiting.get()
            if not more:
                if item is not None:
                    raise item
                return
            yield item
    finally:
        closed.set()
        thread.join()


def in_turn(make: Callable[[Item], Made], items: Iterator[Item], threads: int,
            start: Callable[[], Any] | None = None) -> Iterator[Made]:
    """What ``make`` makes of the items, in their order, made on several threads.

    As many items again as there are threads may wait to be taken. ``start`` is called first on each
    thread.
    """
    with ThreadPoolExecutor(threads, initializer=start) as pool:
        under_way: deque[Future[Made]] = deque()
        try:
            for item in items:
                under_way.append(pool.submit(make, item))
                if len(under_way) > threads:
                    yield under_way.popleft().result()
            while under_way:
                yield under_way.popleft().result()
        finally:
            for future in under_way:
                future.cancel()
            close = getattr(items, "close", None)
            if close is not None:
                close()


DISAGREE = 1.5  # Largest difference of the flow there and back in pixels.
LARGE = 200  # Pictures whose shorter side has at least so many pixels are reduced to half of it.
CUT = 0.3  # Share of trusted places below which two frames have nothing to do with each other.


@dataclass(frozen=True)
class Motion:
    """Motion from the frame before to this one."""

    # float32 [h, w, 2], place in the frame before minus place here, in pixels, at the middles of
    # blocks.
    back: Float32
    there: Float32  # The same from the frame before, to this one.
    trusted: Bool  # bool [h, w].
    factor: int  # Side of a block in pixels.

    def carry(self, field: Float32) -> Float32:
        """A field [h, w, C] on the blocks of the frame before as it lies in this one."""
        field = np.ascontiguousarray(field)
        out = np.empty_like(field)
        carry(field, self.back / np.float32(self.factor), out)
        return out

    def onward(self, points: Float64) -> Float64:
        """Where points [N, 2] of the frame before are now: their median, in the blocks around."""
        height, width = self.there.shape[:2]
        columns, rows = (points / self.factor).astype(np.int64).T
        steps = [self.there[np.clip(rows + v, 0, height - 1), np.clip(columns + u, 0, width - 1)]
                 for v in (-1, 0, 1) for u in (-1, 0, 1)]
        return np.asarray(points + np.median(steps, axis=0), np.float64)


def block_side(shape: tuple[int, ...]) -> int:
    """Side in pixels of the blocks on which the flow of pictures (H, W, ...) is known."""
    return 2 if min(shape[:2]) >= LARGE else 1


class Flow:
    """The flow through a video."""

    def __init__(self) -> None:
        self._network: Any = cv2.DISOpticalFlow_create(  # type: ignore[attr-defined]
            cv2.DISOPTICAL_FLOW_PRESET_FAST)
        self._before: UInt8 | None = None

    def _luma(self, frame: UInt8, factor: int) -> UInt8:
        """The frame in grey, means of blocks of ``factor`` pixels."""
        size = (-(-frame.shape[1] // factor), -(-frame.shape[0] // factor))
        luma = cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY)
        return np.asarray(cv2.resize(luma, size, interpolation=cv2.INTER_AREA), np.uint8)

    def next(self, frame: UInt8) -> Motion | None:
        """Motion to the next frame; None for the first one and after a cut."""
        factor = block_side(frame.shape)
        luma = self._luma(frame, factor)
        before, self._before = self._before, luma
        if before is None or before.shape != luma.shape:
            return None
        back, there = (self._network.calc(one, two, None)
                       for one, two in ((luma, before), (before, luma)))
        trusted = np.empty(luma.shape, np.bool_)
        trust(back, there, np.float32(DISAGREE / factor), trusted)
        if trusted.mean() < CUT or _unlike(luma, before, back):
            return None
        scale = np.float32(factor)
        return Motion(back * scale, there * scale, trusted, factor)


def _unlike(luma: UInt8, before: UInt8, back: Float32) -> bool:
    """Whether the carried frame before explains less than half of every fourth sample seen."""
    height, width = luma.shape
    y, x = np.mgrid[1:height:4, 1:width:4]
    v = np.clip(y + back[1::4, 1::4, 1], 0, height - 1)
    u = np.clip(x + back[1::4, 1::4, 0], 0, width - 1)
    j, i = (np.minimum(at.astype(np.int64), size - 2) for at, size in ((v, height), (u, width)))
    fy, fx = v - j, u - i
    carried = ((before[j, i] * (1 - fx) + before[j, i + 1] * fx) * (1 - fy)
               + (before[j + 1, i] * (1 - fx) + before[j + 1, i + 1] * fx) * fy)
    here = luma[1::4, 1::4].astype(np.float32)
    left, all_of_it = np.abs(here - carried).mean(), np.abs(here - here.mean()).mean()
    return bool(left > 0.5 * all_of_it and left > 2)


def reduced(prepared: Transfer, factor: float) -> Transfer:
    """The same painting, ``factor`` times smaller.

    Where a target's pixel covers several of the exemplar's, as in many videos, what is copied then
    lies closer together: that saves a third of the look-ups' time.
    """
    image, own = prepared.exemplar.image, prepared.regions
    height, width = (max(8, round(n / factor)) for n in image.shape[:2])
    picture = np.asarray(Image.fromarray(image).resize((width, height), Image.Resampling.LANCZOS))
    ratio = np.array([width, height]) / image.shape[1::-1]
    exemplar = Exemplar(picture, prepared.exemplar.landmarks * ratio, prepared.exemplar.name)
    regions = Regions(exemplar.landmarks, resize(own.person, picture.shape),
                      None if own.hair is None else resize(own.hair, picture.shape))
    chunks = prepared.config.blit
    levels = max(1, chunks.levels - round(np.log2(factor)))
    config = replace(prepared.config, blit=replace(chunks, levels=levels))
    out = Transfer(exemplar, config, regions=regions, exact=True)
    out.palette = prepared.palette  # of eyes that may be shut in the picture
    return out


def paint_onward(prepared: Transfer, frame: UInt8, landmarks: Float64,
                 person: Callable[[], Float32], anchor: Float32, motion: Motion,
                 kept: Bool, before: TransferResult) -> TransferResult:
    """Paint a frame uint8 [H, W, 3] with the shifts of the one before.

    Guides other than the anchor are those of the frame before.

    Parameters
    ----------
    person : Gives the person's mask, float32 [H, W], if it is needed.
    anchor : float32 [H, W, 2].
    motion, kept : From the frame before; bool [h, w], blocks whose anchors came from there.
    before : What the frame before was painted with.
    """
    config, guides = prepared.config.blit, before.guides
    height, width = frame.shape[:2]
    margin = max(config.radius, 1)
    shift = shift_planes(height, width, margin)
    inside = np.moveaxis(shift[:, margin:margin + height, margin:margin + width], 0, -1)
    carry_shifts(before.synthesis.shift, motion.back, motion.factor, kept, guides.position, anchor,
                 inside)
    image = np.empty((height, width, 3), np.float32)
    pitch = anchor_scale(anchor)
    reach = np.float32((3 * config.radius + 2) * pitch)
    vote(prepared.colors(pitch), anchor, reach, shift, margin, config.radius, False, image)
    prepared.part_lips(image, frame, landmarks)
    result, cover = image, before.mask
    if not prepared.covers_all:
        cover = prepared.cover(frame, landmarks, person())
        result = np.empty_like(image)
        blend(frame, np.float32(1 / 255), image, cover, result)
    return replace(before, image=result, guides=replace(guides, anchor=anchor), mask=cover,
                   synthesis=replace(before.synthesis, image=image, shift=inside))


FRESH = 0.25  # Share of the detected landmarks in the carried ones.
TORN = (0.6, 1.7)  # Range of the anchor plane's stretch against a new one.
DETECT = 4  # Landmarks are detected in every Nth frame.
SEGMENT = 8  # And person and hair segmented.
PAINT = 3  # Every Nth frame is painted from scratch; those between are carried onward.
KEPT = 0.85  # Share of carried anchors below which a frame is always painted from scratch.
MOST_PAINTERS = 4
"""More frames are not painted at a time: one thread can't follow the motion faster."""
FRESH_MASKS = 0.5  # Share of the segmented masks in the carried ones.


def _similarity(source: Float64, target: Float64) -> NDArray[np.complex128]:
    """Factors (a, b) of the similarity z -> a z + b that takes points to points best."""
    z, w = (points[:, 0] + 1j * points[:, 1] for points in (source, target))
    centred = z - z.mean()
    a = np.vdot(centred, w - w.mean()) / max(float(np.vdot(centred, centred).real), 1e-9)
    return np.array([a, w.mean() - a * z.mean()])


def _moved(points: Float64, source: Float64, target: Float64) -> Float64:
    """Points moved by the similarity that takes ``source`` to ``target``."""
    a, b = _similarity(source, target)
    z = (points[:, 0] + 1j * points[:, 1]) * a + b
    return np.stack([z.real, z.imag], axis=-1)


@dataclass(frozen=True)
class _Followed:
    """What is known of a frame before it is painted."""

    frame: UInt8
    points: Float64
    anchor: Float32
    masks: Float32
    """Person and, if it is known, hair on blocks, [h, w, 1 or 2]."""
    motion: Motion | None
    kept: Bool | None
    """Blocks whose anchors were carried; None if the frame is to be painted from scratch."""

    @property
    def regions(self) -> Regions:
        """Person and hair at full size."""
        size = self.frame.shape[0], self.frame.shape[1]
        person, *hair = (enlarged(plane, block_side(size), size)
                         for plane in np.moveaxis(self.masks, -1, 0))
        return Regions(self.points, person, hair[0] if hair else None)


class VideoTransfer:
    """The frames of one video, one after the other.

    Parameters
    ----------
    carry : False keeps the seeds where they are in the picture, for comparison.

    Attributes
    ----------
    flicker : For each frame but the first, the root mean square difference to the stylised frame
        before, warped by the flow, over the contrast of the frame. Every
        fourth pixel of every fourth row is looked at.
    """

    def __init__(self, prepared: Transfer, carry: bool = True) -> None:
        self.prepared, self.carry = prepared, carry
        self.flicker: list[float] = []
        self._flow = Flow()
        self._number = 0
        self._landmarks: Float64 | None = None
        self._first: Float64 | None = None
        self._anchor: Float32 | None = None
        self._masks: Float32 | None = None
        self._painted: Float32 | None = None
        self._result: TransferResult | None = None
        self._scale = 1.0

    def apply(self, frame: UInt8, landmarks: Floats | None = None) -> Float32:
        """Stylise the next frame, uint8 [H, W, 3], all of one size; float32 [H, W, 3] in [0, 1].

        Landmarks [68, 2] are detected if None. Where no face is found those of the frame before
        serve.
        """
        step = self._follow(frame, landmarks)
        self._result = self._painting(step, self._result)
        self._compare(step, self._result.image)
        return self._result.image

    def frames(self, frames: Iterable[UInt8]) -> Iterator[UInt8]:
        """Stylise frames as `apply` does, several at a time: uint8 [H, W, 3] each.

        One thread takes frames and follows the motion through the video; others paint, each a frame
        that needs nothing from the one before, and those that go on from it. Each kernel keeps to
        its thread, so none waits for another.
        """
        if not _threads_share_kernels():
            yield from (_bytes_of(self.apply(frame)) for frame in frames)
            return
        cores = numba.get_num_threads()
        painters = min(cores, MOST_PAINTERS)

        def start() -> None:
            numba.set_num_threads(max(1, cores // (painters + 1)))

        def paint(steps: list[_Followed],
                  ) -> list[tuple[_Followed, Float32, UInt8]]:
            made, result = [], None
            for step in steps:
                result = self._painting(step, result)
                made.append((step, result.image, _bytes_of(result.image)))
            return made

        followed = _runs(ahead((self._follow(frame) for frame in frames), start=start))
        for run in in_turn(paint, followed, painters, start):
            for step, image, picture in run:
                self._compare(step, image)
                yield picture

    def _follow(self, frame: UInt8, landmarks: Floats | None = None) -> _Followed:
        """Landmarks, regions and anchor plane of the next frame."""
        motion = self._flow.next(frame)
        points = self._points(frame, landmarks, motion)
        anchor, kept = self._carried(frame.shape, points, motion)
        masks = self._segmented(frame, points, motion)
        if self._number % PAINT == 0 or kept is None or kept.mean() < KEPT or not self.carry:
            kept = None
        self._landmarks = points
        self._number += 1
        return _Followed(frame, points, anchor, masks, motion, kept)

    def _painting(self, step: _Followed, before: TransferResult | None) -> TransferResult:
        """A frame painted from scratch, or onward from the one before."""
        if step.kept is None or step.motion is None or before is None:
            return self.prepared.apply(step.frame, step.points, regions=step.regions,
                                       seeds_anchor=step.anchor if self.carry else None)
        return paint_onward(self.prepared, step.frame, step.points,
                            lambda: step.regions.person, step.anchor, step.motion, step.kept,
                            before)

    def _find(self, frame: UInt8) -> Float64:
        from ..face import detect_landmarks

        found = detect_landmarks(frame, thorough=self._landmarks is None)
        if found is not None:
            return np.asarray(found, np.float64)
        return face_landmarks(frame) if self._landmarks is None else self._landmarks

    def _points(self, frame: UInt8, landmarks: Floats | None, motion: Motion | None) -> Float64:
        """Landmarks of the frame before, moved along and corrected by those found."""
        last = self._landmarks
        if last is None or motion is None:
            return self._find(frame) if landmarks is None else np.asarray(landmarks, np.float64)
        moved = motion.onward(last)
        # The jaw lies on the border of what moves: it follows the rest of the face.
        moved[:17] = _moved(last[:17], last[17:], moved[17:])
        if landmarks is None and self._number % DETECT:
            return moved
        found = self._find(frame) if landmarks is None else np.asarray(landmarks, np.float64)
        # A leap is a face that was lost: no reason to glide there.
        if np.linalg.norm(found - moved, axis=1).mean() > 0.3 * face_size(found):
            return found
        return np.asarray(moved + FRESH * (found - moved), np.float64)

    def _segmented(self, frame: UInt8, points: Float64, motion: Motion | None) -> Float32:
        """Masks of the frame before, carried along, or found, or both."""
        side = block_side(frame.shape)
        masks = None
        if motion is not None and self._masks is not None:
            masks = motion.carry(self._masks)
        if motion is None or masks is None or self._number % SEGMENT == 0:
            fresh = _found_masks(frame, points, side, first=masks is None)
            if motion is None or masks is None:
                masks = fresh
            else:
                share = np.where(motion.trusted, np.float32(FRESH_MASKS), np.float32(1))
                masks = _taken_up(masks, fresh, share[..., None])
        self._masks = masks
        return masks

    def _carried(self, shape: tuple[int, ...], points: Float64,
                 motion: Motion | None) -> tuple[Float32, Bool | None]:
        """The anchor plane of this frame, and the blocks whose anchors come from the one before."""
        side = block_side(shape)
        if self._anchor is None or self._first is None:
            self._first = points
            self._scale = self.prepared.scale(points)
            if self._scale > 1:
                self.prepared = reduced(self.prepared, self._scale)
                self._scale = 1.0
            blocks = -(-shape[0] // side), -(-shape[1] // side)
            self._anchor = pixel_centres(blocks) * np.float32(self._scale * side)
            return pixel_centres(shape) * np.float32(self._scale), None
        kept = None
        scale = np.float32(self._scale)
        if motion is None:
            a, b = _similarity(points, self._first)
            middles = pixel_centres(self._anchor.shape) * np.float32(side)
            z = (middles[..., 0] + 1j * middles[..., 1]) * a + b
            self._anchor = np.stack([z.real, z.imag], axis=-1).astype(np.float32) * scale
        else:
            anchor = motion.carry(self._anchor)
            turn, offset = self._continued(anchor, motion)
            self._anchor = np.empty_like(anchor)
            repair(anchor, motion.trusted, side, scale, np.float32(TORN[0]), np.float32(TORN[1]),
                 turn, offset, self._anchor)
            kept = (anchor[..., 0] == self._anchor[..., 0]) & motion.trusted
        out = np.empty((*shape[:2], 2), np.float32)
        unfold(self._anchor, side, scale, np.float32(TORN[1]), out)
        return out, kept

    def _continued(self, anchor: Float32, motion: Motion) -> tuple[complex, complex]:
        """The similarity (a, b), z -> a z + b, that continues a carried plane at restarts.

        That of the person: new parts then join the old ones. A new plane in the picture where the
        person has become much larger or smaller.
        """
        every = slice(2, None, 5)
        person = motion.trusted[every, every]
        if self._masks is not None:
            person = person & (self._masks[every, every, 0] > 0.5)
        if person.sum() > 30:
            rows, columns = np.nonzero(person)
            places = (np.stack([columns, rows], axis=-1) * 5 + 2.5) * motion.factor
            values = anchor[every, every][person]
            for _ in range(2):
                a, b = _similarity(places.astype(np.float64), values.astype(np.float64))
                z = (places[:, 0] + 1j * places[:, 1]) * a + b
                off = np.abs(z - (values[:, 0] + 1j * values[:, 1]))
                near = off <= 2 * np.median(off) + 1e-6
                places, values = places[near], values[near]
            if TORN[0] < abs(a) / self._scale < TORN[1]:
                return complex(a), complex(b)
        return complex(self._scale), 0j

    def _compare(self, step: _Followed, image: Float32) -> None:
        """Add the error against the frame before."""
        motion, before, self._painted = step.motion, self._painted, image
        if motion is None or before is None:
            return
        sums = np.empty((motion.trusted.shape[0], 8), np.float64)
        squared_changes(image, before, motion.back, motion.factor, motion.trusted, 2, sums)
        total = sums.sum(axis=0)
        count = max(float(total[0]), 1.0)
        contrast = float(np.sqrt(max((total[5:] / count - (total[2:5] / count) ** 2).mean(), 0.0)))
        if contrast > 1 / 255:
            self.flicker.append(float(np.sqrt(total[1] / (3 * count))) / contrast)


def _runs(steps: Iterator[_Followed]) -> Iterator[list[_Followed]]:
    """Each frame that is painted from scratch, with those carried onward from it."""
    run: list[_Followed] = []
    try:
        for step in steps:
            if run and step.kept is None:
                yield run
                run = []
            run.append(step)
        if run:
            yield run
    finally:
        close = getattr(steps, "close", None)
        if close is not None:
            close()


def _bytes_of(image: Float32) -> UInt8:
    out = np.empty(image.shape, np.uint8)
    to_bytes(image, out)
    return out


def _taken_up(masks: Float32, fresh: Float32, share: Float32) -> Float32:
    """Masks [h, w, 1 or 2] a ``share`` [h, w, 1] of the way to those found now.

    Hair that is not found now stays: segmentation by color runs on first frames only.
    """
    both = min(masks.shape[-1], fresh.shape[-1])
    mixed = masks[..., :both] + share * (fresh[..., :both] - masks[..., :both])
    more = masks if masks.shape[-1] > both else fresh
    return np.asarray(np.concatenate([mixed, more[..., both:]], axis=-1), np.float32)


def _found_masks(frame: UInt8, points: Float64, side: int, first: bool) -> Float32:
    """Masks of the person and, if it is known, the hair on blocks of a frame, [h, w, 1 or 2].

    The networks see less than that: nothing is gained by showing them the whole frame. Only in a
    ``first`` frame, hair is segmented by color where the network fails.
    """
    small = np.asarray(Image.fromarray(frame).reduce(side))
    regions = find_regions(small, points / side, size=256, by_color=first)
    masks = [regions.person] if regions.hair is None else [regions.person, regions.hair]
    return np.stack(masks, axis=-1)


def _threads_share_kernels() -> bool:
    """Whether kernels may run on several threads at once: Numba's own pool forbids it."""
    try:
        return bool(numba.threading_layer() != "workqueue")
    except ValueError:
        return False
