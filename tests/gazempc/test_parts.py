"""Parts by name or module:Class: what is found, what is refused, and what a message says."""

import sys

import pytest
from builders.own_modules import write_own_parts

from gazempc.errors import SettingsError
from gazempc.parts import (
    CONTROLLER,
    PREDICTOR,
    ROBOT,
    SOURCE,
    check_choice,
    check_members,
    find,
    is_own,
    name_of,
)
from gazempc.sim.simulated import SimulatedNeck

KINDS = (PREDICTOR, CONTROLLER, ROBOT, SOURCE)


@pytest.mark.parametrize(
    ("choice", "own"),
    [
        ("my_parts:Mine", True),
        ("a.b.c:D.e", True),
        ("mpc", False),
        ("udp:5005", False),
        (":Mine", False),
        ("my-parts:Mine", False),
        ("", False),
    ],
)
def test_a_part_of_one_s_own_is_told_from_everything_else(choice, own):
    assert is_own(choice) == own


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_every_shipped_part_is_there_and_has_all_methods(kind):
    for name, place in kind.shipped.items():
        factory = find(kind, name)
        assert place.endswith(f":{factory.__qualname__}")
        for method in kind.members:
            assert hasattr(factory, method), (name, method)
        assert check_choice(kind, name) == name


def test_modules_of_the_working_directory_are_found(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", [path for path in sys.path if path])
    monkeypatch.chdir(tmp_path)
    assert find(PREDICTOR, f"{write_own_parts(tmp_path)}:Standing").__name__ == "Standing"


@pytest.mark.parametrize(
    ("text", "choice", "named"),
    [
        ("class Parts: pass", "mine:Part", ["mine has no 'Part'", "perhaps you meant 'Parts'"]),
        ("Part = 3", "mine:Part", ["Part is no class and no function, but int"]),
        ("import no_such_thing", "mine:Part", ["mine needs the module 'no_such_thing'"]),
        ("1 / 0", "mine:Part", ["importing mine raised ZeroDivisionError: division by zero"]),
        ("", "nowhere:Part", ["there is no module 'nowhere'", "working directory"]),
    ],
)
def test_why_a_part_cannot_be_found_is_said(text, choice, named, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "mine", raising=False)
    (tmp_path / "mine.py").write_text(text, encoding="utf-8")
    with pytest.raises(SettingsError) as raised:
        find(ROBOT, choice)
    for word in (f"robot {choice}", *named):
        assert word in str(raised.value)
    sys.modules.pop("mine", None)


class Robot:
    """Has all that a robot needs."""

    def connect(self): ...
    def read_state(self): ...
    def send_command(self, position_rad): ...
    def close(self): ...


def test_a_method_that_is_missing_or_no_method_is_named_with_what_it_does():
    check_members(ROBOT, Robot())
    lacking = Robot()
    lacking.read_state = None
    with pytest.raises(SettingsError) as raised:
        check_members(ROBOT, lacking)
    assert str(raised.value) == f"robot Robot lacks the method {ROBOT.members['read_state']}"


def test_what_a_part_is_called():
    named = Robot()
    named.name = "my head"
    assert name_of(ROBOT, Robot()) == "Robot"
    assert name_of(ROBOT, named) == "my head"
    named.name = 3
    assert name_of(ROBOT, named) == "Robot"
    assert name_of(ROBOT, SimulatedNeck.__new__(SimulatedNeck)) == "simulated"


def test_a_shipped_name_is_the_shipped_part_s_alone():
    class Perfect(Robot):
        name = "simulated"

    assert name_of(ROBOT, Perfect()) == f"{__name__}.simulated"
