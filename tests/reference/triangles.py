"""A plain rasteriser of triangles: depth buffer, colors between corners or from a picture."""

import numba
import numpy as np


@numba.njit(cache=True)
def _draw(points, faces, colors, places, picture, image, depth):
    height, width, _ = image.shape
    rows, columns, _ = picture.shape
    for face in faces:
        a, b, c = points[face[0]], points[face[1]], points[face[2]]
        if a[2] <= 0 or b[2] <= 0 or c[2] <= 0:
            continue
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if area == 0:
            continue
        left = max(int(np.floor(min(a[0], b[0], c[0]) - 0.5)), 0)
        right = min(int(np.ceil(max(a[0], b[0], c[0]))) + 1, width)
        top = max(int(np.floor(min(a[1], b[1], c[1]) - 0.5)), 0)
        bottom = min(int(np.ceil(max(a[1], b[1], c[1]))) + 1, height)
        for y in range(top, bottom):
            for x in range(left, right):
                px, py = x + 0.5, y + 0.5
                u = ((b[0] - px) * (c[1] - py) - (b[1] - py) * (c[0] - px)) / area
                v = ((c[0] - px) * (a[1] - py) - (c[1] - py) * (a[0] - px)) / area
                w = 1 - u - v
                if u < 0 or v < 0 or w < 0:
                    continue
                # Even in space, not in the picture.
                inverse = u / a[2] + v / b[2] + w / c[2]
                z = 1 / inverse
                if z >= depth[y, x]:
                    continue
                depth[y, x] = z
                u, v, w = u / a[2] * z, v / b[2] * z, w / c[2] * z
                if rows == 0:
                    for k in range(3):
                        image[y, x, k] = (u * colors[face[0], k] + v * colors[face[1], k]
                                          + w * colors[face[2], k])
                    continue
                s = (u * places[face[0], 0] + v * places[face[1], 0]
                     + w * places[face[2], 0]) * columns - 0.5
                t = (u * places[face[0], 1] + v * places[face[1], 1]
                     + w * places[face[2], 1]) * rows - 0.5
                s, t = min(max(s, 0.0), columns - 1.001), min(max(t, 0.0), rows - 1.001)
                i, j = int(s), int(t)
                s, t = s - i, t - j
                for k in range(3):
                    image[y, x, k] = ((1 - t) * ((1 - s) * picture[j, i, k]
                                                 + s * picture[j, i + 1, k])
                                      + t * ((1 - s) * picture[j + 1, i, k]
                                             + s * picture[j + 1, i + 1, k]))


def draw(cameras, view, vertices, faces, *, colors=None, places=None, picture=None,
         background=1.0):
    """A picture [H, W, 3] of a mesh, and its depths [H, W], infinite beside it.

    ``colors`` [V, 3] in [0, 1], or ``places`` [V, 2] (x right, y down, 0 to 1) in a ``picture``
    uint8 [h, w, 3].
    """
    pixels, depth = cameras.project(np.asarray(vertices, np.float64))
    points = np.column_stack([pixels[view], depth[view]])
    size = int(cameras.height[view]), int(cameras.width[view])
    image = np.full((*size, 3), background)
    far = np.full(size, np.inf)
    nothing = np.zeros((0, 2))
    _draw(points, np.asarray(faces, np.int64),
          np.zeros((0, 3)) if colors is None else np.asarray(colors, np.float64),
          nothing if places is None else np.asarray(places, np.float64),
          np.zeros((0, 0, 3)) if picture is None else picture / 255.0, image, far)
    return image, far
