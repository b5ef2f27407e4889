"""Builders shared by test modules: recordings, necks, live runs with faults."""
