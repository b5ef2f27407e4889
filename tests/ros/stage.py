"""Processes of a graph of ROS 2, and a client."""

import os
import signal
import subprocess
import sys
import time
from collections import defaultdict
from pathlib import Path

import numpy as np
from builders.ros2_real import ENVIRONMENT, rclpy_or_skip
from builders.waiting import wait_for

from gazempc.files.documents import as_toml
from gazempc.neck.spec import load_neck

rclpy = rclpy_or_skip()

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
PACKAGE = ROOT / "ros" / "gazempc_ros"
# Additional dead time of the controller, as measured by `identify`: sampling delay and hold of its period.
TOWARDS_CONTROLLER_S = 0.002
NECK_PARAMETERS = {
    "options.ros2.base_frame": "base_link",
    "source": "ros2:/person/pose",
}


class Process:
    """A node in a process of its own, with its output in a file."""

    def __init__(self, folder, name, words):
        path = os.pathsep.join(map(str, (ROOT, PACKAGE, HERE, HERE.parent, os.environ.get("PYTHONPATH", ""))))
        environment = os.environ | ENVIRONMENT | {"PYTHONPATH": path, "PYTHONUNBUFFERED": "1"}
        self.log = folder / f"{name}_{time.monotonic_ns()}.txt"
        self.name = name
        with self.log.open("w") as out:
            self.process = subprocess.Popen([sys.executable, *words], stdout=out, stderr=out, env=environment)

    def text(self):
        return self.log.read_text()

    def stop(self, how=signal.SIGINT, timeout_s=30.0):
        """End the process; returns its exit status."""
        if self.process.poll() is None:
            self.process.send_signal(how)
        try:
            return self.process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            self.process.kill()
            raise

    def until(self, words, timeout_s=60.0):
        """Wait until it has printed some words."""
        wait_for(lambda: words in self.text() or self.process.poll() is not None, timeout_s, why=f"no {words!r}")
        assert words in self.text(), self.text()


class Stage:
    """Starts nodes, and ends them with the test."""

    def __init__(self, folder):
        self.folder, self.running, self.node = folder, [], None
        self.neck_file = folder / "measured.toml"
        neck = load_neck("reference").model_dump(exclude_none=True)
        for axis in ("pan", "tilt"):
            neck[axis]["dead_time_s"] += TOWARDS_CONTROLLER_S
        self.neck_file.write_text(as_toml(neck))

    def start(self, name, *words):
        made = Process(self.folder, name, words)
        self.running.append(made)
        return made

    def controller(self, *words):
        self.controller_file = self.folder / f"controller_{len(self.running)}.npz"
        return self.start("controller", str(HERE / "controller.py"), "--out", str(self.controller_file), *words)

    def tracker(self, *words):
        self.tracker_file = self.folder / f"tracker_{len(self.running)}.npy"
        return self.start("tracker", str(HERE / "tracker.py"), "--out", str(self.tracker_file), *words)

    def gaze(self, *words, **parameters):
        self.gaze_file = self.folder / f"gaze_{len(self.running)}.npz"
        settings = NECK_PARAMETERS | {"neck": str(self.neck_file), "log": str(self.gaze_file)} | parameters
        given = [word for name, value in settings.items() for word in ("-p", f"{name}:={value}")]
        return self.start("gaze", "-m", "gazempc_ros.gaze", "--ros-args", *given, *words)

    def rows(self):
        """Recorded motion: the controller's times, commands (3, N), angles and velocities; and its file."""
        with np.load(self.controller_file) as file:
            found = {name: file[name] for name in file.files}
        rows = found["rows"]
        return rows[:, 0], rows[:, 1:7].reshape(-1, 3, 2), rows[:, 7:9], rows[:, 9:11], found

    def client(self):
        if self.node is None:
            self.node = Client()
        return self.node

    def close(self):
        for process in self.running:
            if process.process.poll() is None:
                process.process.kill()
                process.process.wait()
        if self.node is not None:
            self.node.close()


class Client:
    """A node of the test that records received messages."""

    def __init__(self):
        self.own = not rclpy.ok()
        if self.own:
            rclpy.init(args=[])
        self.node = rclpy.create_node("client")
        self.received = defaultdict(list)

    def listen(self, kind, topic, qos=10):
        self.node.create_subscription(kind, topic, self.received[topic].append, qos)

    def step(self):
        rclpy.spin_once(self.node, timeout_sec=0.02)

    def wait(self, condition, timeout_s=60.0, why="timeout"):
        return wait_for(condition, timeout_s, self.step, why)

    def for_s(self, seconds):
        until_s = time.monotonic() + seconds
        while time.monotonic() < until_s:
            self.step()

    def result(self, future, timeout_s=60.0):
        self.wait(future.done, timeout_s)
        return future.result()

    def ask(self, kind, name, request):
        """Call a service; returns its response."""
        service = self.node.create_client(kind, name)
        self.wait(service.service_is_ready, why=f"no service {name}")
        return self.result(service.call_async(request))

    def close(self):
        self.node.destroy_node()
        if self.own:
            rclpy.shutdown()
