"""What pyproject.toml declares, and that the package keeps to what its libraries promise."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import legs
import pytest

import planner
from planner.support import package as distribution

PACKAGE = Path(planner.__file__).parent
LIBRARIES = ("scipy", "numpy", "casadi", "osqp", "pydantic", "typer")
UNCHECKED = "construct_fast"
"""A public name, but it takes what it is given: SciPy 1.18 reads BPoly's otherwise."""


def test_every_dependency_has_a_lowest_version_and_the_name_is_ours() -> None:
    table = legs.table("project")
    assert table["name"] == distribution.NAME
    pins = legs.lowest()
    assert {"casadi", "numpy", "osqp", "pydantic", "scipy", "typer"} <= {
        pin.partition("==")[0] for pin in pins
    }
    declared = [line for line in table["dependencies"] if not re.search(r",<\d+$", line)]
    assert not declared, "a new major version is not tested"


def test_the_oldest_python_is_the_same_everywhere() -> None:
    oldest = legs.declared()[0]
    assert legs.table("project")["requires-python"] == f">={oldest}"
    setup = (legs.ROOT / "setup.py").read_text(encoding="utf-8")
    assert f'OLDEST = "cp{oldest.replace(".", "")}"' in setup


def test_a_python_that_does_not_run_is_passed_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = "{}.{}".format(*sys.version_info[:2])
    assert legs.interpreter(here)
    monkeypatch.setattr(legs.sys, "executable", "/nowhere/python")
    shim = tmp_path / f"python{here}"
    shim.write_text("#!/bin/sh\nexit 127\n", encoding="utf-8")
    shim.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert legs.interpreter(here) is None


def test_files_of_the_short_suite_exist() -> None:
    assert [name for name in legs.SHORT if not (legs.ROOT / name).is_file()] == []


def test_libraries_are_used_by_their_public_names() -> None:
    offenders = []
    for path in sorted(PACKAGE.rglob("*.py")):
        nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
        names, roots = [], set()
        for node in nodes:
            if isinstance(node, ast.Import):
                names += [alias.name for alias in node.names if theirs(alias.name)]
                roots |= {a.asname or a.name for a in node.names if theirs(a.name)}
            elif isinstance(node, ast.ImportFrom) and node.module and theirs(node.module):
                names += [f"{node.module}.{alias.name}" for alias in node.names]
                roots |= {a.asname or a.name for a in node.names}
        bad = [name for name in names if re.search(r"\._(?!_)", name)]
        for node in nodes:
            if isinstance(node, ast.Attribute) and re.match(rf"_(?!_)|{UNCHECKED}$", node.attr):
                text = ast.unparse(node)
                theirs_too = re.fullmatch(r"[\w.]+", text) and text.partition(".")[0] in roots
                bad += [text] if theirs_too or node.attr == UNCHECKED else []
        offenders += [f"{path.name}: {name}" for name in bad]
    assert offenders == []


def theirs(module: str) -> bool:
    return module.partition(".")[0] in LIBRARIES


def test_hints_fit_how_it_was_installed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "pyproject.toml").write_text(
        f'[project]\nname = "{distribution.NAME}"\nversion = "7.8"\n', encoding="utf-8"
    )
    monkeypatch.setattr(distribution, "ROOT", tmp_path)
    monkeypatch.setattr(distribution, "_checkout", distribution._checkout.__wrapped__)
    assert distribution.version() == "7.8"
    assert distribution.how_to_install("video") == f"pip install -e '{tmp_path}[video]'"
    monkeypatch.chdir(tmp_path)
    assert distribution.how_to_install("video") == "pip install -e '.[video]'"
    monkeypatch.setattr(distribution, "ROOT", tmp_path / "site-packages")
    installed = "pip install 'nonholonomic-planner[video]'"
    assert distribution.how_to_install("video") == installed
    monkeypatch.setattr("importlib.metadata.version", {distribution.NAME: "1.2"}.__getitem__)
    assert distribution.version() == "1.2"


def test_hints_name_extras_that_exist_and_are_written_in_one_place() -> None:
    extras = legs.table("project")["optional-dependencies"]
    for path in PACKAGE.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        assert "pip install" not in text or path.stem == "package", path
        for extra in re.findall(r"how_to_install\(['\"](\w+)", text):
            assert extra in extras, f"{path.name}: no extra {extra}"


def test_without_the_kernel_it_is_said_once_on_standard_error() -> None:
    code = """
import planner.support.progress  # which has the logger that says it
from planner.machine import compiled
compiled.__file__ = "/nowhere/compiled.py"
assert compiled.library() is None and compiled.library() is None
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    (line,) = done.stderr.splitlines()
    assert "about ten times slower" in line
    assert legs.WITHOUT_COMPILER in line
    assert done.stdout == ""
