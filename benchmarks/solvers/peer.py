"""What every solver in the comparison looks like."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from importlib.util import find_spec
from typing import ClassVar

import numpy as np

from benchmarks.solvers.problem import AxisProblem
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray

AxisSolver = Callable[[FloatArray, FloatArray], FloatArray]


class PeerFailedError(RuntimeError):
    """A solver says that it has no solution."""


class Peer(ABC):
    """One way to solve both joints' problems.

    Args:
        neck: The neck.
        steps: Length of the horizon, control periods.
        smoothing_time_s: T.
    """

    name: ClassVar[str]
    # What must be installed beside gazempc: name to import and name to install.
    module: ClassVar[str] = "casadi"
    package: ClassVar[str] = "casadi"

    def __init__(self, neck: NeckSpec, steps: int, smoothing_time_s: float) -> None:
        self._problems = [AxisProblem(neck, i, steps, smoothing_time_s) for i in range(2)]
        self._shape = (2, steps)

    @classmethod
    def is_installed(cls) -> bool:
        """Whether its package is there."""
        return find_spec(cls.module) is not None

    @abstractmethod
    def solve(self, states: FloatArray, references: FloatArray) -> FloatArray:
        """Solve one control tick.

        Args:
            states: z of pan and tilt, shape (2, 5).
            references: Reference angles, shape (2, N).

        Returns:
            Command positions at the end of each step, shape (2, N), radians.

        Raises:
            PeerFailedError: If it has none.
        """


class AxisPeer(Peer):
    """One that solves each joint's problem on its own; arguments as of `Peer`."""

    def __init__(self, neck: NeckSpec, steps: int, smoothing_time_s: float) -> None:
        super().__init__(neck, steps, smoothing_time_s)
        self._solvers = [self._axis(problem) for problem in self._problems]

    @abstractmethod
    def _axis(self, problem: AxisProblem) -> AxisSolver:
        """Make the solver of one joint: command positions from z0 and the reference."""

    def solve(self, states: FloatArray, references: FloatArray) -> FloatArray:
        """See `Peer.solve`."""
        command = np.empty(self._shape)
        for i, solver in enumerate(self._solvers):
            command[i] = solver(states[i], references[i])
        return command
