"""Options of a user's own parts: taken from a command line, checked, given to the parts that they are for."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import pytest
from builders.own_modules import write_own_parts

from gazempc import part_options
from gazempc.errors import SettingsError
from gazempc.part_options import check_options, make, options_for, take_options
from gazempc.parts import CONTROLLER, PREDICTOR, ROBOT, Kind

THING = Kind("thing", {}, {})


@pytest.mark.parametrize(
    ("words", "rest", "options"),
    [
        ([], [], {}),
        (["--options.gain", "0.3"], [], {"gain": "0.3"}),
        (["--options.gain=0.3"], [], {"gain": "0.3"}),
        (
            ["--out", "x", "--options.robot.port", "tty", "--seed", "1"],
            ["--out", "x", "--seed", "1"],
            {"robot.port": "tty"},
        ),
        (["--options.dynamixel.port", "tty"], ["--options.dynamixel.port", "tty"], {}),
        (["--options.a", "1", "--options.a", "2"], [], {"a": "2"}),
    ],
)
def test_options_are_taken_out_of_a_command_line(words, rest, options):
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


def made(monkeypatch, factory, given=None, **options):
    monkeypatch.setattr(part_options, "find", lambda kind, choice: factory)
    return make(THING, "mine:Thing", given or {}, options)


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [
        ("count", "3", 3),
        ("gain", "0.25", 0.25),
        ("on", "true", True),
        ("path", "a/b", Path("a/b")),
        ("mode", "slow", "slow"),
        ("angles", "[1, 2.5]", (1.0, 2.5)),
        ("table", "{a: 1}", {"a": 1}),
    ],
)
def test_a_value_is_read_in_the_type_of_the_parameter(name, text, value, monkeypatch):
    found = getattr(made(monkeypatch, Thing, **{name: text}), name)
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize(
    ("name", "text"),
    [("count", "3.5"), ("gain", "much"), ("on", "maybe"), ("mode", "medium"), ("angles", "[1, x]"), ("table", "{a:")],
)
def test_a_wrong_value_is_named(name, text, monkeypatch):
    with pytest.raises(SettingsError, match=rf"thing mine:Thing: options\.{name}: .* \(given: "):
        made(monkeypatch, Thing, **{name: text})


def test_without_an_annotation_text_is_read_as_yaml(monkeypatch):
    class Plain:
        def __init__(self, gains, label="x"):
            self.gains, self.label = gains, label

    assert made(monkeypatch, Plain, gains="[1, 2]", label="a b").gains == [1, 2]


def test_what_is_given_goes_to_who_asks_and_an_option_wins(monkeypatch):
    assert made(monkeypatch, Thing, {"neck": "long", "clock": 3}).neck == "long"
    assert made(monkeypatch, Thing, {"neck": "long"}, neck="short").neck == "short"


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("own")
        patch.syspath_prepend(folder)
        yield write_own_parts(folder)


def test_an_option_goes_to_every_part_that_takes_it_or_to_one_kind(own):
    options = {"gain": 1, "controller.gain": 2, "predictor.noise_m": 3, "zero_deg": 4}
    assert options_for(CONTROLLER, f"{own}:Eager", options) == {"gain": 2}
    assert options_for(PREDICTOR, f"{own}:Standing", options) == {"noise_m": 3}
    assert options_for(ROBOT, f"{own}:Head", options) == {"zero_deg": 4}
    assert options_for(ROBOT, "simulated", options) == {}


def test_an_option_that_nobody_takes_is_refused_with_what_is_accepted(own):
    chosen = [(CONTROLLER, f"{own}:Eager"), (PREDICTOR, "walker")]
    check_options(chosen, {"gain": 1, "controller.gain": 2})
    with pytest.raises(SettingsError) as raised:
        check_options(chosen, {"gian": 1, "robot.gain": 2, "gain": 3})
    first, second = str(raised.value).splitlines()
    assert first.startswith("options.gian: no chosen part takes it; perhaps you meant 'gain'")
    assert second.startswith("options.robot.gain: no chosen part takes it")
    check_options([(PREDICTOR, "walker")], {})
    with pytest.raises(SettingsError, match="none is chosen"):
        check_options([(PREDICTOR, "walker")], {"gain": 1})
