"""Start of `python -m experiments.rivals`."""

import sys

from gazempc.signals import end_during_imports

if __name__ == "__main__":
    end_during_imports("rivals")
    from experiments.rivals.comparison import main

    sys.exit(main())
