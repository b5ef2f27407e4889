"""Start of `python -m experiments.people`."""

import sys

from gazempc.signals import end_during_imports

if __name__ == "__main__":
    end_during_imports("people")
    from experiments.people.study import main

    sys.exit(main())
