"""Pictures as a film: GIF by Pillow (which Matplotlib brings), MP4 by ffmpeg."""

from __future__ import annotations

import io
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from planner.distribution import how_to_install
from planner.errors import InputError

Frame = NDArray[np.uint8]
"""A picture, shape (height, width, 3): red, green, blue."""

COLOURS = 64


def gif(frames: Iterator[Frame], fps: int, hold: int) -> bytes:
    """A GIF that repeats; the last picture stays for `hold` frames more."""
    from PIL import Image

    pictures = [Image.fromarray(frame) for frame in frames]
    last = pictures[-1]  # all that is drawn is in it
    palette = last.quantize(COLOURS, method=Image.Quantize.MAXCOVERAGE)
    small = [p.quantize(palette=palette, dither=Image.Dither.NONE) for p in pictures]
    period = max(2, round(100 / fps)) * 10  # a GIF counts in 10 ms, and viewers ask for two
    times = [period] * (len(small) - 1) + [period * (1 + hold)]
    stream = io.BytesIO()
    small[0].save(
        stream, "GIF", save_all=True, append_images=small[1:], duration=times, loop=0, disposal=1
    )
    return stream.getvalue()


def mp4(frames: Iterator[Frame], fps: int, hold: int) -> bytes:
    """An H.264 film that every browser plays.

    Raises:
        InputError: If ffmpeg is missing or fails; its own words are in the message.
    """
    program = find_ffmpeg()
    first = next(frames)
    height, width = (n - n % 2 for n in first.shape[:2])  # the codec wants even numbers
    source = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", str(fps)]
    codec = ["-c:v", "libx264", "-crf", "20", "-pix_fmt", "yuv420p", "-movflags", "+faststart"]
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryFile() as said:
        target = Path(folder) / "film.mp4"
        words = [program, "-loglevel", "error", *source, "-i", "-", "-an", *codec, str(target)]
        with subprocess.Popen(words, stdin=subprocess.PIPE, stderr=said) as job:
            try:
                _feed(job, chain([first], frames), hold, (height, width))
            except BaseException:
                job.kill()
                raise
        if job.returncode or not target.exists():
            said.seek(0)
            reason = said.read().decode(errors="replace").strip().splitlines()
            raise InputError(f"ffmpeg ({program}) failed: {reason[-1] if reason else 'no word'}")
        return target.read_bytes()


def _feed(
    job: subprocess.Popen[bytes], frames: Iterator[Frame], hold: int, size: tuple[int, int]
) -> None:
    assert job.stdin is not None
    with suppress(BrokenPipeError):  # ffmpeg has stopped; it says why
        for frame in frames:
            picture = frame[: size[0], : size[1]].tobytes()
            job.stdin.write(picture)
        for _ in range(hold):
            job.stdin.write(picture)
        job.stdin.close()


def find_ffmpeg() -> str:
    """The program ffmpeg: on the path, or the one that imageio-ffmpeg brings.

    Raises:
        InputError: If there is none.
    """
    found = shutil.which("ffmpeg")
    if found is not None:
        return found
    try:
        from imageio_ffmpeg import get_ffmpeg_exe

        return str(get_ffmpeg_exe())
    except (ImportError, RuntimeError):
        raise InputError(
            f"an MP4 needs ffmpeg; install it, or: {how_to_install('video')}; a name that ends"
            " in .gif needs nothing"
        ) from None
