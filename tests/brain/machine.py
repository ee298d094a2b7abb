"""A rotor on the test film as the guard would report it: blocks and rig readings at a chosen
operating point."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from firmware_py import config
from firmware_py.acquire.channel_map import WIRE_SCALES
from firmware_py.brain.film import Film, Points
from firmware_py.brain.session import Session
from firmware_py.brain.store import Model, Models, read_card
from firmware_py.machine.contact import contact_volt
from firmware_py.machine.lubricant import viscosity_Pa_s
from firmware_py.records import (
    Block,
    NodeMode,
    NodeState,
    PeerRecord,
    Quality,
    RigReading,
    RigStatus,
)

from .onnx_models import actor, classifier, short_film

CONFIG, _ = config.load(config.SHIPPED / "bench")
assert CONFIG.machine.contact is not None
CONTACT = CONFIG.machine.contact
RATE = CONFIG.sampling.rate_hz
PERIOD_US = 1_000_000 // RATE


def model(data: bytes) -> Model:
    """A model as the store would hand it out, without its checks."""
    session = Session("test.onnx", data)
    return Model(read_card("test.onnx", session.metadata), session, "0" * 64)


def models(clearance_m: float = 80e-6, **of_classifier: object) -> Models:
    """All three models."""
    return Models(
        model(classifier(**of_classifier)), model(actor(clearance_m)), model(short_film())
    )  # type: ignore[arg-type]


@cache
def film(nodes: int = 60) -> Film:
    """The film functions on the test surrogate; more nodes around the bearing are more exact."""
    b = CONFIG.machine.bearing
    return Film(
        Session("film", short_film(nodes)),
        b.journal_radius_m,
        b.length_m,
        CONFIG.machine.rotor.mass_at_bearing_kg,
    )


@dataclass
class Machine:
    """State of the machine; change it between calls of :meth:`run`."""

    speed_rpm: float = 6000.0
    load_N: float = 100.0
    clearance_m: float = 60e-6
    unbalance_kg_m: float = 1.7e-5
    oil_C: float = 50.0
    half_m: float = 0.0
    tick_us: int = 5_000_000
    angle: float = 0.0
    seq: int = 0
    offset_ns: int = 1_000_000_000

    @property
    def viscosity_Pa_s(self) -> float:
        return viscosity_Pa_s(CONFIG.machine.lubricant, self.oil_C)

    def points(self) -> Points:
        return Points(
            *(
                np.array([v])
                for v in (
                    self.speed_rpm * np.pi / 30,
                    self.clearance_m,
                    self.viscosity_Pa_s,
                    self.load_N,
                )
            )
        )

    @property
    def now_ns(self) -> int:
        return self.offset_ns + self.tick_us * 1000

    def run(self, seconds: float) -> list[PeerRecord]:
        """Blocks of 30 samples and a reading every 48 ms."""
        steady = film().steady(self.points())
        out: list[PeerRecord] = []
        for number in range(round(seconds * RATE / 30)):
            out.append(self._block(steady))
            if number % 8 == 0:
                out.append(self._reading(float(steady.power_W[0])))
        return out

    def _block(self, steady: object) -> Block:
        speed = self.speed_rpm * np.pi / 30
        t = np.arange(30) * PERIOD_US * 1e-6
        angle = self.angle + speed * t
        q = steady.response_m_per_kg_m[0] * self.unbalance_kg_m  # type: ignore[attr-defined]
        orbit = (
            complex(*steady.position_m[0])
            + np.real(q[0] * np.exp(1j * angle))
            + 1j
            * np.real(  # type: ignore[attr-defined]
                q[1] * np.exp(1j * angle)
            )
            + self.half_m * np.exp(0.48j * angle)
        )
        probes = orbit * np.exp(-0.25j * np.pi)
        acceleration = [
            2.0 * np.cos(angle + k) + 0.1 * np.sin(1234.5 * angle + k) for k in range(3)
        ]
        si = np.column_stack(
            [
                probes.real,
                probes.imag,
                *acceleration,
                0.1 * np.sin(777.7 * angle),
                np.full(30, 1.0),
                contact_volt(CONTACT, self.clearance_m - np.abs(orbit)),
            ]
        )
        end = self.angle + speed * 30 * PERIOD_US * 1e-6
        turns = np.arange(np.ceil(self.angle / (2 * np.pi)), np.ceil(end / (2 * np.pi)))
        marks = [self.tick_us + round((k * 2 * np.pi - self.angle) / speed * 1e6) for k in turns]
        counts = np.round(si / np.array(WIRE_SCALES)).astype("<i2")
        block = Block(
            self.seq,
            self.now_ns,
            PERIOD_US * 1000,
            self.tick_us,
            PERIOD_US,
            Quality.GOOD,
            0xFF,
            speed,
            int(end / (2 * np.pi)),
            marks,
            counts.tobytes(),
        )
        self.seq += 1
        self.tick_us += 30 * PERIOD_US
        self.angle = end
        return block

    def _reading(self, power_W: float) -> RigReading:
        status = RigStatus(
            0, self.tick_us % 2**32, power_W, self.oil_C, self.clearance_m * 1e6, 1.0
        )
        node = NodeState(
            0, self.tick_us, NodeMode.FOLLOWING, 1, 0, self.clearance_m * 1e6, 1.0, True, 0, 0, 0, 0
        )
        return RigReading(self.seq, self.now_ns, 0, status, node)
