"""A process that runs cases: `python -m planner.sweep.worker`.

It says `ready`; then one request a line on standard input, one row a line on standard output, both
JSON. It ends when its standard input does, so that it never outlives whoever started it.
"""

from __future__ import annotations

import json
import os
import sys
import threading
from queue import SimpleQueue

from planner.sweep.case import run_case
from planner.sweep.pools import READY


def main() -> None:
    """Answer requests until there are no more."""
    # Solvers print from compiled code: what they print must not end up between the rows.
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    answers.write(READY)
    answers.flush()
    requests: SimpleQueue[str] = SimpleQueue()
    threading.Thread(target=_listen, args=(requests,), daemon=True).start()
    while True:
        print(json.dumps(run_case(json.loads(requests.get()))), file=answers, flush=True)


def _listen(requests: SimpleQueue[str]) -> None:
    for line in sys.stdin:
        requests.put(line)
    os._exit(0)  # at once, even in the middle of a case that nobody waits for any more


if __name__ == "__main__":
    main()
