"""Start of `python -m experiments.fit`."""

import sys

from experiments.fit.command import main

if __name__ == "__main__":
    sys.exit(main())
