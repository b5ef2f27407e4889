"""Start of `python -m experiments.sweep`."""

import sys

from gazempc.signals import end_during_imports

if __name__ == "__main__":
    end_during_imports("sweep")
    from experiments.sweep.sweep import main

    sys.exit(main())
