"""This project's solver, and the same without its first answer."""

from __future__ import annotations

import numpy as np

from benchmarks.solvers.peer import AxisPeer, AxisSolver, Peer, PeerFailedError
from benchmarks.solvers.problem import AxisProblem
from gazempc.controllers.controller import SolverFailed
from gazempc.controllers.mpc.condense import AxisModel
from gazempc.controllers.mpc.ocp import AxisOcp
from gazempc.controllers.mpc.qp import Daqp
from gazempc.neck.spec import NeckSpec
from gazempc.types import FloatArray

# A limit left by more than this share of it is more than a solver's tolerance.
_SOFTENED = 1e-5


def even_model(neck: NeckSpec, index: int, steps: int) -> AxisModel:
    """A joint over a horizon of equal steps, as all peers can pose it; the controller's own steps grow."""
    return AxisModel(neck, index, (1,) * steps, steps)


class Gazempc(Peer):
    """This project: one constant matrix while no limit binds, DAQP where one does.

    Args:
        neck: The neck.
        steps: Length of the horizon, control periods.
        smoothing_time_s: T.

    Attributes:
        ocps: The problems of pan and tilt.
    """

    name = "gazempc"

    def __init__(self, neck: NeckSpec, steps: int, smoothing_time_s: float) -> None:
        super().__init__(neck, steps, smoothing_time_s)
        self.ocps = [AxisOcp(even_model(neck, i, steps), smoothing_time_s) for i in range(2)]

    def solve(self, states: FloatArray, references: FloatArray) -> FloatArray:
        """See `Peer.solve`."""
        command = np.empty(self._shape)
        try:
            for i, ocp in enumerate(self.ocps):
                solution = ocp.solve(states[i], references[i])
                if solution.solver == "none":
                    raise PeerFailedError("stopped")
                command[i] = solution.command[0]
        except SolverFailed as error:
            raise PeerFailedError(str(error)) from None
        return command

    def used(self, states: FloatArray, references: FloatArray) -> list[str]:
        """What answers for pan and for tilt; arguments of `Peer.solve`."""
        return [ocp.solve(states[i], references[i]).solver for i, ocp in enumerate(self.ocps)]


class DaqpAlways(AxisPeer):
    """The same without the constant matrix: DAQP in every tick; shows what the matrix is worth."""

    name = "daqp_always"

    def _axis(self, problem: AxisProblem) -> AxisSolver:
        ocp = AxisOcp(even_model(problem.neck, problem.index, problem.steps), problem.smoothing_time_s)
        data = ocp.program.data
        solver = Daqp(data)

        def solve(state: FloatArray, reference: FloatArray) -> FloatArray:
            g, lower, upper = ocp.changing(np.concatenate([state, [1.0], reference]))
            x = solver.solve(g, lower, upper)
            if x is None:
                raise PeerFailedError("stopped")
            rows = data.a @ np.clip(x, -1.0, 1.0) + 1.0 - upper
            if max(rows.max(), -rows.min()) > 1.0 + _SOFTENED:
                raise PeerFailedError("limit left")
            command: FloatArray = ocp.command(state, x)[0]
            return command

        return solve
