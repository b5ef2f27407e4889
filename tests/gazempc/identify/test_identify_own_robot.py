"""Identification of a user's own robot: measured as a shipped one, its faults named."""

import tomllib

import pytest

from gazempc.identify.identify import main

ROBOT = '''
import numpy as np
from gazempc.sim.simulated import SimulatedNeck

class Head(SimulatedNeck):
    """Stands for a driver."""
    def __init__(self, neck, clock_s, position_rad, dead_time_s: float = 0.1):
        changed = {"dead_time_s": dead_time_s}
        axes = {name: getattr(neck, name).model_copy(update=changed) for name in ("pan", "tilt")}
        super().__init__(neck.model_copy(update=axes), position_rad, clock_s)

class Real(Head):
    keeps_any_clock = False

class NoConnection(Head):
    def connect(self):
        raise KeyError("port")

class Silent(Head):
    def read_state(self): ...
    def send_command(self, position_rad):
        raise AssertionError("moved")

class WrongShape(Head):
    def read_state(self):
        state = super().read_state()
        return type(state)(state.time_s, np.zeros(3), np.zeros(3))

class WrongSent(Head):
    def send_command(self, position_rad):
        return super().send_command(position_rad)[:1]
'''


@pytest.fixture(scope="module", autouse=True)
def _in_the_folder_of_the_robot(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("own")
        (folder / "robot_to_identify.py").write_text(ROBOT, encoding="utf-8")
        patch.chdir(folder)
        patch.syspath_prepend(folder)
        yield


def test_its_dead_time_is_found(tmp_path):
    words = ["--robot", "robot_to_identify:Head", "--duration-s", "6", "--out", str(tmp_path / "mine.toml")]
    assert main([*words, "--options.dead_time_s", "0.25"]) == 0
    measured = tomllib.loads((tmp_path / "mine.toml").read_text())
    assert measured["pan"]["dead_time_s"] == pytest.approx(0.25, abs=0.002)
    assert measured["tilt"]["dead_time_s"] == pytest.approx(0.25, abs=0.002)


@pytest.mark.parametrize(
    ("name", "named"),
    [
        ("Real", ["--neck: a real robot (robot_to_identify:Real) needs its own neck file"]),
        ("NoConnection", ["connect() raised KeyError: 'port'"]),
        ("Silent", ["there is no reading", "identification does not"]),
        ("WrongShape", ["position_rad array([0., 0., 0.]), needed is an array of shape (2,)"]),
        ("WrongSent", ["a command did not get through", "of shape (1,)"]),
    ],
)
def test_faults_of_a_robot_are_named(name, named, tmp_path, capsys):
    out = tmp_path / "mine.toml"
    assert main(["--robot", f"robot_to_identify:{name}", "--duration-s", "8", "--out", str(out)]) == 2
    complained = capsys.readouterr().err
    for word in named:
        assert word in complained
    assert "Traceback" not in complained
    assert not out.exists()
