"""The figures, and their table."""

from __future__ import annotations

from dataclasses import dataclass

# A command this near to the accurate one is the same.
AGREE_RAD = 1e-4
# Calls that are not timed: solvers set themselves up in their first ones.
WARM_UP = 5


@dataclass
class PeerFigures:
    """Figures of one solver; times in CPU milliseconds of a call for both joints."""

    name: str
    median_ms: float
    p95_ms: float
    p99_ms: float
    max_ms: float
    agrees: bool
    worst_difference_rad: float | None
    ticks_over: int
    failures: int
    calls: int
    step_median_ms: float | None = None
    step_p99_ms: float | None = None


@dataclass
class GrowthFigures:
    """Ours with one length of the horizon; the binding median is None if no limit binds."""

    horizon_steps: int
    median_ms: float
    p99_ms: float
    median_binding_ms: float | None
    worst_difference_rad: float | None
    solvers: dict[str, int]
    calls: int
    failures: int


@dataclass
class Figures:
    """All figures of a benchmark."""

    peers: list[PeerFigures]
    growth: list[GrowthFigures]
    ticks: int
    ticks_with_limits: int
    ticks_by_limit: dict[str, int]
    ticks_softened: int
    solvers: dict[str, int]
    bare_kalman_ms: float
    versions: dict[str, str]
    machine: dict[str, str | int]


def table(figures: Figures) -> str:
    """Write the figures for reading.

    Args:
        figures: The figures.

    Returns:
        Lines.
    """
    ours = figures.peers[0].median_ms
    head = f"{'CPU time of a call [ms]':<24}{'median':>9}{'p95':>9}{'p99':>9}{'max':>9}{'ratio':>8}{'calls':>7}"
    head += f"{'worst diff. [rad]':>19}{'over':>6}{'failed':>8}{'agrees':>8}"
    lines = [head]
    for peer in figures.peers:
        worst = "-" if peer.worst_difference_rad is None else f"{peer.worst_difference_rad:.1e}"
        line = f"{peer.name:<24}{peer.median_ms:>9.3f}{peer.p95_ms:>9.3f}{peer.p99_ms:>9.3f}{peer.max_ms:>9.3f}"
        line += f"{peer.median_ms / ours:>8.1f}{peer.calls:>7}{worst:>19}{peer.ticks_over:>6}{peer.failures:>8}"
        line += f"{'yes' if peer.agrees else 'NO':>8}"
        lines.append(line)
    lines.append(
        f"ratio: median to that of gazempc. over: ticks more than {AGREE_RAD:g} rad from the accurate first command, "
        f"of {figures.ticks}; the first {WARM_UP} calls are not timed."
    )
    reached = ", ".join(f"{name} in {count}" for name, count in figures.ticks_by_limit.items())
    answered = ", ".join(f"{name} {count}" for name, count in figures.solvers.items())
    lines += [
        f"A limit binds in {figures.ticks_with_limits} of {figures.ticks} ticks ({reached}); limits left in "
        f"{figures.ticks_softened}. Joints' programs of gazempc answered by: {answered}.",
        f"Whole control step of gazempc, forecast in, plan out: median {figures.peers[0].step_median_ms:.3f} ms, "
        f"p99 {figures.peers[0].step_p99_ms:.3f} ms.",
    ]
    if figures.growth:
        head = f"{'gazempc, CPU time [ms]':<24}{'median':>9}{'p99':>9}{'median where limits bind':>27}"
        lines.append(head + f"{'calls':>7}{'worst diff. [rad]':>19}{'failed':>8}  answered by")
    for row in figures.growth:
        binding = "-" if row.median_binding_ms is None else f"{row.median_binding_ms:.3f}"
        worst = "-" if row.worst_difference_rad is None else f"{row.worst_difference_rad:.1e}"
        answered = ", ".join(f"{name} {count}" for name, count in row.solvers.items())
        line = f"{f'N = {row.horizon_steps}':<24}{row.median_ms:>9.3f}{row.p99_ms:>9.3f}{binding:>27}"
        lines.append(line + f"{row.calls:>7}{worst:>19}{row.failures:>8}  {answered}")
    return "\n".join(lines)
