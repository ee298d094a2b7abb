"""What the reduced network stands beside: the paper's own network, and the spline table of two numbers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from models.film_data import FilmSamples
from models.levenberg_marquardt import LmOptions, levenberg_marquardt
from models.network import Mlp
from sim_hil.film.table import FilmTable
from sim_hil.film.table_kernel import table_force

Floats = NDArray[np.float64]
Force = Callable[[Floats], Floats]

RADIUS_M, CLEARANCE_M, VISCOSITY_PA_S, SPEED_RAD_S = 0.02, 6e-5, 0.01, 628.0
"""The one bearing, clearance and speed that the paper's network can hold."""

HIDDEN = 20
"""n2 is arbitrary in the paper; the order of its references."""


def rivals(judged: FilmSamples, length_over_diameter: float, rng: np.random.Generator) -> dict[str, object]:
    """Errors of the spline table on the judged films, and of the paper's 4-n-2 network on its own variables."""
    force = table(length_over_diameter)
    return {
        "spline_table": table_error(judged, length_over_diameter),
        "paper_4_n_2": paper_network(force, rng),
    }


def table(length_over_diameter: float) -> Force:
    """``(x, y, vx, vy) / (c, c omega)`` ``(m, 4)`` to the force ``(m, 2)`` N of the one bearing, by the table."""
    coefficients = FilmTable.load(length_over_diameter).coefficients
    length = 2.0 * RADIUS_M * length_over_diameter

    def force(x: Floats) -> Floats:
        scaled = x * np.array([1.0, 1.0, SPEED_RAD_S, SPEED_RAD_S]) * CLEARANCE_M
        one = (SPEED_RAD_S, CLEARANCE_M, VISCOSITY_PA_S, RADIUS_M, length)
        return np.array([table_force(coefficients, *row, *one)[:2] for row in scaled])

    return force


def paper_network(force: Force, rng: np.random.Generator, points: int = 3000) -> dict[str, object]:
    """Equation (5) as printed: sigmoid 4-n-2 on (X1 X2 V1 V2), one clearance, by Levenberg-Marquardt."""
    train, test = _raw_states(points, rng), _raw_states(points // 3, rng)
    y, judged = force(train), force(test)
    scale = np.sqrt(np.mean(np.sum(y**2, axis=1)))
    net = Mlp((4, HIDDEN, 2))

    def residuals(theta: Floats) -> tuple[Floats, Floats]:
        outputs, jacobian = net.jacobian(theta, train)
        return (outputs - y / scale).ravel(), jacobian.reshape(-1, net.count)

    result = levenberg_marquardt(residuals, net.initial(rng), options=LmOptions(iterations=300))
    error = np.sum((scale * net.outputs(result.theta, test) - judged) ** 2, axis=1)
    share = float(np.sqrt(np.mean(error) / np.mean(np.sum(judged**2, axis=1))))
    return {"sizes": net.sizes, "weights": net.count, "force_rms_over_rms_percent": round(100.0 * share, 3)}


def _raw_states(count: int, rng: np.random.Generator) -> Floats:
    """Eccentricities to 0.95 evenly in radius, velocities to 0.25 c omega."""
    eps, angle = rng.uniform(0.0, 0.95, count), rng.uniform(-np.pi, np.pi, count)
    speed, heading = rng.uniform(0.0, 0.25, count), rng.uniform(-np.pi, np.pi, count)
    columns = (eps * np.cos(angle), eps * np.sin(angle), speed * np.cos(heading), speed * np.sin(heading))
    return np.column_stack(columns)


def table_error(judged: FilmSamples, length_over_diameter: float) -> dict[str, float]:
    """Error of the spline table on the judged films."""
    coefficients = FilmTable.load(length_over_diameter).coefficients
    c, mu, length, speed = CLEARANCE_M, VISCOSITY_PA_S, 2.0 * RADIUS_M * length_over_diameter, 0.01
    gain = mu * RADIUS_M * length**3 * speed / c**3
    force = np.array([
        table_force(coefficients, a * c, b * c, speed, 0.0, 0.0, c, mu, RADIUS_M, length)[:2]
        for a, b in judged.ab
    ])  # fmt: skip
    error = np.hypot(*(force / gain - judged.force).T) / np.hypot(*judged.force.T)
    return {
        "force_relative_rms_percent": round(100.0 * float(np.sqrt(np.mean(error**2))), 4),
        "force_relative_p95_percent": round(100.0 * float(np.quantile(error, 0.95)), 4),
    }
