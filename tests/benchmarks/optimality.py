"""How close to optimal plans of collocation are: relations, and lengths that are known.

    python tests/benchmarks/optimality.py [--minutes 60] [--only FAMILY]   # to results/optimality

Arms of three and four joints: run backwards, or mirrored and half as fast, a motion takes the same
effort times duration, so that the largest of the three over the least shows what local optima cost.
Unicycle: the least time within |speed| <= 1, |turn rate| <= 1 is the Reeds-Shepp length (Sussmann
and Tang 1991). Heisenberg's system: the geodesics are arcs of circles. Each case is a line of
results/optimality/records.txt; the same command goes on where the last one of the same code ended.
"""

from __future__ import annotations

import argparse
import itertools
import os
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from matplotlib.figure import Figure
from results_pages import begin_records, read_records
from scipy.optimize import brentq

import planner
from planner.support.arrays import Array
from planner.support.package import release

FOLDER = Path(__file__).parents[2] / "results" / "optimality"
RECORDS = FOLDER / "records.txt"
SEED, K, K_G = 40, [0.870125, 0.711625, 0.582], 0.668811
WORDS = {
    "arm3": ("3 joints within 60 degrees, 30 s", 100, "largest over least of three related"),
    "arm4": ("4 joints within 45 degrees, 60 s", 100, "largest over least of three related"),
    "unicycle": ("unicycle, least time", 140, "duration over Reeds-Shepp length"),
    "heisenberg": ("Heisenberg's system", 40, "effort over that of the geodesic"),
}
"""Family: title, cases, and what its figure is."""


def solve(problem: planner.Problem) -> planner.Plan:
    """Collocation with its defaults, verified."""
    return planner.solve(problem, "collocation")


def relations(joints: int, limit: float, duration: float, number: int) -> float:
    """A pair, the way back, and the mirrored pair in twice the time: effort times duration."""
    start, goal = np.random.default_rng([SEED, joints, number]).uniform(-limit, limit, (2, joints))
    sizes = []
    for ends, factor in (((start, goal), 1), ((goal, start), 1), ((-start, -goal), 2)):
        problem = planner.Problem.manipulator(
            *(np.round(end, 2).tolist() for end in ends),
            duration=factor * duration,
            K=K[: joints - 1],
            k_g=K_G,
            joint_deg=80,
        )
        plan = solve(problem)
        sizes.append(plan.objective * plan.duration)
    return max(sizes) / min(sizes)


def unicycle(number: int) -> float:
    """Duration of the fastest motion over the Reeds-Shepp length."""
    rng = np.random.default_rng([SEED, 1, number])
    x, y = np.round(rng.uniform(-3, 3, 2), 3).tolist()
    start, goal = np.round(rng.uniform(-60, 60, 2), 1).tolist()
    tables = {
        "system": {"kind": "unicycle"},
        "start": {"x_m": 0.0, "y_m": 0.0, "heading_deg": start},
        "goal": {"x_m": x, "y_m": y, "heading_deg": goal, "duration": "free"},
        "limits": {"speed_m_s": 1.0, "turn_rate_rad_s": 1.0},
    }
    first = np.deg2rad(start)
    turned = np.exp(-1j * first) * (x + 1j * y)
    length = reeds_shepp(turned.real, turned.imag, np.deg2rad(goal) - first)
    return solve(planner.Problem.from_dict(tables)).duration / length


def heisenberg(number: int) -> float:
    """Effort over that of the geodesic: an arc that encloses the area asked for with its chord."""
    x, y, z = np.round(np.random.default_rng([SEED, 2, number]).uniform(-1, 1, 3), 3).tolist()
    tables = {
        "system": {
            "kind": "custom",
            "name": "heisenberg",
            "coordinates": ["x", "y", "z"],
            "units": ["m", "m", "m2"],
            "slopes": ["y"],
            "drive": "1",
            "intervals": {"y": [-10.0, 10.0]},
        },
        "start": {"q": {"x": 0.0, "y": 0.0, "z": 0.0}},
        "goal": {"q": {"y": y, "z": z}, "travel": x, "duration": 1.0},
    }
    area, chord = abs(z - x * y / 2), float(np.hypot(x, y))

    def excess(angle: float) -> float:
        return float((angle - np.sin(angle)) / (8 * np.sin(angle / 2) ** 2) - area / chord**2)

    angle = float(brentq(excess, 1e-3, 2 * np.pi - 1e-6, xtol=1e-14))
    geodesic = chord / (2 * np.sin(angle / 2)) * angle
    return float(solve(planner.Problem.from_dict(tables)).objective / geodesic**2)


FAMILIES: dict[str, Callable[[int], float]] = {
    "unicycle": unicycle,
    "heisenberg": heisenberg,
    "arm3": lambda number: relations(3, 60.0, 30.0, number),
    "arm4": lambda number: relations(4, 45.0, 60.0, number),
}


def reeds_shepp(x: float, y: float, heading: float) -> float:
    """Length of the shortest path with turns of radius one, forwards and backwards.

    Each word is solved for one sense of turning; the others are that one mirrored, driven
    backwards, and run from the end.

    Source: Reeds and Shepp, Pacific Journal of Mathematics 145 (1990), section 8.
    """
    cos, sin = np.cos(heading), np.sin(heading)
    both = (x, y), (x * cos + y * sin, x * sin - y * cos)
    lengths = [np.inf]
    for (a, b), back, side in itertools.product(both, (1, -1), (1, -1)):
        goal = back * a, side * b, back * side * heading
        for turns, pieces in words(*goal):
            if np.isfinite(pieces).all() and leads_to(turns, pieces, goal):
                lengths.append(float(np.sum(np.abs(pieces))))
    return min(lengths)


def leads_to(turns: str, pieces: Array, goal: tuple[float, float, float]) -> bool:
    """Whether driving a word ends there; the formulas below hold for some goals only."""
    place, heading = 0.0j, 0.0
    for turn, piece in zip(turns, pieces, strict=True):
        sense = {"L": 1.0, "S": 0.0, "R": -1.0}[turn]
        half = sense * piece / 2
        place += piece * np.sinc(half / np.pi) * np.exp(1j * (heading + half))
        heading += sense * piece
    gap = abs(place - goal[0] - 1j * goal[1]) + abs(np.exp(1j * heading) - np.exp(1j * goal[2]))
    return bool(gap < 1e-6)


def around(angle: float) -> float:
    """The angle within half a turn."""
    return float((angle + np.pi) % (2 * np.pi) - np.pi)


def words(x: float, y: float, phi: float) -> Iterator[tuple[str, Array]]:
    """Senses of turning, and signed lengths of the pieces, of each word (formulas 8.1 to 8.11)."""
    same, other = (x + s * np.sin(phi) + 1j * (y - 1 - s * np.cos(phi)) for s in (-1, 1))
    near, far, right = abs(same), abs(other), np.pi / 2
    to_same, to_other = np.angle(same), np.angle(other)
    with np.errstate(invalid="ignore"):
        yield "LSL", np.array([to_same, near, around(phi - to_same)])
        u = np.sqrt(far**2 - 4)
        t = around(to_other + np.arctan2(2, u))
        yield "LSR", np.array([t, u, around(t - phi)])
        u = -2 * np.arcsin(near / 4)
        t = around(to_same + u / 2 + np.pi)
        yield "LRL", np.array([t, u, around(phi - t + u)])
        for u, sign in ((np.arccos((2 + far) / 4), -1), (-np.arccos((20 - far**2) / 16), 1)):
            delta = around(u - sign * u)
            a, b = np.sin(u) - np.sin(delta), np.cos(u) - np.cos(delta) - 1
            t = np.arctan2(other.imag * a - other.real * b, other.real * a + other.imag * b)
            t = around(t + np.pi * (2 * (np.cos(delta) - 2 * np.cos(u)) + 3 < 0))
            yield "LRLR", np.array([t, u, sign * u, around(t - u + sign * u - phi)])
        u = np.sqrt(near**2 - 4)
        t = around(to_same + np.arctan2(u, -2))
        yield "LRSL", np.array([t, -right, 2 - u, around(phi - right - t)])
        t = around(to_other + right)
        yield "LRSR", np.array([t, -right, 2 - far, around(t + right - phi)])
        u = 4 - np.sqrt(far**2 - 4)
        t = np.angle(
            -2 * other.real + (u - 4) * other.imag + 1j * ((4 - u) * other.real - 2 * other.imag)
        )
        yield "LRSLR", np.array([t, -right, u, -right, around(t - phi)])


def main() -> int:
    """Run what is not in the records yet, as far as the time allows, and write the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--minutes", type=float, default=120.0, help="time for new cases")
    parser.add_argument("--only", choices=FAMILIES, help="one family, as for several processes")
    given = parser.parse_args()
    begin_records("optimality", RECORDS)
    known, until = read(), time.monotonic() + 60 * given.minutes
    for family in [given.only] if given.only else FAMILIES:
        for number in range(WORDS[family][1]):
            if number in known[family] or time.monotonic() > until:
                continue
            try:
                ratio = FAMILIES[family](number)
            except planner.NoPlanError:
                ratio = float("inf")
            with RECORDS.open("a", encoding="utf-8") as out:
                out.write(f"{family} {number} {ratio:.9g}\n")
    write_page(read())
    return 0


def read() -> dict[str, dict[int, float]]:
    """Figures by family and number."""
    out: dict[str, dict[int, float]] = {family: {} for family in WORDS}
    for line in read_records(RECORDS):
        family, number, ratio = line.split()
        out[family][int(number)] = float(ratio)
    return out


HEAD = """# How close to optimal plans are

Made by `make optimality` (`tests/benchmarks/optimality.py`; {release}),
which continues an interrupted run.
Collocation with its defaults, every plan verified; no limits on the arms' inputs. The figures are
ratios that equal one for an optimal planner. A local optimum in one of the three problems of a
relation breaks it; if all three have the same local optimum, the ratio does not show it. The inputs
of the fastest unicycle jump; inputs that are linear on each piece need one piece for a jump.

| family | figure | cases done | median | largest | above 1.001 | refused |
|---|---|---|---|---|---|---|
"""


def write_page(figures: dict[str, dict[int, float]]) -> None:
    """One table and one picture."""
    figure = Figure(figsize=(7, 4.4), layout="constrained")
    axes, rows = figure.subplots(), []
    for family, (title, count, what) in WORDS.items():
        values = np.array([*figures[family].values()])
        solved = np.sort(values[np.isfinite(values)])
        if not len(solved):
            continue
        share = np.arange(1, len(solved) + 1) / len(solved)
        axes.step(np.maximum(solved - 1, 1e-9), share, where="post", label=title)
        figure_of = f"{np.median(solved):.7f} | {solved[-1]:.7f} | {np.sum(solved > 1.001)}"
        done = f"{len(values)} of {count}"
        rows.append(f"| {title} | {what} | {done} | {figure_of} | {len(values) - len(solved)} |\n")
    axes.set(
        xscale="log",
        xlabel="cost above the least known, as a share of it (ratio of the table - 1)",
        ylabel="share of cases with at most this",
        ylim=(0, 1.02),
    )
    axes.axvline(1e-3, color="grey", linestyle=":")
    axes.text(1e-3, 1.03, "0.1 %", ha="center", va="bottom", color="grey")
    figure.legend(loc="outside lower center", ncols=2, frameon=False)
    figure.savefig(FOLDER / "optimality.png", dpi=150)
    text = (
        HEAD.replace("{release}", release())
        + "".join(rows)
        + "\n![Share of cases by the cost above the least known](optimality.png)\n"
    )
    (FOLDER / "README.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
