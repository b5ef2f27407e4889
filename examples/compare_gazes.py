"""Compare controllers on two walks, in ten lines; `python -m experiments.compare` is for many walks."""

import numpy as np

import gazempc as gz

WALKS = ["subject01_R1", "subject04_R4"]

for controller in ("reactive", "lookahead", "mpc", "mpc+perfect"):
    metrics = [gz.measure(gz.replay(walk, controller=controller)) for walk in WALKS]
    errors_deg = [each.gaze_error_rms_deg for each in metrics]
    contact = np.mean([each.eye_contact_2p6 for each in metrics])
    shown = ", ".join(f"{error_deg:5.2f}" for error_deg in errors_deg)
    print(f"{controller:<11} {shown}  mean {np.mean(errors_deg):5.2f} deg, eye contact {contact:4.0%}")

# It prints:
# reactive     9.89, 11.39  mean 10.64 deg, eye contact  11%
# lookahead    0.32,  2.72  mean  1.52 deg, eye contact  91%
# mpc          0.37,  2.52  mean  1.45 deg, eye contact  92%
# mpc+perfect  0.09,  0.11  mean  0.10 deg, eye contact 100%
