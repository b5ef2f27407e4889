"""Pan and tilt by two Dynamixel motors, from a data sheet, and the cost of a longer dead time, as of a slow bus.

`gazempc identify --new` wrote `dynamixel_pan_tilt.toml` beside this file. With the motors:

    gazempc identify --robot dynamixel --options.dynamixel.port /dev/ttyUSB0 --neck dynamixel_pan_tilt.toml --out mine.toml
    gazempc live --source camera --robot dynamixel --options.dynamixel.port /dev/ttyUSB0 --neck mine.toml
"""

from pathlib import Path

import gazempc as gz

sheet = gz.load_neck(Path(__file__).with_name("dynamixel_pan_tilt.toml"))
for dead_time_s in (0.1, 0.4):
    joints = {name: getattr(sheet, name).model_copy(update={"dead_time_s": dead_time_s}) for name in ("pan", "tilt")}
    neck = sheet.model_copy(update=joints)
    for controller in ("reactive", "mpc"):
        metrics = gz.measure(gz.replay("subject09_R6", neck=neck, controller=controller))
        error_deg, contact = metrics.gaze_error_rms_deg, metrics.eye_contact_2p6
        print(f"dead time {dead_time_s} s, {controller:<8} {error_deg:5.2f} deg, eye contact {contact:4.0%}")

# It prints:
# dead time 0.1 s, reactive  6.20 deg, eye contact  30%
# dead time 0.1 s, mpc       0.76 deg, eye contact 100%
# dead time 0.4 s, reactive 10.72 deg, eye contact  21%
# dead time 0.4 s, mpc       1.86 deg, eye contact  87%
