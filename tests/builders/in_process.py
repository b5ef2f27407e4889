"""Workers in the process of the test: a worker process of its own takes seconds to start."""

import pickle
from contextlib import contextmanager

import pytest

from experiments.engine.job import carry_out
from experiments.engine.keys import program_hash


class InThisProcess:
    """Does each job at once. Jobs and results are pickled on the way, as they are for a worker process."""

    at_once = 1

    def __init__(self, count):
        assert count >= 1

    def submit(self, key, job, ended):
        row = pickle.dumps(carry_out(pickle.loads(pickle.dumps(job)), key, program_hash()))
        ended(key, lambda: pickle.loads(row))

    def stop(self):
        """There is nothing to end."""


@contextmanager
def workers_in_this_process():
    """Commands that begin in here start no worker process; `tests/experiments/engine` tests those."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("experiments.engine.engine.LocalWorkers", InThisProcess)
        yield
