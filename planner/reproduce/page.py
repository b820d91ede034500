"""The page that goes with the figures, for a reader of the paper."""

from __future__ import annotations

from planner.reproduce.numbers import Finding

MISPRINTS = (
    (
        "(2), (3)",
        "f and h of q_(i-1), q_i",
        "of the underlined tails (q_(i-1), ..., q_n); without"
        " that the class is too small for the manipulator itself",
    ),
    (
        "(7)",
        "thetan' = kn cos^2(theta_(n-1))/pn",
        "thetai' = Ki cos^2(theta_(i-1)) /"
        " prod_{j=i..n-2} cos(theta_j) for i < n, but **cos^3** for i = n",
    ),
    ("(10)", "powers c_1^1, c_1^(n-2) of cos(theta_1)", "products c_1 c_2 ... c_(i-2), as in (6)"),
    (
        "(12)-(15)",
        "X_(i+1) = (c Y - s Z)/(c^2 k)",
        "X_(i+1) = (s Y + c Z)/(-2 k c^3 s), which needs"
        " sin(theta_i) != 0, for i <= n - 2, and X_n = Z/(-3 k c^2 s); the printed one belongs to"
        " theta' = k sin(theta) u",
    ),
    (
        "(24)",
        "v1 = u1 = phi2'",
        "v1 = kg cos(theta1) u1: the u's in (24) are rates of phi2 and"
        " theta1, not the motors' of (6)",
    ),
    (
        "step 3",
        "z3 = z3(0) + z2(0) t + c0 t^2/2 + ...",
        "z3 = z3(0) + b0 (z2(0) t + c0 t^2/2 + ...), z4 with b0 and b0^2",
    ),
    (
        "step 4",
        "offset from the mean of Z_i, i = 1..n",
        "the state has n + 1 coordinates; z2 ... at the turn are left open",
    ),
    (
        "(28)",
        "t_c^(i+k-1), no b0",
        "z_i(tc) = sum_{j<=i} (b0 tc)^(i-j)/(i-j)! z_j(0) + b0^(i-2)"
        " sum_j j! c_j tc^(i+j-1)/(i+j-1)!  (i >= 2, sum over z from j = 2)",
    ),
    ("4.3", "z2(T) = -0.532", "z2(T) = -0.5225"),
    ("4.3", '"Fig. 5 indicates the trajectory of Z without any constraint points"', "Fig. 4"),
)

FIGURES = (
    ("fig4-z-no-point", "Fig. 4", "z without a constraint point: z2 crosses zero twice"),
    ("fig5-z-with-point", "Fig. 5", "z with the constraint point: z2 keeps its sign"),
    ("fig5-no-real-theta1", "what Fig. 5 hides", "in the red stretch no angle theta1 gives this z"),
    ("fig6-joints", "Fig. 6", "joints of a plan of the same law that stays in the domain"),
    ("fig7-inputs", "Fig. 7", "its inputs"),
    ("fig8-arm", "Fig. 8", "its arm in the plane"),
    ("fig9-joints-machine", "Fig. 9", "its joints on the emulated prototype"),
    ("fig10-motors-machine", "Fig. 10", "its motors on the emulated prototype"),
)


def page(findings: list[Finding], samples: int, seed: int) -> str:
    """Markdown."""
    parts = [_HEAD.format(samples=samples, seed=seed), "## Numbers and claims\n"]
    parts.append(
        _table(
            ["where", "printed", "ours", "verdict"],
            [[f.where, f.printed, f.ours, f"**{f.verdict}**"] for f in findings],
        )
    )
    parts.append("\n## Misprints\n")
    parts.append(_table(["where", "printed", "corrected"], [list(row) for row in MISPRINTS]))
    parts.append("\n## Figures\n")
    for name, title, text in FIGURES:
        parts.append(f"### {title}: {text}\n\n![{title}: {text}]({name}.png)\n")
    return "\n".join(parts)


_HEAD = """# The paper, reproduced and corrected

*Chained-Form Design and Motion Planning for a Nonholonomic Manipulator*: what it prints, what we
find, and where the two differ. Made by

    planner reproduce --out results/paper --samples {samples} --seed {seed}

The travel of the disk, its start and the duration are not printed. The constraint point (5, -0.2)
suggests T = 10 s, and at a travel of pi/4 the story of Figs 4 and 5 appears as told. Gear constants
come from the printed z(0). Figs 6 to 10 cannot be redrawn for that travel, since the path has no
joint angles; they show the same polynomial law at the travel of least peak input for which it
stays in the domain of the chart. Figs 9 and 10 come from an emulated machine, not from hardware.
"""


def _table(head: list[str], rows: list[list[str]]) -> str:
    cells = [[c.replace("|", "\\|") for c in row] for row in (head, ["---"] * len(head), *rows)]
    return "\n".join(f"| {' | '.join(row)} |" for row in cells) + "\n"
