"""Hot loops of soft labels and materials, and of the guides' weights.

Features (brows, eyes, nose, lips, and all that is below the jaw) are soft and come as block means
of the picture; person and hair come at full size. Both loops interpolate the former on the fly,
sixteen pixels of a row at once.
"""

import numba
import numpy as np

from ...simd.decorators import kernel, lean_kernel, woven
from ...simd.interleaved import gather_signed, pairs, singles, store_pairs
from ...simd.threads import shared
from ...simd.vectors import LANES

_floats, _ints, _iota, _lane = LANES.floats, LANES.ints, LANES.iota, LANES.lane
_floor, _minimum, _maximum = LANES.floor, LANES.minimum, LANES.maximum


@shared("image")
@lean_kernel
def luma(since, until, image, scale, out):
    """Rec. 601 luma of ``image`` [H, W, 3 or more], any number type, times ``scale``."""
    red, green, blue = (np.float32(0.299) * scale, np.float32(0.587) * scale,
                        np.float32(0.114) * scale)
    for y in range(since, until):
        for x in range(image.shape[1]):
            out[y, x] = (red * np.float32(image[y, x, 0]) + green * np.float32(image[y, x, 1])
                         + blue * np.float32(image[y, x, 2]))


@numba.njit(cache=True, inline="always")
def _place(n, factor, count):
    """Block before pixel ``n`` and the share of the next one, of ``count`` blocks."""
    share = (np.float32(n) + np.float32(0.5)) / np.float32(factor) - np.float32(0.5)
    block = min(max(np.int64(np.floor(share)), 0), max(count - 2, 0))
    return block, min(max(share - np.float32(block), np.float32(0)), np.float32(1))


@woven
def _places(first, factor, count):
    """`_place` of the pixels first .. first + 15."""
    zero, half, one = np.float32(0), np.float32(0.5), np.float32(1)
    share = (_floats(_iota() + np.int32(first)) + half) / np.float32(factor) - half
    block = _ints(_minimum(_maximum(_floor(share), zero), np.float32(max(count - 2, 0))))
    return block, _minimum(_maximum(share - _floats(block), zero), one)


@woven
def _between(line, i, right, fx):
    """Values of ``line`` between the blocks ``i`` and ``right``."""
    left = gather_signed(line, i)
    return left + fx * (gather_signed(line, right) - left)


@numba.njit(cache=True, inline="always")
def _byte(value):
    return _ints(value * np.float32(255) + np.float32(0.5))


@numba.njit(cache=True, inline="always")
def _four(a, b, c, d):
    """Four bytes as one word, the first one lowest."""
    return a | (b << np.int32(8)) | (c << np.int32(16)) | (d << np.int32(24))


@shared("person")
@kernel
def soft_labels(since, until, person, hair, planes, factor, hair_is_skin, body_is_ground, out):
    """Labels of every pixel in the order of `PICTURE_LABELS`: eight bytes in two words.

    Parameters
    ----------
    person, hair : float32 [H, W].
    planes : float32 [5, h, w], means over blocks of ``factor`` pixels: brows, eyes, nose, lips,
        body.
    hair_is_skin, body_is_ground : Give hair to the skin, the body to the background.
    out : int32 [H, W, 2].
    """
    width = person.shape[1]
    rows, columns = planes.shape[1:]
    people, crowns, words = person.reshape(-1), hair.reshape(-1), out.reshape(-1)
    zero, one = np.float32(0), np.float32(1)
    for y in range(since, until):
        j, fy = _place(y, factor, rows)
        below = min(j + 1, rows - 1)
        # One more block, so that whole vectors may reach beyond the border.
        lines = np.zeros((5, columns + 1), np.float32)
        busy = np.zeros(columns + 1, np.bool_)
        for k in range(5):
            for i in range(columns):
                lines[k, i] = planes[k, j, i] + fy * (planes[k, below, i] - planes[k, j, i])
        for k in range(4):
            for i in range(columns):
                busy[i] |= lines[k, i] > 0
        for first in range(0, width, 16):
            n = y * width + first
            i, fx = _places(first, factor, columns)
            right = _minimum(i + np.int32(1), np.int32(columns - 1))
            rest = _floats(one)
            low = _ints(np.int32(0))
            any_feature = False
            for block in range(_lane(i, 0), _lane(right, 15) + 1):
                any_feature |= busy[block]
            if any_feature:
                brows = _between(lines[0], i, right, fx)
                eyes = _between(lines[1], i, right, fx)
                nose = _between(lines[2], i, right, fx)
                lips = _between(lines[3], i, right, fx)
                no_brows = one - brows
                no_eyes = no_brows * (one - eyes)
                no_nose = no_eyes * (one - nose)
                rest = no_nose * (one - lips)
                low = _four(_byte(brows), _byte(eyes * no_brows), _byte(nose * no_eyes),
                            _byte(lips * no_nose))
            body = _between(lines[4], i, right, fx)
            inside, crown = singles(people, n) * rest, singles(crowns, n)
            if hair_is_skin:
                crown = _floats(zero)
            skin = inside * (one - crown)
            ground = rest - inside
            below_jaw = skin * body
            if body_is_ground:
                ground = ground + below_jaw
                below_jaw = _floats(zero)
            high = _four(_byte(skin * (one - body)), _byte(inside * crown), _byte(below_jaw),
                         _byte(ground))
            if first + 16 <= width:
                store_pairs(words, 2 * n, low, high)
            else:
                for k in range(width - first):
                    words[2 * (n + k)] = _lane(low, k)
                    words[2 * (n + k) + 1] = _lane(high, k)


@shared("person")
@kernel
def pixel_weights(since, until, person, labels, soft, face, lines, factor, place, outline, look,
                  hair, body, skin, hold, out):
    """Weights of place and appearance of every pixel, float32 [H, W, 2].

    Parameters
    ----------
    person : float32 [H, W].
    labels : int32 [H, W, 2], eight bytes in two words.
    soft : float32 [h, w], the person blurred, means over blocks of ``factor`` pixels.
    place, look : float32 [2] each, weight outside the person and on it.
    face : float32 [h, w], 1 between jaw and brows, blurred, at the middles of the same blocks.
    lines : float32 [h, w] there, 1 where the exemplar is drawn in lines: the appearance does not
        count.
    outline : Added to the weight of the place where ``soft`` is one half, and along the jaw.
    hair, body : float32 [2] each, factors of the weights of place and appearance there.
    skin : Factor of the weight of the appearance on skin where ``face`` is 0.
    hold : Times that the weight of the place is added to itself at lines.
    """
    width = person.shape[1]
    rows, columns = soft.shape
    people, words, flat = person.reshape(-1), labels.reshape(-1), out.reshape(-1)
    one, four, byte = np.float32(1), np.float32(4), np.int32(255)
    less_skin = (one - skin) / np.float32(255)
    less_hair, less_body = (one - hair[1]) / np.float32(255), (one - body[1]) / np.float32(255)
    free_hair, free_body = (one - hair[0]) / np.float32(255), (one - body[0]) / np.float32(255)
    place_out, place_step = place[0], place[1] - place[0]
    look_out, look_step = look[0], look[1] - look[0]
    for y in range(since, until):
        j, fy = _place(y, factor, rows)
        below = min(j + 1, rows - 1)
        line, faces, inks = (np.empty(columns, np.float32), np.empty(columns, np.float32),
                             np.empty(columns, np.float32))
        for i in range(columns):
            line[i] = soft[j, i] + fy * (soft[below, i] - soft[j, i])
            faces[i] = one - (face[j, i] + fy * (face[below, i] - face[j, i]))
            inks[i] = lines[j, i] + fy * (lines[below, i] - lines[j, i])
        for first in range(0, width, 16):
            n = y * width + first
            i, fx = _places(first, factor, columns)
            right = _minimum(i + np.int32(1), np.int32(columns - 1))
            edge, away = _between(line, i, right, fx), _between(faces, i, right, fx)
            inside = singles(people, n)
            _, high = pairs(words, n)
            crown, below = (_floats((high >> np.int32(8)) & byte),
                            _floats((high >> np.int32(16)) & byte))
            # Skin against neck, clothes or ground: the jaw must not break where chunks meet.
            jaw = (_floats(high & byte) * (below + _floats((high >> np.int32(24)) & byte))
                   * np.float32(1 / 65025))
            held = one - free_hair * crown - free_body * below
            drawn = _between(inks, i, right, fx)
            near = ((place_out + place_step * inside) * held
                    + four * outline * _maximum(edge * (one - edge), jaw)) * (one + hold * drawn)
            share = (one - less_hair * crown - less_body * below
                     - less_skin * away * _floats(high & byte))
            looks = (look_out + look_step * inside) * share * (one - drawn)
            if first + 16 <= width:
                store_pairs(flat, 2 * n, near, looks)
            else:
                for k in range(width - first):
                    flat[2 * (n + k)] = _lane(near, k)
                    flat[2 * (n + k) + 1] = _lane(looks, k)


@shared("out")
@lean_kernel
def shrink_label(since, until, labels, channel, invert, factor, out):
    """Means of blocks of ``factor`` x ``factor`` pixels of one label, into ``out`` [h, w] float32.

    ``labels`` uint8 [H, W, K]; 255 counts as 1, or as 0 with ``invert``.
    """
    height, width = labels.shape[:2]
    for j in range(since, until):
        top, bottom = j * factor, min((j + 1) * factor, height)
        for i in range(out.shape[1]):
            left, right = i * factor, min((i + 1) * factor, width)
            total = 0
            for y in range(top, bottom):
                for x in range(left, right):
                    total += np.int64(labels[y, x, channel])
            mean = np.float32(total) / np.float32(255 * (bottom - top) * (right - left))
            out[j, i] = np.float32(1) - mean if invert else mean


@shared("person")
@lean_kernel
def own_body(since, until, position, style, top, labels, person):
    """Give pixels of body and background from row ``top`` on the exemplar's labels, in place.

    Parameters
    ----------
    position : float32 [H, W, 2], places in the exemplar; nothing changes where they are NaN or
        outside.
    style, labels : int32 [h, w, 2] and [H, W, 2], eight bytes in two words; the last two are
        body and background.
    person : float32 [H, W], follows the background.
    """
    width = person.shape[1]
    byte, nearly = np.int32(255), np.int32(240)
    for y in range(max(top, since), until):
        for x in range(width):
            high = labels[y, x, 1]
            if ((high >> 16) & byte) + ((high >> 24) & byte) <= nearly:
                continue
            u, v = position[y, x, 0], position[y, x, 1]
            if 0 <= u < style.shape[1] and 0 <= v < style.shape[0]:
                i, j = np.int64(u), np.int64(v)
                labels[y, x, 0], labels[y, x, 1] = style[j, i, 0], style[j, i, 1]
                ground = (style[j, i, 1] >> 24) & byte
                person[y, x] = np.float32(byte - ground) * np.float32(1 / 255)


@shared("shares")
@lean_kernel
def largest_share(since, until, shares, out):
    """The first of each row's largest values, float32 [N, M], into ``out`` int64 [N]."""
    for n in range(since, until):
        best = 0
        for m in range(1, shares.shape[1]):
            if shares[n, m] > shares[n, best]:
                best = m
        out[n] = best


@shared("position")
@lean_kernel
def move_to_material(since, until, position, material, nearest, out):
    """Positions [N, 2], moved to the nearest pixel of each place's material, into ``out``.

    Parameters
    ----------
    position, material : float32 [N, 2] (x, y) and int64 [N].
    nearest : int32 [M, h, w], flat index of the nearest pixel of each material.
    out : float32 [N, 2]; a position in its own material stays as it is.
    """
    height, width = nearest.shape[1], nearest.shape[2]
    for n in range(since, until):
        x = np.int64(min(max(position[n, 0], np.float32(0)), np.float32(width - 1)))
        y = np.int64(min(max(position[n, 1], np.float32(0)), np.float32(height - 1)))
        near = nearest[material[n], y, x]
        if near == y * width + x:
            out[n, 0], out[n, 1] = position[n, 0], position[n, 1]
        else:
            out[n, 0] = np.float32(near % width) + np.float32(0.5)
            out[n, 1] = np.float32(near // width) + np.float32(0.5)
