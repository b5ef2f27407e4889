"""Start of `python -m gazempc.identify`."""

import sys

from gazempc.identify.command import main

if __name__ == "__main__":
    sys.exit(main())
