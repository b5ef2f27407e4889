"""Unusual events of a run, with their names in the log."""

from __future__ import annotations

from enum import StrEnum


class Event(StrEnum):
    """An event of the loop: the value is the name in the log, `meaning` a description."""

    meaning: str

    def __new__(cls, value: str, meaning: str) -> Event:
        """Make a member from its name and meaning."""
        member = str.__new__(cls, value)
        member._value_ = value
        member.meaning = meaning
        return member

    NO_OBSERVATION_YET = "no_observation_yet", "no person has been observed yet; the neck holds still"
    OUT_OF_ORDER = "out_of_order", "an observation was not newer than the last one; dropped"
    STALE_OBSERVATION = "stale_observation", "an observation was older than `stale_after_s` on arrival; dropped"
    FUTURE_OBSERVATION = "future_observation", "a capture time is in the future, so a clock is wrong; dropped"
    TRACKER_FROZEN = "tracker_frozen", "a walking person's position stayed exactly equal for 0.5 s; not used"
    ORIENTATION_JUMPED = "orientation_jumped", "yaw of head or pelvis changed by over 90 degrees in a frame; not used"
    FORECAST_FAILED = (
        "forecast_failed",
        "the predictor raised an exception, or its forecast has a NaN, a wrong shape or a head over 1 km away; "
        "the last plan is used further",
    )
    CONTROLLER_FAILED = (
        "controller_failed",
        "the controller raised an exception, or returned no plan of this neck; the last plan is used further",
    )
    FORECAST_OUT_OF_REACH = (
        "forecast_out_of_reach",
        "the forecast is farther from the last position than 0.3 m and 3 m/s, or with a camera farther outside the "
        "picture than half of it; it is cut there",
    )
    SOLVER_FAILED = "solver_failed", "the controller's problem has no solution; the last plan is used further"
    PLAN_NOT_FINITE = "plan_not_finite", "the plan has a NaN; the last plan is used further"
    PLAN_OUT_OF_RANGE = (
        "plan_out_of_range",
        "the plan has an angle beyond two turns or a velocity over 1000 rad/s; the last plan is used further",
    )
    LISTENER_FAILED = "listener_failed", "a listener raised an exception; it gets no more moments"
    PART_SLOW = "part_slow", "a call of a part takes over 0.1 s; the last plan is followed, then the neck brakes"
    LATE_PLAN = (
        "late_plan",
        "a plan came after its first tick (its remaining part is used), or the planner was still busy (no new plan "
        "was requested)",
    )
    SOLVER_GAVE_UP = (
        "solver_gave_up",
        "the solver was stopped; the plan is the best one without limits, and the smoother keeps the limits",
    )
    LIMITS_SOFTENED = (
        "limits_softened",
        "no plan keeps all limits (for example, the start is outside them); this plan violates them least",
    )
    OWN_ROW_SOFTENED = (
        "own_row_softened",
        "no plan keeps all rows that you added to the MPC (`--mpc.rows`) and all limits; this plan violates them least",
    )
    STALE_PLAN = "stale_plan", "the last plan has ended; the smoother stops the command"
    LIMIT_GUARD = "limit_guard", "the smoother refused a motion that could not stop inside the position limits"
    TARGET_LOST = "target_lost", "no observation for `lost_after_s`; the neck stops"
    RETURN_TO_REST = "return_to_rest", "no observation for `rest_after_s`; the neck slowly returns to rest"
    JOINT_READING_REFUSED = (
        "joint_reading_refused",
        "a reading of the joints was NaN, too old, too fast or far from any possible position; not used",
    )
    JOINT_NOT_FOLLOWING = (
        "joint_not_following",
        "a joint does not move although its commands do; of a neck with eyes or body the other joints replace it",
    )
    JOINT_OFF_COMMAND = (
        "joint_off_command",
        "a joint stands 10 degrees or more from where its commands lead: its encoder drifts or it is blocked",
    )
    EYES_AT_LIMIT = "eyes_at_limit", "the eyes are at their limit while the head still moves"
    ROBOT_NOT_ANSWERING = (
        "robot_not_answering",
        "the joints could not be read (plans use the sent commands), or a command was not acknowledged (after three, "
        "the neck brakes and returns slowly to the last acknowledged one)",
    )
    BAD_OBSERVATION = "bad_observation", "a source received data that are not an observation; dropped"
    SENDER_REFUSED = "sender_refused", "a line of a sender that is not allowed or not the current one; dropped"
    OPEN_TO_ALL = "open_to_all", "the source listens beyond the loopback: who reaches the port may send"
    NO_SENDER = "no_sender", "a subscribed ROS 2 topic has no sender"
    STREAM_FROZEN = "stream_frozen", "no picture of a network camera for 2 s, or an equal one for 1 s; not used"
    STREAM_LAGS = (
        "stream_lags",
        "the pictures of a network camera come more and more late by their time stamps; the stream is opened again",
    )
    SEVERAL_SENDERS = "several_senders", "several nodes send on one ROS 2 topic"
    SOURCE_FAILED = "source_failed", "the source of observations raised an exception; it is read again at the next tick"
    OBSERVATIONS_DROPPED = "observations_dropped", "too many observations came at once; the oldest are dropped"
    WRONG_CLOCK = "wrong_clock", "capture times seem to be of another clock, or in another unit"
    WRONG_UNIT = "wrong_unit", "positions seem to be in another unit than metres"
    WRONG_AXES = "wrong_axes", "positions seem to have other axes than x forward, y left, z up"
    IMPLAUSIBLE_PERSON = (
        "implausible_person",
        "the head is at an unlikely place, or faster than a walking person; at an impossible place it is dropped",
    )
    LOW_FRAME_RATE = "low_frame_rate", "fewer than six frames a second arrive"
    NEW_ID_EACH_FRAME = "new_id_each_frame", "the tracker gives the person a new name in every frame"
    CLOCK_SHIFTED = "clock_shifted", "the tracker's clock is ahead, far behind or fast; corrected"
    GATE_REFUSED = "gate_refused", "the predictor's gate refused an observation as a false detection or another person"
    PERSON_ENTERED = "person_entered", "a new person was detected three times, and is tracked from now on"
    PERSON_RETURNED = "person_returned", "a person is back, with the same name or at the expected place"
    PERSON_RENAMED = "person_renamed", "the tracker gave a person another name; gazempc keeps the person"
    ANOTHER_PERSON = "another_person", "an observation of a person who is not attended; used for their track"
    SEEN_TWICE = "seen_twice", "a second detection of a person in one frame; dropped"
    ATTENTION_SWITCHED = "attention_switched", "the robot now looks at another person"
    NO_PERSON_ATTENDED = "no_person_attended", "no person is tracked, or the policy chooses none"
    POLICY_FAILED = "policy_failed", "the attention policy raised an exception; the robot looks at the same person"
    ATTENTION_NOT_SENT = "attention_not_sent", "a report of the attended person could not be sent; the run goes on"
    LOOK_AWAY_LEFT_OUT = "look_away_left_out", "a look away cannot be done in time, or overlaps another; skipped"
    CLOCK_STEPPED = "clock_stepped", "the computer's Unix clock was set to another time"


MEANINGS = {event.value: event.meaning for event in Event}
