"""An exception of a part becomes an error that names its class; only Ctrl-C propagates, to the main thread."""

import threading

import pytest

from gazempc.loop.boundary import PartError, boundary


class Part:
    """A part."""


def raised_at_the_boundary(error):
    try:
        with boundary(Part(), "plan"):
            raise error
    except BaseException as found:
        return found


@pytest.mark.parametrize("error", [ValueError("x"), SystemExit("x"), KeyboardInterrupt("x"), GeneratorExit("x")])
def test_an_exception_in_a_thread_names_its_part(error):
    found = []
    thread = threading.Thread(target=lambda: found.append(raised_at_the_boundary(error)))
    thread.start()
    thread.join()
    assert isinstance(found[0], PartError)
    assert "Part.plan()" in str(found[0])


def test_an_interrupt_of_the_main_thread_propagates():
    assert isinstance(raised_at_the_boundary(KeyboardInterrupt()), KeyboardInterrupt)
