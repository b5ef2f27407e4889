"""The public package: `import gazempc as gz` is fast, has all its names, and replays by names and objects."""

import json
import subprocess
import sys

import numpy as np
import pytest

import gazempc as gz
from gazempc.errors import SettingsError

HEAVY = {"numpy", "scipy", "casadi", "pydantic", "matplotlib", "filterpy", "ruckig", "yaml", "tyro", "predictors"}


def loaded_by(code):
    """Which heavy packages a process has loaded after some code."""
    program = f"{code}; import sys, json; print(json.dumps(sorted(m for m in sys.modules if '.' not in m)))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stderr == ""
    return HEAVY & set(json.loads(done.stdout))


def test_importing_the_package_loads_no_heavy_library():
    assert loaded_by("import gazempc; dir(gazempc); gazempc.__all__") == set()
    # Names are loaded on use.
    assert "numpy" in loaded_by("import gazempc; gazempc.JointState")


@pytest.mark.parametrize("name", gz.__all__)
def test_every_public_name_is_loaded_on_first_use(name):
    value = getattr(gz, name)
    assert value.__doc__
    assert value is getattr(gz, name)
    # Public and defining names are equal, but for loading functions.
    assert value.__name__ in (name, name.removesuffix("_recording"))


def test_an_unknown_name_is_refused_with_the_valid_ones():
    with pytest.raises(AttributeError, match=r"'gazempc' has no attribute 'Gase'; it offers .*Gaze"):
        _ = gz.Gase
    assert not hasattr(gz, "__wrapped__")


def test_a_replay_by_names_equals_one_by_objects():
    named = gz.replay("subject03_R1", controller="reactive", predictor="constant_velocity", neck="reachy_mini")
    neck = gz.load_neck("reachy_mini")
    objects = gz.replay(
        gz.load_recording("subject03_R1"),
        controller=gz.Reactive(neck),
        predictor=gz.ConstantVelocity(acceleration_psd=0.05, position_noise_m=0.01),
        neck=neck,
        sensor=gz.load_sensor("reference"),
    )
    np.testing.assert_array_equal(named.command_position_rad, objects.command_position_rad)
    assert gz.measure(named).gaze_error_rms_deg == gz.measure(objects).gaze_error_rms_deg
    other = gz.replay("subject03_R1", controller="reactive", predictor="constant_velocity", neck="reachy_mini", seed=1)
    assert not np.array_equal(named.head_observed_base_m, other.head_observed_base_m)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"controller": "mpx"}, ["mpx", "mpc"]),
        ({"predictor": "walkr"}, ["walkr", "walker"]),
        ({"distanc_m": 1.0}, ["distanc_m", "distance_m"]),
        ({"mpc": {"horizon_s": -1}}, ["mpc.horizon_s"]),
        ({"predictor": object()}, ["predictor object lacks the method"]),
        ({"controller": gz.Reactive}, ["Reactive is a class"]),
        ({"controller": gz.Reactive(gz.load_neck("slow"))}, ["controller reactive", "'slow'", "'reference'"]),
    ],
)
def test_invalid_arguments_are_reported(arguments, named):
    with pytest.raises(SettingsError) as raised:
        gz.replay("subject03_R1", **arguments)
    for word in named:
        assert word in str(raised.value)
