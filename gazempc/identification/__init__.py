"""Identify a neck: excite it, record what it does, and estimate dead time and servo of each axis."""

from gazempc.identification.estimate import AxisEstimate, Interval, estimate_axis
from gazempc.identification.excitation import Excitation, ExcitationSettings, excite
from gazempc.identification.latency import LatencyEstimate, estimate_latency
from gazempc.identification.recording import IdentificationError, NeckRecord, load_record, record

__all__ = [
    "AxisEstimate",
    "Excitation",
    "ExcitationSettings",
    "IdentificationError",
    "Interval",
    "LatencyEstimate",
    "NeckRecord",
    "estimate_axis",
    "estimate_latency",
    "excite",
    "load_record",
    "record",
]
