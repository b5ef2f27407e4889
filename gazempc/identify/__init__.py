"""System identification of a neck: excitation, record, fit of dead time and servo. May import gazempc.live."""
