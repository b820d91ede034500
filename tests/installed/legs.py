"""The package as users install it, on every Python it declares (`make installed`).

The archives are built and looked through. Then each Python gets an environment of its own, in a
temporary folder: the oldest with the lowest dependencies that pyproject.toml declares, the others
with the newest. There the wheel is installed and the main job runs, without any extra; then a short
part of the suite, with the extras. On the newest the source archive is installed too, without a
compiler. A Python that is not at hand is skipped, and the last lines say so.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
import tomllib
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]

SHORT = (
    "tests/robustness/test_sobol.py",
    "tests/verification/test_certificate_plans.py",
    "tests/cli/test_commands.py",
    "tests/methods/convex/test_convex_search.py",
    "tests/explorer/test_explorer_widget.py",
    "tests/browser/test_notebook_server.py",
    "tests/plan/test_views.py",
    "tests/machine/test_kernel.py",
    "tests/methods/laws/test_polynomial.py",
    "tests/methods/collocation/test_curve.py",
    "tests/methods/collocation/test_solvers.py",
    "tests/sweep/test_sweep_table.py",
    "tests/support/test_files.py",
    "tests/plan/test_plan.py",
    "tests/machine/test_replay.py",
    "tests/verification/test_verify.py",
)
"""Each dependency and extra is used: about two minutes on one core."""

EXTRAS = "budget,cluster,notebook,tables,video"
TOOLS = ("hypothesis", "jsonschema", "pytest", "pytest-xdist")
"""Of the extra dev what the tests above import."""

MAIN_JOB = ("compare", "problems/paper.toml", "--samples", "20", "--out", "out/installed")

WITHOUT_COMPILER = "the compiled replay is missing"


def table(name: str) -> dict[str, Any]:
    """A table of pyproject.toml."""
    found: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))[name]
    return found


def declared() -> list[str]:
    """Versions of Python in the classifiers, such as "3.11", oldest first."""
    found = [c.rpartition(" :: ")[2] for c in table("project")["classifiers"]]
    return [c for c in found if re.fullmatch(r"3\.\d+", c)]


def lowest() -> list[str]:
    """`name==version` with the lowest version that pyproject.toml allows, of all but the docs'.

    Raises:
        ValueError: If a requirement has no lower bound.
    """
    project = table("project")
    groups = {**project["optional-dependencies"], "": project["dependencies"]}
    groups["build"] = table("build-system")["requires"]
    pins = []
    for line in (line for name, group in groups.items() if name != "docs" for line in group):
        if line.startswith(f"{project['name']}["):
            continue
        bound = re.fullmatch(r"([\w.-]+)>=([\w.]+)(,<[\w.]+)?", line)
        if bound is None:
            raise ValueError(f"{line}: expected name>=version or name>=version,<version")
        pins.append(f"{bound[1]}=={bound[2]}")
    return sorted(set(pins))


def interpreter(version: str) -> str | None:
    """A Python of a version that runs and can make environments, or None."""
    for path in _candidates(version):
        code = "import sys, venv, ensurepip; print('%d.%d' % sys.version_info[:2])"
        try:  # pyenv's names run only where that version is chosen
            said = subprocess.run([path, "-c", code], capture_output=True, text=True, check=False)
        except OSError:
            continue
        if said.returncode == 0 and said.stdout.strip() == version:
            return path
    return None


def _candidates(version: str) -> Iterator[str]:
    yield sys.executable
    for folder in os.get_exec_path():
        yield from filter(None, [shutil.which(f"python{version}", path=folder)])
    if pyenv := shutil.which("pyenv"):
        said = subprocess.run([pyenv, "root"], capture_output=True, text=True, check=False)
        yield from map(str, Path(said.stdout.strip()).glob(f"versions/{version}.*/bin/python"))


def build(folder: Path) -> tuple[Path, Path]:
    """The wheel and the source archive of what git knows; the wheel is built from the archive.

    What is left in `folder / "source"` is everything but the package.
    """
    source, dist = folder / "source", folder / "dist"
    words = ["git", "ls-files", "-z"]
    listed = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    names = [name for name in listed.split("\0") if name and (ROOT / name).exists()]
    for name in names:
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, source / name)
    pins = folder / "pins.txt"
    pins.write_text("\n".join(lowest()))  # the lowest setuptools here, the newest in `leg`
    own = {**os.environ, "PIP_CONSTRAINT": str(pins)}
    run(sys.executable, "-m", "build", "--outdir", dist, source, env=own)
    (wheel,), (archive,) = dist.glob("*.whl"), dist.glob("*.tar.gz")
    package = {n for n in names if n.startswith("planner/") or n == "planner_start.py"}
    with zipfile.ZipFile(wheel) as held:
        inside = {n for n in held.namelist() if ".dist-info/" not in n}
    kernels = {n for n in inside if n.startswith("planner/machine/_kernel.")}
    same("the wheel", inside - kernels, package)
    if not kernels or "-cp311-abi3-" not in wheel.name:
        sys.exit(f"{wheel.name}: no compiled kernel for every Python")
    with tarfile.open(archive) as tar:
        inside = {m.name.partition("/")[2] for m in tar.getmembers() if m.isfile()}
    made = {n for n in inside if ".egg-info/" in n} | {"PKG-INFO", "setup.cfg"}
    same("the source archive", inside - made, {n for n in names if not n.startswith(".")})
    for name in ("planner", "planner_start.py"):  # else the tests would find these
        path = source / name
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    return wheel, archive


def same(what: str, found: set[str], expected: set[str]) -> None:
    """Leave with a message if two sets of file names differ."""
    if found != expected:
        extra, lacking = sorted(found - expected), sorted(expected - found)
        sys.exit(f"{what} should not hold {extra[:10]}, and lacks {lacking[:10]}")


def run(*words: str | Path, **settings: Any) -> str:
    """Run a command; leave with what it said if it fails, else return its standard error."""
    done = subprocess.run(
        [str(w) for w in words], capture_output=True, text=True, check=False, **settings
    )
    if done.returncode:
        text = " ".join(map(str, words))
        sys.exit(
            f"{text}\nended with {done.returncode}\n{done.stdout[-8000:]}{done.stderr[-8000:]}"
        )
    return done.stderr


def leg(python: str, folder: Path, wheel: Path, archive: Path | None, pins: list[str]) -> None:
    """The main job in a bare environment, from both archives, then the short part of the suite."""
    began, source = time.monotonic(), folder.parent / "source"
    run(python, "-m", "venv", folder)
    command = folder / "bin" / "planner"
    (folder / "pins.txt").write_text("\n".join(pins))
    pip = [folder / "bin" / "python", "-m", "pip", "--disable-pip-version-check", "--quiet"]
    install = [*pip, "install", "--constraint", folder / "pins.txt"]
    # Nothing of the caller's environment may lead to another package.
    own = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
    own["MPLBACKEND"] = "Agg"
    (folder / "bare" / "problems").mkdir(parents=True)
    shutil.copy(ROOT / MAIN_JOB[1], folder / "bare" / MAIN_JOB[1])
    there: dict[str, Any] = {"cwd": folder / "bare", "env": own}
    if archive:
        run(*install, archive, cwd=folder, env={**own, "CC": "false"})
        if (said := run(command, *MAIN_JOB, **there)).count(WITHOUT_COMPILER) != 1:
            sys.exit(f"without a compiler this must be said once: {WITHOUT_COMPILER}\n{said}")
        run(*pip, "uninstall", "--yes", table("project")["name"])
    run(*install, wheel, cwd=folder, env=own)
    if WITHOUT_COMPILER in (said := run(command, *MAIN_JOB, **there)):
        sys.exit(f"the wheel's kernel does not run\n{said}")
    run(*install, f"{wheel}[{EXTRAS}]", *TOOLS, cwd=folder, env=own)
    words = [str(folder / "bin" / "pytest"), "-p", "no:cacheprovider", "-n", "2", *SHORT]
    if pins:  # the lowest libraries use what newer ones below them have deprecated
        words += ["-W", "ignore::DeprecationWarning"]
    if subprocess.run(words, cwd=source, env=own, check=False).returncode:
        sys.exit(f"{python}: the short part of the suite fails")
    print(f"installed and run in {time.monotonic() - began:.0f} s", flush=True)


def main() -> None:
    """Every leg, one after the other; the first that fails ends it."""
    versions = declared()
    here = {v: path for v in versions if (path := interpreter(v))}
    with tempfile.TemporaryDirectory(prefix="planner-installed-") as name:
        wheel, archive = build(Path(name))
        for version, path in here.items():
            pins = lowest() if version == versions[0] else []
            kind = "lowest" if pins else "newest"
            print(f"Python {version} with the {kind} dependencies", flush=True)
            last = archive if version == list(here)[-1] else None
            leg(path, Path(name) / version, wheel, last, pins)
            shutil.rmtree(Path(name) / version)
    for version in sorted(set(versions) - set(here)):
        print(f"skipped: Python {version} is not here, or cannot make environments")


if __name__ == "__main__":
    main()
