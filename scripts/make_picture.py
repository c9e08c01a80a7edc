"""Make the moving picture of the README: new gestures on the demo dataset, with the words that are said.

    python scripts/make_picture.py WORK DATA OUT.gif

WORK is a work folder in which `gesturegen run` has finished the demo dataset DATA. The first test clip is drawn by the
renderer of `gesturegen render`, `SECONDS` of it from where somebody begins to speak, as a GIF that repeats.
"""

from __future__ import annotations

import argparse
import io
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from gesturegen import files
from gesturegen.api import read_motion, read_speech
from gesturegen.motion.skeleton import Motion
from gesturegen.video import figure, picture

WIDTH, HEIGHT, STRIP, TEXT = 520, 270, 50, 13
SECONDS, STEP, COLOURS = 5.0, 2, 40  # every second frame: 15 pictures a second
SIGHT = 2.2  # seconds of words in sight
ROOT = "b_root"
PAPER, INK, FAINT, SAID = (250, 250, 250), (30, 30, 30), (150, 150, 150), (0, 114, 178)


def draw(motion: Motion, words: list[tuple[str, float, float]], began: float) -> list[Image.Image]:
    """Pictures of `SECONDS` of a motion from `began`: front and side view, below them the words as they are said."""
    first = round(began * motion.fps)
    taken = motion.take(np.arange(first, min(first + round(SECONDS * motion.fps), motion.n_frames)))
    scene = picture.Scene("", figure.make_figure(taken, ROOT))
    font = ImageFont.load_default(TEXT)
    pictures = []
    shown = picture.draw_pictures([scene], "gestures for new speech", (WIDTH, HEIGHT), motion.fps, taken.n_frames)
    for frame, view in enumerate(shown):
        if frame % STEP:
            continue
        image = Image.new("RGB", (WIDTH, HEIGHT + STRIP), PAPER)
        image.paste(Image.fromarray(view))
        pen = ImageDraw.Draw(image)
        now = began + frame / motion.fps
        pen.line([(0, HEIGHT), (WIDTH, HEIGHT)], fill=(220, 220, 220))
        middle, scale = WIDTH / 2, WIDTH / SIGHT
        for text, start, end in words:
            left, right = middle + scale * (start - now), middle + scale * (end - now)
            if right < -60 or left > WIDTH + 60:
                continue
            colour = SAID if start <= now < end else FAINT
            pen.rectangle([left + 1, HEIGHT + 36, max(right - 2, left + 2), HEIGHT + 42], fill=colour)
            pen.text(((left + right) / 2, HEIGHT + 20), text, fill=colour, font=font, anchor="mm")
        pen.line([(middle, HEIGHT + 32), (middle, HEIGHT + 46)], fill=INK, width=2)
        pictures.append(image)
    return pictures


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("work", type=Path)
    parser.add_argument("data", type=Path)
    parser.add_argument("out", type=Path)
    given = parser.parse_args()
    bvh = min((given.work / "reenact").glob("*.bvh"))
    folder = given.data / "tst/main-agent"
    speech = read_speech(folder / f"wav/{bvh.stem}.wav", folder / f"tsv/{bvh.stem}.tsv")
    words = [(word.text, word.start, word.end) for word in speech.words]
    motion = read_motion(bvh)
    pictures = draw(motion, words, max(words[0][1] - 0.5, 0.0))
    # One palette for all of them, so that what stands still does not flicker.
    several = Image.fromarray(np.concatenate([np.asarray(image) for image in pictures[::8]]))
    palette = several.quantize(COLOURS, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    small = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in pictures]
    made = io.BytesIO()
    duration = round(1000 * STEP / motion.fps)
    small[0].save(made, "GIF", save_all=True, append_images=small[1:], duration=duration, loop=0, optimize=True)
    files.write_bytes(given.out, lambda file: file.write(made.getvalue()))
    print(f"{given.out}: {len(small)} pictures, {len(made.getvalue()) / 1000:.0f} kB")


if __name__ == "__main__":
    main()
