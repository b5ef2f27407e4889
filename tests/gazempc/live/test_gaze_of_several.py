"""Gaze among several people, and what a program tells it besides."""

import math
import time

import numpy as np
import pytest
from builders.checks import assert_within_limits
from builders.live import NECK

import gazempc as gz
from gazempc.sim.simulated import SimulatedNeck

LEFT_M, RIGHT_M = [2.0, 0.8, 0.3], [2.5, -1.0, 0.3]


class Kept(SimulatedNeck):
    def __init__(self):
        super().__init__(NECK, np.radians([5.0, 2.0]), time.monotonic)
        self.received = []

    def send_command(self, position_rad):
        self.received.append(position_rad.copy())
        return super().send_command(position_rad)


def see_both(opened, seconds, tell=lambda elapsed_s: None):
    start_s = time.monotonic()
    while (elapsed_s := time.monotonic() - start_s) < seconds:
        now_s = time.time() - 0.03
        opened.see(now_s, LEFT_M, person_id="anna")
        opened.see(now_s, RIGHT_M, person_id="bob")
        tell(elapsed_s)
        time.sleep(1 / 30)


@pytest.mark.slow
def test_who_speaks_is_looked_at_and_it_looks_away_when_it_thinks():
    def tell(opened, elapsed_s):
        if elapsed_s > 0.5:
            opened.hear(math.atan2(RIGHT_M[1], RIGHT_M[0]))
        if elapsed_s > 1.5 and not told:
            told.append(opened.think(1.2))

    told, robot = [], Kept()
    settings = {"hysteresis_s": 0.2, "dwell_s": 0.2}
    with gz.Gaze(NECK, robot, predictor="constant_velocity", attend="speaker", attention=settings) as opened:
        see_both(opened, 2.6, lambda elapsed_s: tell(opened, elapsed_s))
        assert opened.attended.number == 2
        assert opened.warnings == ()
    assert_within_limits(np.array(robot.received), np.radians([5.0, 2.0]), ends=True)
    log = opened.log()
    assert log.attended_person.tolist() == [1, 2]
    assert log.away_why.tolist() == ["thinking"]
    assert log.away_end_s[0] - log.away_start_s[0] == pytest.approx(1.2)
