"""Start of `python -m experiments.sensor_example`."""

import sys

from gazempc.signals import end_during_imports

if __name__ == "__main__":
    end_during_imports("sensor_example")
    from experiments.sensor_example.example import main

    sys.exit(main())
