"""People as ROS4HRI trackers tell them (REP 155): frames in tf, lists of who is tracked, and whose face it is."""

from __future__ import annotations

import math
from collections.abc import Callable

from gazempc.live.sources.dead_topics import DeadTopics
from gazempc.live.sources.hri_frames import HeadFrames, HeadInFrame
from gazempc.live.sources.hri_ids import HriIds
from gazempc.live.sources.source import Arrived, SourceError
from gazempc.live.sources.tf import TfListener
from gazempc.ros2.node import Ros2Node
from gazempc.ros2.wire import Ros2Network, WireError
from gazempc.types import FloatArray, Sighting
from predictors import HeadObservation

_NODE_NAME = "gazempc_people"  # this program in the graph of ROS 2
# While a face is seen, what a skeleton says of this head is worse. No two heads are so near to each other.
_FACE_COUNTS_S, _ONE_HEAD_M = 0.5, 0.4


class Ros4HriPeople:
    """Takes everybody's head from tf, over Zenoh as rmw_zenoh does; each with the person's id, or the tracker's.

    A head is where ``face_<id>`` is, else ``head_<id>`` of a skeleton, else over the hips of ``body_<id>``. Whoever the
    tracker's list does not name is left out.

    Args:
        clock_s: The loop's clock, seconds.
        to_loop_s: Converts Unix time in seconds to the loop's clock.
        network: Router, domain and release of ROS 2.
        base_frame: tf frame of the positions, on the robot. Default: the frame of the tracker's sensor, with optical
            axes converted to x forward. The mount says where this frame is.
    """

    def __init__(
        self,
        clock_s: Callable[[], float],
        to_loop_s: Callable[[float], float],
        network: Ros2Network | None = None,
        base_frame: str | None = None,
    ) -> None:
        self._clock_s, self._to_loop_s = clock_s, to_loop_s
        self._network, self._base_frame = network or Ros2Network(), base_frame
        self._node: Ros2Node | None = None
        # By the tracker's name: capture time and place.
        self._faces: dict[str, tuple[float, FloatArray]] = {}

    def open(self) -> None:
        """See `gazempc.live.sources.source.Source.open`; does not wait until somebody sends."""
        if self._node is not None:
            return
        try:
            self._node = Ros2Node(_NODE_NAME, self._network)
            self._tf, self._ids = TfListener(self._node), HriIds(self._node)
        except WireError as error:
            self.close()
            raise SourceError(f"ROS4HRI: {error}") from None
        self._heads = HeadFrames(self._tf.transforms, self._ids.is_tracked, self._to_loop_s, self._base_frame)
        self._dead = DeadTopics({self._tf.topic: self._tf.moving}, self._clock_s())

    def poll(self) -> Arrived:
        """See `gazempc.live.sources.source.Source.poll`."""
        if self._node is None:
            return Arrived()
        sightings: list[Sighting] = []
        now_s, lost = self._clock_s(), self._node.lost_router()
        problems = [lost] if lost else []
        try:
            problems += self._ids.listen()
            moved, unusable = self._tf.listen()
            problems += unusable
        except WireError as error:
            return Arrived((), (str(error),))
        heads, unplaced = self._heads.heads(moved, now_s)
        problems += [f"{self._tf.topic}, {problem}" for problem in unplaced]
        for head in heads:
            try:
                seen = self._observation(head)
            except ValueError as error:
                problems.append(f"{self._tf.topic}, {head.kind}_{head.part_id}: {error}")
            else:
                sightings += [] if seen is None else [Sighting(now_s, seen)]
        return Arrived(tuple(sightings), tuple(problems), self._dead.notices(now_s))

    @property
    def finished(self) -> bool:
        """False: nobody can know that nothing more will be sent."""
        return False

    def close(self) -> None:
        """See `gazempc.live.sources.source.Source.close`."""
        if self._node is not None:
            self._node.close()
        self._node = None
        self._faces = {}

    def _observation(self, head: HeadInFrame) -> HeadObservation | None:
        """A head that counts; None for one whose face is seen."""
        captured_s = head.captured_s
        self._faces = {name: face for name, face in self._faces.items() if captured_s - face[0] <= _FACE_COUNTS_S}
        if head.kind == "face":
            self._faces[head.part_id] = captured_s, head.position_m
        elif any(math.dist(head.position_m, place_m) < _ONE_HEAD_M for _, place_m in self._faces.values()):
            return None
        is_body = head.kind == "body"
        return HeadObservation(
            captured_s,
            head.position_m,
            head_quat_wxyz=None if is_body else head.quat_wxyz,
            pelvis_quat_wxyz=head.quat_wxyz if is_body else None,
            person_id=self._ids.person(head.kind, head.part_id) or head.part_id,
        )
