"""What replays of a process share must not show: the same log whatever ran before, and nothing of another neck."""

from collections.abc import Iterator
from dataclasses import fields

import numpy as np
import pytest

from gazempc.controllers.mpc.condense import axis_model, condense
from gazempc.controllers.mpc.mpc import Mpc
from gazempc.loop.observer import observer_gain
from gazempc.neck import servo
from gazempc.neck.ahead import settled_joints
from gazempc.neck.spec import load_neck
from gazempc.results.log import Log
from gazempc.sim.replay import ReplaySettings, replay_scene
from gazempc.sim.scene import SceneSettings, make_scene

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


def replayed(recording: str, neck: str, controller: str | Mpc = "mpc", **settings: object) -> Log:
    # It starts far aside, so that limits bind and the solvers are asked, too.
    scene = make_scene(recording, SceneSettings(neck=neck, start_offset_deg=60.0))
    return replay_scene(scene, controller, "walker", ReplaySettings.model_validate(settings)).log


def bits(log: Log) -> dict[str, bytes]:
    arrays = {f.name: getattr(log, f.name) for f in fields(log)}
    return {name: array.tobytes() for name, array in arrays.items() if isinstance(array, np.ndarray)}


def test_what_ran_before_does_not_show() -> None:
    """One replay, then others on another neck and with other settings, then the first again."""
    first = bits(replayed("subject03_R4", "reference"))
    other = bits(replayed("subject05_R2", "slow", mpc={"smoothing_time_s": 0.15}))
    assert bits(replayed("subject03_R4", "reference")) == first
    forget()
    assert bits(replayed("subject05_R2", "slow", mpc={"smoothing_time_s": 0.15})) == other


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
