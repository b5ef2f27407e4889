"""Workers in the process of the test: a worker process of its own takes seconds to start."""

import pickle
from contextlib import contextmanager

import pytest

from experiments.engine.job import carry_out, program_hash


def in_this_process(jobs, count):
    """Do each job at once. Jobs and results are pickled on the way, as they are for a worker process."""
    assert count >= 1
    for key, job in jobs.items():
        row = carry_out(pickle.loads(pickle.dumps(job)), key, program_hash())
        yield key, pickle.loads(pickle.dumps(row))


@contextmanager
def workers_in_this_process():
    """Commands that begin in here start no worker process; `tests/experiments/engine` tests those."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("experiments.engine.engine.on_this_machine", in_this_process)
        yield
