"""Start of `python -m experiments.forecast`."""

import sys

from experiments.forecast.command import main

if __name__ == "__main__":
    sys.exit(main())
