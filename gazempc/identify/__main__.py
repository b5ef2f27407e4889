"""Start of `python -m gazempc.identify`."""

import sys

from gazempc.identify.identify import main

if __name__ == "__main__":
    sys.exit(main())
