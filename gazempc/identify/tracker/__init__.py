"""Error model of a tracker, estimated from a recording. May import gazempc.live."""
