"""Calibrate the prototype preset to the paper's statements about its experiment.

The file also writes a page with a figure: how the calibrated prototype executes the paper's motion,
and how well the parameters are known.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np

from planner.machine.machine import Machine
from planner.machine.replay import Replay, replay
from planner.paper.cases import paper_problem
from planner.paper.fit import (
    DURATION_RATIOS,
    ENCODER_DEG,
    FITTED_PARAMETERS,
    FIXED_PARAMETERS,
    JOINT_MARK,
    READ_DEG,
    READ_PERCENT,
    SPREADS,
    STATEMENTS,
    DataSet,
    Fit,
    PaperReplays,
    Parameter,
    Statement,
    fit,
    identify,
    main_parameters,
    move,
    nominal_machine,
    settings,
    to_preset_digits,
)
from planner.plan.plan import Plan
from planner.problem.tables.machine_effects import EFFECTS
from planner.report.figures.style import COLOURS, GRID_STYLE
from planner.report.result_folder import folder
from planner.solve import solve
from planner.support.package import Figure, provenance
from planner.support.progress import Tell, expect_listener
from planner.support.tables import Column, Markup, markdown_table

MACHINES = 500
"""Number of random machines, whose median error is compared with the paper."""

LATERAL_FRICTIONS = (0.05, 0.10, 0.15, 0.20, 0.25, 0.30)
"""Other ratios of sideways to driving friction for which the prototype is fitted."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """The result of `calibrate`.

    Attributes:
        plan: The plan that represents the paper's experiment: the polynomial plan of the paper's
            example, at the travel of least peak input.
        fit: The most probable parameters.
        sideways: Fits by ratio of sideways to driving friction.
        data: How well the paper's words, the paper's curves and better records determine the
            parameters.
        motions: Motion of the nominal machine, by fidelity ("quasi-static", "dynamic").
        replays: Motions of random machines with all spreads, by fidelity.
    """

    plan: Plan
    fit: Fit
    sideways: Mapping[float, Fit]
    data: tuple[DataSet, ...]
    motions: dict[str, PaperReplays]
    replays: dict[str, Replay]

    @property
    def settings(self) -> dict[str, Any]:
        """Fitted effects of the prototype preset, as `planner/machine/prototype.toml` has them."""
        return preset_settings(self.fit.parameters)

    def to_dict(self) -> dict[str, Any]:
        """Return preset, statements, sideways friction and identifiability as JSON-ready data."""
        statements = [
            {"text": s.text, "target": s.target, "bound": s.bound, "unit": s.unit, "found": value}
            for s, value in zip(STATEMENTS, self.fit.values.tolist(), strict=True)
        ]
        return {
            "preset": self.settings,
            "statements": statements,
            "lateral_friction": [
                {"lateral_friction": ratio, "distance": each.distance, "preset": each.parameters}
                for ratio, each in self.sideways.items()
            ],
            "identified": [
                {
                    "data": d.name,
                    "rank": d.rank,
                    "singular_values": d.singular.tolist(),
                    "left": dict(zip(self.fit.parameters, d.remaining.tolist(), strict=True)),
                }
                for d in self.data
            ],
        }


def preset_settings(parameters: Mapping[str, float]) -> dict[str, Any]:
    """Convert fitted parameters to effects: numbers, or value and spread where machines differ."""
    out: dict[str, Any] = {}
    for name, value in settings(parameters).items():
        share = SPREADS.get(name, 0.0)
        spread = settings({k: to_preset_digits(v * share) for k, v in parameters.items()})[name]
        out[name] = {"value": value, "spread": spread} if share else value
    return out


def calibrate(progress: Tell | None = None, seed: int = 0) -> Calibration:
    """Fit the prototype to the paper, and compute how well the paper determines each parameter.

    Args:
        progress: Function that is called with the current step and the finished share, 0 … 1.
        seed: Seed of the machines with spreads.
    """
    say = expect_listener(progress)
    say("planning the paper's motion", 0.0)
    plan = solve(paper_problem(), "polynomial")
    say("fitting", 0.05)
    result = fit(plan)
    usual = Machine.prototype().nominal().to_dict()["lateral_friction"]
    sideways = {usual: result}
    for i, ratio in enumerate(LATERAL_FRICTIONS):
        say(f"fitting with lateral_friction = {ratio:g}", 0.15 + 0.05 * i)
        sideways[ratio] = sideways.get(ratio) or fit(plan, lateral_friction=ratio)
    sideways = dict(sorted(sideways.items()))
    say("identifiability", 0.5)
    data = identify(plan, result)
    say("replaying in both fidelities", 0.75)
    machine = nominal_machine(result.parameters)
    spread = preset_settings(result.parameters)
    motions, replays = {}, {}
    for fidelity in ("quasi-static", "dynamic"):
        motions[fidelity] = move(plan, machine.with_(fidelity=fidelity), [result.parameters])
        many = Machine.prototype(step_s=machine.step_s, fidelity=fidelity, **spread)
        replays[fidelity] = replay(plan, many, MACHINES, seed, record_s=None)
    return Calibration(plan, result, sideways, data, motions, replays)


def write(calibration: Calibration, path: str | Path) -> Path:
    """Write a calibration as README.md and the figure calibration.png to a folder.

    Args:
        calibration: The result to write.
        path: The folder. An earlier run's folder is replaced after everything is written.

    Raises:
        InputError: If the folder cannot be written or holds something else.
    """
    with folder(path) as place:
        figure = picture(calibration.plan, calibration.motions, calibration.data)
        figure.savefig(place / "calibration.png", dpi=110, bbox_inches="tight")
        (place / "README.md").write_text(page(calibration), encoding="utf-8")
    return Path(path)


def page(calibration: Calibration) -> str:
    """Return the text of README.md, the page about a calibration: calibrate.md with its tables."""
    still, moving = (calibration.motions[name].error[0] for name in ("quasi-static", "dynamic"))
    return (
        Path(__file__)
        .with_name("calibrate.md")
        .read_text(encoding="utf-8")
        .format(
            provenance=provenance("planner calibrate --out results/calibration"),
            statements=_statements(calibration.fit),
            sideways=_sideways(calibration.sideways),
            fidelities=_fidelities(calibration.motions, calibration.replays),
            apart=_slashed(np.max(np.abs(still - moving), axis=0)),
            parameters=_parameters(calibration.settings, calibration.data),
            read_deg=READ_DEG,
            read_percent=READ_PERCENT,
            encoder_deg=ENCODER_DEG,
            ratios=", ".join(f"{ratio:g}" for ratio in DURATION_RATIOS),
            identified=_identified(calibration.data),
            directions=_directions(calibration.data[0]),
            fixed=_fixed_parameters(),
        )
    )


def _statements(fit: Fit) -> str:
    columns: list[Column[tuple[Statement, float]]] = [
        Column("statement", "", lambda r: r[0].text, left=True),
        Column("target", "", lambda r: r[0].target_text, left=True),
        Column("standard deviation", "", lambda r: f"{r[0].tolerance:g} {r[0].unit}", left=True),
        Column("preset", "", lambda r: f"{r[1]:.2f} {r[0].unit}", left=True),
    ]
    return markdown_table(columns, zip(STATEMENTS, fit.values, strict=True))


def _fitted_value(key: str, row: tuple[float, Fit]) -> float:
    return row[1].parameters[key]


def _sideways(fits: Mapping[float, Fit]) -> str:
    frictions = [f"coulomb_friction_nm{JOINT_MARK}{i}" for i in (2, 3)]
    rest = ("friction_capacity_nm", "backlash_deg", "shaft_stiffness_nm_per_rad")
    columns: list[Column[tuple[float, Fit]]] = [
        Column("lateral_friction", "", lambda r: r[0], "{:.2f}".format),
        Column("distance", "standard deviations", lambda r: r[1].distance, "{:.2f}".format),
        *(Column(k, "", partial(_fitted_value, k), "{:.3g}".format) for k in (*frictions, *rest)),
        Column("theta3", "deg", lambda r: r[1].values[0], "{:.2f}".format),
        Column("theta2", "deg", lambda r: r[1].values[1], "{:.2f}".format),
        Column("largest torque of motor 1", "N m", lambda r: r[1].motor_nm, "{:.2f}".format),
    ]
    return markdown_table(columns, fits.items())


def _fidelities(motions: Mapping[str, PaperReplays], replays: Mapping[str, Replay]) -> str:
    machines = len(next(iter(replays.values())).numbers)
    medians = {name: np.median(each.largest_error_deg, axis=0) for name, each in replays.items()}
    motors = {name: motion.statements[0, 2:4] for name, motion in motions.items()}
    columns: list[Column[str]] = [
        Column("fidelity", "", str, left=True),
        Column("largest errors", "deg", lambda f: motions[f].largest[0], _slashed, left=True),
        Column("at the end", "deg", lambda f: motions[f].error[0, -1], _slashed, left=True),
        Column(f"median largest of {machines} machines", "deg", medians.get, _slashed, left=True),
        Column("motor deviation", "% of peak, rms", motors.get, _slashed, left=True),
    ]
    return markdown_table(columns, motions)


def _parameters(settings: Mapping[str, Any], data: Sequence[DataSet]) -> str:
    columns: list[Column[Parameter]] = [
        Column("parameter", "", lambda r: r.key, left=True, code=True),
        Column("unit", "", lambda r: EFFECTS[r.name].unit or "1", left=True),
        Column("range", "95 %", lambda r: f"{r.low:g} ... {r.high:g}", left=True),
        Column("preset", "", lambda r: _preset(settings[r.name], r.joint), left=True),
        *(
            Column(d.name, "", partial(remaining_share, d), "{:.2f}".format, left=True)
            for d in data
        ),
        Column("source of the range", "", lambda r: r.source, left=True),
    ]
    return markdown_table(columns, FITTED_PARAMETERS)


def remaining_share(data: DataSet, parameter: Parameter) -> float:
    """Return the share of a parameter's range that the data leave open; 1: not identifiable."""
    return float(data.remaining[FITTED_PARAMETERS.index(parameter)])


def _preset(value: Any, joint: int | None = None) -> str:
    if isinstance(value, dict):
        return f"{_entry(value['value'], joint):g} ± {_entry(value['spread'], joint):g}"
    return f"{_entry(value, joint):g}"


def _entry(number: Any, joint: int | None) -> float:
    """Return the number itself or, for a joint, its entry in a list of numbers of joints 2 … n."""
    return float(number if joint is None else number[joint - 2])


def _identified(data: Sequence[DataSet]) -> str:
    columns: list[Column[DataSet]] = [
        Column("data", "", lambda d: d.name, left=True),
        Column("numbers", "", lambda d: d.count, left=True),
        Column("identified directions", "", lambda d: f"{d.rank} of {len(d.remaining)}", left=True),
        Column("largest singular values", "", _largest_values, left=True),
        Column("parameters not identified", "> 0.9", _open_parameters, left=True),
    ]
    return markdown_table(columns, data)


def _directions(words: DataSet) -> str:
    """Return the first directions that the paper's words determine, as a numbered list."""
    return "\n".join(
        f"{k + 1}. s = {words.singular[k]:.3g}: "
        + ", ".join(f"{part:+.2f} `{name}`" for name, part in main_parameters(words, k).items())
        for k in range(3)
    )


def _largest_values(data: DataSet) -> str:
    return ", ".join(f"{s:.3g}" for s in data.singular[:8])


def _open_parameters(data: DataSet) -> Markup:
    names = [f"`{r.key}`" for r in FITTED_PARAMETERS if remaining_share(data, r) > 0.9]
    return Markup("; ".join(names) or "none")


def _fixed_parameters() -> str:
    effects = Machine.prototype().to_dict()
    columns: list[Column[str]] = [
        Column("parameter", "", str, left=True, code=True),
        Column("preset", "", lambda name: effects[name], _preset, left=True),
        Column("unit", "", lambda name: EFFECTS[name].unit or "1", left=True),
        Column("why", "", lambda name: FIXED_PARAMETERS[name], left=True),
    ]
    return markdown_table(columns, FIXED_PARAMETERS)


def _slashed(numbers: Any) -> str:
    return " / ".join(f"{x:.2f}" for x in numbers)


DASHES = {"quasi-static": "-", "dynamic": "--"}


def picture(plan: Plan, motions: Mapping[str, PaperReplays], data: Sequence[DataSet]) -> Figure:
    """Draw joint errors, motor speeds, and the share of each parameter's range that remains."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.5, 6.2), dpi=100, layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=[1.1, 1.0])
    errors: Any = figure.add_subplot(grid[0, 0])
    motors: Any = figure.add_subplot(grid[1, 0], sharex=errors)
    for axes in (errors, motors):
        axes.grid(**GRID_STYLE)
        axes.spines[["top", "right"]].set_visible(False)
    _errors(errors, motions)
    _motors(motors, plan, motions)
    _draw_remaining(figure.add_subplot(grid[:, 1]), data)
    return figure


def _errors(ax: Any, motions: Mapping[str, PaperReplays]) -> None:
    for name, motion in motions.items():
        for i in range(motion.error.shape[2]):
            curve = {"color": COLOURS[i], "linestyle": DASHES[name], "linewidth": 1.5}
            ax.plot(motion.t, motion.error[0, :, i], label=f"$\\theta_{i + 1}$, {name}", **curve)
    for level in (-5, 5):
        ax.axhline(level, color="#555555", linewidth=0.8, linestyle=":")
    ax.set_ylabel("true minus planned (deg)")
    ax.set_title("errors of the nominal machine; dotted: the paper's 5 deg", fontsize=10)
    ax.legend(fontsize=7, ncols=2)


def _motors(ax: Any, plan: Plan, motions: Mapping[str, PaperReplays]) -> None:
    t = next(iter(motions.values())).t
    command = np.where((t < plan.duration)[:, None], plan.trajectory.u(t), 0.0)
    peak = np.max(np.abs(command), axis=0) / 100
    for i in range(2):
        ax.plot(t, command[:, i], color="#BBBBBB", linewidth=4, label="command" if i else None)
        for name, motion in motions.items():
            curve = {"color": COLOURS[i], "linestyle": DASHES[name], "linewidth": 1.2}
            ax.plot(t, motion.motors[0, :, i] * peak[i], label=f"motor {i + 1}, {name}", **curve)
    ax.set(xlabel="time (s)", ylabel="speed (rad/s)")
    ax.legend(fontsize=7, ncols=2)


def _draw_remaining(ax: Any, data: Sequence[DataSet]) -> None:
    share = np.array([d.remaining for d in data]).T
    ax.imshow(share, cmap="Blues_r", vmin=0, vmax=1, aspect="auto")
    for i, row in enumerate(share):
        for j, part in enumerate(row):
            ax.text(j, i, f"{part:.2f}", ha="center", va="center", color="w" if part < 0.5 else "k")
    ax.set_yticks(range(len(FITTED_PARAMETERS)), [r.key for r in FITTED_PARAMETERS], fontsize=8)
    ax.set_xticks(range(len(data)), [fill(d.name, 16) for d in data], fontsize=8)
    ax.set_title("share of each range that remains (1: not identifiable)", fontsize=10)
