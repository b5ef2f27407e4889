"""Start of `python -m experiments.paper`."""

import sys

from gazempc.signals import end_during_imports

if __name__ == "__main__":
    end_during_imports("paper")
    from experiments.paper.reproduction import main

    sys.exit(main())
