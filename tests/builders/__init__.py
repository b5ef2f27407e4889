"""What several test modules build: recordings, necks, live runs with faults. One builder for each thing."""
