"""A neck with reduced range and speed for a run."""

from __future__ import annotations

from gazempc.errors import SettingsError
from gazempc.neck.picture import FramedPicture, Framing
from gazempc.neck.spec import Axis, NeckSpec

# Least and greatest pan, least and greatest tilt of the gaze, degrees.
Region = tuple[float, float, float, float]
# Kinematic chains of the gaze: about the vertical, and up or down.
_CHAINS = (("pan", "eye_pan", "body_yaw"), ("tilt", "eye_tilt"))


def narrowed(
    neck: NeckSpec, gaze_region_deg: Region | None, speed_max_rad_s: float | None, framing: Framing | None = None
) -> NeckSpec:
    """Narrow a neck's limits, for controllers, smoother and robot.

    The region is distributed over the joints of a chain in proportion to their ranges, so that the sum of their angles
    is always in the region.

    Args:
        neck: The neck.
        gaze_region_deg: Least and greatest pan, least and greatest tilt of the gaze, degrees; None for all.
        speed_max_rad_s: Greatest speed of each joint, rad/s; None for the joint's own.
        framing: Limits of acceleration and jerk.

    Returns:
        The neck with all these limits.

    Raises:
        SettingsError: If the region is out of the neck's range.
    """
    picture = None if framing is None else FramedPicture.of(framing, neck)
    neck = neck if picture is None else picture.calmed(neck)
    axes = dict(zip(neck.joint_names, neck.axes, strict=True))
    if speed_max_rad_s is not None:
        for name, axis in axes.items():
            speeds = {"velocity_max_rad_s": min(axis.velocity_max_rad_s, speed_max_rad_s)}
            axes[name] = axis.model_copy(update={**speeds, "full_speed_rad_s": axis.full_rad_s})
    if gaze_region_deg is not None:
        for chain, low_deg, high_deg in zip(_CHAINS, gaze_region_deg[::2], gaze_region_deg[1::2], strict=True):
            joints = {name: axes[name] for name in chain if name in axes}
            axes |= _within(joints, low_deg, high_deg, f"neck {neck.name!r}, {chain[0]} of the gaze")
    return neck.with_axes(axes)


def _within(joints: dict[str, Axis], low_deg: float, high_deg: float, what: str) -> dict[str, Axis]:
    least_deg = sum(axis.position_min_deg for axis in joints.values())
    most_deg = sum(axis.position_max_deg for axis in joints.values())
    low_deg, high_deg = max(low_deg, least_deg), min(high_deg, most_deg)
    if low_deg >= high_deg:
        accepted = f"a region within {least_deg:g} to {most_deg:g}, least before greatest"
        raise SettingsError(
            f"loop.gaze_region_deg: {what} would be {low_deg:g} to {high_deg:g} deg; accepted: {accepted}"
        )

    def part(axis: Axis, share: float) -> float:
        return axis.position_min_deg + share * (axis.position_max_deg - axis.position_min_deg)

    # Shares of the common range: the limits of all joints add up to those of the region.
    low, high = ((end - least_deg) / (most_deg - least_deg) for end in (low_deg, high_deg))
    return {
        name: axis.model_copy(update={"position_min_deg": part(axis, low), "position_max_deg": part(axis, high)})
        for name, axis in joints.items()
    }
