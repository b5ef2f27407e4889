"""Trackers that misbehave in a live run: ids, yaws, covariances, ranges and positions that make no sense."""

import dataclasses

import numpy as np
import pytest
from builders.checks import assert_recovered, assert_same_commands, assert_sound
from builders.faults import between
from builders.live import NECK, TS, run_live

from gazempc.controllers.lookahead import LookAhead
from gazempc.loop.attended import AttendedPeople
from gazempc.loop.looking_away import LookingAway
from gazempc.people.attention import Attention
from gazempc.people.policies import Nearest
from gazempc.people.schedule import LookAways
from gazempc.settings import AttentionSettings, LoopSettings
from gazempc.types import Sighting
from predictors import ConstantVelocity, Walker

ORIENTATIONS = ("head_quat_wxyz", "pelvis_quat_wxyz")


def changed(sighting, **fields):
    return dataclasses.replace(sighting, observation=dataclasses.replace(sighting.observation, **fields))


def half_turn(quat_wxyz):
    """The quaternion (0, 0, 0, 1) times it: half a turn about the vertical."""
    w, x, y, z = quat_wxyz
    return np.array([-z, -y, x, w])


def test_a_person_whose_id_changes_at_every_frame_is_one_person():
    result = run_live(change=lambda now, s: [changed(s, person_id=f"track {now:.3f}")])
    assert_sound(result)
    assert result.events == {"no_observation_yet", "new_id_each_frame"}
    assert_same_commands(result, within_rad=1e-12)
    ids = result.joined("person_id")
    assert len(set(ids)) == len(ids) > 100


@pytest.mark.slow
def test_a_yaw_that_flips_at_every_frame_is_as_good_as_none():
    frames = {"flips": 0, "none": 0}

    def flips(now_s, sighting):
        frames["flips"] += 1
        if frames["flips"] % 2:
            return [sighting]
        return [changed(sighting, **{name: half_turn(getattr(sighting.observation, name)) for name in ORIENTATIONS})]

    def none(now_s, sighting):
        frames["none"] += 1
        return [sighting if frames["none"] == 1 else changed(sighting, **dict.fromkeys(ORIENTATIONS))]

    flipping, without = (
        run_live(change=change, predictor=Walker(), controller=LookAhead(NECK), duration_s=4.0)
        for change in (flips, none)
    )
    assert_sound(flipping)
    assert flipping.events == {"no_observation_yet", "orientation_jumped"}
    assert flipping.event_s("orientation_jumped").size == 1
    assert without.events == {"no_observation_yet"}
    sent, usual = (each.joined("command_position_rad") for each in (flipping, without))
    np.testing.assert_allclose(sent, usual, atol=1e-9)


def test_a_tracker_that_is_frozen_in_mid_walk_is_not_believed():
    """After half a second its frames are not seen any more: one event, the neck brakes, and then a new track."""
    until_s = 5.0
    frozen, held = between(2.0, until_s), []

    def freeze(now_s, sighting):
        if not frozen(now_s):
            return [sighting]
        held.append(sighting.observation.head_position_base_m)
        return [changed(sighting, head_position_base_m=held[0])]

    result = run_live(change=freeze, duration_s=8.5)
    assert_sound(result)
    assert result.events - {"gate_refused"} == {"no_observation_yet", "tracker_frozen", "target_lost"}
    (noticed_s,) = result.event_s("tracker_frozen")
    assert noticed_s == pytest.approx(2.0 + 0.5, abs=0.05)
    captures_s = result.joined("capture_time_s")
    last_s = captures_s[captures_s < 3.5].max()
    assert last_s < noticed_s
    assert result.event_s("target_lost") == pytest.approx([last_s + 1.0], abs=2 * TS)
    now = result.joined("time_s")
    still = result.joined("command_velocity_rad_s")[(now > last_s + 1.7) & (now < until_s)]
    assert np.abs(still).max() < 1e-9
    assert_recovered(result, until_s + 1.5, within_deg=1.0)


def test_among_several_people_who_enters_leaves_and_is_renamed_is_an_event():
    """Beside the walker: a second person from 1.0 to 2.5 s, and again from 4.0 s."""

    def change(now_s, sighting):
        seen = sighting.observation
        there = [(seen.head_position_base_m, "a" if now_s < 3.0 else "c")]
        if 2.0 <= now_s < 2.2:
            there.append((there[0][0] + [0.1, 0.0, 0.0], "body"))
        if 1.0 <= now_s < 2.5 or now_s >= 4.0:
            there.append((np.array([4.0, 2.5, 0.3]), "b"))
        observed = [dataclasses.replace(seen, head_position_base_m=at_m, person_id=name) for at_m, name in there]
        return [Sighting(sighting.arrival_s, each) for each in observed]

    attended = AttendedPeople(ConstantVelocity, Attention(Nearest(), AttentionSettings()), LoopSettings())
    result = run_live(change=change, several=LookingAway(attended, LookAways(NECK, "told", 0)))
    assert_sound(result)
    began_s = {name: result.event_s(name).tolist() for name in result.events}
    delay_s = 0.2
    assert began_s["person_entered"][1:] == pytest.approx([1.0], abs=delay_s)
    assert began_s["seen_twice"] == pytest.approx([2.0], abs=delay_s)
    assert began_s["person_renamed"] == pytest.approx([3.0], abs=delay_s)
    assert began_s["person_returned"] == pytest.approx([4.0], abs=delay_s)
    assert len(began_s["attention_switched"]) == 1
    # Observations that are not the walker's, or come before a track is confirmed.
    assert result.refused["another_person"] == pytest.approx(30 * (1.5 + 2.0), abs=8)
    assert result.refused["seen_twice"] == pytest.approx(6, abs=1)
    assert set(result.refused) == {"another_person", "seen_twice"}
    assert set(result.joined("person_id")) == {"a", "c"}
