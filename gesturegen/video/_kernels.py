"""The rasteriser: a loop over pixels that cannot be arrays."""

from __future__ import annotations

import math

import numpy as np

from gesturegen.compiled import njit


@njit(cache=True, nogil=True)
def draw_capsules(image, segments, radii, colours, box):
    """Paint round-ended lines with smooth edges into `image`, in order, later ones over earlier ones.

    image : uint8 [shape=(H, W, 3)]; segments : float [shape=(K, 4)], x0 y0 x1 y1 in pixels
    radii : float [shape=(K,)], pixels; colours : uint8 [shape=(K, 3)]
    box : int [shape=(4,)], left, top, right, bottom of what may be painted
    """
    for k in range(segments.shape[0]):
        x0, y0, x1, y1 = segments[k]
        reach = radii[k] + 0.5
        dx, dy = x1 - x0, y1 - y0
        length = dx * dx + dy * dy
        top = max(box[1], math.floor(min(y0, y1) - reach))
        bottom = min(box[3], math.ceil(max(y0, y1) + reach) + 1)
        for y in range(top, bottom):
            # Only the part of the line near this row can reach it: long thin lines stay cheap.
            low, high = 0.0, 1.0
            if abs(dy) > 1e-9:
                a, b = (y - reach - 1.0 - y0) / dy, (y + reach + 1.0 - y0) / dy
                low, high = min(max(min(a, b), 0.0), 1.0), min(max(max(a, b), 0.0), 1.0)
            xa, xb = x0 + low * dx, x0 + high * dx
            left = max(box[0], math.floor(min(xa, xb) - reach))
            right = min(box[2], math.ceil(max(xa, xb) + reach) + 1)
            for x in range(left, right):
                along = 0.0
                if length > 0.0:
                    along = min(max(((x - x0) * dx + (y - y0) * dy) / length, 0.0), 1.0)
                px, py = x - x0 - along * dx, y - y0 - along * dy
                cover = min(reach - math.sqrt(px * px + py * py), 1.0)
                if cover > 0.0:
                    for c in range(3):
                        before = float(image[y, x, c])
                        image[y, x, c] = int(before + cover * (float(colours[k, c]) - before) + 0.5)


@njit(cache=True, nogil=True)
def to_yuv420(image, planes):
    """Convert a picture to planes of video, in whole numbers: BT.601, 16 to 235, one colour for each 2 by 2 pixels.

    image : uint8 [shape=(H, W, 3)], H and W even; planes : uint8 [shape=(3 H / 2, W)], written to:
    the brightness, then both colour planes, two of their rows side by side in one
    """
    height, width = image.shape[0], image.shape[1]
    for y in range(height):
        for x in range(width):
            r, g, b = np.int32(image[y, x, 0]), np.int32(image[y, x, 1]), np.int32(image[y, x, 2])
            planes[y, x] = ((66 * r + 129 * g + 25 * b + 128) >> 8) + 16
    colour = planes[height:].reshape(2, height // 2, width // 2)
    for y in range(height // 2):
        for x in range(width // 2):
            r, g, b = np.int32(0), np.int32(0), np.int32(0)
            for k in range(2):
                for m in range(2):
                    r += image[2 * y + k, 2 * x + m, 0]
                    g += image[2 * y + k, 2 * x + m, 1]
                    b += image[2 * y + k, 2 * x + m, 2]
            colour[0, y, x] = ((-38 * r - 74 * g + 112 * b + 512) >> 10) + 128
            colour[1, y, x] = ((112 * r - 94 * g - 18 * b + 512) >> 10) + 128
