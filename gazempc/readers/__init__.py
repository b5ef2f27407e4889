"""Readers of recordings, one module a file format; all return a `gazempc.recording.Recording`."""
