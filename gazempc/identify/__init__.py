"""Measuring a neck: excitation, record, fit of dead time and servo. May import live.clock, robots and results."""
