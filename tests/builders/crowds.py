"""Several people who are seen at once."""

import numpy as np

from gazempc.people.people import People
from predictors import ConstantVelocity, HeadObservation

FRAME_S = 1.0 / 30.0


def people(coast_s=1.0):
    return People(ConstantVelocity, coast_s)


def straight(start_m, velocity_m_s, at_s):
    """Positions on a straight walk."""
    return np.asarray(start_m) + np.asarray(at_s)[..., None] * np.asarray(velocity_m_s)


def frame(time_s, positions_m, names=None, noise_m=0.0, rng=None):
    """Detections of one instant; None is a person out of sight."""
    names = names or [None] * len(positions_m)
    noise = np.zeros(3) if rng is None else noise_m * rng.standard_normal(3)
    return [
        HeadObservation(time_s, np.asarray(where) + noise, person_id=name)
        for where, name in zip(positions_m, names, strict=True)
        if where is not None
    ]


def shown(crowd, frames):
    """Show frames; gives what became of each detection, a list a frame."""
    return [crowd.see(each) for each in frames]


def stand(crowd, places_m, seconds=0.5, names=None, from_s=0.0):
    """Show people who stand; gives the time of the last frame."""
    for k in range(round(seconds / FRAME_S)):
        crowd.see(frame(from_s + k * FRAME_S, places_m, names))
    return from_s + (round(seconds / FRAME_S) - 1) * FRAME_S


def numbers_at(crowd, time_s):
    return [state.number for state in crowd.present(time_s)]
