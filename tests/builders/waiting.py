"""Waiting for conditions in another thread or process."""

import time

from gazempc.errors import RobotError

# Longer than every wait here on a slow, loaded machine: beyond it the program hangs.
FOREVER_S = 240.0


def wait_for(condition, timeout_s=60.0, step=lambda: time.sleep(0.005), why="waited in vain"):
    """The value of a condition once it is true; `why` is the failure message, or a function that returns it."""
    until = time.monotonic() + timeout_s
    while not (found := condition()):
        assert time.monotonic() < until, why() if callable(why) else why
        step()
    return found


def tried(call, *arguments):
    """What a robot's method returns, or the error that it raises."""
    try:
        return call(*arguments)
    except RobotError as error:
        return error
