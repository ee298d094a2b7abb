"""The diagnosis of a machine that is monitor only: orbits of every bearing, and its own normal.

No model was taught on such a machine.  Each window gives figures of every bearing (first order
without the runout, second, half-order band, the rest, place) and of every housing that is measured;
ten windows are averaged and held against what is normal here
(:mod:`~firmware_py.brain.watch_normal`).  The words, in this order: ``sensor_fault:CHANNEL``,
``none`` (no whole turns), ``whirl``, ``uncommissioned``, ``outside`` (a speed that was not
commissioned), ``normal`` or ``unknown``, with the figures that departed most.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire.channel_map import ChannelMap
from firmware_py.acquire.orders import Orders, analyse
from firmware_py.acquire.windows import Window, Windower, WindowerState
from firmware_py.brain import watch_normal
from firmware_py.brain.verdict import CONFIRM_NS, WHIRL_CLEARANCE_SHARE, WHIRL_SHARE, WINDOWS
from firmware_py.config import Config
from firmware_py.config.bearings import BearingView, views
from firmware_py.config.instances import places
from firmware_py.machine.parts import CLEARANCE, has
from firmware_py.records import N_CHANNELS, Block, Diagnosis, Normal, Quality

WHIRL_M: Final = 5e-6
"""Amplitude of the half-order band that is called whirl where no clearance is known."""
HOUSINGS_MOST: Final = 3
"""Accelerations that are analysed over the shaft's angle, at each bearing; others keep their
limits."""
HISTORY_NS: Final = 6_000_000_000
DEPARTED: Final = 3
"""Figures named with an ``unknown``."""

ORBIT: Final = (
    "1x_cos_um", "1x_sin_um", "1x_log", "1x_back_log", "2x_log", "2x_back_log", "half_log",
    "half_back_log", "not_1x_log", "centre_x_um", "centre_y_um",
)  # fmt: skip
"""Figures of the orbit of a bearing."""
HOUSING: Final = ("rms_log", "1x_log", "2x_log", "half_log")
"""And of a housing."""
ORBIT_FLOOR_M: Final = 2e-7
HOUSING_FLOOR_M_S2: Final = 2e-2
"""Below these an amplitude is noise: ``log10`` is smooth through it."""
LEAST_UM, LEAST_LOG = 0.2, 0.03
"""Least scatter of a place, and of a logarithm (7 %)."""

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Watched:
    """One bearing as it is analysed: its channels in the columns of a window."""

    name: str
    channels: ChannelMap
    housings: tuple[tuple[int, str], ...]
    slow_roll_m: complex
    clearance_m: float
    names: tuple[str, ...]


class Figures(msgspec.Struct, frozen=True, array_like=True):
    """Figures ``row`` (k,) of the window that ended at ``end_ns``, at ``speed_rad_s``."""

    end_ns: int
    speed_rad_s: float
    row: Floats


class WatchState(msgspec.Struct):
    """What is remembered between windows: those of further bearings by name."""

    windowers: dict[str, WindowerState] = {}
    windows: list[Figures] = []
    verdict: str = "none"
    held_since_ns: int = 0
    seq: int = 0
    normal: Normal | None = None


class OrbitWatch:
    """Turns windows of all bearings into diagnoses.

    Parameters
    ----------
    config
        Of a machine that is monitor only.
    """

    def __init__(self, config: Config) -> None:
        self.bearings = [_watched(config, view) for view in views(config)]
        self.names, self.parts, self.columns, floors = _figures(self.bearings)
        self.floors = np.array(floors)
        self._windowers = {
            each.name: Windower(each.channels, config.sampling.rate_hz)
            for each in self.bearings[1:]
        }
        self._others: dict[str, list[Window]] = {}
        self.state = WatchState()

    @property
    def channels(self) -> ChannelMap:
        """Of the first bearing, whose windows the brain cuts."""
        return self.bearings[0].channels

    def save(self) -> WatchState:
        """The state, the windowers' included."""
        self.state.windowers = {name: each.state for name, each in self._windowers.items()}
        return self.state

    def restore(self, state: WatchState, blocks: list[Block]) -> None:
        """Go on from ``state``; ``blocks`` are the newest samples."""
        self.state = state
        for name, windower in self._windowers.items():
            if name in state.windowers:
                windower.restore(state.windowers[name], blocks)

    def take(self, block: Block) -> None:
        """Cut the windows of the further bearings."""
        for name, windower in self._windowers.items():
            found = windower.step(block)
            if found:
                self._others[name] = found

    def step(self, window: Window) -> Diagnosis:
        """Diagnosis after ``window`` of the first bearing, and those of the others that ended with
        it."""
        found, state = self._windows(window), self.state
        bad = [
            name
            for each, own in zip(self.bearings, found, strict=True)
            for column, name in enumerate(each.names)
            if name and (own is None or not own.channel_ok >> column & 1)
        ]
        turning = not window.quality & Quality.NO_MARK
        orders = [analyse(own) if own is not None and turning else None for own in found]
        while state.windows and window.end_ns - state.windows[0].end_ns > HISTORY_NS:
            state.windows.pop(0)
        evidence: dict[str, float] = {}
        if not bad and turning:
            self._hear(window.end_ns, [each for each in orders if each is not None])
        for each, seen in zip(self.bearings, orders, strict=True):
            if seen is not None:
                evidence |= _shown(each, seen)
        verdict, departed = self._verdict(bad, orders)
        return self._record(window, verdict, evidence | departed)

    def _windows(self, window: Window) -> list[Window | None]:
        """The window of each bearing that ends with that of the first."""
        found: list[Window | None] = [window]
        for each in self.bearings[1:]:
            same = [w for w in self._others.get(each.name, ()) if w.end_ns == window.end_ns]
            found.append(same[0] if same else None)
        return found

    def _hear(self, end_ns: int, orders: list[Orders]) -> None:
        windows = self.state.windows
        row = np.concatenate([_row(*pair) for pair in zip(self.bearings, orders, strict=True)])
        windows.append(Figures(end_ns, orders[0].speed_rad_s, row))
        del windows[:-WINDOWS]

    @property
    def mean(self) -> Figures | None:
        """The figures of the last windows; None before there are :data:`WINDOWS`."""
        windows = self.state.windows
        if len(windows) < WINDOWS:
            return None
        row = np.mean([each.row for each in windows], axis=0)
        speed = float(np.mean([each.speed_rad_s for each in windows]))
        return Figures(windows[-1].end_ns, speed, row)

    def _verdict(self, bad: list[str], orders: list[Orders | None]) -> tuple[str, dict[str, float]]:
        """The word, and what stands behind it."""
        if bad:
            return f"sensor_fault:{'+'.join(bad)}", {}
        known = [each for each in orders if each is not None]
        if not known:
            return "none", {}
        if any(_whirls(*pair) for pair in zip(self.bearings, known, strict=True)):
            return "whirl", {}
        normal, mean = self.state.normal, self.mean
        if normal is None or normal.own is None:
            return "uncommissioned", {}
        if mean is None:
            return "none", {}
        if not watch_normal.within(normal, mean.speed_rad_s):
            return "outside", {}
        away = watch_normal.residuals(normal.own, mean.row, mean.speed_rad_s)
        parts = watch_normal.by_part(normal.own, away)
        said = {f"normal_{name}": value for name, value in parts.items()}
        if max(parts.values()) <= 1.0:
            return "normal", said
        most = np.argsort(-np.abs(away), kind="stable")[:DEPARTED].tolist()
        return "unknown", said | {f"departure_{self.names[i]}": float(away[i]) for i in most}

    def _record(self, window: Window, verdict: str, evidence: dict[str, float]) -> Diagnosis:
        state = self.state
        if verdict != state.verdict:
            state.verdict, state.held_since_ns = verdict, window.end_ns
        held_ns = window.end_ns - state.held_since_ns
        state.seq += 1
        return Diagnosis(
            seq=state.seq,
            t_acq_ns=window.end_ns,
            quality=int(window.quality),
            verdict=verdict,
            probability=0.0,
            heads={},
            classes={},
            doubt=False,
            unknown=verdict == "unknown",
            evidence={
                "windows": float(len(state.windows)),
                "held_s": held_ns * 1e-9,
                "confirmed": float(held_ns >= CONFIRM_NS),
            }
            | evidence,
            model="",
        )


def _watched(config: Config, view: BearingView) -> Watched:
    """The columns of a bearing: probes, the housings beside it, and for the first one the other
    standard channels."""
    own, first = places(view.config.machine.channel), view.columns[:2] == (0, 1)
    machine = view.config.machine
    housings = own.accelerations[:HOUSINGS_MOST]
    order = [0, 1, *housings, *(-1 for _ in range(N_CHANNELS - 2 - len(housings)))]
    if first:
        order[5:8] = [own.of("microphone"), own.of("supply_pressure"), own.of("contact_resistance")]
    names = tuple(own.names[i] if i >= 0 else "" for i in order)
    whole = tuple(view.columns[i] if i >= 0 else -1 for i in order)
    channels = ChannelMap.chosen(config, whole)
    rolled = [
        probe.slow_roll_um * 1e-6 * cmath.exp(1j * math.radians(probe.slow_roll_deg))
        for probe in machine.channel[:2]
    ]
    x, y = (channels.to_xy @ np.array(rolled)).tolist()
    known = has(machine, CLEARANCE)
    clearance_m = machine.bearing.radial_clearance_nominal_um * 1e-6 if known else math.nan
    return Watched(
        view.name or "shaft",
        channels,
        tuple((2 + k, own.names[i]) for k, i in enumerate(housings)),
        0.5 * complex(x + 1j * y),
        clearance_m,
        names,
    )


def _figures(bearings: list[Watched]) -> tuple[list[str], list[str], list[int], list[float]]:
    """Names of all figures, parts with how many figures each has, and least scatters."""
    names, parts, columns, floors = list[str](), list[str](), list[int](), list[float]()
    for each in bearings:
        groups = [(each.name, ORBIT), *((name, HOUSING) for _, name in each.housings)]
        for part, figures in groups:
            parts.append(part)
            columns.append(len(figures))
            names += [f"{part}_{figure}" for figure in figures]
            floors += [LEAST_UM if figure.endswith("_um") else LEAST_LOG for figure in figures]
    return names, parts, columns, floors


def _compensated(each: Watched, orders: Orders) -> complex:
    """Forward first order without the runout, m, phase from the mark."""
    x, y = orders.harmonics[:2, 0].tolist()
    return complex(0.5 * (x + 1j * y)) - each.slow_roll_m


def _row(each: Watched, orders: Orders) -> Floats:
    """The figures of one bearing and its housings, in the order of their names."""
    first = _compensated(each, orders)
    logs = [
        abs(first), orders.backward[0], orders.forward[1], orders.backward[1],
        orders.half_forward, orders.half_backward, math.hypot(*orders.not_1x[:2].tolist()),
    ]  # fmt: skip
    orbit = [
        first.real * 1e6, first.imag * 1e6, *(_log(value, ORBIT_FLOOR_M) for value in logs),
        orders.mean[0] * 1e6, orders.mean[1] * 1e6,
    ]  # fmt: skip
    housings = [
        _log(value, HOUSING_FLOOR_M_S2)
        for column, _ in each.housings
        for value in (
            orders.rms[column], abs(orders.harmonics[column, 0]),
            abs(orders.harmonics[column, 1]), orders.half[column],
        )
    ]  # fmt: skip
    return np.array([*orbit, *housings], np.float64)


def _log(value: float, floor: float) -> float:
    """``log10`` of an amplitude above ``floor``, smooth through it."""
    return 0.5 * math.log10(float(value) ** 2 + floor * floor)


def _whirls(each: Watched, orders: Orders) -> bool:
    """Whether a forward half-order orbit of notable size stands beside the first order."""
    known = math.isfinite(each.clearance_m)
    least_m = WHIRL_CLEARANCE_SHARE * each.clearance_m if known else WHIRL_M
    return orders.subsync_share > WHIRL_SHARE and orders.half_forward > least_m


def _shown(each: Watched, orders: Orders) -> dict[str, float]:
    """The amplitudes of one bearing and its housings, in the units of a report."""
    first, um = _compensated(each, orders), 1e6
    found = {
        "1x_compensated_um": abs(first) * um,
        "1x_phase_deg": math.degrees(cmath.phase(first)),
        "1x_um": float(orders.forward[0]) * um,
        "backward_1x_um": float(orders.backward[0]) * um,
        "2x_um": float(orders.forward[1]) * um,
        "half_um": orders.half_forward * um,
        "not_1x_um": math.hypot(*orders.not_1x[:2].tolist()) * um,
        "subsync_share": orders.subsync_share,
        "centre_x_um": float(orders.mean[0]) * um,
        "centre_y_um": float(orders.mean[1]) * um,
    }
    named = {f"{each.name}_{key}": value for key, value in found.items()}
    named["speed_rpm"] = orders.speed_rad_s * 30 / math.pi
    return named | {f"{name}_rms_m_s2": float(orders.rms[column]) for column, name in each.housings}
