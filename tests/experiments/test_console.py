"""The command `gazempc`."""

import importlib

import pytest

from experiments.console import COMMANDS, main


@pytest.mark.parametrize("words", [["--help"], ["-h"], []])
def test_it_lists_its_commands(words, capsys):
    assert main(words) == (0 if words else 2)
    said = capsys.readouterr().out
    for name, (_, what) in COMMANDS.items():
        assert f"  {name:<9} {what}" in said


def test_a_misspelt_command_is_named(capsys):
    assert main(["comprae"]) == 2
    assert "no command 'comprae': perhaps you meant 'compare'" in capsys.readouterr().err


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_every_command_is_there_and_explains_itself(name, capsys):
    assert callable(importlib.import_module(COMMANDS[name][0]).main)
    with pytest.raises(SystemExit) as ended:
        main([name, "--help"])
    assert ended.value.code == 0
    assert "--" in capsys.readouterr().out
