"""A polled node of rclpy, so that none of its threads competes with the servo thread."""

from __future__ import annotations

import contextlib
import importlib
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from itertools import islice
from typing import Any

from gazempc.errors import GazempcError
from gazempc.ros2.messages import Ros2Error, stamp_s, topic_name

# Length of queues: older messages are outdated.
WAITING_MAX = 256


class RosNotSourcedError(GazempcError):
    """This Python cannot import a package of ROS 2; the message gives the command that makes it available."""

    def __init__(self, package: str) -> None:
        super().__init__(
            f"ROS 2: this Python cannot import {package!r}. Source the installation before starting, such as "
            "'source /opt/ros/jazzy/setup.bash' (and the workspace's install/setup.bash), with the Python of that "
            f"distribution; if rclpy itself is found: sudo apt install ros-$ROS_DISTRO-{package.replace('_', '-')}"
        )


@cache
def message_type(name: str) -> Any:
    """The class of an interface.

    Args:
        name: Such as ``std_msgs/msg/String`` or ``control_msgs/action/PointHead``.

    Raises:
        RosNotSourcedError: If its package cannot be imported.
    """
    package, kind, cls = name.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.{kind}"), cls)
    except ImportError:
        raise RosNotSourcedError(package) from None


@contextlib.contextmanager
def ros_errors() -> Iterator[None]:
    """Convert exceptions of rclpy to `Ros2Error`."""
    try:
        yield
    except GazempcError:
        raise
    except Exception as error:
        raise Ros2Error(f"rclpy: {error}") from None


class _End:
    """One end of a topic, and the reasons why others do not match it.

    Args:
        made: The publisher or subscription of rclpy.
        ask: Returns the other ends of a topic.
        topic: Full name of the topic.
        type_name: Type of its messages.
    """

    def __init__(self, made: Any, ask: Callable[[str], Iterable[Any]], topic: str, type_name: str) -> None:
        self.made, self._ask, self._topic, self.type_name = made, ask, topic, type_name

    @property
    def described(self) -> str:
        """Topic and type, and the nodes of incompatible other ends with the reasons."""
        unfit = sorted({f"{other.node_name} {why}" for other in self._others() if (why := self._why(other))})
        return f"{self._topic} as {self.type_name}" + (f", but {' and '.join(unfit)}" if unfit else "")

    def _others(self) -> list[Any]:
        with contextlib.suppress(Exception):
            return list(self._ask(self._topic))
        return []

    def _why(self, other: Any) -> str:
        """Incompatibility of another end; empty if it is compatible."""
        from rclpy.qos import QoSCompatibility, qos_check_compatible  # noqa: PLC0415

        if other.topic_type != self.type_name:
            return f"has the type {other.topic_type}"
        pair = other.qos_profile, self.made.qos_profile  # publisher and subscription
        verdict, reason = qos_check_compatible(*(pair if isinstance(self, Subscription) else reversed(pair)))
        if verdict != QoSCompatibility.ERROR:
            return ""
        return f"has an incompatible quality of service ({reason.removeprefix('ERROR: ').rstrip('; ')})"


class Publication(_End):
    """A publisher; made by `Ros2Node`."""

    @property
    def has_listeners(self) -> bool:
        """Whether there is a subscription of this type with a compatible quality of service."""
        with ros_errors():
            return bool(self.made.get_subscription_count())

    def publish(self, message: Any) -> None:
        """Send a message; does not wait for its delivery.

        Raises:
            Ros2Error: If it cannot be sent.
        """
        with ros_errors():
            self.made.publish(message)


class Subscription(_End):
    """A polled subscription; made by `Ros2Node`.

    Attributes:
        made: The subscription of rclpy.
        type_name: Type of its messages.
    """

    def take(self) -> list[Any]:
        """Messages since the last call, oldest first.

        Raises:
            Ros2Error: If the node is closed.
        """
        handle, kind = self.made.handle, self.made.msg_type
        with ros_errors(), handle:
            taken = iter(lambda: handle.take_message(kind, False), None)
            return [message for message, _ in islice(taken, WAITING_MAX)]

    @property
    def senders(self) -> tuple[str, ...]:
        """Full names of the nodes that send messages of this type with a compatible quality of service."""
        fit = (end for end in self._others() if not self._why(end))
        return tuple(f"{end.node_namespace.rstrip('/')}/{end.node_name}" for end in fit)


class _Context:
    """The process's default context of rclpy: the program's, or one with the lifetime of the nodes."""

    def __init__(self) -> None:
        self._lock, self._nodes, self._own = threading.Lock(), 0, False

    def enter(self) -> None:
        try:
            import rclpy  # noqa: PLC0415
            from rclpy.signals import SignalHandlerOptions  # noqa: PLC0415
        except ImportError:
            raise RosNotSourcedError("rclpy") from None
        with self._lock, ros_errors():
            if not rclpy.ok():
                rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
                self._own = True
            self._nodes += 1

    def leave(self) -> None:
        import rclpy  # noqa: PLC0415

        with self._lock:
            self._nodes -= 1
            if self._own and not self._nodes:
                self._own = False
                with contextlib.suppress(Exception):
                    rclpy.shutdown()


_CONTEXT = _Context()


class Ros2Node:
    """A node in the graph of ROS 2, in the domain and by the middleware of the environment.

    It is never spun: the middleware queues messages until `Subscription.take`.

    Args:
        name: The node's name.
        use_sim_time: Use the topic ``/clock`` for stamps.

    Raises:
        RosNotSourcedError: If rclpy cannot be imported.
        Ros2Error: If the node cannot be constructed.
    """

    def __init__(self, name: str, use_sim_time: bool = False) -> None:
        _CONTEXT.enter()
        try:
            with ros_errors():
                from rclpy.node import Node  # noqa: PLC0415

                # Without the arguments of the program, whose name is for one node only.
                self._node: Any = Node(
                    name, use_global_arguments=False, start_parameter_services=False, enable_rosout=False
                )
            self._clock = self.subscription("/clock", "rosgraph_msgs/msg/Clock") if use_sim_time else None
        except BaseException:
            _CONTEXT.leave()
            raise
        self._unix_minus_ros_s: float | None = None

    def unix_s(self, ros_s: float) -> float:
        """Convert a stamp to Unix time; with ``use_sim_time`` by the newest message of the clock.

        Args:
            ros_s: Seconds of ROS time.

        Raises:
            Ros2Error: Before the first message of the clock.
        """
        if self._clock is None:
            return ros_s
        for message in self._clock.take()[-1:]:
            with contextlib.suppress(Ros2Error):
                self._unix_minus_ros_s = time.time() - stamp_s(message.clock)
        if self._unix_minus_ros_s is None:
            raise Ros2Error("no message on /clock yet, and use_sim_time is set")
        return ros_s + self._unix_minus_ros_s

    def publication(self, topic: str, type_name: str, latched: bool = False) -> Publication:
        """Create a publisher.

        Args:
            topic: Its name.
            type_name: Such as ``std_msgs/msg/String``.
            latched: Keep the last message for later subscribers (transient local).
        """
        kind, full = message_type(type_name), topic_name(topic)
        with ros_errors():
            # A late command is useless: only the newest is kept.
            made = self._node.create_publisher(kind, full, _quality(1, latched, True))
        return Publication(made, self._node.get_subscriptions_info_by_topic, full, type_name)

    def subscription(self, topic: str, type_name: str, latched: bool = False) -> Subscription:
        """Create a subscription.

        Args:
            topic: Its name.
            type_name: Such as ``std_msgs/msg/String``.
            latched: Request earlier messages (transient local, reliable); else compatible with any sender.
        """
        kind, full = message_type(type_name), topic_name(topic)
        with ros_errors():
            # The callback of a polled subscription is never called.
            made = self._node.create_subscription(kind, full, lambda _: None, _quality(WAITING_MAX, latched, latched))
        return Subscription(made, self._node.get_publishers_info_by_topic, full, type_name)

    def forget(self, subscription: Subscription) -> None:
        """End a subscription."""
        with contextlib.suppress(Exception):
            self._node.destroy_subscription(subscription.made)

    def close(self) -> None:
        """Destroy the node; never raises."""
        node, self._node = self._node, None
        if node is not None:
            with contextlib.suppress(Exception):
                node.destroy_node()
            _CONTEXT.leave()


def _quality(depth: int, latched: bool, reliable: bool) -> Any:
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy  # noqa: PLC0415

    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


# Factory of a node: name, and whether it uses a simulated clock.
MakeNode = Callable[[str, bool], Ros2Node]
