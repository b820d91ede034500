"""Recompute the paper's figures and numbers, and write a page that explains both."""

from __future__ import annotations

from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path

import numpy as np

from planner.paper.cases import POINT, Z2_MARGIN, Cases, cases
from planner.paper.numbers import TEXTS, PaperNumber, findings, turned_ratio
from planner.report.figures.arm import plot_arm
from planner.report.figures.mechanism import plot_mechanism
from planner.report.figures.on_the_machine import median_sample, plot_replays
from planner.report.figures.over_time import plot_inputs, plot_joints, plot_z
from planner.report.figures.style import COLOURS, grid, heading
from planner.report.film import animate
from planner.report.panels import z2_band
from planner.report.result_folder import folder
from planner.support.package import Figure, provenance
from planner.support.progress import Tell, expect_listener
from planner.support.tables import Column, Markup, markdown_table


@dataclass(frozen=True)
class Reproduction:
    """The result of `reproduce`.

    Attributes:
        path: The folder with README.md, one PNG per figure, and a GIF of the moving arm.
        findings: The paper's numbers and claims, each with a verdict.
        cases: The plans behind the figures.
    """

    path: Path
    findings: tuple[PaperNumber, ...]
    cases: Cases


def reproduce(
    path: str | Path, samples: int = 200, seed: int = 0, progress: Tell | None = None
) -> Reproduction:
    """Draw the paper's figures again, check the paper's numbers, and write both to a folder.

    Args:
        path: The folder to write; it is written completely or not at all.
        samples: Number of machines for Figs 9 and 10.
        seed: Seed of the machines.
        progress: Function that is called with the current step and the finished share, 0 … 1.

    Raises:
        InputError: If the folder cannot be written.
    """
    say = expect_listener(progress)
    with folder(path) as place:
        say("planning and replaying", 0.0)
        plans = cases(samples, seed)
        say("checking printed numbers", 0.4)
        numbers = findings(plans)
        pictures = figures(plans)
        for k, (name, figure) in enumerate(pictures.items()):
            say(f"drawing {name}", 0.6 + 0.3 * k / len(pictures))
            figure.savefig(place / f"{name}.png", dpi=110, bbox_inches="tight")
        say(f"drawing {FILM}", 0.9)
        both = {"the paper's polynomial law": plans.valid, "least effort": plans.best}
        animate(both, place / FILM, fps=20, speed=2.0)
        (place / "README.md").write_text(page(numbers, samples, seed), encoding="utf-8")
    return Reproduction(Path(path), tuple(numbers), plans)


Z2_LABEL = f"least effort, z2 <= {-Z2_MARGIN:g}"
VALID_LABEL = "same law, travel chosen inside the domain"


def figures(cases: Cases) -> dict[str, Figure]:
    """Draw the paper's figures; return each by its file name without ending."""
    point = {f"constraint point ({POINT[0]:g} s, {POINT[1]:g})": cases.point}
    return {
        "mechanism": plot_mechanism(cases.valid.problem.system)[0],
        "eq6-turned-contacts": _turned_contacts(),
        "fig4-z-no-point": plot_z({"no constraint point": cases.free})[0],
        "fig5-z-with-point": plot_z(point)[0],
        "fig5-no-real-theta1": _finding(cases),
        "z2-limit": plot_z({"least effort": cases.crossing, Z2_LABEL: cases.kept})[0],
        "fig6-joints": plot_joints({VALID_LABEL: cases.valid})[0],
        "fig7-inputs": plot_inputs({VALID_LABEL: cases.valid})[0],
        "fig8-arm": plot_arm({VALID_LABEL: cases.valid})[0],
        "fig9-joints-machine": plot_replays({VALID_LABEL: cases.replay})[0],
        "fig10-motors-machine": _motors(cases),
    }


def _turned_contacts() -> Figure:
    """Plot the speed of a joint behind three turned contacts, for several ratios of friction."""
    figure, axes, _ = grid(1, 1, size=(6.4, 4.0))
    ax, degrees = axes[0, 0], np.linspace(0, 60, 241)
    ax.plot(degrees, np.cos(np.deg2rad(degrees)) ** 3, "k--", label="eq. (6): $\\cos^3\\theta$")
    for k, lateral in enumerate((0.1, 0.3, 1.0)):
        words = f"{lateral:g}" + (": plain disks, $\\cos 3\\theta$" if lateral == 1 else "")
        for share, style in ((0.0, "-"), (0.3, ":")):
            label = words if share == 0 else None
            ratio = turned_ratio(degrees, lateral, share)
            ax.plot(degrees, ratio, style, color=COLOURS[k], linewidth=1.6, label=label)
    ax.set(xlabel="angle of the contacts (deg)", ylabel="speed of the joint over $k_2 u_1$")
    ax.legend(title="sideways over driving friction", fontsize=9)
    heading(figure, "Three turned contacts in a row; dotted: at 0.3 of their capacity", ours=True)
    return figure


def _finding(cases: Cases) -> Figure:
    """Draw z₂ of the paper's Fig. 5 with the band −g(z₃) < z₂ < 0 in which a real θ₁ exists."""
    figure, axes, _ = grid(1, 1, size=(6.4, 4.0))
    ax, t = axes[0, 0], np.linspace(0, cases.point.duration, 2001)
    z2 = cases.point.z(t)[:, 1]
    low, high = z2_band(cases.point, t)
    ax.fill_between(t, low, high, color="#DCEAF5", label="a real $\\theta_1$ exists")
    ax.plot(t, low, color="#5B8DB8", linewidth=1, label="$-g(z_3)$")
    ax.plot(t, z2, color="black", linewidth=1.6, label="$z_2$ of the paper's Fig. 5")
    no_angle = np.where(z2 < low, z2, np.nan)
    ax.plot(t, no_angle, color="#B00020", linewidth=2.6, label="no real $\\theta_1$")
    ax.plot(*POINT, "o", color="black", markersize=6, label="constraint point")
    ax.axhline(0, color="grey", linewidth=0.8)
    ax.set(xlabel="time (s)", ylabel="$z_2$")
    ax.legend(loc="lower left", fontsize=9)
    heading(
        figure, "z2 stays negative, yet no arm is there (at pi/4, an inferred travel)", ours=True
    )
    return figure


def _motors(cases: Cases) -> Figure:
    """Draw commands and motor speeds of the machine whose error is the median."""
    run = cases.replay
    figure, axes, _ = grid(1, 2, size=(4.2, 3.0))
    commanded, k = run.plan.trajectory.u(run.t), median_sample(run)
    for i, ax in enumerate(axes[0]):
        ax.plot(run.t, commanded[:, i], "k--", linewidth=1.1, label="command")
        ax.plot(run.t, run.motor_rates[k, :, i], color="#0072B2", linewidth=1.4, label="motor")
        ax.set(xlabel="time (s)", ylabel=f"$u_{i + 1}$ (rad/s)")
    axes[0, 0].legend(fontsize=9)
    heading(figure, "Motor speeds on the emulated prototype (one machine)", ours=True)
    return figure


MISPRINTS = TEXTS["misprints"]
"""Place, what is printed there, and what is correct."""

PAPER_FIGURES = TEXTS["figures"]
"""File name without ending, title, and what the figure shows."""

FILM = "arm.gif"


def _escape_separators(text: str) -> Markup:
    """Escape the separators of a Markdown table in a text that is Markdown with formulas."""
    return Markup(text.replace("|", "\\|"))


FINDING_COLUMNS: list[Column[PaperNumber]] = [
    Column("where", "", lambda f: f.where, _escape_separators, left=True),
    Column("printed", "", lambda f: f.printed, _escape_separators, left=True),
    Column("ours", "", lambda f: f.ours, _escape_separators, left=True),
    Column("verdict", "", lambda f: f"**{f.verdict}**", _escape_separators, left=True),
]


def page(findings: list[PaperNumber], samples: int, seed: int) -> str:
    """Return the text of README.md, the page with findings, misprints and figures."""
    command = f"planner reproduce --out results/paper --samples {samples} --seed {seed}"
    parts = [TEXTS["head"].format(provenance=provenance(command)), "## Numbers and claims\n"]
    parts += [markdown_table(FINDING_COLUMNS, findings) + "\n", "\n## Misprints\n"]
    columns = [
        Column(head, "", itemgetter(k), _escape_separators, left=True)
        for k, head in enumerate(("where", "printed", "corrected"))
    ]
    parts += [markdown_table(columns, MISPRINTS) + "\n", "\n## Figures\n"]
    for name, title, text in PAPER_FIGURES:
        parts.append(f"### {title}: {text}\n\n![{title}: {text}]({name}.png)\n")
    text = "the arm in motion, at double speed: the paper's law and the plan of least effort"
    parts.append(f"### Film: {text}\n\n![{text}]({FILM})\n")
    return "\n".join(parts)
