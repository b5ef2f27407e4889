"""Fault injection in live runs: attacks, tracker faults and faulty parts. May import gazempc."""
