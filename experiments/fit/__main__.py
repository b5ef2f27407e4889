"""Start of `python -m experiments.fit`."""

import sys

from gazempc.signals import end_during_imports

if __name__ == "__main__":
    end_during_imports("fit")
    from experiments.fit.command import main

    sys.exit(main())
