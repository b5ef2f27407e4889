"""Fetch: pan and tilt of the head, with the geometry and speeds of its URDF, while a person walks past and turns.

On the robot, with a ROS4HRI tracker and ros2_control; Fetch's tilt is positive down:

    gazempc live --source ros4hri --options.ros2.base-frame torso_lift_link --robot ros2 --neck fetch \
        --options.ros2.joint-names head_pan_joint head_tilt_joint --options.ros2.joint-signs 1 -1
"""

import gazempc as gz

neck = gz.load_neck("fetch")
print(f"dead time {neck.pan.dead_time_s:.1f} s, lag {neck.servo_lag_s[0]:.2f} s")
for controller in ("reactive", "mpc"):
    metrics = gz.measure(gz.replay("subject03_R4", neck=neck, controller=controller))
    print(f"{controller:<9} {metrics.gaze_error_rms_deg:.2f} deg, eye contact {metrics.eye_contact_2p6:4.0%}")

# It prints:
# dead time 0.1 s, lag 0.15 s
# reactive  6.95 deg, eye contact  28%
# mpc       0.51 deg, eye contact 100%
