"""Start of `python -m gazempc.live`."""

import sys

from gazempc.live.program import main

if __name__ == "__main__":
    sys.exit(main())
