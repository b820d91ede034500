"""The commands that open the notebooks, as they are told, serve them."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar
from urllib.request import urlopen

import pytest
from lab_server import WAIT_S, home_of_jupyter, started

ROOT = Path(__file__).parents[2]
T = TypeVar("T")
BIN = Path(sys.executable).parent


def of_the_makefile() -> str:
    """What `make notebook` starts once it has installed, with the Python that runs the tests."""
    words = ["make", "--no-print-directory", "--dry-run", "notebook", f"BIN={BIN}"]
    said = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True)
    return said.stdout.splitlines()[-1]


def of_the_documentation() -> str:
    (found,) = re.findall(r"`(jupyter lab [^`]+)`", (ROOT / "docs/howto/explore.md").read_text())
    return f"{BIN}/{found}"


@pytest.mark.parametrize(
    ("command", "opened", "own_folder"),
    [
        (of_the_makefile, "lab/tree/quick-tour.ipynb", False),
        (of_the_makefile, "lab/tree/quick-tour.ipynb", True),
        (of_the_documentation, "lab", True),
    ],
)
def test_a_told_command_opens_the_notebooks(
    command: Callable[[], str], opened: str, own_folder: bool, tmp_path: Path
) -> None:
    """In a browser that only notes the address; the user's Jupyter may serve another folder."""
    pytest.importorskip("jupyterlab", reason="needs the extra 'notebook'")
    home = tmp_path / "home"
    environment = home_of_jupyter(home)
    own = {"allow_root": True, "port": 0, **({"root_dir": str(tmp_path)} if own_folder else {})}
    (home / "config" / "jupyter_server_config.json").write_text(json.dumps({"ServerApp": own}))
    note = tmp_path / "address"
    browser = tmp_path / "browser"
    browser.write_text(f'#!/bin/sh\nprintf %s "$1" > {note}.part && mv {note}.part {note}\n')
    browser.chmod(0o755)
    environment["BROWSER"] = f"{browser} %s"
    with started(shlex.split(command()), home, environment, cwd=ROOT) as server:

        def soon(ask: Callable[[], T]) -> T:
            """The answer, as soon as there is one: the browser may be sooner than the server."""
            until = time.monotonic() + WAIT_S
            while True:
                try:
                    return ask()
                except OSError:
                    if server.poll() is not None or time.monotonic() > until:
                        raise AssertionError((home / "log").read_text()[-2000:]) from None
                    time.sleep(0.05)

        # The address is a file, which leads to the server: nobody else can read its token there.
        page = Path(soon(note.read_text).removeprefix("file://")).read_text()
        (address,) = re.findall(r'href="(http://[^"]+)"', page)
        place, _, token = address.partition("?")
        base = place.removesuffix(opened)
        assert place == base + opened
        assert soon(lambda: urlopen(address)).status == 200
        served = urlopen(f"{base}api/contents/quick-tour.ipynb?{token}").read()
    assert "Traceback" not in (home / "log").read_text()
    stored = json.loads((ROOT / "notebooks" / "quick-tour.ipynb").read_text("utf-8"))
    held = json.loads(served)["content"]["cells"]
    assert [cell["source"] for cell in held] == ["".join(c["source"]) for c in stored["cells"]]
