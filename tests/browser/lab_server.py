"""Real Jupyter servers with a home of their own, which touch nothing of the user's."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

WAIT_S = 60.0
QUIET = {
    "@jupyterlab/apputils-extension:announcements": True,  # asks the network for news
    "@jupyterlab/extensionmanager-extension": True,
    "@jupyterlab/lsp-extension": True,
}


@contextmanager
def lab_server(folder: Path) -> Iterator[str]:
    """Serve the notebooks of a folder; gives the address, which ends in a slash."""
    home = folder / ".jupyter-home"
    command = [sys.executable, "-m", "jupyterlab", "--no-browser", "--allow-root", "--ip=127.0.0.1"]
    command += ["--port=0", "--IdentityProvider.token=", f"--ServerApp.root_dir={folder}"]
    command += ["--LabApp.extension_manager=readonly", "--ServerApp.use_redirect_file=False"]
    command += ["--LabApp.expose_app_in_browser=True"]  # window.jupyterapp
    with started(command, home, home_of_jupyter(home)) as server:
        yield _address(server, home)


def home_of_jupyter(home: Path) -> dict[str, str]:
    """Make a home for Jupyter; return the environment with which it uses nothing else."""
    config = home / "config"
    (config / "labconfig").mkdir(parents=True)
    (config / "labconfig" / "page_config.json").write_text(
        json.dumps({"disabledExtensions": QUIET})
    )
    places = {"CONFIG": config, "DATA": home / "data", "RUNTIME": home / "runtime"}
    return {
        **os.environ,
        **{f"JUPYTER_{name}_DIR": str(place) for name, place in places.items()},
        "JUPYTERLAB_SETTINGS_DIR": str(home / "settings"),
        "JUPYTERLAB_WORKSPACES_DIR": str(home / "workspaces"),
        "IPYTHONDIR": str(home / "ipython"),
    }


@contextmanager
def started(
    command: list[str], home: Path, environment: dict[str, str], **settings: Any
) -> Iterator[subprocess.Popen[bytes]]:
    """Start a server, with its log in its home, and end it."""
    with (home / "log").open("w") as log:
        server = subprocess.Popen(command, env=environment, stdout=log, stderr=log, **settings)
    try:
        yield server
    finally:
        server.terminate()
        try:
            server.wait(10)
        except subprocess.TimeoutExpired:
            server.kill()
            server.wait()


def _address(server: subprocess.Popen[bytes], home: Path) -> str:
    until = time.monotonic() + WAIT_S
    while time.monotonic() < until and server.poll() is None:
        for found in (home / "runtime").glob("jpserver-*.json"):
            try:
                return str(json.loads(found.read_text())["url"])
            except ValueError:  # half written
                pass
        time.sleep(0.1)
    raise RuntimeError(f"the Jupyter server did not start:\n{(home / 'log').read_text()[-3000:]}")
