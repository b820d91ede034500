"""What the command `planner` starts: small, so that signals are heard while the rest is loading.

Modules that are being loaded may turn Ctrl-C into an error of their own (SciPy does). Until all of
them are there nothing has been written, so that the process can end on the spot.
"""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType


def main() -> int:
    """Load the command line and run it; see `planner.cli.app.main`."""
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)  # Windows has no SIGHUP
        # Where a signal is ignored it stays so: nohup, or a script's jobs in the background.
        if number is not None and signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, _leave)
    from planner.cli.app import main as run

    return run(last=True)


def _leave(number: int, frame: FrameType | None) -> None:
    what = "interrupted" if number == signal.SIGINT else "terminated"
    if "--json" in sys.argv:
        text = f'"status": "{what}", "error": "{what}, nothing written"'
        os.write(1, f'{{{text}, "exit_status": {128 + number}}}\n'.encode())
    os.write(2, f"planner: {what}, nothing written\n".encode())
    os._exit(128 + number)
