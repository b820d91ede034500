"""Run the command `planner` as `python -m planner`."""

import sys

from planner_start import main

if __name__ == "__main__":
    sys.exit(main())
