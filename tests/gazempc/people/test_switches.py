"""A switch from one person to another: near the least time of the neck, with little overshoot."""

import numpy as np
import pytest
from builders.standing import standing_together

from experiments.people.study import least_time_s
from gazempc.results.attention import measure_attention
from gazempc.results.metrics import gaze_error_deg
from gazempc.results.motion import limit_violations
from gazempc.settings import AttentionSettings
from gazempc.sim.replay import ReplaySettings, replay_scene

WANTED_FROM_S, HYSTERESIS_S = 1.4, 0.2
CALM = AttentionSettings(hysteresis_s=HYSTERESIS_S, dwell_s=1.0)
PLACES_M = ([1.5, 1.2, 0.0], [1.5, -1.2, 0.5])


class SecondLater:
    """Prefers the second person from `WANTED_FROM_S` on, else the first."""

    def reset(self):
        pass

    def scores(self, company):
        wanted = 2 if company.time_s >= WANTED_FROM_S else 1
        return [float(person.number == wanted) for person in company.people]


@pytest.mark.parametrize("controller", ["mpc", "lookahead"])
def test_a_switch_is_near_time_optimal_with_less_than_a_degree_of_overshoot(controller):
    settings = ReplaySettings(attend=f"{__name__}:SecondLater", attention=CALM)
    log = replay_scene(standing_together(3.6, *PLACES_M), controller, "walker", settings).log
    assert log.attended_person.tolist() == [1, 2]
    switched_s = float(log.attended_time_s[1])
    assert switched_s == pytest.approx(WANTED_FROM_S + HYSTERESIS_S, abs=0.03)
    found = measure_attention(log)
    assert found.switch_overshoot_deg < 1.0
    away_deg = gaze_error_deg(log)[np.searchsorted(log.time_s, switched_s)]
    assert away_deg > 60.0
    assert found.time_to_contact_after_switch_s < least_time_s(log.neck, away_deg) + 0.12
    assert limit_violations(log, log.neck) == 0
