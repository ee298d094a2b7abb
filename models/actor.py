"""Trainer of the clearance agent: DDPG behind the guard's shield, beside fixed clearances and a lookup table."""

from __future__ import annotations

import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from models import card, export, figures
from models.ddpg import Actor, DdpgSettings, Scale, train_ddpg
from models.lookup import lookup_policy
from models.runs import Run, Settings, progress_bar
from models.shielded import Observation, Policy, Score, ShieldedRotor, episodes
from sim_hil.environment import OBSERVATIONS, RotorEnv
from sim_hil.rigs import load_rig

JUDGE_SEED = 1_000_000
"""Added to the seed of judged episodes, so that no training sees them."""

RANGES = {
    "speed_rad_s": (100.0, 1400.0),
    "eccentricity_x_m": (-1.2e-4, 1.2e-4),
    "eccentricity_y_m": (-1.2e-4, 1.2e-4),
    "peak_to_peak_x_m": (0.0, 1e-4),
    "peak_to_peak_y_m": (0.0, 1e-4),
    "clearance_m": (3e-5, 1.7e-4),
    "supply_pressure_bar": (0.0, 4.0),
    "shaft_power_W": (-10.0, 500.0),
    "oil_outlet_C": (20.0, 80.0),
    "load_estimate_N": (0.0, 500.0),
    "subsync_share": (0.0, 1.0),
}
"""What a working machine shows: the scale of the network's inputs, and the model's domain."""


class ActorSettings(Settings, frozen=True):
    """What ``orbitd train actor`` does; every key may stand in the ``--config`` file."""

    rig: str = "bench"
    episode_s: float = 15.0
    ddpg: DdpgSettings = DdpgSettings()
    judged_episodes: int = 12
    judged_seconds: float = 20.0
    lookup_points: tuple[int, int, int] = (7, 6, 13)
    fixed_um: tuple[float, ...] = (50.0, 60.0, 70.0, 90.0)

    def smoked(self) -> ActorSettings:
        """The same training in some seconds."""
        return ActorSettings(
            episode_s=2.0, ddpg=DdpgSettings(steps=250, warm_up=100, batch=32, hidden=(16, 16)),
            judged_episodes=2, judged_seconds=1.0, lookup_points=(2, 2, 3), fixed_um=(60.0, 100.0),
        )  # fmt: skip


SETTINGS = ActorSettings


class Clearance(nn.Module):
    """``observation (m, 11)`` in SI -> ``clearance (m, 1)`` in metres, inside the bearing's range."""

    def __init__(self, actor: Actor, low_m: float, high_m: float) -> None:
        super().__init__()
        self.actor, self.low_m, self.high_m = actor, low_m, high_m

    def forward(self, observation: Tensor) -> Tensor:
        """Scaled and clipped inside the graph."""
        share = 0.5 * (self.actor(observation) + 1.0)
        return torch.clamp(self.low_m + share * (self.high_m - self.low_m), self.low_m, self.high_m)


def train(run: Run, settings: ActorSettings) -> dict[str, object]:
    """Train, judge and export; returns the report that is written beside the model."""
    started = time.monotonic()
    bearing = load_rig(settings.rig).bearing
    actor = _learn(run, settings)
    module = Clearance(actor, bearing.clearance_min_m, bearing.clearance_max_m)
    trained_s = round(time.monotonic() - started, 1)
    comparison = compare(of_module(module), settings, run.seed)
    report: dict[str, object] = {
        "unseen_episodes": comparison,
        "training": {"steps": settings.ddpg.steps, "seconds": trained_s},
        "reproduce": run.command,
    }
    _export(module, run, settings, report)
    figures.actor(run.folder, comparison["policies"])
    return report


def compare(agent: Policy, settings: ActorSettings, seed: int) -> dict[str, Any]:
    """The agent and what could replace it on the same unseen episodes.

    Behind the shield: ``agent``, ``lookup``, and ``widest``, which always wishes for the largest clearance and
    so shows what the shield alone gives.  Without it: ``agent_without_shield`` and the fixed clearances.
    ``saving_percent`` is the fall of mean power against the nominal fixed clearance, and against the fixed
    clearance of least power whose time in violation is no longer than the nominal's.
    """
    with progress_bar("lookup table", settings.lookup_points[0]) as bar:
        lookup = lookup_policy(settings.rig, settings.lookup_points, bar)
    nominal_um = 1e6 * load_rig(settings.rig).bearing.clearance_nominal_m
    seeds = range(JUDGE_SEED + 1000 * seed, JUDGE_SEED + 1000 * seed + settings.judged_episodes)
    policies: dict[str, tuple[Policy, bool]] = {
        "agent": (agent, True),
        "agent_without_shield": (agent, False),
        "lookup": (lookup, True),
        "widest": (_fixed(1e6 * load_rig(settings.rig).bearing.clearance_max_m), True),
        **{f"fixed_{um:g}_um": (_fixed(um), False) for um in settings.fixed_um},
    }
    results: dict[str, Score] = {}
    with progress_bar("unseen episodes", len(policies)) as bar:
        for done, (name, (policy, shielded)) in enumerate(policies.items(), 1):
            results[name] = episodes(policy, seeds, settings.judged_seconds, shielded=shielded, rig=settings.rig)
            bar(done)
    nominal = results[f"fixed_{nominal_um:g}_um"]
    fixed = {n: r for n, r in results.items() if n.startswith("fixed") and r.violation_s <= nominal.violation_s}
    best_fixed = min(fixed, key=lambda name: fixed[name].power_W)
    return {
        "policies": {name: _rounded(score) for name, score in results.items()},
        "best_fixed_no_worse_than_nominal": best_fixed,
        "saving_percent": {
            name: {"against_nominal": _saving(results[name], nominal),
                   "against_best_fixed": _saving(results[name], fixed[best_fixed])}
            for name in ("agent", "lookup", "widest")
        },
    }  # fmt: skip


def of_module(module: Clearance) -> Policy:
    """A torch module as a policy."""

    def policy(observation: Observation) -> float:
        with torch.no_grad():
            return float(module(torch.from_numpy(observation[None]))[0, 0])

    return policy


def of_file(path: Path) -> Policy:
    """An exported file as a policy."""
    session = export.session(path)
    return lambda observation: float(session.run(["clearance"], {"observation": observation[None]})[0][0, 0])


def _learn(run: Run, settings: ActorSettings) -> Actor:
    environment = ShieldedRotor(RotorEnv(settings.rig, episode_s=settings.episode_s))
    low, high = np.array([RANGES[name] for name in OBSERVATIONS], np.float32).T
    torch.set_num_threads(1)
    with progress_bar("DDPG", settings.ddpg.steps) as bar:
        actor = train_ddpg(
            environment, Scale(low, high), settings.ddpg, run.seed, on_step=bar,
            on_episode=lambda step, total: run.log({"step": step, "return": round(total, 3)}),
        )  # fmt: skip
    torch.save(actor.state_dict(), run.folder / "actor.pt")
    return actor


def _fixed(clearance_um: float) -> Policy:
    return lambda _: clearance_um * 1e-6


def _saving(score: Score, reference: Score) -> float:
    return round(100.0 * (1.0 - score.power_W / reference.power_W), 2)


def _rounded(score: Score) -> dict[str, float]:
    figures = asdict(score)
    del figures["episode_power_W"]
    return {name: float(f"{figure:.4g}") for name, figure in figures.items()}


def _export(module: Clearance, run: Run, settings: ActorSettings, report: dict[str, object]) -> None:
    names = tuple(OBSERVATIONS)
    metadata = export.Metadata(
        kind="actor", version="0.1.0", inputs=names, outputs=("clearance",), rate_hz=(10,), channels=(),
        units=("rad/s", "m", "m", "m", "m", "m", "bar", "W", "degC", "N", "1", "-> m"), rigs=(settings.rig,),
        domain={name: RANGES[name] for name in names}, data_hash=export.data_hash(np.array([run.seed])),
        metrics=report,
    )  # fmt: skip
    example = torch.zeros(2, len(names))
    export.export(module, example, run.model, input_name="observation", output_names=("clearance",), metadata=metadata)
    report["export_parity"] = export.parity(module, run.model, random_observations(10_000, run.seed))
    run.write_json("actor.json", report)
    card.write(run, report, card.ACTOR)


def random_observations(count: int, seed: int) -> NDArray[np.float32]:
    """Observations over the ranges and beyond, corners first."""
    low, high = np.array(list(RANGES.values())).T
    rng = np.random.default_rng(seed)
    corners = rng.integers(0, 2, (min(count, 2 ** min(len(low), 10)), len(low)))
    spread = rng.uniform(-0.5, 1.5, (count - len(corners), len(low)))
    share = np.concatenate([corners.astype(np.float64), spread])
    return np.asarray(low + share * (high - low), np.float32)
