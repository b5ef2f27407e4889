"""Process set-up of a live run: signals, priorities, thread switching, warnings; a predictor in a child process."""

from __future__ import annotations

import _thread
import contextlib
import gc
import logging
import multiprocessing
import os
import pickle
import queue
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from logging.handlers import QueueHandler, QueueListener
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from types import FrameType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # the process begins with this module, before slow imports
    from numpy.typing import ArrayLike

    from predictors import Forecast, HeadObservation, Predictor

# Switch interval of threads: bounds the delay of a tick by other threads.
_SWITCH_S = 0.0005
# Real-time priorities: of the servo thread, and of threads that may hold a lock it needs.
_SERVO, _OTHER_THREADS = 20, 10
# Niceness of child processes: commands have precedence.
_NICE = 5


@contextmanager
def stopped_by_signals(stop: threading.Event) -> Iterator[None]:
    """SIGINT, SIGTERM and SIGHUP set the event instead of ending the process; the third one ends it.

    Args:
        stop: The event.
    """
    times = 0

    def handle(number: int, frame: FrameType | None) -> None:
        nonlocal times
        times += 1
        # A handler interrupts the main thread anywhere, so also in `stop.set`, whose lock is not reentrant: it takes no
        # lock itself, nor does it start a `threading.Thread`, which takes one.
        _thread.start_new_thread(stop.set, ())
        if times == 2:
            # The third signal is for a driver that hangs.
            for each in before:
                signal.signal(each, signal.SIG_DFL)

    is_main = threading.current_thread() is threading.main_thread()
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP) if is_main else ()
    before = {number: signal.signal(number, handle) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def fast_switching() -> Iterator[None]:
    """Thread switch interval of a tenth of the default."""
    before_s = sys.getswitchinterval()
    sys.setswitchinterval(_SWITCH_S)
    try:
        yield
    finally:
        sys.setswitchinterval(before_s)


@contextmanager
def without_collection() -> Iterator[None]:
    """Disable the cyclic garbage collector, which takes many ticks; reference counting frees a run's objects.

    Objects frozen by the program before are frozen again afterwards.
    """
    gc.collect()
    frozen_before = gc.get_freeze_count() > 0
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
        if not frozen_before:
            gc.unfreeze()


@contextmanager
def real_time_priority() -> Iterator[None]:
    """Real-time priority of the calling thread, which sends commands, if the system permits it.

    If it is the main thread, also of all other threads, against priority inversion: a thread that holds the interpreter
    lock must not wait for a processor.
    """
    mine = threading.get_native_id()
    whole = threading.current_thread() is threading.main_thread()
    threads = {each.native_id for each in threading.enumerate() if each.native_id} if whole else {mine}
    before = {}
    # Requires Linux, and root or an rtprio limit; threads may have ended.
    with contextlib.suppress(AttributeError, PermissionError):
        for thread in sorted(threads):
            with contextlib.suppress(ProcessLookupError):
                known = os.sched_getscheduler(thread), os.sched_getparam(thread)
                urgent = os.sched_param(_SERVO if thread == mine else _OTHER_THREADS)
                os.sched_setscheduler(thread, os.SCHED_RR | os.SCHED_RESET_ON_FORK, urgent)
                before[thread] = known
    try:
        yield
    finally:
        for thread, known in before.items():
            with contextlib.suppress(PermissionError, ProcessLookupError):
                os.sched_setscheduler(thread, *known)


def before_other_programs() -> None:
    """Real-time priority of this thread and all threads that it starts later, if the system permits it.

    For a dedicated process: the middleware of ROS 2 receives and sends in its own threads.
    """
    with contextlib.suppress(AttributeError, PermissionError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(_OTHER_THREADS))


def start_child(name: str, target: Callable[..., None], *given: Any) -> tuple[SpawnProcess, Connection]:
    """Start a child process of lower priority that ignores Ctrl-C and ends with the run.

    Args:
        name: Its name.
        target: Its function; called with its end of a pipe and the given arguments.
        given: Arguments; they are pickled.

    Returns:
        The process, and the run's end of the pipe.
    """
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_at_lower_priority, args=(target, theirs, *given), name=name, daemon=True)
    process.start()
    theirs.close()
    return process, ours


def _at_lower_priority(target: Callable[..., None], *given: Any) -> None:
    # Ctrl-C is handled by the parent, which brakes the neck before ending this process.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with contextlib.suppress(AttributeError, PermissionError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    with contextlib.suppress(AttributeError):
        os.nice(_NICE)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    target(*given)


def _end_with_parent() -> None:
    """End this process with its parent, also after a kill; else it would hold a camera or a port."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(0)


class IsolatedPredictor:
    """Proxy of a predictor in another process; waits for replies without the lock.

    Args:
        make: Factory of the predictor; can be pickled.

    Attributes:
        rejections_in_a_row: The predictor's attribute after the last call.
    """

    def __init__(self, make: Callable[[], Predictor]) -> None:
        self.rejections_in_a_row = 0
        # The process ends with this one, or when this end of the pipe is closed.
        _, self._line = start_child("predictor", _serve, make)
        self.reset()

    def _ask(self, method: str, *args: Any) -> Any:
        self._line.send((method, args))
        answer, self.rejections_in_a_row = self._line.recv()
        if isinstance(answer, BaseException):
            raise answer
        return answer

    def reset(self) -> None:
        """See `predictors.predictor.Predictor.reset`."""
        self._ask("reset")

    def update(self, observation: HeadObservation) -> None:
        """See `predictors.predictor.Predictor.update`."""
        self._ask("update", observation)

    def forecast(self, times_s: ArrayLike) -> Forecast:
        """See `predictors.predictor.Predictor.forecast`."""
        found: Forecast = self._ask("forecast", times_s)
        return found


def _serve(line: Connection, make: Callable[[], Predictor]) -> None:
    predictor = make()
    with contextlib.suppress(EOFError):  # the run has ended
        while True:
            method, args = line.recv()
            try:
                answer = getattr(predictor, method)(*args)
            except BaseException as error:  # also of sys.exit
                answer = error
            if isinstance(answer, BaseException) and not _is_sendable(answer):
                answer = RuntimeError(f"{type(answer).__name__}: {answer}")
            line.send((answer, getattr(predictor, "rejections_in_a_row", 0)))


def _is_sendable(error: BaseException) -> bool:
    """Whether a copy by pickle is of the same class: not with a lock, or with further arguments of its own."""
    with contextlib.suppress(Exception):
        return type(pickle.loads(pickle.dumps(error))) is type(error)
    return False


_LOGGERS = ("gazempc.live", "gazempc.loop")


class _Unformatted(QueueHandler):
    """Passes on unformatted records: formatting a traceback reads source files, tens of milliseconds."""

    def prepare(self, record: logging.LogRecord) -> logging.LogRecord:
        """See `logging.handlers.QueueHandler.prepare`."""
        return record


@contextmanager
def async_warnings() -> Iterator[None]:
    """Write warnings to standard error in a separate thread."""
    written = logging.StreamHandler()
    written.setFormatter(logging.Formatter("gazempc.live: WARNING %(message)s"))
    waiting: queue.SimpleQueue[logging.LogRecord] = queue.SimpleQueue()
    listener, aside = QueueListener(waiting, written), _Unformatted(waiting)
    listener.start()
    loggers = [logging.getLogger(name) for name in _LOGGERS]
    for logger in loggers:
        logger.addHandler(aside)
    try:
        yield
    finally:
        for logger in loggers:
            logger.removeHandler(aside)
        listener.stop()
