"""Compare controllers over some walks, in ten lines. Many walks: `python -m experiments.compare`."""

import numpy as np

import gazempc as gz

WALKS = ["subject01_R1", "subject04_R4", "subject09_R6"]

for controller in ("reactive", "lookahead", "mpc", "perfect"):
    metrics = [gz.measure(gz.replay(walk, controller=controller)) for walk in WALKS]
    errors_deg = [each.gaze_error_rms_deg for each in metrics]
    contact = np.mean([each.eye_contact_2p6 for each in metrics])
    shown = ", ".join(f"{error_deg:5.2f}" for error_deg in errors_deg)
    print(f"{controller:<9} {shown}  mean {np.mean(errors_deg):5.2f} deg, eye contact {contact:4.0%}")

# It prints:
# reactive   9.89, 11.39, 10.69  mean 10.65 deg, eye contact  14%
# lookahead  0.35,  2.35,  1.82  mean  1.50 deg, eye contact  90%
# mpc        0.39,  2.36,  1.80  mean  1.51 deg, eye contact  91%
# perfect    0.09,  0.11,  0.12  mean  0.11 deg, eye contact 100%
