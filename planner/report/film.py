"""Films of the motion as GIF or MP4: the arm (the paper's Fig. 8) or a vehicle.

Pillow (a dependency of Matplotlib) writes GIF, ffmpeg writes MP4.
"""

from __future__ import annotations

import io
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.errors import ABOVE_ZERO, InputError, expect_number
from planner.report.figures.arm import body_points, draw_places, drawable, plane_axes
from planner.report.figures.style import Curve, Plans, heading
from planner.report.figures.style import times as fine_times
from planner.support.arrays import Array
from planner.support.files import refuse_unwritable, write_bytes
from planner.support.package import Figure, how_to_install
from planner.support.progress import expect_listener

Progress = Callable[[int, int], None]
"""Function that is called with (frames done, total frames)."""

SUFFIXES = (".gif", ".mp4")
LAST_FRAME_S = 1.0
"""Time for which a film shows its last frame, seconds."""

MAX_FRAMES = 5000
TRAIL_COLOUR = "#BBBBBB"
BODY_COLOUR = "#222222"


@dataclass(frozen=True)
class _Scene:
    """Panel of one plan in a film: the moving parts and their positions in each frame."""

    axes: Any
    line: Any
    trail: Any
    points: Array  # (frames, P, 2)
    path: Array  # (m, 2), path of the tip, densely sampled
    tip_index: NDArray[np.intp]  # number of points of the path behind the tip, for each frame

    def move(self, k: int) -> None:
        self.line.set_data(*self.points[k].T)
        behind = np.vstack([self.path[: self.tip_index[k]], self.points[k, -1]])
        self.trail.set_data(*behind.T)


def animate(
    plans: Plans,
    path: str | Path,
    *,
    fps: int = 25,
    speed: float = 1.0,
    progress: Progress | None = None,
) -> Path:
    """Write a film of one or several plans, side by side with a common clock.

    Args:
        plans: One plan, several, or several by label; plans that are not executable (no real angles
            at some time) are left out.
        path: A file name that ends in .gif, or in .mp4, which needs ffmpeg (on the search path, or
            from the extra `video`). An existing file is replaced.
        fps: Frames per second, 1 to 60; a GIF stores times in hundredths of a second.
        speed: Seconds of motion per second of film; 2 is twice real time.
        progress: Called with (frames done, total frames).

    Returns:
        The path.

    Raises:
        InputError: If the name has another ending, ffmpeg is missing, no plan can be drawn, a
            number is out of range, or the file cannot be written.
    """
    suffix = check_film(path, fps, speed)
    report = expect_listener(progress)
    drawn = drawable(plans)
    longest = max(curve.plan.duration for curve in drawn)
    count = int(np.ceil(longest / speed * fps)) + 1
    if count > MAX_FRAMES:
        raise InputError(
            f"{longest:g} s at speed {speed:g} and {fps} frames per second are {count} frames,"
            f" allowed {MAX_FRAMES}; raise the speed"
        )
    times = np.minimum(np.arange(count) * speed / fps, longest)
    frames = _frames(drawn, times, report)
    write = gif if suffix == ".gif" else mp4
    return write_bytes(path, write(frames, fps, round(LAST_FRAME_S * fps)))


def check_film(path: str | Path, fps: int, speed: float) -> str:
    """Check the arguments of `animate` and return the ending of `path`, ".gif" or ".mp4".

    Raises:
        InputError: If the name has another ending, the file cannot be written, a number is out of
            range, or ffmpeg is missing.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"cannot animate to {path}: its name must end in {' or '.join(SUFFIXES)}")
    refuse_unwritable(path)
    expect_number("fps", fps, "1 to 60 frames per second", 1, 60)
    expect_number("speed", speed, "a positive number", ABOVE_ZERO)
    if suffix == ".mp4":
        find_ffmpeg()
    return suffix


def _frames(drawn: Sequence[Curve], times: Array, report: Progress) -> Iterator[Frame]:
    """Yield the frames of a film, each (height, width, 3); only the moving parts are redrawn."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure, scenes, clock = _stage(drawn, times)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    figure.set_layout_engine("none")
    for scene in scenes:
        scene.line.set_animated(True)
        scene.trail.set_animated(True)
    clock.set_animated(True)
    canvas.draw()
    empty = canvas.copy_from_bbox(figure.bbox)
    for k, t in enumerate(times):
        canvas.restore_region(empty)
        clock.set_text(f"t = {t:.2f} s")
        figure.draw_artist(clock)
        for scene in scenes:
            scene.move(k)
            scene.axes.draw_artist(scene.trail)
            scene.axes.draw_artist(scene.line)
        yield np.asarray(canvas.buffer_rgba())[..., :3].copy()
        report(k + 1, len(times))


def _stage(drawn: Sequence[Curve], times: Array) -> tuple[Figure, list[_Scene], Any]:
    figure, axes = plane_axes(drawn)
    scenes = [_scene(ax, curve, times) for ax, curve in zip(axes.flat, drawn, strict=True)]
    every = np.concatenate([scene.points.reshape(-1, 2) for scene in scenes])
    low, high = every.min(axis=0), every.max(axis=0)
    margin = 0.06 * float(np.max(high - low))
    for ax in axes.flat:
        ax.set_xlim(low[0] - margin, high[0] + margin)
        ax.set_ylim(low[1] - margin, high[1] + margin)
    heading(figure, drawn[0].plan.problem.name, ours=True)
    clock = figure.text(0.01, 0.01, f"t = {times[-1]:.2f} s", family="monospace", fontsize=10)
    return figure, scenes, clock


def _scene(ax: Any, curve: Curve, times: Array) -> _Scene:
    plan = curve.plan
    points, close = body_points(plan.problem, plan.trajectory.q(times)), fine_times(plan)
    path = body_points(plan.problem, plan.q(close))[:, -1]
    draw_places(ax, plan.problem)
    for k in (0, -1):
        ax.plot(*points[k].T, "-o", color=TRAIL_COLOUR, linewidth=2, markersize=3, zorder=1)
    ax.plot(*path.T, color=curve.colour, linewidth=0.8, alpha=0.4, zorder=2)
    (trail,) = ax.plot([], [], color=curve.colour, linewidth=2.2, zorder=3)
    look = {"linewidth": 3, "markersize": 6, "markerfacecolor": "white", "zorder": 4}
    (line,) = ax.plot([], [], "-o", color=BODY_COLOUR, **look)
    return _Scene(ax, line, trail, points, path, np.searchsorted(close, times))


Frame = NDArray[np.uint8]
"""A picture, shape (height, width, 3): red, green, blue."""

GIF_COLOURS = 64


def gif(frames: Iterator[Frame], fps: int, hold: int) -> bytes:
    """Return frames as a GIF that loops; the last frame stays for `hold` more frames."""
    from PIL import Image

    pictures = [Image.fromarray(frame) for frame in frames]
    last = pictures[-1]  # it contains everything that is drawn
    palette = last.quantize(GIF_COLOURS, method=Image.Quantize.MAXCOVERAGE)
    small = [p.quantize(palette=palette, dither=Image.Dither.NONE) for p in pictures]
    period = max(2, round(100 / fps)) * 10  # multiples of 10 ms; viewers need at least 20 ms
    times = [period] * (len(small) - 1) + [period * (1 + hold)]
    stream = io.BytesIO()
    small[0].save(
        stream, "GIF", save_all=True, append_images=small[1:], duration=times, loop=0, disposal=1
    )
    return stream.getvalue()


def mp4(frames: Iterator[Frame], fps: int, hold: int) -> bytes:
    """Return frames as an H.264 film for every browser; the last frame is repeated `hold` times.

    Raises:
        InputError: If ffmpeg is missing or fails; the message quotes ffmpeg.
    """
    program = find_ffmpeg()
    first = next(frames)
    height, width = (n - n % 2 for n in first.shape[:2])  # the codec requires even numbers
    source = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", str(fps)]
    codec = ["-c:v", "libx264", "-crf", "20", "-pix_fmt", "yuv420p", "-movflags", "+faststart"]
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryFile() as log:
        target = Path(folder) / "film.mp4"
        words = [program, "-loglevel", "error", *source, "-i", "-", "-an", *codec, str(target)]
        with subprocess.Popen(words, stdin=subprocess.PIPE, stderr=log) as job:
            try:
                assert job.stdin is not None
                with suppress(BrokenPipeError):  # ffmpeg stopped and reports the reason itself
                    for frame in chain([first], frames):
                        picture = frame[:height, :width].tobytes()
                        job.stdin.write(picture)
                    for _ in range(hold):
                        job.stdin.write(picture)
                    job.stdin.close()
            except BaseException:
                job.kill()
                raise
        if job.returncode or not target.exists():
            log.seek(0)
            reason = log.read().decode(errors="replace").strip().splitlines()
            raise InputError(f"ffmpeg ({program}) failed: {reason[-1] if reason else 'no message'}")
        return target.read_bytes()


def find_ffmpeg() -> str:
    """Return the path of the program ffmpeg, from the search path or from imageio-ffmpeg.

    Raises:
        InputError: If ffmpeg is missing.
    """
    if program := shutil.which("ffmpeg"):
        return program
    try:
        from imageio_ffmpeg import get_ffmpeg_exe

        return str(get_ffmpeg_exe())
    except (ImportError, RuntimeError):
        raise InputError(
            f"an MP4 needs ffmpeg; install it, or: {how_to_install('video')}; a name that ends"
            " in .gif needs no ffmpeg"
        ) from None
