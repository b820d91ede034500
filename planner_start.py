"""What the command `planner` starts: small, so that Ctrl-C is heard while the rest is loading."""

from __future__ import annotations

import sys


def main() -> int:
    """Load the command line and run it; see `planner.cli.main`."""
    try:
        from planner.cli import main as run
    except KeyboardInterrupt:
        print("planner: interrupted, nothing written", file=sys.stderr)
        return 130
    return run()
