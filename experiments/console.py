"""The command `gazempc`: `gazempc run --replay subject03_R4` is `python -m gazempc.run --replay subject03_R4`."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Sequence

from gazempc.errors import suggest
from gazempc.signals import end_during_imports

COMMANDS = {
    "run": ("gazempc.run", "replay a walk to several gazes, with table and pictures"),
    "live": ("gazempc.live.__main__", "direct a robot's gaze at people, in real time"),
    "identify": ("gazempc.identify.identify", "measure a neck's dead time and servo"),
    "margins": ("gazempc.margins.command", "stability margins for errors of a neck file"),
    "export": ("gazempc.export", "write a log as csv, parquet or mcap"),
    "compare": ("experiments.compare", "compare gazes over many recordings"),
    "sweep": ("experiments.sweep.sweep", "vary settings over many recordings"),
    "forecast": ("experiments.forecast.command", "compare forecasts over many recordings"),
    "fit": ("experiments.fit.command", "fit the predictor walker to recordings"),
    "rivals": ("experiments.rivals.comparison", "compare with other robots' control laws"),
    "paper": ("experiments.paper.reproduction", "reproduce the validation of Tamaru et al. 2021"),
}
_BAD_INPUT = 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one of the commands.

    Args:
        arguments: Command line without the program's name; default: the process's.

    Returns:
        The command's exit status; 2 for an unknown command.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    if not words or words[0] in ("-h", "--help"):
        print("usage: gazempc COMMAND ...   (gazempc COMMAND --help: options)\n")
        print("\n".join(f"  {name:<9} {what}" for name, (_, what) in COMMANDS.items()))
        return 0 if words else _BAD_INPUT
    if words[0] not in COMMANDS:
        print(f"gazempc: no command {words[0]!r}: {suggest(words[0], COMMANDS)}", file=sys.stderr)
        return _BAD_INPUT
    if arguments is None:
        end_during_imports(f"gazempc {words[0]}")
    command = importlib.import_module(COMMANDS[words[0]][0])
    status: int = command.main(words[1:])
    return status


if __name__ == "__main__":
    sys.exit(main())
