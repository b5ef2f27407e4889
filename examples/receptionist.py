"""A receptionist with two visitors: it looks at the engaged one, and averts its gaze while it thinks."""

import math
import threading
import time

import gazempc as gz

# MuJoCo (extra `mujoco`), "simulated" without extras, or the name of your robot, with your neck file.
ROBOT = "mujoco"
FACING = [0.0, 0.0, 0.0, 1.0]  # w, x, y, z: turned towards the robot


def visitors(seconds):
    """Simulated face tracker: Anna waits and looks around, Bob comes to the desk."""
    start_s = time.time()
    while (since_s := time.time() - start_s) < seconds:
        anna = (2.2, 1.0 + 0.02 * math.sin(since_s), 0.3)
        bob = (max(3.5 - 0.9 * since_s, 1.3), -0.5, 0.4)
        yield time.time() - 0.05, {"anna": anna, "bob": bob}
        time.sleep(1 / 30)


attention = {"hysteresis_s": 0.3, "dwell_s": 1.0}
with gz.Gaze("reference", ROBOT, attend="engaged", attention=attention, look_away={"rhythm": "listening"}) as gaze:
    # After a question by Bob: think, then answer.
    threading.Timer(3.0, lambda: (gaze.think(1.2), gaze.look_away("speaking"))).start()
    for time_s, heads_m in visitors(seconds=6.0):
        for name, head_m in heads_m.items():
            gaze.see(time_s, head_m, head_quat_wxyz=FACING, person_id=name)

log = gaze.log()
first, then, *_ = log.attended_person.tolist()
print(f"looked at first: person {first}, then person {then}")
print(f"it looked away to think: {'thinking' in log.away_why}")
print(f"limit violations: {gz.measure(log).limit_violations}")

# It prints:
# looked at first: person 1, then person 2
# it looked away to think: True
# limit violations: 0
