"""The tracker of an exported plan, compiled, in the place of the tracker in Python."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import planner
from planner.machine.feedback.tracker import TrackerDesign

STRICT = ("-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wdouble-promotion")
ACCESS = """
#include "tracker.h"
unsigned tracker_size(void) { return (unsigned)sizeof(tracker); }
int tracker_fallbacks(const tracker *self) { return self->fallbacks; }
int tracker_outside(const tracker *self) { return self->outside; }
int tracker_steps(const tracker *self) { return self->steps; }
"""
"""What is looked at from outside, as functions."""

LATE, OVER = 1, 2


def compiler() -> str | None:
    """A C compiler, if there is one."""
    return shutil.which("cc")


def compile_c(folder: Path, words: Sequence[str]) -> None:
    """Compile in a folder; a warning is an error."""
    subprocess.run([str(compiler()), *STRICT, *words, "-lm"], cwd=folder, check=True)


class CompiledTracker:
    """A tracker in C; `planner.machine.closed_loop.Feedback`.

    Args:
        folder: An export of the format c.
        design: What it was made from, for its clock.
    """

    def __init__(self, folder: Path, design: TrackerDesign) -> None:
        text = (folder / "sizes.h").read_text()
        self.number = np.float32 if "typedef float" in text else np.float64
        (folder / "access.c").write_text(ACCESS)
        compile_c(folder, ["-shared", "-fPIC", "tracker.c", "access.c", "-o", "tracker.so"])
        self.library = ctypes.CDLL(str(folder / "tracker.so"))
        self.design = design
        self.controls: list[CompiledControl] = []

    def start(
        self, plan: planner.Plan, machine: planner.Machine, numbers: NDArray[np.int64]
    ) -> CompiledControl:
        """See `Feedback`."""
        self.controls.append(CompiledControl(self, len(numbers)))
        return self.controls[-1]


class CompiledControl:
    """One state in C for each of S samples; `planner.machine.closed_loop.Controller`."""

    def __init__(self, outer: CompiledTracker, count: int) -> None:
        ref = outer.design.ref
        clock = ref.timing
        self.period_s, self.tick_s, self.lead_s = clock.period, clock.tick, -clock.begin
        self.end_s = clock.begin + len(ref.feed) * clock.period + clock.latency * clock.tick
        self._library, self._number, self._ticks = outer.library, outer.number, clock.ticks
        self._k = 0
        size = self._library.tracker_size()
        self.states = [ctypes.create_string_buffer(size) for _ in range(count)]
        self.steps: list[list[int]] = []
        for state in self.states:
            self._library.tracker_start(state)

    @property
    def fallbacks(self) -> NDArray[np.int64]:
        """See `Controller`."""
        return np.array([self._library.tracker_fallbacks(state) for state in self.states])

    @property
    def outside(self) -> list[int]:
        """The joint of each sample that first left the band; 0: none."""
        return [self._library.tracker_outside(state) for state in self.states]

    def command(self, sample: int, tick: int) -> tuple[int, NDArray[Any]]:
        """Status and speeds (2,)."""
        speed = np.empty(2, self._number)
        status = self._library.tracker_command(self.states[sample], tick, _address(speed))
        return status, speed

    def __call__(self, t: float, measured: NDArray[np.float64]) -> NDArray[np.float64]:
        """See `Controller`."""
        read = np.ascontiguousarray(measured.T.astype(self._number))
        for state, row in zip(self.states, read, strict=True):
            self._library.tracker_read(state, _address(row))
        self.steps.append([self._library.tracker_steps(state) for state in self.states])
        ticks = range(self._k * self._ticks, (self._k + 1) * self._ticks)
        self._k += 1
        out = [[self.command(s, tick)[1] for s in range(len(self.states))] for tick in ticks]
        return np.moveaxis(np.array(out, dtype=float), 1, 2)


def _address(values: NDArray[Any]) -> ctypes.c_void_p:
    return ctypes.c_void_p(values.ctypes.data)
