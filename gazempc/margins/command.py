"""Print the stability margins for errors of a neck file: `gazempc margins --neck my_neck.toml`.

Gain, delay and disk margin of the MPC, its observer and the dead time, for pan and tilt, while no limit is active.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import tyro
from pydantic import Field

from gazempc.command import TYRO_CONFIG, run_interruptible
from gazempc.neck.spec import load_neck, neck_names
from gazempc.settings import Settings

if TYPE_CHECKING:
    from gazempc.margins.margins import Margins


class MarginsSettings(Settings):
    """Settings of `gazempc margins`."""

    neck: str | None = Field(default=None, description="Shipped neck or a .toml file; default: all shipped necks")
    figure: Path | None = Field(default=None, description="Picture to write: loop transfers and closed-loop poles")


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
    found: list[tuple[str, Margins]] = []
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
        found += [(neck.name, m) for m in each]
        warnings += too_small(mpc)
    print("\n" + "\n".join(findings))
    for warning in warnings:
        print(f"Warning: {warning}")
    if settings.figure is not None:
        _draw(found, settings.figure)
        print(f"Written: {settings.figure}")
    return 0


def _draw(found: Sequence[tuple[str, Margins]], path: Path) -> None:
    """Loop transfers in the Nyquist plane, and the closed-loop poles, of the pan of each neck."""
    from matplotlib.figure import Figure  # noqa: PLC0415

    from gazempc.margins.margins import LEAST_DISTANCE  # noqa: PLC0415

    figure = Figure(figsize=(10.0, 4.8), layout="constrained")
    nyquist, poles = figure.subplots(1, 2)
    circle = np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 200))
    near = -1.0 + LEAST_DISTANCE * circle
    nyquist.fill(near.real, near.imag, color="C3", alpha=0.2, lw=0, label="less than the least margin")
    nyquist.plot(-1.0, 0.0, "k+", ms=10)
    # Necks with equal servos and settings have one curve.
    curves: dict[bytes, tuple[list[str], Margins]] = {}
    for name, each in found:
        if each.joint == "pan":
            curves.setdefault(np.round(each.loop, 6).tobytes(), ([], each))[0].append(name)
    for k, (names, each) in enumerate(curves.values()):
        nyquist.plot(each.loop.real, each.loop.imag, color=f"C{k}", label=", ".join(names))
        poles.plot(each.poles.real, each.poles.imag, "x", color=f"C{k}", ms=5)
    nyquist.set(xlim=(-2.0, 1.5), ylim=(-2.2, 1.3), xlabel="Re L", ylabel="Im L", aspect="equal")
    nyquist.set_title("Loop transfer L, cut at the measured pan")
    nyquist.legend(fontsize=7, loc="lower right")
    poles.plot(circle.real, circle.imag, "k", lw=0.8)
    poles.set(xlim=(-1.1, 1.1), ylim=(-1.1, 1.1), xlabel="Re z", ylabel="Im z", aspect="equal")
    poles.set_title("Closed-loop poles over a control period")
    for ax in (nyquist, poles):
        ax.grid(alpha=0.3)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    sys.exit(main())
