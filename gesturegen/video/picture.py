"""Pictures of a video, one per frame: front and side view of every motion, floor grid, title and time code."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from gesturegen.extras import need
from gesturegen.video._kernels import draw_capsules
from gesturegen.video.figure import Figure

# Okabe and Ito's blue and vermillion differ in lightness too, so that no kind of colour blindness mixes them.
_COLOURS = np.array([[88, 88, 92], [0, 114, 178], [213, 94, 0]], dtype=np.uint8)
_PAPER, _INK, _FAINT, _GRID = (np.array(c, dtype=np.float64) for c in ((250,) * 3, (30,) * 3, (110,) * 3, (196,) * 3))
# Camera: how far away, how high above the level, both for the whole body; what must fit in the picture.
_DISTANCE, _ELEVATION = 4.0, np.radians(8.0)
_FITS_HEIGHT, _FITS_WIDTH = 1.24, (0.6, 1.5)
_VIEWS = (("front", 0.0), ("right side", -np.pi / 2))
_ENDED = 190
_GRID_REACH, _GRID_CENTIMETRES = 1.1, 50.0


@dataclass(frozen=True, eq=False)
class Scene:
    """A motion to show: its figure and its label."""

    label: str
    figure: Figure


@dataclass(frozen=True, eq=False)
class _Panel:
    """One view of one motion: its box in pixels, and the lines of every frame, projected beforehand.

    segments : float [shape=(T, L, 4)]; radii : float [shape=(T, L)]; colours : uint8 [shape=(T, L, 3)]:
    in each frame the floor first, then the bones from far to near
    """

    box: np.ndarray
    segments: np.ndarray
    radii: np.ndarray
    colours: np.ndarray


def draw_pictures(
    scenes: Sequence[Scene], title: str, size: tuple[int, int], fps: float, n_frames: int
) -> Iterator[np.ndarray]:
    """Yield `n_frames` pictures, uint8 `[shape=(height, width, 3)]`; `size` is width and height in pixels.

    A motion that is shorter than `n_frames` holds its last pose, in grey.
    """
    width, height = size
    bar = max(round(height / 16), 14)
    span = _span(scenes)
    boxes = _arrange(len(scenes), width, height, bar, span)
    panels = [
        _make_panel(scene, boxes[k][v], yaw, span, n_frames)
        for k, scene in enumerate(scenes)
        for v, (_, yaw) in enumerate(_VIEWS)
    ]
    paper = np.full((height, width, 3), _PAPER, dtype=np.uint8)
    _draw_labels(paper, scenes, boxes, title, bar)
    seconds = n_frames / fps
    for frame in range(n_frames):
        image = paper.copy()
        for panel in panels:
            draw_capsules(image, panel.segments[frame], panel.radii[frame], panel.colours[frame], panel.box)
        clock = f"{_clock(frame / fps)} / {_clock(seconds)}   frame {frame} of {n_frames}"
        _stamp(image, _clock_mask(clock, max(round(0.55 * bar), 8)), 0.22 * bar, _INK, right=width - bar // 3)
        yield image


# --- layout -------------------------------------------------------------------------------------------------


def _span(scenes: Sequence[Scene]) -> float:
    """Compute how wide a view must be for the widest gesture, in body heights; the same for all motions."""
    reach = 0.0
    for scene in scenes:
        figure = scene.figure
        away = np.abs(figure.points[..., [0, 2]] - figure.targets[:, None])
        reach = max(reach, float(np.percentile(away.max(axis=(1, 2)), 99)))
    # What is near the camera looks larger than what is beside the body.
    return float(np.clip(2.3 * reach, *_FITS_WIDTH))


def _arrange(n_scenes: int, width: int, height: int, bar: int, span: float) -> list[list[np.ndarray]]:
    """Arrange boxes (left, top, right, bottom) by scene and view: in one row, or side views below if that is larger."""
    room = height - bar
    by_row = _fitting(width / (2 * n_scenes), room, span)
    stacked = _fitting(width / n_scenes, room / 2, span)
    boxes = []
    for k in range(n_scenes):
        pair = []
        for v in range(2):
            if by_row >= stacked:
                left, right = (2 * k + v) * width / (2 * n_scenes), (2 * k + v + 1) * width / (2 * n_scenes)
                top, bottom = float(bar), float(height)
            else:
                left, right = k * width / n_scenes, (k + 1) * width / n_scenes
                top, bottom = bar + v * room / 2, bar + (v + 1) * room / 2
            pair.append(np.array([left + 1, top, right - 1, bottom]).round().astype(np.int64))
        boxes.append(pair)
    return boxes


def _fitting(width: float, height: float, span: float) -> float:
    """Compute the pixels per body height with which a figure fits a box."""
    return min(width / span, height / _FITS_HEIGHT)


# --- camera -------------------------------------------------------------------------------------------------


def _project(points: np.ndarray, targets: np.ndarray, yaw: float, box: np.ndarray, scale: float) -> np.ndarray:
    """Project points `[shape=(..., 3)]` to pixels and depth `[shape=(..., 3)]`, with the camera turned to `targets`.

    targets : X and Z `[shape=(..., 2)]`, broadcast over points; depth is 1 at the target, less nearer
    """
    away = np.array([np.sin(yaw) * np.cos(_ELEVATION), np.sin(_ELEVATION), np.cos(yaw) * np.cos(_ELEVATION)])
    right = np.array([np.cos(yaw), 0.0, -np.sin(yaw)])
    up = np.cross(away, right)
    centre = np.stack([targets[..., 0], np.full(targets.shape[:-1], 0.5), targets[..., 1]], axis=-1)
    seen = points - centre
    depth = np.maximum(1.0 - seen @ away / _DISTANCE, 0.05)
    x = (box[0] + box[2]) / 2 + scale * (seen @ right) / depth
    # The body's middle stands a little above the box's: the label is below.
    y = box[1] + 0.49 * (box[3] - box[1]) - scale * (seen @ up) / depth
    return np.stack([x, y, depth], axis=-1)


def _make_panel(scene: Scene, box: np.ndarray, yaw: float, span: float, n_frames: int) -> _Panel:
    """Project all frames of a motion into one box."""
    figure = scene.figure
    shown = np.minimum(np.arange(n_frames), len(figure.points) - 1)
    scale = _fitting(box[2] - box[0], box[3] - box[1], span)
    targets = figure.targets[shown]
    floor, strength = _floor_lines(targets, figure.height)
    floor = _project(floor, targets[:, None, None], yaw, box, scale)[..., :2].reshape(n_frames, -1, 4)
    floor_colours = _PAPER + strength[..., None] * (_GRID - _PAPER)
    pixels = _project(figure.points[shown], targets[:, None], yaw, box, scale)
    a, b = pixels[:, figure.bones[:, 0]], pixels[:, figure.bones[:, 1]]
    depth = (a[..., 2] + b[..., 2]) / 2
    colours = _shade(figure.sides, depth)
    colours[len(figure.points) :] = _ENDED
    order = np.arange(n_frames)[:, None], np.argsort(-depth, axis=1, kind="stable")
    segments = np.concatenate([a[..., :2], b[..., :2]], axis=-1)[order]
    radii = np.maximum(scale * figure.radii / depth, 0.6)[order]
    return _Panel(
        box,
        np.concatenate([floor, segments], axis=1),
        np.concatenate([np.full(strength.shape, 0.5), radii], axis=1),
        np.concatenate([floor_colours, colours[order]], axis=1).astype(np.uint8),
    )


def _floor_lines(targets: np.ndarray, height: float) -> tuple[np.ndarray, np.ndarray]:
    """Make squares of 50 cm on the floor: ends `[shape=(T, L, 2, 3)]`, strength `[shape=(T, L)]`.

    Lines fade outwards, so that none appears at once. height : of the body in file units; a file in other
    units than centimetres gets squares of a similar look.
    """
    spacing = _GRID_CENTIMETRES / height if 80 <= height <= 300 else 0.3
    count = int(2 * _GRID_REACH / spacing) + 1
    lines, strengths = [], []
    for axis in range(2):
        middle = targets[:, axis, None]
        marks = (np.ceil((middle - _GRID_REACH) / spacing) + np.arange(count)) * spacing
        ends = np.zeros((len(targets), count, 2, 3))
        ends[..., 2 * axis] = marks[..., None]
        ends[..., 2 - 2 * axis] = targets[:, 1 - axis, None, None] + np.array([-_GRID_REACH, _GRID_REACH])
        lines.append(ends)
        strengths.append(np.clip(1.0 - np.abs(marks - middle) / _GRID_REACH, 0.0, 1.0))
    return np.concatenate(lines, axis=1), np.concatenate(strengths, axis=1)


def _shade(sides: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Compute colours uint8 `[shape=(T, B, 3)]`: bones further away are paler."""
    pale = np.clip((depth - 0.95) / 0.12, 0.0, 1.0)[..., None] * 0.45
    return np.round(_COLOURS[sides] * (1.0 - pale) + _PAPER * pale).astype(np.uint8)


# --- drawing ------------------------------------------------------------------------------------------------


def _draw_labels(image: np.ndarray, scenes: Sequence[Scene], boxes: list, title: str, bar: int) -> None:
    """Draw the title, the names of motions and views, and which colour is which side."""
    _write(image, title, 0.6 * bar, left=bar // 3, top=0.2 * bar, colour=_INK, most=0.55 * image.shape[1])
    for scene, pair in zip(scenes, boxes, strict=True):
        for (view, _), box in zip(_VIEWS, pair, strict=True):
            text = f"{scene.label}, {view}" if scene.label else view
            room = box[2] - box[0] - bar // 2
            _write(image, text, 0.5 * bar, left=box[0] + bar // 4, top=box[3] - 0.75 * bar, colour=_FAINT, most=room)
    last = boxes[-1][-1]
    for k, (text, side) in enumerate((("left", 1), ("right", 2))):
        _write(
            image, text, 0.5 * bar, right=last[2] - bar // 4, top=last[1] + (0.1 + 0.6 * k) * bar, colour=_COLOURS[side]
        )


def _write(
    image: np.ndarray, text: str, size: float, top: float, colour: np.ndarray,
    left: float | None = None, right: float | None = None, most: float = np.inf,
) -> None:  # fmt: skip
    """Write a line of text from `left` or up to `right`, cut to `most` pixels."""
    mask = _text_mask(text, max(round(size), 8))
    if mask.shape[1] > most and len(text) > 1:
        kept = max(int(len(text) * most / mask.shape[1]) - 2, 1)
        mask = _text_mask(text[:kept] + "...", max(round(size), 8))
    _stamp(image, mask, top, colour, left, right)


def _stamp(
    image: np.ndarray, mask: np.ndarray, top: float, colour: np.ndarray,
    left: float | None = None, right: float | None = None,
) -> None:  # fmt: skip
    """Paint `colour` where `mask` covers, from `left` or up to `right`."""
    start = max(round(left if left is not None else right - mask.shape[1]), 0)
    place = image[max(round(top), 0) :, start:][: mask.shape[0], : mask.shape[1]]
    cover = mask[: place.shape[0], : place.shape[1], None] / np.float32(255.0)
    place[:] = place + cover * (colour.astype(np.float32) - place)


def _text_mask(text: str, size: int, width: int | None = None) -> np.ndarray:
    """Render the coverage of a line of text, uint8 `[shape=(h, w)]`, as high for every text of one size."""
    font = _font(size)
    width = int(np.ceil(font.getlength(text))) if width is None else width
    picture = need("PIL.Image", "video").new("L", (max(width, 1), sum(font.getmetrics())))
    need("PIL.ImageDraw", "video").Draw(picture).text((0, 0), text, fill=255, font=font)
    return np.asarray(picture)


def _clock_mask(text: str, size: int) -> np.ndarray:
    """Render the coverage of a text whose digits are all as wide, so that a running number stands still."""
    return np.concatenate([_glyph_mask(character, size) for character in text], axis=1)


@lru_cache(maxsize=256)
def _glyph_mask(character: str, size: int) -> np.ndarray:
    """Render the coverage of one character; all digits are as wide as the widest."""
    widest = "0123456789" if character.isdigit() else character
    return _text_mask(character, size, max(int(np.ceil(_font(size).getlength(c))) for c in widest))


@lru_cache(maxsize=16)
def _font(size: int) -> Any:
    """Load the default font in a size in pixels."""
    return need("PIL.ImageFont", "video").load_default(size)


def _clock(seconds: float) -> str:
    """Format seconds as `mm:ss.cc`."""
    minutes, rest = divmod(round(seconds * 100), 6000)
    return f"{minutes:02d}:{rest // 100:02d}.{rest % 100:02d}"
