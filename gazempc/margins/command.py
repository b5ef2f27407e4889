"""Print the stability margins for errors of a neck file: `gazempc margins --neck my_neck.toml`.

Gain, delay and disk margin of the MPC, its observer and the dead time, for pan and tilt, while no limit is active.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import tyro
from pydantic import Field

from gazempc.command import TYRO_CONFIG, run_interruptible
from gazempc.neck.spec import load_neck, neck_names
from gazempc.settings import Settings


class MarginsSettings(Settings):
    """Settings of `gazempc margins`."""

    neck: str | None = Field(default=None, description="Shipped neck or a .toml file; default: all shipped necks")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        arguments: Command line without the program's name; default: the process's.

    Returns:
        Exit status: 0, 2 on bad input.
    """
    settings = tyro.cli(
        MarginsSettings, config=TYRO_CONFIG, args=arguments, prog="gazempc margins", description=__doc__
    )
    return run_interruptible("margins", lambda: _work(settings), "")


def _work(settings: MarginsSettings) -> int:
    from gazempc.controllers.mpc.mpc import Mpc  # noqa: PLC0415
    from gazempc.margins.margins import margins, sentences, too_small  # noqa: PLC0415

    head = f"{'neck':<17} {'joint':<5} {'gain':>6} {'at [Hz]':>8} {'phase [deg]':>12} {'delay [ms]':>11} "
    print(head + f"{'disk: gain, phase':>18} {'peak |S|':>9} {'slowest pole [s]':>17}")
    findings, warnings = list[str](), list[str]()
    for name in neck_names() if settings.neck is None else (settings.neck,):
        neck = load_neck(name)
        mpc = Mpc(neck)
        each = margins(mpc)
        for m in each:
            disk = f"{m.disk[0]:.2f}, {m.disk[1]:.0f} deg"
            print(
                f"{neck.name:<17} {m.joint:<5} {m.gain:>6.2f} {m.gain_hz:>8.2f} {m.phase_deg:>12.0f} "
                f"{1e3 * m.delay_s:>11.0f} {disk:>18} {m.peak_sensitivity:>9.2f} {m.slowest_s:>17.2f}"
            )
        findings += sentences(neck, each)
        warnings += too_small(mpc)
    print("\n" + "\n".join(findings))
    for warning in warnings:
        print(f"Warning: {warning}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
