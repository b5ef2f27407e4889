"""Reading of observations and joints outside of the servo thread, as these parts may block."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from gazempc.live.arrivals import Arrivals
from gazempc.loop.boundary import boundary, slow_calls
from gazempc.loop.observer import JointEstimate
from gazempc.loop.recorder import LoopRecorder
from gazempc.loop.track import AroundTarget, Target
from gazempc.robots.robot import Robot
from gazempc.types import FloatArray, JointState, Sighting

# Timeout of a command that waits for a reading in progress; after it the command is sent concurrently.
_PATIENCE_S = 0.012
# Length of the queue of joint states while a part blocks.
_JOINTS_KEPT = 1000


class ArrivingTarget(AroundTarget):
    """A target that polls the sources in the planner's thread.

    Args:
        target: The person to look at.
        arrivals: Polls the sources.

    Attributes:
        finished: Whether the source has ended.
        stopped: Set to end polling.
    """

    def __init__(self, target: Target, arrivals: Arrivals) -> None:
        super().__init__(target)
        self._arrivals = arrivals
        self._joints: deque[tuple[float, JointEstimate]] = deque(maxlen=_JOINTS_KEPT)
        self.finished = self.stopped = False

    def note_joints(self, time_s: float, joints: JointEstimate) -> None:
        """See `Arrivals.note_joints`; may be called by another thread."""
        self._joints.append((time_s, joints))

    def assimilate(self, sightings: Iterable[Sighting], time_s: float, recorder: LoopRecorder) -> None:
        """See `gazempc.loop.track.Target.assimilate`; processes the observations of the sources."""
        if self.stopped:
            return
        while self._joints:
            self._arrivals.note_joints(*self._joints.popleft())
        self._target.assimilate(self._arrivals.take(time_s, recorder), time_s, recorder)
        self.finished = self._arrivals.finished(time_s, recorder)


class ReadAside:
    """A robot whose joints are read in a separate thread, once after each command.

    Calls of the driver are mutually exclusive, except for commands during a reading beyond its timeout.

    Args:
        robot: The robot, connected.
    """

    def __init__(self, robot: Robot) -> None:
        self.wrapped = robot
        self._reading, self._hangs = threading.Lock(), False
        self._wake, self._closed = threading.Event(), False
        self._answer: deque[JointState | BaseException | None] = deque(maxlen=1)
        # A driver that never returns must not keep the process alive.
        self._thread = threading.Thread(target=self._work, name="joints", daemon=True)
        self._thread.start()

    def connect(self) -> None:
        """See `gazempc.robots.robot.Robot.connect`."""
        self.wrapped.connect()

    def read_state(self) -> JointState | None:
        """The reading since the last call; None without one."""
        answer = self._answer.popleft() if self._answer else None
        if isinstance(answer, BaseException):
            raise answer
        return answer

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Exclusive access to the robot, unless a reading is beyond its timeout."""
        free = self._reading.acquire(timeout=0.0 if self._hangs else _PATIENCE_S)
        self._hangs = not free
        try:
            yield
        finally:
            if free:
                self._reading.release()

    def send_command(self, position_rad: FloatArray) -> FloatArray:
        """See `gazempc.robots.robot.Robot.send_command`."""
        try:
            with self.alone():
                return self.wrapped.send_command(position_rad)
        finally:
            self._wake.set()

    def slow_calls(self, ended: bool) -> list[TimeoutError | None]:
        """A slow reading, see `gazempc.loop.boundary.slow_calls`."""
        return slow_calls(self._thread.ident or 0, ended)

    def close(self) -> None:
        """Close the robot; waits only briefly for a reading in progress."""
        self._closed = True
        self._wake.set()
        self._thread.join(timeout=1.0)
        self.wrapped.close()

    def _work(self) -> None:
        while self._wake.wait() and not self._closed:
            self._wake.clear()
            try:
                with self._reading, boundary(self.wrapped, "read_state"):
                    answer: JointState | BaseException | None = self.wrapped.read_state()
            except BaseException as error:
                answer = error
            self._answer.append(answer)
