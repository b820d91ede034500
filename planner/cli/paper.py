"""`planner reproduce`: regenerate the paper's figures and numbers.

`planner calibrate`: fit the prototype preset to the paper's statements.
"""

from __future__ import annotations

from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import Annotated

from planner.cli.arguments import Folder, Samples, Seed, out_option
from planner.cli.output import finish, job
from planner.paper.calibrate import calibrate as run_calibration
from planner.paper.calibrate import remaining_share, write
from planner.paper.fit import FITTED_PARAMETERS, STATEMENTS, Parameter
from planner.paper.reproduce import reproduce as run_reproduction
from planner.report.result_folder import refuse_unwritable_folder
from planner.support.tables import Column, terminal_table


def reproduce(
    out: Annotated[Path, out_option("FOLDER", "Folder for the figures and the page.")] = Path(
        "results/paper"
    ),
    samples: Samples = 200,
    seed: Seed = 0,
) -> int:
    """Regenerate the paper's figures and check its printed numbers.

    \b
    Example:
      planner reproduce --out results/paper
    """
    with job() as progress:
        reproduction = run_reproduction(out, samples, seed, progress)
    heads = "where", "printed", "ours", "verdict"
    columns = [Column(head, "", attrgetter(head), left=True) for head in heads]
    rows = [vars(f) for f in reproduction.findings]
    data = {"written": reproduction.path, "seed": seed, "samples": samples, "findings": rows}
    return finish(data, terminal_table(columns, reproduction.findings))


def calibrate(
    out: Folder = None,
    seed: Seed = 0,
) -> int:
    """Fit the emulated prototype to the paper's experiment.

    Also prints which parameters the paper does not determine.

    \b
    Example:
      planner calibrate --out results/calibration
    """
    refuse_unwritable_folder(out)
    with job() as progress:
        calibration = run_calibration(progress, seed)
        if out is not None:
            progress("writing", 0.95)
            write(calibration, out)
    columns: list[Column[Parameter]] = [
        Column("parameter", "", lambda r: r.key, left=True),
        Column("low", "", lambda r: r.low, "{:g}".format),
        Column("high", "", lambda r: r.high, "{:g}".format),
        Column("preset", "", lambda r: calibration.fit.parameters[r.key], "{:g}".format),
        *(
            Column(d.name, "", partial(remaining_share, d), "{:.2f}".format)
            for d in calibration.data
        ),
    ]
    met = [
        f"{s.text}: {value:.2f} {s.unit} (target {s.target_text})"
        for s, value in zip(STATEMENTS, calibration.fit.values, strict=True)
    ]
    return finish(
        {**calibration.to_dict(), "written": out},
        terminal_table(columns, FITTED_PARAMETERS, ruled=True),
        *met,
        "last columns: share of the range left by the data in the heading; 1 = not identifiable",
    )
