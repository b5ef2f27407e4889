"""A log as an MCAP file: channels for viewers, and the whole log, exact to the last bit, as an attachment.

Written with foxglove-sdk, read with the `mcap` library; both are in the extra ``view``.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

import numpy as np

from gazempc.errors import importing
from gazempc.files.whole import whole
from gazempc.results.log import Log
from gazempc.results.moments import AttendedMoment, EventMoment, Moment, PlanMoment, SeenMoment, TickMoment
from gazempc.types import JointState

_Timed = AttendedMoment | SeenMoment | EventMoment | PlanMoment | TickMoment


def write_mcap(log: Log, path: Path | str, plans: Sequence[PlanMoment] = ()) -> None:
    """Write a log as MCAP.

    The channels are those of `gazempc.results.mcap_channels.Channels`. A log has neither plans, lateness nor pictures.

    Args:
        log: The log.
        path: File to write; an existing one is replaced.
        plans: The plans of the run, if available.

    Raises:
        MissingOptionalDependencyError: If a package is missing.
        SettingsError: If the file cannot be written.
    """
    with importing("writing MCAP files", "foxglove-sdk", "view"):
        from gazempc.results.mcap_channels import Channels, McapWriter  # noqa: PLC0415
    buffer = io.BytesIO()
    log.save(buffer)
    with whole(Path(path)) as part, closing(McapWriter(log.run, part)) as writer:
        channels = Channels(log.run, writer.context)
        for moment in moments_of(log, plans):
            channels.write(moment)
        writer.attach(buffer.getvalue())


def moments_of(log: Log, plans: Sequence[PlanMoment] = ()) -> Sequence[Moment]:
    """Moments of a run, from its log.

    Args:
        log: The log. Plans, lateness and pictures are not in it.
        plans: The plans of the run in temporal order, if available.

    Returns:
        The moments in temporal order.
    """
    texts = {fault.event: fault.line for fault in log.faults}
    rows = zip(log.attended_time_s.tolist(), log.attended_person.tolist(), log.attended_why.tolist(), strict=True)
    found: list[_Timed] = [AttendedMoment(*row) for row in rows]
    for k, time_s in enumerate(log.arrival_time_s.tolist()):
        forecast = log.forecast_mean_base_m[k], log.forecast_covariance_m2[k], float(log.forecast_degrees_of_freedom[k])
        observed = float(log.capture_time_s[k]), log.head_observed_base_m[k], None, str(log.person_id[k])
        found.append(SeenMoment(time_s, *observed, *forecast, log.forecast_true_base_m[k]))
    events = zip(log.event_time_s.tolist(), log.event_name.tolist(), strict=True)
    found += [EventMoment(time_s, name, texts.get(name, name)) for time_s, name in events]
    found += plans
    commands = np.stack([log.command_position_rad, log.command_velocity_rad_s, log.command_acceleration_rad_s2], axis=2)
    for k, (time_s, motions) in enumerate(zip(log.time_s.tolist(), commands.tolist(), strict=True)):
        joints = JointState(float(log.joint_time_s[k]), log.joint_position_rad[k], log.joint_velocity_rad_s[k])
        known = joints if np.isfinite(joints.position_rad).all() else None
        sent = tuple(map(tuple, motions))
        found.append(TickMoment(time_s, known, log.command_position_rad[k], sent, log.head_true_base_m[k]))
    # Stable: of one time, a tick comes last.
    return sorted(found, key=lambda each: each.time_s)
