"""Trainer of the film-force surrogate: the reduced network by Levenberg-Marquardt, with its rivals beside it."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from models import card, export, figures
from models.film_data import FilmSamples, draw_points, solve_points
from models.film_network import STATE, ReducedFilm, half_film_integrals
from models.film_rivals import rivals
from models.levenberg_marquardt import LmOptions, LmResult, levenberg_marquardt
from models.network import Mlp
from models.runs import Run, Settings, progress_bar

Floats = NDArray[np.float64]
FilmModel = Callable[[Floats], Sequence[Floats]]
"""State ``(m, 9)`` in SI to force ``(m, 2)``, friction torque and side flow ``(m, 1)``."""

ECCENTRICITY_JUDGED = 0.95
JUDGE_SEED = 1_000_000
"""Stands before the seed of judged films, so that they are never those of a training seed."""


class SurrogateSettings(Settings, frozen=True):
    """What ``orbitd train surrogate`` does; every key may stand in the ``--config`` file."""

    length_over_diameter: float = 0.5
    eccentricity_max: float = 0.97
    train_points: int = 1500
    judge_points: int = 300
    grid: tuple[int, int] = (240, 48)
    judge_grid: tuple[int, int] = (320, 64)
    hidden: tuple[int, ...] = (8, 8)
    l2: tuple[float, ...] = (1e-9, 1e-7)
    restarts: int = 3
    iterations: int = 800

    def smoked(self) -> SurrogateSettings:
        """The same training in a few seconds."""
        return SurrogateSettings(
            train_points=300, judge_points=40, grid=(120, 16), judge_grid=(160, 20), restarts=1, iterations=150,
            l2=(1e-8,),
        )  # fmt: skip


SETTINGS = SurrogateSettings


@dataclass(frozen=True)
class Targets:
    """What the network learns: inputs ``(a, b^2)``, three logarithms, and their share in the force's error."""

    x: Floats
    y: Floats
    weight: Floats

    @classmethod
    def of(cls, samples: FilmSamples) -> Targets:
        """Logarithms of film over short film (along, across) and of the side flow."""
        a, b = samples.ab[:, :1], samples.ab[:, 1:]
        along, across = (j.numpy()[:, 0] for j in half_film_integrals(torch.tensor(a), torch.tensor(b)))
        size = np.hypot(samples.force[:, 0], samples.force[:, 1])
        ratio = np.ones_like(along)
        np.divide(-samples.force[:, 1], across, out=ratio, where=b[:, 0] > 1e-9)
        y = np.log(np.stack([-samples.force[:, 0] / along, ratio, samples.side_flow], axis=1))
        share = np.abs(samples.force) / size[:, None]
        share[b[:, 0] <= 1e-9, 1] = 0.0
        return cls(np.hstack([a, b * b]), y, np.column_stack([share, np.ones(len(size))]))

    def subset(self, rows: NDArray[np.bool_]) -> Targets:
        """The targets at ``rows``."""
        return Targets(self.x[rows], self.y[rows], self.weight[rows])

    def error(self, net: Mlp, theta: Floats) -> Floats:
        """Weighted error ``(m, 3)``: columns 0 and 1 are the relative force error's two parts."""
        error: Floats = (net.outputs(theta, self.x) - self.y) * self.weight
        return error


def train(run: Run, settings: SurrogateSettings) -> dict[str, object]:
    """Train, judge and export; returns the report that is written beside the model."""
    started = time.monotonic()
    rng = np.random.default_rng(run.seed)
    points = draw_points(settings.train_points, settings.eccentricity_max, rng)
    with progress_bar("film solutions", len(points)) as bar:
        samples = solve_points(
            points, length_over_diameter=settings.length_over_diameter, grid=settings.grid, progress=bar
        )
    judged = unseen(settings, np.random.default_rng([JUDGE_SEED, run.seed]))
    net = Mlp((2, *settings.hidden, 3))
    fit = _fit(net, Targets.of(samples), settings, run, rng)
    module = ReducedFilm(net.layers(fit.theta))
    report = {
        "reduced_network": {
            "sizes": net.sizes,
            "weights": net.count,
            **judge(of_module(module), judged, settings.length_over_diameter),
        },
        "rivals": rivals(judged, settings.length_over_diameter, rng),
        "training": {"points": settings.train_points, "seconds": round(time.monotonic() - started, 1)},
        "reproduce": run.command,
    }
    _export(module, run, samples, settings, report)
    figures.surrogate(run.folder, judged, answer(of_module(module), judged.ab, settings.length_over_diameter)[0])
    return report


def judge(film: FilmModel, judged: FilmSamples, length_over_diameter: float) -> dict[str, float]:
    """Relative error of force and side flow against unseen films (the torque follows from the force)."""
    force, flow = answer(film, judged.ab, length_over_diameter)
    size = np.hypot(judged.force[:, 0], judged.force[:, 1])
    error = np.hypot(*(force - judged.force).T)
    return {
        "force_relative_rms_percent": _percent(np.sqrt(np.mean((error / size) ** 2))),
        "force_rms_over_rms_percent": _percent(np.sqrt(np.mean(error**2) / np.mean(size**2))),
        "force_relative_p95_percent": _percent(np.quantile(error / size, 0.95)),
        "side_flow_relative_rms_percent": _percent(np.sqrt(np.mean((flow / judged.side_flow - 1.0) ** 2))),
    }


def answer(film: FilmModel, ab: Floats, length_over_diameter: float) -> tuple[Floats, Floats]:
    """Dimensionless force ``(m, 2)`` and side flow ``(m,)`` of a model that takes the nine SI inputs."""
    state = np.zeros((len(ab), 9))
    clearance, viscosity, radius, speed = 5e-5, 0.02, 0.03, 0.02
    length = 2.0 * radius * length_over_diameter
    state[:, :2] = ab * clearance
    state[:, 2] = speed
    state[:, 5:] = clearance, viscosity, radius, length
    force, _, flow = film(state)
    gain = viscosity * radius * length**3 * speed / clearance**3
    return force / gain, flow[:, 0] / (2.0 * radius * length * speed)


def of_module(module: ReducedFilm) -> FilmModel:
    """A torch module as a :data:`FilmModel`."""

    def film(state: Floats) -> Sequence[Floats]:
        with torch.no_grad():
            return [output.numpy() for output in module(torch.from_numpy(state))]

    return film


def of_file(path: Path) -> FilmModel:
    """An exported file as a :data:`FilmModel`."""
    run = export.session(path)
    return lambda state: run.run(None, {"state": state})


def _percent(share: float) -> float:
    return round(100.0 * float(share), 4)


def unseen(settings: SurrogateSettings, rng: np.random.Generator) -> FilmSamples:
    """Films on the finer grid at new points up to the judged eccentricity."""
    points = draw_points(settings.judge_points, ECCENTRICITY_JUDGED, rng)
    with progress_bar("unseen films", len(points)) as bar:
        return solve_points(
            points,
            length_over_diameter=settings.length_over_diameter,
            grid=settings.judge_grid,
            progress=bar,
        )


def _fit(net: Mlp, targets: Targets, settings: SurrogateSettings, run: Run, rng: np.random.Generator) -> LmResult:
    """Restarts and weight decay by the force error on every fourth point, which no restart trains on."""
    held_out = np.arange(len(targets.x)) % 4 == 0
    train_on, validate = targets.subset(~held_out), targets.subset(held_out)

    def residuals(theta: Floats) -> tuple[Floats, Floats]:
        outputs, jacobian = net.jacobian(theta, train_on.x)
        weighted = (jacobian * train_on.weight[:, :, None]).reshape(-1, net.count)
        return ((outputs - train_on.y) * train_on.weight).ravel(), weighted

    def score(theta: Floats) -> float:
        return float(np.sqrt(np.mean(np.sum(validate.error(net, theta)[:, :2] ** 2, axis=1))))

    results = []
    options = LmOptions(iterations=settings.iterations)
    for l2 in settings.l2:
        for restart in range(settings.restarts):
            with progress_bar(f"Levenberg-Marquardt, l2 {l2:g}, start {restart + 1}", settings.iterations) as bar:
                result = levenberg_marquardt(
                    residuals, net.initial(rng), l2=l2, penalised=net.is_weight(), monitor=score,
                    options=options, progress=bar,
                )  # fmt: skip
            run.log({"l2": l2, "restart": restart, "validation": result.score, "iterations": result.iterations,
                     "reason": result.reason})  # fmt: skip
            results.append(result)
    return min(results, key=lambda r: r.score)


def _export(
    module: ReducedFilm, run: Run, samples: FilmSamples, settings: SurrogateSettings, report: dict[str, object]
) -> None:
    half = settings.length_over_diameter
    metadata = export.Metadata(
        kind="surrogate", version="0.1.0", inputs=STATE, outputs=("force", "friction_torque", "side_flow"),
        units=("m", "m", "m/s", "m/s", "rad/s", "m", "Pa s", "m", "m", "-> N", "N m", "m3/s"), channels=(),
        rate_hz=(), rigs=("bench",), data_hash=export.data_hash(samples.ab, samples.force, samples.side_flow),
        domain={"eccentricity_ratio": (0.0, settings.eccentricity_max), "length_over_diameter": (half, half)},
        metrics=report,
    )  # fmt: skip
    example = torch.zeros((2, len(STATE)), dtype=torch.float64)
    example[:, 5:] = torch.tensor([6e-5, 0.01, 0.02, 0.02], dtype=torch.float64)
    export.export(module, example, run.model, input_name="state", output_names=metadata.outputs, metadata=metadata)
    report["export_parity"] = export.parity(module, run.model, random_states(10_000, settings, run.seed))
    run.write_json("surrogate.json", report)
    card.write(run, report, card.SURROGATE)


def random_states(count: int, settings: SurrogateSettings, seed: int) -> Floats:
    """States over and beyond the domain: corners, zero speed, both senses, journal outside the clearance."""
    rng = np.random.default_rng(seed)
    state = np.empty((count, 9))
    c, radius = rng.uniform(3e-5, 2e-4, count), rng.uniform(0.01, 0.05, count)
    eps, angle = rng.uniform(0.0, 1.1, count), rng.uniform(-np.pi, np.pi, count)
    eps[:100], eps[100:200] = 0.0, settings.eccentricity_max
    state[:, 0], state[:, 1] = eps * c * np.cos(angle), eps * c * np.sin(angle)
    state[:, 2:4] = rng.normal(0.0, 0.01, (count, 2))
    state[:, 4] = rng.uniform(-1300.0, 1300.0, count)
    state[::10, 4], state[::20, 2:4] = 0.0, 0.0
    state[:, 5], state[:, 6], state[:, 7] = c, rng.uniform(1e-3, 0.05, count), radius
    state[:, 8] = 2.0 * radius * settings.length_over_diameter
    return state
