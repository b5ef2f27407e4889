"""The receptionist on two recordings, or on a ROS 2 bag, in ten lines."""

import sys

import gazempc as gz
from gazempc.results.attention import measure_attention

# Recordings to replay together, or the folder of a bag with several people.
recording = sys.argv[1] if len(sys.argv) > 1 else "subject03_R4+subject05_R1"
log = gz.replay(recording, attend="engaged", look_away={"rhythm": "listening", "seed": 2})

for start_s, person, why in zip(log.attended_time_s, log.attended_person, log.attended_why, strict=True):
    print(f"{start_s:.1f} s: person {person} ({why})")
found = measure_attention(log)
print(f"contact with them {found.contact_attended:.0%} of the time, {found.switches_per_minute:.0f} switches a minute")

# It prints:
# 0.1 s: person 2 (policy)
# 1.8 s: person 1 (policy)
# contact with them 72% of the time, 13 switches a minute
