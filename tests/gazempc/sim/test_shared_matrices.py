"""What replays of a process share must not show: the same log whatever ran before, and nothing of another neck."""

from collections.abc import Iterator

import pytest

from gazempc.controllers.mpc.condense import axis_model, condense
from gazempc.controllers.mpc.mpc import Mpc
from gazempc.loop.observer import observer_gain
from gazempc.neck import servo
from gazempc.neck.ahead import settled_joints
from gazempc.neck.spec import load_neck

REFERENCE, SLOW = load_neck("reference"), load_neck("slow")
CACHES = (axis_model, condense, observer_gain, servo._transition, settled_joints)


@pytest.fixture(autouse=True)
def nothing_shared_yet() -> Iterator[None]:
    forget()
    yield
    forget()


def forget() -> None:
    for cached in CACHES:
        cached.cache_clear()


def test_necks_and_settings_do_not_share() -> None:
    """Every number that a program depends on is in its key."""

    def gain(mpc: Mpc) -> bytes:
        return mpc.ocps[0].program.gain.tobytes()

    limit = REFERENCE.model_copy(update={"pan": REFERENCE.pan.model_copy(update={"jerk_max_rad_s3": 200.0})})
    rate = REFERENCE.model_copy(update={"servo_rate_hz": 400.0})
    gains = [
        gain(mpc)
        for mpc in (
            Mpc(REFERENCE),
            Mpc(SLOW),
            Mpc(limit),
            Mpc(rate),
            Mpc(REFERENCE, horizon_s=0.6),
            Mpc(REFERENCE, smoothing_time_s=0.1),
        )
    ]
    assert len(set(gains)) == len(gains)
    assert gain(Mpc(REFERENCE)) == gains[0]


def test_the_same_neck_shares_but_cannot_be_written_to() -> None:
    """Two controllers have their matrices in common, and solvers of their own; a change is an error."""
    first, second = Mpc(REFERENCE).ocps[0], Mpc(REFERENCE).ocps[0]
    assert first.program is second.program
    assert first is not second
    program = first.program
    for array in (program.data.h, program.data.a, program.rows_map, program.gain, program.cost_map):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0
