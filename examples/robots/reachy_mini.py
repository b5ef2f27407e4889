"""Reachy Mini, head alone and head with body, while a person turns sharply in front of it.

On the robot, or on the daemon's own simulator (`reachy-mini-daemon --sim --headless --no-media`):

    gazempc live --source camera --mount.on head --robot reachy_mini --neck reachy_mini_body
"""

import gazempc as gz

for neck in ("reachy_mini", "reachy_mini_body"):
    for controller in ("reactive", "mpc"):
        metrics = gz.measure(gz.replay("subject09_R6", neck=neck, controller=controller))
        print(
            f"{neck:<17}{controller:<9} {metrics.gaze_error_rms_deg:.2f} deg, "
            f"eye contact {metrics.eye_contact_2p6:4.0%}, {metrics.rms_acceleration_rad_s2:.2f} rad/s²"
        )

# It prints:
# reachy_mini      reactive  4.26 deg, eye contact  39%, 0.54 rad/s²
# reachy_mini      mpc       0.53 deg, eye contact 100%, 0.66 rad/s²
# reachy_mini_body reactive  1.63 deg, eye contact  89%, 0.92 rad/s²
# reachy_mini_body mpc       0.51 deg, eye contact 100%, 0.65 rad/s²
