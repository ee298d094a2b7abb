"""What the reduced network stands beside: the paper's own networks, and the spline table of two
numbers."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from models.film.fit import Fit, Search, Targets, fit
from models.film.judge import FilmModel
from models.film.states import ECCENTRICITY_JUDGED, VELOCITY_JUDGED
from models.learning.network import Mlp
from sim_hil.film.table import FilmTable
from sim_hil.film.table_kernel import table_force
from sim_hil.rigs import load_rig
from sim_hil.rotor.network_law import Perceptron, RawNetworkLaw

Floats = NDArray[np.float64]

HIDDEN = 20
"""n2 is arbitrary in the paper; this is the order of its references."""


def table_model(length_over_diameter: float) -> FilmModel:
    """The shipped spline table as a film model."""
    coefficients = FilmTable.load(length_over_diameter).coefficients

    def film(state: Floats) -> list[Floats]:
        answers = np.array([table_force(coefficients, *row) for row in state])
        return [answers[:, :2], answers[:, 2:3], answers[:, 3:4], np.ones((len(state), 1))]

    return film


@dataclass(frozen=True)
class TrainedBearing:
    """The one bearing, speed and viscosity that a raw network holds for; ``clearances_m`` apart
    only for 5-n-2."""

    clearances_m: tuple[float, float]
    viscosity_Pa_s: float
    speed_rad_s: float
    radius_m: float
    length_m: float

    @classmethod
    def of_rig(
        cls, name: str, speed_rpm: float, clearances_m: tuple[float, float] | None = None
    ) -> TrainedBearing:
        """A rig's bearing at one speed; at its nominal clearance unless a range is given."""
        rig = load_rig(name)
        nominal = rig.bearing.clearance_nominal_m
        return cls(
            clearances_m or (nominal, nominal),
            rig.oil.viscosity_at(rig.oil.inlet_C),
            speed_rpm * np.pi / 30.0,
            rig.bearing.radius_m,
            rig.bearing.length_m,
        )

    @property
    def widest_m(self) -> float:
        """Scale of the lengths."""
        return self.clearances_m[1]

    def draw(self, count: int, rng: np.random.Generator) -> Floats:
        """States ``(count, 9)``: eccentricities to 0.95 evenly in radius, velocities to 0.25 c
        omega."""
        eps, angle = rng.uniform(0.0, ECCENTRICITY_JUDGED, count), rng.uniform(-np.pi, np.pi, count)
        speed, heading = rng.uniform(0.0, VELOCITY_JUDGED, count), rng.uniform(-np.pi, np.pi, count)
        c = rng.uniform(*self.clearances_m, count)
        one = np.ones(count)
        speed *= c * self.speed_rad_s
        return np.column_stack(
            [
                eps * c * np.cos(angle),
                eps * c * np.sin(angle),
                speed * np.cos(heading),
                speed * np.sin(heading),
                self.speed_rad_s * one,
                c,
                self.viscosity_Pa_s * one,
                self.radius_m * one,
                self.length_m * one,
            ]
        )

    def inputs(self, state: Floats) -> Floats:
        """``(X1 X2 V1 V2)``, and the clearance where it varies, in units of the widest and of the
        speed."""
        scale = np.array([1.0, 1.0, self.speed_rad_s, self.speed_rad_s]) * self.widest_m
        moves = self.clearances_m[0] < self.clearances_m[1]
        return (
            np.hstack([state[:, :4] / scale, state[:, 5:6] / self.widest_m])
            if moves
            else state[:, :4] / scale
        )


@dataclass(frozen=True)
class RawNetwork:
    """Equation (5) as printed, trained on the table's film; ``error_percent`` is RMS over RMS of
    the force."""

    bearing: TrainedBearing
    net: Mlp
    fitted: Fit
    force_N: float
    error_percent: float

    @property
    def law(self) -> RawNetworkLaw:
        """The network as the film of a rotor."""
        net = Perceptron.make(self.fitted.theta, self.net.sizes)
        widest = self.bearing.widest_m
        return RawNetworkLaw(net, widest, widest * self.bearing.speed_rad_s, self.force_N)

    def report(self) -> dict[str, object]:
        """Size and error."""
        return {
            "sizes": self.net.sizes,
            "weights": self.net.count,
            "lambda": self.fitted.l2,
            "force_rms_over_rms_percent": round(self.error_percent, 3),
            "starts": self.fitted.starts,
        }


def raw_network(
    bearing: TrainedBearing, rng: np.random.Generator, search: Search, out: Path, points: int = 3000
) -> RawNetwork:
    """Sigmoid network 4-n-2 on (X1 X2 V1 V2), or 5-n-2 with the clearance, by
    Levenberg-Marquardt."""
    film = table_model(bearing.length_m / (2.0 * bearing.radius_m))
    train, judged = bearing.draw(points, rng), bearing.draw(points // 3, rng)
    force, truth = film(train)[0], film(judged)[0]
    scale = float(np.sqrt(np.mean(np.sum(force**2, axis=1))))
    x = bearing.inputs(train)
    net = Mlp((x.shape[1], HIDDEN, 2))
    name = "-".join(map(str, net.sizes))
    fitted = fit(net, Targets(x, force / scale, np.ones_like(force)), search, rng, name, out)
    error = np.sum((scale * net.outputs(fitted.theta, bearing.inputs(judged)) - truth) ** 2, axis=1)
    share = float(np.sqrt(np.mean(error) / np.mean(np.sum(truth**2, axis=1))))
    return RawNetwork(bearing, net, fitted, scale, 100.0 * share)
