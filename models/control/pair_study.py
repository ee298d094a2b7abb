"""How often the plausibility of the probe pair cries wolf, and how soon it finds a fault, on random
builds.

    python -m models.control.pair_study --hours 20            # false alarms of healthy builds
    python -m models.control.pair_study --faults --builds 40  # share found, and time to detect, by
    fault python -m models.control.pair_study --rest --builds 40    # shafts that stand, healthy and
    not

Rig, sample blocks and the guard's own parts, without wire and arming: the machine follows a random
duty, and its clearance wanders through what the shield admits.  Each build draws its calibration,
runout, clearance and oil.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from typing import Final

import numpy as np

from firmware_py.acquire.channel_ok import ChannelOk
from firmware_py.config import SHIPPED, Config, load
from firmware_py.guard.envelope.admissible import Envelope, EnvelopeInput, Known
from firmware_py.guard.measurement.motion import MotionMeter
from firmware_py.guard.plausibility.pair import PairCheck
from firmware_py.guard.plausibility.pair_window import KINDS
from firmware_py.records import Block
from sim_hil.plant.build import Build
from sim_hil.plant.duty import Duty
from sim_hil.plant.machine import SimulatedMachine
from sim_hil.processes import end_with_parent
from sim_hil.rigs import load_rig
from sim_hil.rotor.parameters import TRUTH_COLUMNS, Floats

RATE_HZ: Final = 5000
ROWS: Final = 30
STEP_BLOCKS: Final = 10
"""Blocks between two looks of the shield: 60 ms."""
WANDER_S: Final = 4.0
"""The wished clearance is drawn anew so often, and then stays until the next."""
EPISODE_S: Final = 120.0
SETTLED_S: Final = 2.0
CHANNEL: Final = "channel"
"""Not a kind of the pair: a displacement channel is not OK, which ends authority at once."""
REST_EPISODE_S: Final = 20.0
START_S: Final = 20.0
"""A fault begins so long after the start of its episode."""

Distort = Callable[[Floats, Floats], Floats]
"""Displacements in counts, shape (n, 2), and seconds since the fault began: what the channels read
then."""

_COLUMN = {name: i for i, name in enumerate(TRUTH_COLUMNS)}


def _gain(x: float, y: float) -> Distort:
    return lambda c, t: c * np.array([x, y])


FAULTS: Final[dict[str, Distort]] = {
    "gain of x 0.2": _gain(0.2, 1.0),
    "gain of x 0.5": _gain(0.5, 1.0),
    "gain of both 0.2": _gain(0.2, 0.2),
    "gain of both 0.5": _gain(0.5, 0.5),
    "gain of y 2": _gain(1.0, 2.0),
    "swapped": lambda c, t: c[:, ::-1],
    "x copied from y": lambda c, t: c[:, [1, 1]],
    "y copied from x": lambda c, t: c[:, [0, 0]],
    "sign of x reversed": _gain(-1.0, 1.0),
    "sign of y reversed": _gain(1.0, -1.0),
    "both signs reversed": _gain(-1.0, -1.0),
    "offset of x 10 um": lambda c, t: c + np.array([1000.0, 0.0]),
    "offset of y -10 um": lambda c, t: c + np.array([0.0, -1000.0]),
    "drift of x 1 um/s": lambda c, t: c + np.column_stack([100.0 * t, 0.0 * t]),
}


class GuardedBuild:
    """One build behind its guard."""

    def __init__(self, seed: int, config: Config, rest: bool = False) -> None:
        self._rng = np.random.default_rng([seed, 20])
        rig = load_rig("bench")
        self._duty = Duty.random(rig, self._rng, EPISODE_S)
        self._oil_error = float(self._rng.uniform(-rig.errors.oil_C, rig.errors.oil_C))
        most_W = rig.errors.shaft_power_W
        self._power_error = float(self._rng.uniform(-most_W, most_W))
        self._target_m = self._safe_m = config.machine.actuator.safe_radial_clearance_um * 1e-6
        self._rest = rest
        if rest:
            self._duty = Duty((0.0,), (0.0,), self._duty.load_N[:1])
        self._machine = SimulatedMachine(
            rig, Build.draw(rig, self._rng), seed, rate_hz=RATE_HZ, clearance_m=self._safe_m
        )
        self._pressure_Pa = rig.supply.nominal_Pa
        self._noise_m = rig.actuator.position_noise_rms_m
        self._ok, self._meter, self._pair = (
            ChannelOk.of(config),
            MotionMeter(config),
            PairCheck(config),
        )
        self._envelope = Envelope(config)
        self._seq, self._wish, self._wish_s = 0, 0.5, 0.0
        self._left_out = False

    def seconds(
        self, until_s: float, distort: Distort | None = None, start_s: float = 0.0
    ) -> dict[str, float]:
        """Go on until then; when each kind began to stand first."""
        found: dict[str, float] = {}
        while self._seq * ROWS < until_s * RATE_HZ:
            for name in self._step(distort, start_s):
                found.setdefault(name.removeprefix("disp_pair_"), self._seq * ROWS / RATE_HZ)
        return found

    def _step(self, distort: Distort | None, start_s: float) -> list[str]:
        n = STEP_BLOCKS * ROWS
        at = (self._seq * ROWS + np.arange(n + 1)) / RATE_HZ
        batch = self._machine.advance(self._duty.at(at), self._target_m, self._pressure_Pa)
        counts, truth = batch.counts, batch.truth
        if distort is not None:
            changed = distort(counts[:, :2].astype(np.float64), at[:-1] - start_s)
            counts = np.column_stack(
                [np.clip(np.rint(changed), -25000, 25000).astype(np.int16), counts[:, 2:]]
            )
        names = []
        for i in range(0, n, ROWS):
            row = truth[i + ROWS - 1]
            clearance_m = row[_COLUMN["clearance_m"]] + self._noise_m * float(
                self._rng.standard_normal()
            )
            speed, oil_C = (
                float(row[_COLUMN["speed_rad_s"]]),
                float(row[_COLUMN["oil_C"]]) + self._oil_error,
            )
            part = np.ascontiguousarray(counts[i : i + ROWS])
            ok = self._ok.step(part, speed)
            if ok & 3 != 3 and not self._left_out:
                names.append(CHANNEL)
            self._left_out = ok & 3 != 3
            block = Block(
                self._seq,
                self._seq * ROWS * 200_000,
                200_000,
                0,
                200,
                0,
                ok,
                speed,
                0,
                [],
                part.tobytes(),
                self._ok.state.causes,
                self._ok.state.unusable,
            )
            motion = self._meter.step(block)
            p2p_m = max(motion.peak_to_peak_um) * 1e-6
            facts = self._pair.facts(clearance_m, oil_C)
            names += [notice.name for notice in self._pair.step(block, facts, p2p_m)]
            self._seq += 1
        if self._rest:
            return names
        time_s = self._seq * ROWS / RATE_HZ
        power_W = float(row[_COLUMN["shaft_power_W"]]) + self._power_error
        narrow_um = min(clearance_m, self._target_m) * 1e6
        seen = EnvelopeInput(
            (motion.mean_x_m, motion.mean_y_m),
            p2p_m,
            displacement_ok=True,
            whole=motion.complete,
            fast_rad_s=speed,
            slow_rad_s=speed,
            readings=Known(oil_C, clearance_m * 1e6, self._pressure_Pa * 1e-5, power_W),
            oil_C=oil_C,
            narrow_um=narrow_um,
        )
        room = self._envelope.step(seen, (), round(time_s * 1e9)).interval_m
        if time_s >= self._wish_s:
            self._wish, self._wish_s = float(self._rng.uniform()), time_s + WANDER_S
        wished_m = (
            room[0] + self._wish * (room[1] - room[0])
            if room and distort is None
            else self._target_m
        )
        bearing = self._machine.rig.bearing
        within_m = bearing.clearance_min_m, bearing.clearance_max_m
        self._target_m = float(np.clip(wished_m if room else self._safe_m, *within_m))
        return names


@cache
def _config() -> Config:
    """Read once for each process."""
    return load(SHIPPED / "bench")[0]


def healthy(seed: int) -> tuple[float, list[str]]:
    """Seconds of one build and what it cried."""
    found = GuardedBuild(seed, _config()).seconds(EPISODE_S)
    return EPISODE_S, sorted(found)


def faulty(seed: int, fault: str) -> tuple[float, float]:
    """Seconds from the fault to the pair's alarm, and to the loss of authority by it or by a
    channel that is not OK.

    Infinite within half a minute, nan when it cried before.
    """
    run = GuardedBuild(seed, _config())
    if run.seconds(START_S):
        return math.nan, math.nan
    found = run.seconds(START_S + 30.0, FAULTS[fault], START_S)
    first = min(found.values(), default=math.inf) - START_S
    found.pop(CHANNEL, None)
    return min(found.values(), default=math.inf) - START_S, first


def resting(seed: int, fault: str) -> list[str]:
    """What a shaft that stands in the safe clearance brings, with a fault from the first sample
    on."""
    return sorted(
        GuardedBuild(seed, _config(), rest=True).seconds(REST_EPISODE_S, FAULTS.get(fault))
    )


def upper_limit(count: int) -> float:
    """Upper 95 % limit of a Poisson mean of which ``count`` were seen."""
    low, high = 0.0, 10.0 + 4.0 * count
    for _ in range(60):
        mean = 0.5 * (low + high)
        term = total = math.exp(-mean)
        for k in range(1, count + 1):
            term *= mean / k
            total += term
        low, high = (mean, high) if total > 0.05 else (low, mean)
    return high


def main() -> int:
    """Print the rate of false alarms, or the table of faults; 1 when there was more than one in 20
    hours."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--hours", type=float, default=0.5, help="simulated time of healthy builds")
    parser.add_argument("--faults", action="store_true", help="instead: how soon faults are found")
    parser.add_argument("--rest", action="store_true", help="instead: shafts that stand")
    parser.add_argument("--builds", type=int, default=10, help="builds for each fault")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    asked = parser.parse_args()
    with ProcessPoolExecutor(asked.workers, initializer=end_with_parent) as pool:
        if asked.rest:
            for fault in ("none", "gain of both 0.2", "gain of both 0.5", "gain of x 0.2"):
                seeds = range(asked.seed, asked.seed + asked.builds)
                found = list(pool.map(resting, seeds, [fault] * asked.builds))
                named = [names for names in found if set(names) - {CHANNEL}]
                print(f"{fault:22s} named in {len(named):3d} of {len(found):3d}", flush=True)
            return 0
        if asked.faults:
            for fault in FAULTS:
                seeds = range(asked.seed, asked.seed + asked.builds)
                times = [
                    t
                    for t in pool.map(faulty, seeds, [fault] * asked.builds)
                    if not math.isnan(t[0])
                ]
                caught = sorted(t for t, _ in times if math.isfinite(t))
                median = caught[len(caught) // 2] if caught else math.inf
                last = caught[-1] if caught else math.inf
                ended = sorted(first for _, first in times if math.isfinite(first))
                print(
                    f"{fault:22s} named in {len(caught):3d} of {len(times):3d}, after "
                    f"{median:5.1f} s (median), "
                    f"{last:5.1f} s at most; authority gone in {len(ended):3d}, after "
                    f"{ended[len(ended) // 2] if ended else math.inf:5.1f} s (median)",
                    flush=True,
                )
            return 0
        episodes = max(1, round(asked.hours * 3600.0 / EPISODE_S))
        hours, cries = 0.0, dict.fromkeys(KINDS, 0)
        seeds = range(asked.seed, asked.seed + episodes)
        for seed, (seconds, kinds) in zip(seeds, pool.map(healthy, seeds), strict=True):
            hours += seconds / 3600.0
            for kind in kinds:
                if kind in cries:
                    cries[kind] += 1
                    print(f"seed {seed}: {kind}", flush=True)
            if (seed - asked.seed) % 30 == 29:
                print(f"{hours:.1f} h, {sum(cries.values())} false alarms", flush=True)
        total = sum(cries.values())
        print(
            f"{total} false alarms {cries} in {hours:.2f} simulated hours of {episodes} builds: "
            f"{20 * total / hours:.2f} in 20 h, at most {20 * upper_limit(total) / hours:.2f} "
            f"(95 %)"
        )
        return int(20 * total / hours > 1.0)


if __name__ == "__main__":
    raise SystemExit(main())
