"""What `python -m gazempc.run --list` prints."""

from __future__ import annotations

from gazempc.neck.spec import load_neck, neck_names
from gazempc.recordings.readers.table import shipped_mappings
from gazempc.recordings.synthetic.everyday import ACTIVITIES, everyday_names
from gazempc.recordings.synthetic.walks import synthetic_names
from gazempc.sim.sensor import load_sensor, sensor_names


def listing() -> str:
    """Recordings, necks and sensors by name, and what else can be replayed.

    Returns:
        Lines of text.
    """
    walks, everyday = synthetic_names(), everyday_names()
    lines = [
        "Recordings (synthetic, generated from the name; 14 people):",
        f"  {walks[0]} ... {walks[-1]}  walks on 6 routes; all: --recordings synthetic",
        "  R1, R2 straight; R3, R4 turn left, right; R5, R6 turn sharply left, right",
        f"  {everyday[0]} ... {everyday[-1]}  5 activities; all: --recordings everyday",
        f"  {', '.join(f'{name} ({about.description})' for name, about in ACTIVITIES.items())}",
        "Recordings of your own, by path:",
        "  .csv, .parquet  columns t, head_{x,y,z}; optional head_q{w,x,y,z}, pelvis_{x,y,z}, pelvis_q{w,x,y,z}",
        "  .csv, .tsv, .txt, .parquet  any other columns, by --reading.columns or --guess; known by themselves:",
        f"    {', '.join(shipped_mappings())}",
        "  .mvnx           Xsens MVN",
        "  a folder        ROS 2 bag, or OpenPose --3d --write_json",
        "  .json           Azure Kinect Body Tracking, offline_processor",
        "  .bvh            motion capture of any exporter",
        "Necks (or a .toml file):",
    ]
    lines += [f"  {name:<14}  {load_neck(name).source}" for name in neck_names()]
    lines.append("Sensors (or a .toml file):")
    lines += [f"  {name:<14}  {load_sensor(name).source}" for name in sensor_names()]
    return "\n".join(lines)
