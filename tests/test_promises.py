"""What the README promises and no other test shows: files are data; plans are the same anywhere."""

from __future__ import annotations

import ast
import multiprocessing
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import planner

ROOT = Path(__file__).parents[1]
EXECUTING = {"eval", "exec", "compile", "__import__"}
UNPICKLING = {"pickle", "marshal", "shelve", "dill", "cloudpickle", "joblib"}

JOBS = [
    ("paper", "collocation", 0.82),
    ("paper", "collocation", 0.84),
    ("crossing", "collocation", "free"),
    ("paper", "convex", 0.83),
    ("paper", "collocation", 0.83),
]


def test_no_module_executes_text_or_unpickles() -> None:
    found = []
    for path in sorted((ROOT / "planner").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            match node:
                case ast.Call(func=ast.Name(id=name)) if name in EXECUTING:
                    found.append(f"{path.name}:{node.lineno} calls {name}")
                case ast.Import(names=names) if {n.name for n in names} & UNPICKLING:
                    found.append(f"{path.name}:{node.lineno} imports {names[0].name}")
                case ast.ImportFrom(module=str(name)) if name.split(".")[0] in UNPICKLING:
                    found.append(f"{path.name}:{node.lineno} imports {name}")
                case ast.keyword(arg="allow_pickle", value=ast.Constant(value=True)):
                    found.append(f"{path.name} allows pickles")
    assert found == []


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os').system('touch {mark}')",
        "(lambda: open('{mark}', 'w'))()",
        "[c for c in ().__class__.__base__.__subclasses__()][0]",
        "open('{mark}', 'w').write('x')",
    ],
)
def test_an_expression_in_a_file_is_never_executed(text: str, tmp_path: Path) -> None:
    mark = tmp_path / "mark"
    words = (ROOT / "problems/custom.toml").read_text("utf-8")
    hostile = words.replace('"tan(heading)"', f'"{text.format(mark=mark)}"')
    assert hostile != words
    path = tmp_path / "mine.toml"
    path.write_text(hostile, "utf-8")
    with pytest.raises(planner.InputError, match="slopes"):
        planner.load_problem(path)
    assert not mark.exists()


def _planned(job: tuple[str, str, float | str]) -> list[np.ndarray]:
    name, method, travel = job
    problem = planner.load_problem(ROOT / f"problems/{name}.toml")
    plan = planner.solve(problem.changed({"goal.travel": travel}), method)
    times = np.linspace(0.0, plan.duration, 101)
    return [plan.t, plan.q(times), plan.u(times)]


@pytest.fixture(scope="module")
def alone() -> list[list[np.ndarray]]:
    """In one thread, one after the other."""
    return [_planned(job) for job in JOBS]


@pytest.mark.parametrize("where", ["threads", "processes"])
def test_plans_are_the_same_from_threads_and_processes(
    where: str, alone: list[list[np.ndarray]]
) -> None:
    """Alone and all at once: no state is shared, to the last bit."""
    pool: Executor = ThreadPoolExecutor(4)
    if where == "processes":
        pool = ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn"))
    with pool:
        together = list(pool.map(_planned, JOBS))
    for job, one, other in zip(JOBS, alone, together, strict=True):
        for a, b in zip(one, other, strict=True):
            np.testing.assert_array_equal(a, b, err_msg=str(job))
