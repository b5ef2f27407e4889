"""Start of `python -m experiments.forecast`."""

import sys

from gazempc.signals import end_during_imports

if __name__ == "__main__":
    end_during_imports("forecast")
    from experiments.forecast.command import main

    sys.exit(main())
