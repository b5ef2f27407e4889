"""Own costs and rows of the MPC: CasADi expressions in the symbols of `Trajectory`, checked before they are condensed.

A term is a function of `Trajectory` whose value, a scalar in rad^2 times control periods, is added to the cost. A row
is a function whose values, a column of any length, are kept within +-1 as soft rows, with the penalty of the limits.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from gazempc.controllers.mpc.problem import Trajectory
from gazempc.errors import SettingsError
from gazempc.neck.spec import AXES
from gazempc.types import FloatArray

Part = Callable[[Trajectory], Any]
# Own parts for all joints, or by the joint's name.
PartList = list[Part] | tuple[Part, ...]
OwnChoice = PartList | Mapping[str, PartList]

# Sizes of the random trajectories on which an expression is compared with its coefficients, and the relative tolerance.
_SIZES = (1e-3, 1e-1, 1.0, 1e1, 1e3)
_TOLERANCE = 1e-6
_SYMBOLS = ("q", "v", "a", "u", "du", "ddu", "j", "r")


class Own(NamedTuple):
    """One own part.

    Attributes:
        label: Its name in messages, such as ``mpc.terms[0] (calm)``.
        make: The function of `Trajectory`.
    """

    label: str
    make: Part


@dataclass(frozen=True)
class OwnParts:
    """The own parts of one joint."""

    terms: tuple[Own, ...] = ()
    rows: tuple[Own, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.terms or self.rows)

    @property
    def labels(self) -> str:
        """The names of all parts."""
        return ", ".join(part.label for part in (*self.terms, *self.rows))

    def cost(self, o: Trajectory) -> Any:
        """Sum of the terms.

        Raises:
            SettingsError: If one is not a convex quadratic scalar in the symbols of o; the message names the part.
        """
        return sum((_checked_term(term, o) for term in self.terms), ca.SX(0))

    def row_values(self, o: Trajectory) -> dict[str, Any]:
        """The rows of each part by its name: a column of values, shape (m, 1).

        Raises:
            SettingsError: If one is not linear in the symbols of o; the message names the part.
        """
        return {row.label: _checked_row(row, o) for row in self.rows}


NO_PARTS = OwnParts()


def own_parts(terms: OwnChoice, rows: OwnChoice, joint: str) -> OwnParts:
    """The own parts of a joint.

    Args:
        terms: For pan and tilt, or by the joint's name.
        rows: As terms.
        joint: The joint's name.

    Raises:
        SettingsError: If a part is not a function, or there is no such joint.
    """
    return OwnParts(_named("terms", terms, joint), _named("rows", rows, joint))


def _named(kind: str, choice: OwnChoice, joint: str) -> tuple[Own, ...]:
    place = f"mpc.{kind}"
    if isinstance(choice, Mapping):
        for name in choice:
            if name not in AXES:
                raise SettingsError(f"{place}: no joint {name!r}; accepted: {', '.join(AXES)}")
        choice, place = choice.get(joint, ()), f"{place}[{joint!r}]"
    if not isinstance(choice, list | tuple):
        raise SettingsError(f"{place}: {type(choice).__name__} is not a list of functions of the trajectory o")
    parts = []
    for k, make in enumerate(choice):
        label = f"{place}[{k}] ({getattr(make, '__name__', type(make).__name__)})"
        if not callable(make):
            raise SettingsError(f"{label} is not a function of the trajectory o")
        parts.append(Own(label, make))
    return tuple(parts)


def _expression(part: Own, o: Trajectory) -> Any:
    try:
        value = part.make(o)
    except Exception as error:
        raise SettingsError(f"{part.label} raised {type(error).__name__}: {error}") from error
    try:
        value = value if isinstance(value, ca.SX) else ca.SX(value)
    except Exception:  # the type that CasADi raises depends on the argument
        raise SettingsError(
            f"{part.label} returned {type(value).__name__}; expected a casadi.SX expression in the symbols of o"
        ) from None
    # By identity: a symbol made by the user may have the name of one in `Trajectory`.
    known = {each.element_hash() for each in ca.symvar(_motion(o))}
    foreign = [str(each) for each in ca.symvar(value) if each.element_hash() not in known]
    if foreign:
        raise SettingsError(f"{part.label} has foreign symbols: {', '.join(foreign[:4])}; accepted: those of this o")
    return value


def _motion(o: Trajectory) -> Any:
    return ca.vertcat(*(getattr(o, name) for name in _SYMBOLS))


def _checked_term(term: Own, o: Trajectory) -> Any:
    value, y = _expression(term, o), _motion(o)
    if value.shape != (1, 1):
        raise SettingsError(f"{term.label} has shape {value.shape}; expected a scalar, such as casadi.sumsqr(o.du)")
    curvature, slope, constant = _coefficients(term, "quadratic", ca.quadratic_coeff, value, y)
    _compare(term, "quadratic", value, y, lambda x: 0.5 * x @ curvature @ x + slope[:, 0] @ x + constant[0])
    # The reference is a parameter; the decision variables are the motion.
    given = o.r.shape[0]
    if not (curvature[:-given].any() or slope[:-given].any()):
        raise SettingsError(f"{term.label} does not depend on the motion")
    of_motion = curvature[:-given, :-given]
    lowest, highest = np.linalg.eigvalsh(of_motion)[[0, -1]]
    if lowest < -1e-9 * max(abs(lowest), abs(highest)):
        raise SettingsError(f"{term.label} is not convex: its second derivative has the eigenvalue {lowest:.3g}")
    return value


def _checked_row(row: Own, o: Trajectory) -> Any:
    value, y = _expression(row, o), _motion(o)
    if value.shape[1] != 1 or not value.shape[0]:
        raise SettingsError(f"{row.label} has shape {value.shape}; expected a column, such as (o.u - o.q) / 0.05")
    matrix, constants = _coefficients(row, "linear", ca.linear_coeff, value, y)
    _compare(row, "linear", value, y, lambda x: matrix @ x + constants[:, 0])
    still = ~matrix[:, : -o.r.shape[0]].any(axis=1)
    if still.any():
        raise SettingsError(f"{row.label} does not depend on the motion in element {int(np.flatnonzero(still)[0])}")
    return value


def _coefficients(part: Own, what: str, find: Callable[[Any, Any, bool], Any], value: Any, y: Any) -> list[FloatArray]:
    try:
        found = [array_of(each) for each in find(value, y, True)]
    except RuntimeError:
        raise SettingsError(f"{part.label} is not {what}: its coefficients depend on the symbols of o") from None
    if not all(np.isfinite(each).all() for each in found):
        raise SettingsError(f"{part.label} is not finite: its coefficients have a NaN or infinity")
    return found


def _compare(part: Own, what: str, value: Any, y: Any, by_coefficients: Callable[[Any], Any]) -> None:
    # Piecewise functions such as |x| also have constant derivatives: compare values of the expression.
    function, rng = ca.Function("own", [y], [value]), np.random.default_rng(0)
    for size in _SIZES:
        x = size * rng.uniform(-1.0, 1.0, y.shape[0])
        found, wanted = np.array(function(x))[:, 0], by_coefficients(x)
        if not np.allclose(
            found, wanted, rtol=_TOLERANCE, atol=_TOLERANCE * max(np.abs(wanted).max(initial=0.0), 1e-12)
        ):
            raise SettingsError(f"{part.label} is not {what}: it has kinks, jumps or values that are not finite")


def array_of(constants: Any) -> FloatArray:
    """A numeric CasADi matrix as an array, by its non-zeros: CasADi's own conversion takes a millisecond."""
    matrix = ca.DM(constants)
    array = np.zeros(matrix.shape)
    array[matrix.sparsity().get_triplet()] = matrix.nonzeros()
    return array
