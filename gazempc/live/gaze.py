"""Python interface of live runs: a program with a tracker drives a neck."""

from __future__ import annotations

import math
import threading
import warnings
from contextlib import closing
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Unpack

import numpy as np

from gazempc.controllers.controller import Controller
from gazempc.live.mount import placed
from gazempc.live.process import fast_switching
from gazempc.live.run import Listener, LiveRun
from gazempc.live.setup import setup_of_gaze
from gazempc.live.sources.pushed import Stated, checked
from gazempc.loop.looking_away import LookingAway
from gazempc.loop.observer import JointEstimate
from gazempc.loop.pointing import Place
from gazempc.neck.kinematics import gaze_ray
from gazempc.neck.spec import NeckSpec
from gazempc.people.attention import Attended
from gazempc.people.company import Choice, Glance, Rhythm, Sound, Speech, Thinking
from gazempc.results.log import ComputeTimes, Fault, Log, join_logs
from gazempc.robots.robot import Robot
from gazempc.settings import DEFAULT_PREDICTOR, LookAwayMode
from gazempc.types import FloatArray
from predictors import Predictor


class Gaze:
    """Looks at the person observed by a program.

        with gz.Gaze("my_neck.toml", MyRobot()) as gaze:
            for frame in tracker:
                gaze.see(frame.time_s, frame.head_m)

    The with-block owns a thread that sends commands within the neck's limits, at its servo rate. At the end of the
    block, also after an exception, the neck is braked within its limits and the robot is closed. A Gaze is used once.

    Exceptions of the thread are raised by the next `see`, or at the end of the block, after the neck was braked.
    Exceptions of robot, predictor and controller become events: see `events` and `faults`.

    Args:
        neck: Name of a shipped neck, path of a TOML file, or a neck.
        robot: A robot (`gazempc.robots.robot.Robot`; it stamps its joints with `time.monotonic`), a shipped name, or
            ``module:Class``. Inside the block one thread sends, another one reads; never both at once, unless a
            reading takes longer than 12 ms.
        controller: ``mpc``, ``lookahead``, ``reactive``, ``module:Class``, or a controller.
        predictor: Name, ``module:Class``, or a predictor.
        listener: Gets each moment of the run (`gazempc.results.moments`) in the servo thread; must return at once.
        **settings: Any other of `gazempc.live.setup.LiveGazeSettings`: ``clock="monotonic"``,
            ``mount={"on": "head"}``, ``mpc={"horizon_s": 0.6}``, ``loop={"lost_after_s": 2.0}``, or
            ``options={"port": "/dev/ttyUSB1"}`` for the constructor of a ``module:Class``.

    Attributes:
        settings: The checked settings.

    Raises:
        GazempcError: If a name does not exist, a file or setting is wrong, or a part violates its interface.
    """

    def __init__(
        self,
        neck: str | Path | NeckSpec,
        robot: str | Robot,
        *,
        controller: str | Controller = "mpc",
        predictor: str | Predictor = DEFAULT_PREDICTOR,
        listener: Listener | None = None,
        **settings: Any,
    ) -> None:
        self._setup, self._source, self.settings = setup_of_gaze(neck, robot, controller, predictor, settings)
        self._listeners = () if listener is None else (listener,)
        self._kept: tuple[Log, ...] = ()
        self._run: LiveRun | None = None
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._failure: BaseException | None = None
        self._warned = 0

    def __enter__(self) -> Gaze:
        """Connect the robot, read its joints, begin to send commands.

        Returns:
            Itself.

        Raises:
            RobotError: If the robot cannot be connected to, or its joints cannot be read.
            RuntimeError: If it was used before.
        """
        if self._run is not None:
            raise RuntimeError("this Gaze was used before: make another one for another with-block")
        self._run = run = LiveRun(self._setup, self._keep, self._listeners)
        # Not a daemon thread: the neck is also braked at the end of the program.
        thread = threading.Thread(target=self._work, args=(run,), name="servo")
        try:
            run.start(self._stop)
            thread.start()
        except BaseException:
            self._stop.set()
            if thread.is_alive():
                thread.join()
            else:
                run.close()
            raise
        self._thread = thread
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> Literal[False]:
        """Brake within limits, close the robot.

        Raises:
            BaseException: What the servo thread raised, unless the block itself raised.
        """
        self._stop.set()
        if self._thread is not None:
            try:
                self._thread.join()
            except KeyboardInterrupt:
                # After a further Ctrl-C, still wait for the braking, which takes a fraction of a second.
                self._thread.join()
                raise
        failure = self._failure
        if failure is not None and failure is not error:
            if error is None:
                raise failure
            error.add_note(f"The servo thread of Gaze raised, too: {type(failure).__name__}: {failure}")
        return False

    def see(self, time_s: float, head_m: Any, **stated: Unpack[Stated]) -> None:
        """Pass one observation of a person to the loop; non-blocking.

        The capture time matters most: a stamp that is 0.1 s late adds 0.1 s of unmodelled dead time.

        Args:
            time_s: Capture time of the frame (not the time of processing), seconds. The default is Unix time, as of
                `time.time`. With ``clock="monotonic"`` it is the time of `time.monotonic`. With ``clock="other"`` it is
                the time of any steady clock; the frames with the shortest delay (0.05 s) determine its offset.
            head_m: Head in the sensor's frame, shape (3,), metres: x forward, y left, z up.
            **stated: Optional values of the tracker:

                - ``head_quat_wxyz``: orientation of the head in the same frame, shape (4,). The identity faces +x.
                - ``pelvis_quat_wxyz``: orientation of the pelvis, likewise.
                - ``covariance_m2``: covariance of `head_m`, shape (3, 3), square metres. `gazempc.bearing_covariance`
                  computes it for a tracker that measures the direction better than the range.
                - ``head_yaw_sd_rad``, ``pelvis_yaw_sd_rad``: standard deviations of the yaw, radians.
                - ``person_id``: the tracker's name of the person, a whole number or a text. A new name alone starts no
                  new track.
                - ``confidence``: probability that this is a person, 0 to 1.

        Raises:
            ValueError: If a value is invalid; names the field and the accepted values. The observation is not used.
            TypeError: If an argument does not exist.
            RuntimeError: Outside of the with-block.
            BaseException: What the servo thread raised, after the neck was braked.
        """
        if self._thread is None:
            raise RuntimeError("see() is called before the with-block: with Gaze(...) as gaze: gaze.see(...)")
        if self._failure is not None:
            raise self._failure
        if self._stop.is_set() or not self._thread.is_alive():
            raise RuntimeError("see() is called after the end of the with-block: the robot is closed")
        for text in self.warnings[self._warned :]:
            self._warned += 1
            warnings.warn(text, UserWarning, stacklevel=2)
        self._source.push(time_s, head_m, stated)

    def hear(self, azimuth_rad: float) -> None:
        """Report speech from a direction, for the policy ``speaker``.

        Args:
            azimuth_rad: Direction of the sound in the base frame, radians, positive to the left.
        """
        self._setup.cues.put(Sound(0.0, azimuth_rad))

    def think(self, lasts_s: float = 1.5) -> None:
        """Gaze aversion of a thinking person, as soon as feasible; requires ``attend`` or ``look_away``.

        Args:
            lasts_s: Duration without contact, seconds.
        """
        self._setup.cues.put(Thinking(lasts_s))

    def speech_starts(self, in_s: float) -> None:
        """Hold the floor before an utterance, by a gaze aversion that ends when it starts.

        Args:
            in_s: Time until the utterance, seconds; an aversion needs 2 s or more.
        """
        self._setup.cues.put(Speech(in_s))

    def glance(self, target_base_m: Any, lasts_s: float = 1.0) -> None:
        """Glance at an object.

        Args:
            target_base_m: Position of the object in the base frame, shape (3,), metres.
            lasts_s: Duration without contact with the person, seconds.

        Raises:
            ValueError: If the position is invalid.
        """
        self._setup.cues.put(Glance(checked("target_base_m", target_base_m, (3,), "metres in the base frame"), lasts_s))

    def look_away(self, rhythm: LookAwayMode) -> None:
        """Change the rhythm of gaze aversion.

        Args:
            rhythm: ``listening``, ``speaking``, or ``told`` for none.
        """
        self._setup.cues.put(Rhythm(rhythm))

    def attend_to(self, person_id: str | int | None) -> None:
        """Attend one of several people while present, with precedence over the policy; requires ``attend``.

        Args:
            person_id: The tracker's name; None to follow the policy again.
        """
        self._setup.cues.put(Choice(None if person_id is None else str(person_id)))

    def point(
        self, target_base_m: Any | None, min_duration_s: float = 0.0, max_velocity_rad_s: float = math.inf
    ) -> float:
        """Look at a place, with precedence over all people, until the next call with None.

        Args:
            target_base_m: Position in the base frame, shape (3,), metres; None to look at people again.
            min_duration_s: Minimum duration of the motion, seconds.
            max_velocity_rad_s: Maximum angular speed of the path, rad/s. After late ticks the command returns to the
                path at up to the limits of the neck.

        Returns:
            Time until the end of the path plus the delay of the joints, seconds; the neck's limits may need longer.

        Raises:
            ValueError: If the position or a limit is invalid.
        """
        if target_base_m is None:
            self._setup.goal.place = None
            return 0.0
        target_m = checked("target_base_m", target_base_m, (3,), "metres in the base frame")
        if not (0.0 <= min_duration_s < math.inf and max_velocity_rad_s > 0.0):
            raise ValueError(
                f"min_duration_s is {min_duration_s}, max_velocity_rad_s {max_velocity_rad_s}: expected a time and "
                "a speed"
            )
        neck = self.neck
        eye_m, direction = gaze_ray(neck.geometry, neck.rest_rad if self._run is None else self._run.command_rad)
        # The path starts after the delay of the joints.
        lag_s = float(np.max(neck.dead_time_s + neck.servo_lag_s))
        start_s = self._setup.clock.now_s() + lag_s
        place = Place.reached(target_m, eye_m, direction, start_s, min_duration_s, max_velocity_rad_s)
        self._setup.goal.place = place
        return lag_s + place.lasts_s

    def to_base(self, place_m: Any) -> FloatArray:
        """Transform a place to the neck's base frame, shape (3,), metres.

        Args:
            place_m: Position in the frame of a fixed mount, shape (3,), metres.
        """
        return placed(self._setup.mount, self.neck, np.asarray(place_m, dtype=np.float64))

    @property
    def neck(self) -> NeckSpec:
        """The neck, with the limits of this run."""
        return self._setup.neck

    @property
    def attended(self) -> Attended | None:
        """The attended one of several people, with start time and reason; None without ``attend``."""
        target = self._setup.several
        several = target.several if isinstance(target, LookingAway) else None
        return None if several is None else several.attention.attended

    @property
    def joints(self) -> JointEstimate | None:
        """Estimate of the joints at the last tick; None before the first one."""
        return None if self._run is None else self._run.joints

    @property
    def events(self) -> dict[str, int]:
        """Count of each event of `gazempc.loop.events` over the whole run; a lasting event counts once."""
        return {} if self._run is None else self._run.logs.events

    @property
    def warnings(self) -> tuple[str, ...]:
        """Probable errors of clock, unit, axes, rate or names, with remedies; `see` warns of each once."""
        return () if self._run is None else tuple(self._run.report.warnings)

    @property
    def observations(self) -> dict[str, int]:
        """Number of observations: ``used``, and refused by the name of the event."""
        return {} if self._run is None else {"used": self._run.logs.used, **self._run.logs.refused}

    @property
    def faults(self) -> tuple[Fault, ...]:
        """The exceptions caught over the whole run, each event once with its first traceback."""
        return () if self._run is None else self._run.logs.faults

    def log(self) -> Log:
        """The log so far; after the block of the whole run, including the stop.

        Bounded memory: of a longer run the last ``keep_minutes`` (10 by default).

        Returns:
            The log; `gazempc.results.metrics.measure` and the figures read it.

        Raises:
            RuntimeError: If the log is empty.
        """
        if self._run is not None:
            self._run.logs.snapshot().result()
        if not self._kept:
            raise RuntimeError("there is no log yet: nothing has happened")
        return join_logs(self._kept)

    def _keep(self, log: Log, times: ComputeTimes) -> None:
        oldest_s = log.time_s[-1] - 60.0 * self.settings.keep_minutes
        self._kept = (*(kept for kept in self._kept if kept.time_s[-1] >= oldest_s), log)

    def _work(self, run: LiveRun) -> None:
        try:
            with fast_switching(), closing(run):
                run.serve(self._stop)
            run.logs.check()
        except BaseException as error:
            self._failure = error
