"""Which pages of results/ are older than the code that made them (`make results-check`).

A page ends with a fingerprint of the code that its figures depend on. Only what is computed counts:
comments, docstrings and layout may change.

    python tests/benchmarks/results_pages.py               the pages whose code has changed
    python tests/benchmarks/results_pages.py --sign suite  after its command has made a page anew
    python tests/benchmarks/results_pages.py --list suite  after a page was edited by hand
"""

from __future__ import annotations

import argparse
import ast
import hashlib
import re
import shutil
import sys
from collections.abc import Iterable
from pathlib import Path

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "results"

PLANS = (
    "systems",
    "problem",
    "plan",
    "methods",
    "verification",
    "solve.py",
    "support",
    "errors.py",
)
"""What every plan depends on, in planner/."""
MACHINES = (*PLANS, "machine", "compensation.py")
COMPARISONS = (*MACHINES, "comparison")

DEPENDENCIES: dict[str, tuple[str, ...]] = {
    "benchmarks": (
        *COMPARISONS,
        "sweep",
        *(f"tests/benchmarks/{k}.py" for k in ("beside", "collocation", "frameworks", "jobs")),
    ),
    "budget": (*MACHINES, "robustness/budget.py"),
    "calibration": ("machine", "paper/calibrate.py"),
    "compare": (*COMPARISONS, "problems/paper.toml", "tests/benchmarks/comparison.py"),
    "compensation": (*MACHINES, "tests/benchmarks/compensation.py"),
    "controller": (*MACHINES, "report/controller", "tests/benchmarks/controller.py"),
    "coverage": (*PLANS, *(f"tests/benchmarks/{k}.py" for k in ("coverage", "stress_problems"))),
    "design": (*MACHINES, "sweep/design", "problems/designs"),
    "explorer": ("explorer", "report/charts"),
    "feedback": (*MACHINES, "tests/benchmarks/robustness.py"),
    "gallery": (*COMPARISONS, "robustness", "report/figures", "docs/gallery.md"),
    "identification": (*MACHINES, "tests/benchmarks/identification.py"),
    "judging": (
        *(*PLANS, "retime.py"),
        *(
            f"tests/benchmarks/{k}.py"
            for k in ("judged", "judging", "outside_judge", "stress_problems")
        ),
    ),
    "map": (*PLANS, "tests/benchmarks/goal_map.py"),
    "mutants": (
        *("verification", "systems", "machine", "methods", "tests/benchmarks/mutants.py"),
        *(f"tests/{k}" for k in ("verification", "plan", "problem", "systems", "machine")),
        *("tests/methods", "tests/report/test_mechanism.py"),
    ),
    "optimality": (*PLANS, "tests/benchmarks/optimality.py"),
    "paper": (*COMPARISONS, "paper", "report/figures"),
    "peers": (*PLANS, "tests/benchmarks/peers.py", "tests/benchmarks/peers_theirs.py"),
    "report": ("report", "comparison"),
    "sensitivity": (*MACHINES, "robustness", "tests/benchmarks/sensitivity.py"),
    "singular": (*MACHINES, "problems/z2-singular.toml", "tests/benchmarks/singular.py"),
    "stress": (
        *PLANS,
        *(f"tests/benchmarks/{k}.py" for k in ("stress", "stress_problems", "families")),
    ),
    "suite": (*PLANS, "problems", "tests/benchmarks/suite.py"),
    "sweeps": (*PLANS, "sweep", "problems/sweeps"),
    "truths": (*MACHINES, "tests/benchmarks/truths.c", "tests/benchmarks/truths.py"),
}
"""By page: folders and files, in planner/ or, where they are not there, of the checkout."""

SIGNATURE = re.compile(r"\n*^<small>Fingerprint `(\w+)` of .*</small>\n*\Z", flags=re.MULTILINE)


def fingerprint(names: Iterable[str], root: Path = ROOT) -> str:
    """Twelve digits that change with what the code computes."""
    digest = hashlib.sha256()
    for name in names:
        for path in _files(root, name):
            digest.update(path.relative_to(root).as_posix().encode())
            digest.update(_substance(path))
    return digest.hexdigest()[:12]


def _files(root: Path, name: str) -> list[Path]:
    place = root / "planner" / name
    place = place if place.exists() else root / name
    if place.is_file():
        return [place]
    kinds = {".py", ".c", ".h", ".js", ".css", ".html", ".toml"}
    return sorted(path for path in place.rglob("*") if path.suffix in kinds)


def _substance(path: Path) -> bytes:
    """Of Python the syntax tree without docstrings; of other files all of it."""
    if path.suffix != ".py":
        return path.read_bytes()
    return _dump(ast.parse(path.read_text(encoding="utf-8"))).encode()


def _dump(node: object) -> str:
    """A syntax tree as text, the same on each version of Python; `ast.dump` writes others."""
    if isinstance(node, list):
        return "[" + " ".join(_dump(each) for each in node if not _is_text(each)) + "]"
    if not isinstance(node, ast.AST):
        return ascii(node)
    fields = dict(ast.iter_fields(node))
    if isinstance(node, ast.JoinedStr):  # some versions end it with an empty part
        fields["values"] = [part for part in node.values if getattr(part, "value", None) != ""]
    held = (f"{k}={_dump(v)}" for k, v in fields.items() if v is not None and v != [])
    return f"{type(node).__name__}({' '.join(held)})"


def _is_text(node: object) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def cache_path(page: str, kind: str = "") -> Path:
    """Where a campaign of this code keeps what is finished, under out/."""
    path = ROOT / "out" / f"{page}-{fingerprint(DEPENDENCIES[page])}{kind}"
    path.parent.mkdir(exist_ok=True)
    return path


def begin_records(page: str, path: Path) -> Path:
    """A file whose lines are of this code: one of other code is moved to out/, with a word.

    Its first line is the fingerprint. A campaign that was ended goes on where it was, and figures
    of two versions never share a page.
    """
    first = f"# {fingerprint(DEPENDENCIES[page])}\n"
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True) if path.exists() else []
    if lines[:1] != [first]:
        if lines:
            old = ROOT / "out" / f"{page}-before-{path.name}"
            old.parent.mkdir(exist_ok=True)
            shutil.move(path, old)
            print(
                f"{path.name} is of other code: it begins anew, and {old} has it", file=sys.stderr
            )
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(first, encoding="utf-8")
    return path


def read_records(path: Path) -> list[str]:
    """The lines after the fingerprint."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    return [line for line in lines if not line.startswith("#")]


def sign(page: str, root: Path = ROOT) -> None:
    """Put the fingerprint of the code at the end of a page that was just made with it."""
    path, names = RESULTS / page / "README.md", DEPENDENCIES[page]
    text = SIGNATURE.sub("", path.read_text(encoding="utf-8")).rstrip("\n")
    of = ", ".join(_files_named(name) for name in names)
    line = f"<small>Fingerprint `{fingerprint(names, root)}` of {of}</small>"
    path.write_text(f"{text}\n\n{line}\n", encoding="utf-8")
    list_page(page)


def list_page(page: str) -> None:
    """List the page in its folder as it is now: else the next run keeps it as another's work."""
    from planner.report.result_folder import list_file  # fingerprints need no package

    list_file(RESULTS / page / "README.md")


def _files_named(name: str) -> str:
    return f"planner/{name}" if (ROOT / "planner" / name).exists() else name


def stale() -> list[str]:
    """The pages whose code has changed since they were made, or that were never signed."""
    out = []
    for page, names in DEPENDENCIES.items():
        match = SIGNATURE.search((RESULTS / page / "README.md").read_text(encoding="utf-8"))
        if not match or match[1] != fingerprint(names):
            out.append(page)
    return out


def main() -> None:
    """Sign a page, or list those that are stale and end with status 1 if there are some."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sign", metavar="PAGE", choices=sorted(DEPENDENCIES))
    parser.add_argument("--list", metavar="PAGE", choices=sorted(DEPENDENCIES))
    asked = parser.parse_args()
    if asked.sign or asked.list:
        sign(asked.sign) if asked.sign else list_page(asked.list)
        return
    pages = stale()
    for page in pages:
        print(f"results/{page}: code that it depends on has changed since it was made")
    print(f"{len(DEPENDENCIES) - len(pages)} of {len(DEPENDENCIES)} pages are of this code")
    sys.exit(bool(pages))


if __name__ == "__main__":
    main()
