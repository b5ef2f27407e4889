"""Parts by name or module:Class, and options of user-defined parts."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import pytest
from builders.own_modules import write_own_parts

from gazempc.errors import SettingsError
from gazempc.part_options import check_options, make, options_for, take_options
from gazempc.parts import CONTROLLER, PREDICTOR, ROBOT, SOURCE, Kind, check_choice, check_members, find, is_own, name_of
from gazempc.sim.simulated import SimulatedNeck

KINDS = (PREDICTOR, CONTROLLER, ROBOT, SOURCE)


def test_names_of_the_form_module_class_are_recognised():
    own = {"my_parts:Mine", "a.b.c:D.e"}
    assert {each for each in (*own, "mpc", "udp:5005", ":Mine", "my-parts:Mine", "") if is_own(each)} == own


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_every_shipped_part_implements_its_interface(kind):
    for name, place in kind.shipped.items():
        factory = find(kind, name)
        assert place.endswith(f":{factory.__qualname__}")
        for method in kind.members:
            assert hasattr(factory, method), (name, method)
        assert check_choice(kind, name) == name


def test_modules_of_the_working_directory_are_importable(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", [path for path in sys.path if path])
    monkeypatch.chdir(tmp_path)
    assert find(PREDICTOR, f"{write_own_parts(tmp_path)}:Standing").__name__ == "Standing"


@pytest.mark.parametrize(
    ("text", "choice", "named"),
    [
        ("class Parts: pass", "mine:Part", ["mine has no 'Part'", "perhaps you meant 'Parts'"]),
        ("Part = 3", "mine:Part", ["Part is neither class nor function, but int"]),
        ("import no_such_thing", "mine:Part", ["mine needs the module 'no_such_thing'"]),
        ("1 / 0", "mine:Part", ["importing mine raised ZeroDivisionError: division by zero"]),
        ("", "nowhere:Part", ["there is no module 'nowhere'", "working directory"]),
    ],
)
def test_an_unknown_part_is_reported_with_the_reason(text, choice, named, tmp_path, monkeypatch):
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
    """A complete robot."""

    def connect(self): ...
    def read_state(self): ...
    def send_command(self, position_rad): ...
    def close(self): ...


def test_a_missing_method_is_named_with_its_purpose():
    check_members(ROBOT, Robot())
    lacking = Robot()
    lacking.read_state = None
    with pytest.raises(SettingsError) as raised:
        check_members(ROBOT, lacking)
    assert str(raised.value) == f"robot Robot lacks the method {ROBOT.members['read_state']}"


def test_the_display_name_of_a_part():
    named = Robot()
    named.name = "my head"
    assert name_of(ROBOT, Robot()) == "Robot"
    assert name_of(ROBOT, named) == "my head"
    named.name = 3
    assert name_of(ROBOT, named) == "Robot"
    assert name_of(ROBOT, SimulatedNeck.__new__(SimulatedNeck)) == "simulated"
    # Names of shipped parts are reserved.
    named.name = "simulated"
    assert name_of(ROBOT, named) == f"{__name__}.simulated"


THING = Kind("thing", {}, {})


@pytest.mark.parametrize(
    ("words", "rest", "options"),
    [
        ([], [], {}),
        (["--options.gain=0.3"], [], {"gain": "0.3"}),
        (["--out", "x", "--options.robot.port", "tty", "--a"], ["--out", "x", "--a"], {"robot.port": "tty"}),
        (["--options.dynamixel.port", "tty"], ["--options.dynamixel.port", "tty"], {}),
        (["--options.a", "1", "--options.a", "2"], [], {"a": "2"}),
    ],
)
def test_part_options_are_removed_from_the_command_line(words, rest, options):
    assert take_options(words, ["dynamixel"]) == (rest, options)


@dataclass
class Thing:
    """Takes an option of each kind."""

    count: int = 0
    gain: float = 0.0
    on: bool = False
    path: Path = Path()
    mode: Literal["fast", "slow"] = "fast"
    angles: tuple[float, ...] = ()
    table: dict[str, int] | None = None
    neck: str = ""


class Plain:
    def __init__(self, gains, label="x"):
        self.gains, self.label = gains, label


def made(name="Thing", given=None, **options):
    return make(THING, f"{__name__}:{name}", given or {}, options)


def test_values_have_the_types_of_the_parameters():
    texts = {"count": "3", "gain": "0.25", "on": "true", "path": "a/b", "mode": "slow"}
    found = made(**texts, angles="[1, 2.5]", table="{a: 1}")
    assert repr(found) == repr(Thing(3, 0.25, True, Path("a/b"), "slow", (1.0, 2.5), {"a": 1}))


@pytest.mark.parametrize(
    ("name", "text"),
    [("count", "3.5"), ("gain", "much"), ("on", "maybe"), ("mode", "medium"), ("angles", "[1, x]"), ("table", "{a:")],
)
def test_a_wrong_value_is_named(name, text):
    with pytest.raises(SettingsError, match=rf"thing {__name__}:Thing: options\.{name}: .* \(given: "):
        made(**{name: text})


def test_without_an_annotation_text_is_read_as_yaml():
    assert made("Plain", gains="[1, 2]", label="a b").gains == [1, 2]


def test_arguments_are_passed_by_parameter_name_and_options_override():
    assert made(given={"neck": "long", "clock": 3}).neck == "long"
    assert made(given={"neck": "long"}, neck="short").neck == "short"


def test_an_option_applies_to_all_accepting_parts_or_one_kind(own):
    options = {"gain": 1, "controller.gain": 2, "predictor.noise_m": 3, "zero_deg": 4}
    assert options_for(CONTROLLER, f"{own}:Eager", options) == {"gain": 2}
    assert options_for(PREDICTOR, f"{own}:Standing", options) == {"noise_m": 3}
    assert options_for(ROBOT, f"{own}:Head", options) == {"zero_deg": 4}
    assert options_for(ROBOT, "simulated", options) == {}


def test_an_unused_option_is_refused_with_the_accepted_ones(own):
    chosen = [(CONTROLLER, f"{own}:Eager"), (PREDICTOR, "walker")]
    check_options(chosen, {"gain": 1, "controller.gain": 2})
    with pytest.raises(SettingsError) as raised:
        check_options(chosen, {"gian": 1, "robot.gain": 2, "gain": 3})
    first, second = str(raised.value).splitlines()
    assert first.startswith("options.gian: ")
    assert "'gain'" in first
    assert second.startswith("options.robot.gain: ")
    check_options([(PREDICTOR, "walker")], {})
    with pytest.raises(SettingsError, match="none is chosen"):
        check_options([(PREDICTOR, "walker")], {"gain": 1})
