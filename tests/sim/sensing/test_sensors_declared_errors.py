"""Errors and settings are declared once for editors, files and compiled code."""

import inspect
from dataclasses import fields

import numpy as np

from laisn import settings
from sim.scenario.parts import SensingSettings
from sim.scenario.settings import Navigation, Scenario
from sim.sensing.sensors import ERRORS, SensorErrors, errors_of


def test_a_scenario_without_keys_has_the_declared_errors() -> None:
    scenario = Scenario(followers=[{"route": "T5"}])
    errors = errors_of(SensingSettings.of(scenario))
    assert errors == SensorErrors()
    assert errors.heading_bias == np.pi / 36.0
    assert ERRORS.names == SensorErrors._fields
    record = np.array([tuple(errors)], ERRORS)[0]
    assert record["range_tau"].tolist() == [0.01, 0.01, 0.01]


def test_each_key_is_in_its_unit() -> None:
    scenario = Scenario(
        followers=[{"route": "T5"}],
        sensors={"heading_sigma_deg": 18.0, "leader_position_drift_m_s": 2.0},
        acoustics={"clock_drift_ppm": 3.0, "range_tau_m": (0.1, 0.2, 0.3)},
    )
    errors = errors_of(SensingSettings.of(scenario))
    assert np.isclose(errors.heading_sigma, np.pi / 10.0, rtol=1e-15)
    assert np.isclose(errors.clock_drift, 3e-6, rtol=1e-15)
    assert errors.range_tau == (0.1, 0.2, 0.3)
    # towards north
    assert (errors.leader_drift_east, errors.leader_drift_north) == (0.0, 2.0)


def test_settings_have_descriptions_and_are_defaults_of_keys_in_their_units() -> None:
    for kind in (settings.NavigationSettings, settings.TightSettings, settings.BeaconSettings):
        declared = [
            field
            for field in fields(kind)
            if field.name in inspect.get_annotations(kind)
            and field.name not in ("variant", "assume")
        ]
        assert all(field.metadata["description"] for field in declared), kind
    assert Navigation.model_fields["threshold_m"].default == settings.NavigationSettings.threshold
    # the keys of the scenario take their descriptions from the settings
    description = Navigation.model_fields["sigma_heading_deg"].description
    assert description == "σθ of the speed update"
    assert Navigation.model_fields["sigma_heading_deg"].default == 2.0
    tuning = settings.Tuning.of(settings.NavigationSettings(alpha=3.0, gate="off"))
    assert (tuning.alpha, tuning.gate) == (3.0, settings.GATE_OFF)
