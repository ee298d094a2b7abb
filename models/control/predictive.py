"""Model-predictive choice: the brain's own predictor says what each clearance would bring, the
cheapest good one wins.

Each rotor has its predictor, synchronised from the same observations as every other policy.  A
candidate is good where the brain's policy would call it good
(:func:`firmware_py.brain.overrule.good`) as the machine runs now, and also after
:data:`AHEAD_S` of the fastest unannounced ramps, light and fast as well as slow and heavy.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.brain.measurement import Measured
from firmware_py.brain.overrule import OverruleLimits, good
from firmware_py.brain.prediction import HELD, Future, Predictor
from firmware_py.brain.store import load_factors, load_model
from models.control.shielded import Observation, column
from sim_hil.gym.control_task import CONTROL_S
from sim_hil.rigs import load_rig

Floats = NDArray[np.float64]

AHEAD_S: Final = 0.5
"""How far ahead a ramp is foreseen: the shield or the next choices move the bearing by 25 um in
that time."""


class ModelPredictive:
    """Clearance of least expected power among those whose forecasts are good.

    Parameters
    ----------
    rig
        Whose shipped configuration and surrogate are taken.
    """

    def __init__(self, rig: str) -> None:
        self._rig = rig

    def __getstate__(self) -> dict[str, Any]:
        """The rig alone: sessions are made where an episode starts."""
        return {"_rig": self._rig}

    def start(self, count: int) -> None:
        """Predictors that know nothing yet."""
        config = load_rig(self._rig).config
        model = load_model("surrogate", config)
        self._config, self._limits = config, OverruleLimits.of(config)
        self._predictors = [Predictor(model, config, load_factors(config)) for _ in range(count)]
        self._step = 0

    def __call__(self, observation: Observation) -> Floats:
        """As :class:`models.control.episodes.SettingPolicy`."""
        self._step += 1
        rows = zip(self._predictors, observation.astype(np.float64), strict=True)
        return np.array([[self._choose(predictor, seen)] for predictor, seen in rows])

    def _choose(self, predictor: Predictor, seen: Floats) -> float:
        measured = self._measured(seen)
        estimate = predictor.estimate(measured)
        left, power = predictor.candidates_m, np.empty(0)
        for future in (*self._ramps(measured), HELD):
            outlook = predictor.forecast(measured, estimate, left, future)
            keeps = good(outlook, measured.clearance_m, self._limits)
            if not keeps.any():
                return self._limits.safe_m
            left, power = left[keeps], outlook.power_W[keeps, 1]
        return float(left[np.argmin(power)])

    def _ramps(self, measured: Measured) -> list[Future]:
        """To faster and lighter, and to slower and heavier, within the declared speeds."""
        o = self._config.machine.operating
        low, high = o.speed_min_rpm * np.pi / 30.0, o.speed_max_rpm * np.pi / 30.0
        speed, load = (
            AHEAD_S * rate
            for rate in (o.speed_ramp_unannounced_rpm_s * np.pi / 30.0, o.load_ramp_unannounced_N_s)
        )
        return [
            Future(AHEAD_S, min(high, measured.speed_rad_s + speed), -load),
            Future(AHEAD_S, max(low, measured.speed_rad_s - speed), load),
        ]

    def _measured(self, seen: Floats) -> Measured:
        def of(name: str) -> float:
            return float(seen[column(name)])

        return Measured(
            of("speed_rad_s"),
            of("clearance_m"),
            of("eccentricity_x_m"),
            of("eccentricity_y_m"),
            max(of("peak_to_peak_x_m"), of("peak_to_peak_y_m")),
            of("shaft_power_W"),
            of("oil_outlet_C"),
            t_ns=round(1e9 * CONTROL_S * self._step),
        )
