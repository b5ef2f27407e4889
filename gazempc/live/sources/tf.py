"""What tf tells: frames that move, and frames that stand still."""

from __future__ import annotations

from gazempc.ros2.node import Ros2Node
from gazempc.ros2.transforms import Moved, Transforms
from gazempc.ros2.wire import WireError

_MOVING, _FIXED, _TYPE = "/tf", "/tf_static", "tf2_msgs/msg/TFMessage"
# Frames between a tracker and the robot are told by others, who may be this much later.
WAITS_S = 0.2


class TfListener:
    """Keeps the tree of frames as it is told.

    Args:
        node: Listens.

    Attributes:
        transforms: The tree.
        moving: The topic of frames that move.
    """

    topic = _MOVING

    def __init__(self, node: Ros2Node) -> None:
        self.transforms = Transforms()
        self.moving = node.subscription(_MOVING, _TYPE)
        self._fixed = node.subscription(_FIXED, _TYPE, latched=True)

    def listen(self) -> tuple[list[Moved], list[str]]:
        """Take in what has come.

        Returns:
            Frames that have moved, in the order in which that was told; and what could not be used, and why.

        Raises:
            WireError: If the session is closed.
        """
        moved: list[Moved] = []
        problems: list[str] = []
        for topic, subscription, fixed in ((_FIXED, self._fixed, True), (_MOVING, self.moving, False)):
            for message in subscription.take():
                if isinstance(message, WireError):
                    problems.append(f"{topic}: {message}")
                    continue
                newly, unusable = self.transforms.take(message.transforms, fixed)
                moved += newly
                problems += [f"{topic}, {problem}" for problem in unusable]
        return moved, problems
