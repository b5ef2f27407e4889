"""Priorities while commands are sent, where the system allows them."""

import os
import threading

import pytest

from gazempc.live.process import real_time_priority


def policy(thread):
    kind = os.sched_getscheduler(thread) & ~os.SCHED_RESET_ON_FORK
    return kind, os.sched_getparam(thread).sched_priority


def may():
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    except PermissionError:
        return False
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    return True


@pytest.mark.skipif(not may(), reason="real-time priorities are not allowed to this user (limit rtprio)")
def test_the_thread_that_sends_commands_goes_first_and_all_is_as_before_afterwards():
    ended, found = threading.Event(), {}
    other = threading.Thread(target=ended.wait)
    other.start()
    with real_time_priority():
        found |= {"servo": policy(0), "other": policy(other.native_id)}
        later = threading.Thread(target=lambda: found.update(later=policy(0)))
        later.start()
        later.join()
    found |= {"servo after": policy(0), "other after": policy(other.native_id)}
    ended.set()
    other.join()
    usual = (os.SCHED_OTHER, 0)
    assert found == {
        "servo": (os.SCHED_RR, 20),
        "other": (os.SCHED_RR, 10),
        "later": usual,
        "servo after": usual,
        "other after": usual,
    }
