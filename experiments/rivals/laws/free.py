"""Constants that a law leaves to its user, and the values that are tried: a rival is shown with the best of them."""

from __future__ import annotations

# What stands for "full speed" in a law that answers -1 to 1, over the top speed of the neck; faster is cut to that.
_SPEED_SCALES = (0.5, 1.0, 2.0, 4.0, 8.0)
# OP3's own computer decides how many frames a second it looks at; PR2's user writes the duration into the goal.
_DETECTION_PERIODS_S = (1.0 / 30.0, 0.1, 0.2, 0.4)
_MIN_DURATIONS_S = (0.1, 0.2, 0.5, 1.0)
# Textbooks leave both to the reader.
_GAINS, _ALPHAS = (0.5, 1.0), (0.1, 0.2, 0.3, 0.5, 0.8)

FREE: dict[str, tuple[dict[str, float], ...]] = {
    "autoptz": tuple({"speed_scale": scale} for scale in _SPEED_SCALES),
    "obs_face_tracker": tuple({"speed_scale": scale} for scale in _SPEED_SCALES),
    "op3": tuple({"detection_period_s": period_s} for period_s in _DETECTION_PERIODS_S),
    "pr2_point_head": tuple({"min_duration_s": duration_s} for duration_s in _MIN_DURATIONS_S),
    "smith": tuple({"gain": gain} for gain in _GAINS),
    "smith_feedforward": tuple({"gain": gain, "alpha": alpha} for gain in _GAINS for alpha in _ALPHAS),
}
