"""Start of `python -m experiments.rivals`."""

import sys

from experiments.engine.signals import end_during_imports

if __name__ == "__main__":
    end_during_imports("rivals")
    from experiments.rivals.comparison import main

    sys.exit(main())
