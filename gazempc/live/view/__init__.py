"""What viewers get of a run while it runs, and files for them afterwards. May import gazempc.live."""
