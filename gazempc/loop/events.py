"""Unusual events of a run: each has one name, as in the log."""

from __future__ import annotations

from enum import StrEnum


class Event(StrEnum):
    """An event of the loop; its value is its name in the log, `meaning` says it in words."""

    meaning: str

    def __new__(cls, value: str, meaning: str) -> Event:
        """Make a member of a name and its meaning."""
        member = str.__new__(cls, value)
        member._value_ = value
        member.meaning = meaning
        return member

    NO_OBSERVATION_YET = "no_observation_yet", "no person has been observed yet; the neck holds still"
    OUT_OF_ORDER = "out_of_order", "an observation was not newer than the last one; dropped"
    STALE_OBSERVATION = "stale_observation", "an observation was older than `stale_after_s` on arrival; dropped"
    FUTURE_OBSERVATION = (
        "future_observation",
        "an observation was captured later than now, so a clock is wrong; dropped",
    )
    TRACKER_FROZEN = (
        "tracker_frozen",
        "a tracker repeated one position for 0.5 s although the person was walking; its frames are not used",
    )
    ORIENTATION_JUMPED = (
        "orientation_jumped",
        "the yaw of head or pelvis changed by more than 90 degrees from one frame to the next; it is not used",
    )
    FORECAST_FAILED = "forecast_failed", "the predictor raised, or its forecast has a NaN; the last plan goes on"
    CONTROLLER_FAILED = "controller_failed", "the controller raised; the last plan goes on"
    SOLVER_FAILED = "solver_failed", "the controller's problem has no solution; the last plan goes on"
    PLAN_NOT_FINITE = "plan_not_finite", "the controller planned a NaN; the last plan goes on"
    LATE_PLAN = (
        "late_plan",
        "a plan came after the tick it was made for (the rest of it is used), or the planner was still busy (no new "
        "plan was asked for)",
    )
    SOLVER_GAVE_UP = (
        "solver_gave_up",
        "the solver was stopped; the plan is the best without limits, which the smoother keeps",
    )
    LIMITS_SOFTENED = (
        "limits_softened",
        "no plan keeps all limits (for example, the start is outside them); this plan violates them least",
    )
    STALE_PLAN = "stale_plan", "the last plan has ended; the smoother stops the command"
    LIMIT_GUARD = "limit_guard", "the smoother refused a motion that could not stop inside the position limits"
    TARGET_LOST = "target_lost", "no observation for `lost_after_s`; the command stops"
    RETURN_TO_REST = "return_to_rest", "no observation for `rest_after_s`; the neck returns to rest, slowly"
    JOINT_READING_REFUSED = (
        "joint_reading_refused",
        "a reading of the joints was NaN, too old or far from any possible position; not used",
    )
    JOINT_NOT_FOLLOWING = (
        "joint_not_following",
        "a joint of a neck with eyes or body stands still although its commands move; the other joints do without it",
    )
    EYES_AT_LIMIT = "eyes_at_limit", "the eyes are at their limit while the head is still on its way"
    ROBOT_NOT_ANSWERING = (
        "robot_not_answering",
        "the joints could not be read (the plan then relies on the commands sent), or a command did not get through "
        "(the robot stands by the last one; no plan until one does)",
    )
    BAD_OBSERVATION = "bad_observation", "a source received data that are not an observation; dropped"
    SENDER_REFUSED = (
        "sender_refused",
        "somebody else sends than the first sender or those allowed, or a line is not signed with the key; dropped",
    )
    OPEN_TO_ALL = "open_to_all", "the source listens on all interfaces, and takes lines from whoever sends first"
    NO_SENDER = "no_sender", "nobody sends on a ROS 2 topic that is listened to; it counts once somebody does"
    SOURCE_FAILED = "source_failed", "the source of observations raised; its data are lost, and it is read again"
    OBSERVATIONS_DROPPED = (
        "observations_dropped",
        "more observations came than can be taken in; the oldest are dropped",
    )
    WRONG_CLOCK = "wrong_clock", "capture times look like those of another clock, or in another unit"
    WRONG_UNIT = "wrong_unit", "positions look as if they were in another unit than metres"
    WRONG_AXES = "wrong_axes", "positions look as if they were on other axes than x forward, y left, z up"
    IMPLAUSIBLE_PERSON = (
        "implausible_person",
        "the head is at an unlikely place, or faster than anybody walks; at an impossible place it is dropped",
    )
    LOW_FRAME_RATE = "low_frame_rate", "fewer than six frames a second arrive"
    NEW_ID_EACH_FRAME = "new_id_each_frame", "the tracker gives the person another name at every frame"
    CLOCK_SHIFTED = (
        "clock_shifted",
        "the tracker's clock is ahead, far behind or fast; capture times are shifted by as much as the stream shows",
    )
    GATE_REFUSED = "gate_refused", "the predictor takes a head for a mistaken detection, or for somebody else; not used"
    PERSON_ENTERED = "person_entered", "somebody is seen for the third time, and counts as a person from now on"
    PERSON_RETURNED = "person_returned", "somebody who was gone is back: by name, or where they were expected"
    PERSON_RENAMED = "person_renamed", "the tracker gave a person another name; the person goes on as before"
    ANOTHER_PERSON = "another_person", "an observation of somebody who is not looked at; kept for their track"
    SEEN_TWICE = "seen_twice", "a second detection of a person in one frame; dropped"
    ATTENTION_SWITCHED = "attention_switched", "somebody else is looked at from now on"
    NOBODY_ATTENDED = "nobody_attended", "nobody is there, or nobody whom the policy wants looked at"
    POLICY_FAILED = "policy_failed", "the attention policy raised; who is looked at stays the same"
    ATTENTION_NOT_SENT = "attention_not_sent", "whom the robot looks at could not be sent or written; the run goes on"
    LOOK_AWAY_LEFT_OUT = "look_away_left_out", "a look away cannot be done in its time, or clashes with one; left out"
    CLOCK_STEPPED = "clock_stepped", "the computer's Unix clock was set to another time"


MEANINGS = {event.value: event.meaning for event in Event}
