"""Predictor and controller of a run: by name, as objects, and user-defined, which are tested first."""

import dataclasses

import numpy as np
import pytest
from builders.walkers import random_model

import gazempc as gz
from gazempc.controllers.lookahead import LookAhead
from gazempc.errors import SettingsError
from gazempc.loop.build import Person, make_controller, make_predictor, walker_model
from gazempc.loop.trial import check_controller, check_predictor, warm_up
from gazempc.parts import CONTROLLER, PREDICTOR, name_of
from gazempc.settings import ConstantVelocitySettings, GazeSettings
from predictors import ConstantVelocity, NotReadyError
from predictors.walker.network import save_walker_model

NECK = gz.load_neck("reference")
SETTINGS = GazeSettings()


def future(times_s):
    return np.tile([2.0, 0.0, 0.3], (len(times_s), 1))


@pytest.mark.parametrize("name", [*PREDICTOR.shipped])
def test_every_shipped_predictor_is_built_by_name(name):
    made = make_predictor(name, SETTINGS, Person("somebody", future), {})
    assert name_of(PREDICTOR, made) == name
    assert check_predictor(made) is made


@pytest.mark.parametrize("name", [*CONTROLLER.shipped])
def test_every_shipped_controller_is_built_by_name(name):
    made = make_controller(name, NECK, SETTINGS, {})
    assert name_of(CONTROLLER, made) == name
    assert check_controller(made, NECK) is made


@pytest.mark.parametrize("kind", [gz.Reactive, gz.LookAhead, gz.Mpc])
def test_a_controller_that_was_made_for_another_neck_is_refused(kind):
    slow = gz.load_neck("slow")
    with pytest.raises(SettingsError, match=r"made for the neck 'slow'.*steer the neck 'reference'") as raised:
        make_controller(kind(slow), NECK, SETTINGS, {})
    for axis in ("pan", "tilt"):
        assert f"{axis}.velocity_max_rad_s 1.0 instead of 2.5" in str(raised.value)
    made = kind(slow)
    assert make_controller(made, slow, SETTINGS, {}) is made


def test_properties_outside_the_model_of_a_controller_may_differ():
    noisy = NECK.model_copy(update={"name": "noisy", "pan": NECK.pan.model_copy(update={"encoder_noise_deg": 0.1})})
    made = gz.Mpc(NECK)
    assert make_controller(made, noisy, SETTINGS, {}) is made


def test_the_settings_reach_the_predictor():
    noisy = GazeSettings(constant_velocity=ConstantVelocitySettings(position_noise_m=0.5))
    spreads = []
    for settings in (SETTINGS, noisy):
        predictor = make_predictor("constant_velocity", settings, Person(), {})
        for k in range(10):
            predictor.update(gz.HeadObservation(k / 30, np.array([2.0, 0.0, 0.3])))
        spreads.append(predictor.forecast(np.array([0.4])).covariances_m2[0, 0, 0])
    assert spreads[1] > 10 * spreads[0]


def test_the_perfect_predictor_requires_a_future():
    with pytest.raises(SettingsError, match="the true future is unknown"):
        make_predictor("perfect", SETTINGS, Person(), {})


def test_a_given_object_is_tested_and_reset():
    class Counting(gz.ConstantVelocity):
        updates = resets = 0

        def update(self, observation):
            self.updates += 1
            super().update(observation)

        def reset(self):
            self.resets += 1
            super().reset()

    own = Counting()
    own.resets = 0
    assert make_predictor(own, SETTINGS, Person(), {}) is own
    assert own.updates == 5
    assert own.resets == 2
    shipped = gz.ConstantVelocity()
    shipped.update(gz.HeadObservation(0.0, np.array([2.0, 0.0, 0.3])))
    assert make_predictor(shipped, SETTINGS, Person(), {}) is shipped
    # After a reset an earlier observation starts a new track.
    shipped.update(gz.HeadObservation(-100.0, np.array([2.0, 0.0, 0.3])))


def test_user_defined_parts_get_future_neck_and_options(own):
    predictor = make_predictor(f"{own}:Standing", SETTINGS, Person("anna", future), {"noise_m": "0.2", "gain": "1"})
    assert (predictor.person, predictor.noise_m) == ("anna", 0.2)
    assert make_controller(f"{own}:Eager", NECK, SETTINGS, {"noise_m": "0.2", "gain": "0.5"}).gain == 0.5


def failing(method, how):
    """A predictor with a method that raises or returns an invalid value."""

    class Failing(gz.ConstantVelocity):
        pass

    predictor = Failing()
    right = getattr(predictor, method)

    def instead(*arguments):
        if isinstance(how, Exception):
            raise how
        return how(right(*arguments))

    setattr(predictor, method, instead)
    return predictor


@pytest.mark.parametrize(
    ("method", "how", "message"),
    [
        ("reset", RuntimeError("broken"), r"RuntimeError: broken \(Failing.reset\(\)\)"),
        ("update", KeyError("x"), r"KeyError: .*Failing.update"),
        ("forecast", ZeroDivisionError("0"), r"ZeroDivisionError: 0 .*Failing.forecast"),
        ("forecast", lambda found: None, "TypeError: .*NoneType.*Forecast"),
        (
            "forecast",
            lambda found: gz.Forecast(found.times_s, np.nan * found.means_base_m, found.covariances_m2, 0.0),
            "ValueError: .*not finite",
        ),
        (
            "forecast",
            lambda found: gz.Forecast(found.times_s, found.means_base_m, np.nan * found.covariances_m2, 0.0),
            "ValueError: .*covariances with a NaN",
        ),
    ],
)
def test_an_invalid_predictor_is_reported(method, how, message):
    with pytest.raises(SettingsError, match=f"predictor Failing: {message}"):
        check_predictor(failing(method, how))


@pytest.mark.parametrize(
    ("method", "result", "message"),
    [
        ("forecast_times_s", np.zeros((2, 2)), r"shape \(2, 2\)"),
        ("forecast_times_s", np.array([np.nan]), "1 times, .* finite"),
        ("forecast_times_s", np.array([]), "0 times"),
        ("plan", None, "NoneType, expected a Plan"),
    ],
)
def test_an_invalid_controller_is_reported(method, result, message):
    class Wrong(gz.Reactive):
        pass

    setattr(Wrong, method, lambda self, *arguments: result)
    with pytest.raises(SettingsError, match=message):
        check_controller(Wrong(NECK), NECK)


def test_a_part_that_fails_in_the_warm_up_is_reset_before_the_run():
    class Fails(ConstantVelocity):
        def forecast(self, times_s):
            raise RuntimeError("not yet")

    predictor = Fails()
    warm_up(predictor, LookAhead(NECK), NECK)
    with pytest.raises(NotReadyError):
        ConstantVelocity.forecast(predictor, [0.0])


def test_a_folder_gives_the_model_fitted_without_the_person(tmp_path):
    (tmp_path / "left_out").mkdir()
    for name in ("walker", "left_out/ann"):
        save_walker_model(dataclasses.replace(random_model(), about={"name": name}), tmp_path / f"{name}.npz")
    assert walker_model(tmp_path, "ann").about["name"] == "left_out/ann"
    assert walker_model(tmp_path, "bob").about["name"] == "walker"
    assert walker_model(tmp_path / "walker.npz", "ann").about["name"] == "walker"
    with pytest.raises(SettingsError, match=r"walker\.fitted: .*walker\.npz.*accepted: a model file, or a folder"):
        walker_model(tmp_path / "left_out", "bob")
