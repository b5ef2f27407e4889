"""The picture of margins: loop transfers in the Nyquist plane, and the closed-loop poles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from gazempc.margins.margins import LEAST_DISTANCE, Margins


def draw(found: Sequence[tuple[str, Margins]]) -> Figure:
    """Draw the pan of each neck.

    Args:
        found: Names of necks, and margins of their joints.

    Returns:
        The figure.
    """
    figure = Figure(figsize=(10.0, 4.8), layout="constrained")
    nyquist, poles = figure.subplots(1, 2)
    circle = np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 200))
    nyquist.fill(
        *_plane(-1.0 + LEAST_DISTANCE * circle), color="C3", alpha=0.2, lw=0, label="less than the least margin"
    )
    nyquist.plot(-1.0, 0.0, "k+", ms=10)
    # Necks with equal servos and settings have one curve.
    curves: dict[bytes, tuple[list[str], Margins]] = {}
    for name, each in found:
        if each.joint == "pan":
            curves.setdefault(np.round(each.loop, 6).tobytes(), ([], each))[0].append(name)
    for k, (names, each) in enumerate(curves.values()):
        nyquist.plot(*_plane(each.loop), color=f"C{k}", label=", ".join(names))
        poles.plot(*_plane(each.poles), "x", color=f"C{k}", ms=5)
    nyquist.set(xlim=(-2.0, 1.5), ylim=(-2.2, 1.3), xlabel="Re L", ylabel="Im L", aspect="equal")
    nyquist.set_title("Loop transfer L, cut at the measured pan")
    nyquist.legend(fontsize=7, loc="lower right")
    poles.plot(*_plane(circle), "k", lw=0.8)
    poles.set(xlim=(-1.1, 1.1), ylim=(-1.1, 1.1), xlabel="Re z", ylabel="Im z", aspect="equal")
    poles.set_title("Closed-loop poles over a control period")
    for ax in (nyquist, poles):
        ax.grid(alpha=0.3)
    return figure


def _plane(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.real(values), np.imag(values)
