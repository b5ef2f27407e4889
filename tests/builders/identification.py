"""Plants with known parameters, and records of them."""

import dataclasses

from gazempc.identify.estimate import bandwidth_hz
from gazempc.identify.excitation import ExcitationSettings, excite
from gazempc.identify.record import record
from gazempc.live.clock import SimulatedClock
from gazempc.neck.spec import load_neck
from gazempc.sim.simulated import SimulatedNeck

REFERENCE = load_neck("reference")
SHORT = ExcitationSettings(duration_s=8.0)
AXIS_NAMES = ("pan", "tilt")


def plant(dead_times_s=(0.4, 0.4), wn=12.0, zeta=0.9, **changes):
    axes = {
        name: getattr(REFERENCE, name).model_copy(
            update={"dead_time_s": d, "natural_frequency_rad_s": wn, "damping_ratio": zeta, **changes}
        )
        for name, d in zip(AXIS_NAMES, dead_times_s, strict=True)
    }
    return REFERENCE.model_copy(update=axes)


def drive(robot, clock, how=SHORT, limits=REFERENCE, about=None):
    robot.connect()
    return record(robot, clock, excite(limits, limits.rest_rad, how), limits, about or {"from": "test"})


def simulate(neck, how=SHORT, clock=None, seed=0):
    clock = clock or SimulatedClock()
    return drive(SimulatedNeck(neck, REFERENCE.rest_rad, clock.now_s, seed), clock, how)


def altered(taken, **changes):
    return dataclasses.replace(taken, **changes)


def assert_close(estimate, dead_time_s, wn, zeta, *, dead_time_ms=5.0, bandwidth_share=0.05):
    assert estimate.doubts == ()
    assert 1e3 * abs(estimate.dead_time_s.value - dead_time_s) < dead_time_ms
    assert abs(estimate.bandwidth_hz.value / bandwidth_hz(wn, zeta) - 1.0) < bandwidth_share
