"""The tables of the configuration: the machine, and how the device runs there."""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal

import msgspec
from msgspec import Meta

from firmware_py.config.measure_schema import (
    MEASURE_WORDS,
    GroupConfig,
    MeasureConfig,
    MultiplyConfig,
)
from firmware_py.machine import Machine, values
from firmware_py.machine.supply import full_film_bar
from firmware_py.machine.values import Name, PressureBar, Section, SpeedRpm, Word
from firmware_py.records import Mode

_CHANNEL: Final = r"^[A-Za-z0-9_][A-Za-z0-9_.-]{0,39}\Z"
_PATH: Final = r"^(/[^\x00-\x1f\x7f]{1,250})?\Z"
_ENDPOINT: Final = r"^[\x21-\x7e]{1,250}\Z"
_KEY: Final = r"^[A-Za-z0-9+/]{1,250}={0,2}\Z"
WORDS: Final = {
    **values.WORDS,
    **MEASURE_WORDS,
    _CHANNEL: "a name of 1 to 40 letters, digits, - . and _, the first a letter, a digit or _",
    _PATH: "an absolute path, /.., of at most 250 characters",
    _ENDPOINT: "an endpoint of at most 250 characters without blanks",
    _KEY: "the base64 of a key",
}
"""Each pattern for people."""

BusChannel = Annotated[str, Meta(pattern=_CHANNEL)]
FilePath = Annotated[str, Meta(pattern=_PATH)]
"""Absolute, or empty: services start in another folder than people."""
Endpoint = Annotated[str, Meta(pattern=_ENDPOINT)]
PublicKey = Annotated[str, Meta(pattern=_KEY)]

DisplacementUm = Annotated[float, Meta(ge=1.0, le=655.0)]
"""Peak-to-peak; the wire carries +-327.68 um."""
AccelerationMS2 = Annotated[float, Meta(ge=0.1, le=3000.0)]
"""Rms; no housing that shakes by 300 g stays whole."""

OIL_ALERT_SHARE: Final = 0.8
"""Alert of low supply pressure over ``feed.pressure_min_bar``, where it is not set: a healthy feed
stays above."""

OIL_DANGER_C: Final = 10.0
"""Danger of a hot outlet above ``lubricant.film_max_C``, where it is not set."""


class DeviceConfig(Section, frozen=True):
    """Who this device is, and how it starts."""

    site: Name
    """Name of the place, first part of every published key."""
    rig: Name
    """Name of the rig, second part of every published key."""
    instance: Name = "default"
    """Name of this device, where several run on one computer."""
    mode_at_start: Literal["monitor", "manual", "auto"] = "monitor"
    """What it does after a start: monitor never moves the actuator, manual follows set points, auto
    the model; arming is another step."""

    @property
    def start_mode(self) -> Mode:
        """``mode_at_start`` as the enumeration."""
        return Mode[self.mode_at_start.upper()]


class Bus(Section, frozen=True):
    """The CAN FD bus, or the serial port that carries the same records as MAVLink 2."""

    link: Literal["can", "serial"] = "can"
    """CAN FD, or a serial port with MAVLink 2."""
    schema: Literal[1, 2] = 1
    """Of the messages (``deploy/NODE.md``): 1 is the eight standard channels and four readings, 2
    what the rig declares."""
    interface: Literal["orbitd_hub", "socketcan"] = "orbitd_hub"
    """`orbitd_hub` is a bus in software, `socketcan` a real one."""
    channel: BusChannel = "orbitd0"
    """Name of the hub, or of the CAN interface, such as can0."""
    nominal_bitrate: Annotated[int, Meta(ge=10_000, le=1_000_000)] = 1_000_000
    """Bit rate of arbitration; the same as the node's."""
    data_bitrate: Annotated[int, Meta(ge=10_000, le=8_000_000)] = 5_000_000
    """Bit rate of the data phase; the same as the node's."""
    serial_port: FilePath = ""
    """Device file of the serial port, such as /dev/ttyUSB0."""
    serial_baud: Annotated[int, Meta(ge=9600, le=12_000_000)] = 3_000_000
    """Bit rate of the serial port."""


class Sampling(Section, frozen=True):
    """Rate of the fast channels, and how many frames make a block."""

    rate_hz: Annotated[int, Meta(ge=100, le=10_000)] = 5000
    """Samples a second of each fast channel; at least 20 a turn at the greatest speed, 64 for the
    analysis of the orbit."""
    frames_per_block: Annotated[int, Meta(ge=1, le=100)] = 10
    """Sample frames that are judged together: a block of 2 to 50 ms."""
    fresh_age_ms: Annotated[float, Meta(ge=1.0, le=500.0)] = 20.0
    """Older samples are no ground for a command: below the time to live in the node."""

    @property
    def period_us(self) -> int:
        """Sample period in microseconds."""
        return round(1e6 / self.rate_hz)


class Limits(Section, frozen=True):
    """Alert and danger set points (vocabulary of API 670, 5th ed.); peak-to-peak over at least one
    full turn."""

    min_film_um: Annotated[float, Meta(ge=0.5, le=100.0)]
    """Least film that the retreat value and the model keep; below 0.5 um the roughness of the best
    journals touches."""
    displacement_alert_um: DisplacementUm
    """Alert of the shaft's displacement, peak to peak."""
    displacement_danger_um: DisplacementUm
    """Danger of the shaft's displacement, peak to peak; at most 0.7 of the diametral clearance."""
    clearance_share: Annotated[float, Meta(ge=0.05, le=1.0)]
    """Danger of the displacement, peak to peak, as a share of the smaller of reported and commanded
    radial clearance."""
    acceleration_alert_m_s2: AccelerationMS2
    """Alert of a housing's acceleration, rms."""
    acceleration_danger_m_s2: AccelerationMS2
    """Danger of a housing's acceleration, rms."""
    alert_delay_s: Annotated[float, Meta(ge=0.0, le=30.0)] = 1.0
    """How long a limit is exceeded before it is an alert."""
    danger_delay_s: Annotated[float, Meta(ge=0.0, le=10.0)] = 1.0
    """How long a danger limit is exceeded before it trips; API 670: 1 to 3 s, a rub that lasts 10 s
    has done its damage."""
    hysteresis_share: Annotated[float, Meta(ge=0, le=0.5)] = 0.05
    """An alarm ends this share below its limit."""
    min_speed_rpm: SpeedRpm = 300.0
    """Slower than this the window of protection is not a full turn but this long."""
    speed_high_rpm: Annotated[float, Meta(ge=0, le=200_000)] = 0.0
    """Speed-high trip; 0: 1.1 times ``operating.speed_max_rpm``.  It takes the place of no
    overspeed protection."""
    oil_pressure_low_alert_bar: PressureBar = 0.0
    """Least supply pressure; 0: 0.8 of ``feed.pressure_min_bar``.  It also bars arming."""
    oil_pressure_low_danger_bar: PressureBar = 0.0
    """Trips a turning machine after ``danger_delay_s``; 0: half of ``feed.pressure_min_bar``."""
    oil_outlet_high_alert_C: Annotated[float, Meta(ge=0, le=200)] = 0.0
    """Hottest outlet; 0: ``lubricant.film_max_C``, up to which the film is proven.  It also bars
    arming."""
    oil_outlet_high_danger_C: Annotated[float, Meta(ge=0, le=200)] = 0.0
    """Trips after ``danger_delay_s``; 0: 10 K above ``lubricant.film_max_C``."""


class LimitsAt(Section, frozen=True):
    """Displacement limits of a further bearing, in place of those of ``[limits]``."""

    bearing: Word
    """Name of the bearing."""
    displacement_alert_um: DisplacementUm
    """Alert of the shaft's displacement there, peak to peak."""
    displacement_danger_um: DisplacementUm
    """Danger of the shaft's displacement there, peak to peak."""


class AuthorityConfig(Section, frozen=True):
    """How the model's right to act is lost and regained."""

    good_advices: Annotated[int, Meta(ge=1, le=1000)] = 10
    """Good advices in a row before a model may act."""
    regain_after_s: Annotated[float, Meta(ge=0.0, le=3600.0)] = 2.0
    """How long nothing speaks against it before authority comes back."""
    max_regains_per_hour: Annotated[int, Meta(ge=1, le=120)] = 12
    """After so many losses within an hour authority waits for a person."""
    advice_age_max_ms: Annotated[float, Meta(ge=200.0, le=2000.0)] = 500.0
    """At least two periods of advice (0.1 s each), so that one may be lost; at most what a person
    takes to react."""
    provisional_may_act: bool = False
    """Whether a model that has not passed its sealed simulation test may act."""


class ModelsConfig(Section, frozen=True):
    """Which models the device uses, and what it does with one that goes wrong."""

    directory: FilePath = ""
    """Folder of the ONNX files; empty: ``models`` in the rig folder where that holds a set, else
    the ones shipped with the package."""
    shadow: FilePath = ""
    """File of a classifier of one's own recordings that says beside the active one what it would
    say; nothing follows from it."""
    public_keys: Annotated[list[PublicKey], Meta(max_length=32)] = msgspec.field(
        default_factory=list
    )
    """Keys of which one must have signed the models."""
    require_signature: bool | None = None
    """Whether models that none of ``public_keys`` has signed are refused, not only named; left
    away: where there are any keys."""
    deadline_ms: Annotated[float, Meta(ge=1.0, le=100.0)] = 20.0
    """Longest answer of a model; a set that is slower is not taken, one that comes to be slower is
    rolled back."""

    disagreement_max: Annotated[float, Meta(ge=0.05, le=1.0)] = 0.5
    """Share of decisions in which a promoted set may disagree with the former one before it is
    rolled back; 1: any."""
    disagreement_decisions: Annotated[int, Meta(ge=10, le=600)] = 60
    """The newest so many decisions are counted for that."""
    disagreement_um: Annotated[float, Meta(ge=1.0, le=500.0)] = 20.0
    """Would-be clearances further apart than this are a disagreement."""

    @property
    def signed_only(self) -> bool:
        """Whether models must be signed."""
        listed = bool(self.public_keys)
        return listed if self.require_signature is None else self.require_signature


class Drive(Section, frozen=True):
    """What the rig's drive is told to do on a trip."""

    trip_on_danger: bool = True
    """Whether a danger alarm withdraws the run permit."""
    trip_on_foreign: bool = False
    """Withdraw the run permit while the node follows commands that this device did not send."""
    coast_down_on_lost_heartbeat: bool = True
    """Whether the drive coasts down when the device falls silent; the node must be built so."""
    blind_max_s: Annotated[float, Meta(ge=0.5, le=60)] = 3.0
    """The run permit is withdrawn after so long without fresh samples; on probation after a
    restart, 2 s at most."""


class Zenoh(Section, frozen=True):
    """Local Unix-socket endpoint always; TCP stays off until endpoints are listed here."""

    listen: Annotated[list[Endpoint], Meta(max_length=16)] = msgspec.field(default_factory=list)
    """Endpoints at which the device answers, such as tls/0.0.0.0:7447."""
    connect: Annotated[list[Endpoint], Meta(max_length=16)] = msgspec.field(default_factory=list)
    """Endpoints of routers to which it connects."""
    insecure_network: bool = False
    """Endpoints without TLS may reach beyond this machine: whoever is on that network reads
    everything."""
    tls_root_ca: FilePath = ""
    """Certificate of the authority that signs both sides."""
    tls_certificate: FilePath = ""
    """Certificate of this device."""
    tls_private_key: FilePath = ""
    """Its private key."""


class RecorderConfig(Section, frozen=True):
    """The flight recorder."""

    enabled: bool = True
    """Whether the flight recorder runs."""
    directory: FilePath = ""
    """Folder of the recordings; empty: the state folder of the user or service."""
    max_megabytes: Annotated[int, Meta(ge=10, le=10_000_000)] = 2000
    """The oldest recordings go where all are larger."""
    raw_frames: bool = True
    """Whether every frame of the bus is kept, which exact replay needs."""


class Metrics(Section, frozen=True):
    """Prometheus text and the live page over HTTP on the loopback; port 0 is off, those below 1024
    need root."""

    port: Annotated[int, Meta(ge=0, le=65535)] = 0
    """Port of the metrics and the live page on the loopback; 0 is off, those below 1024 need
    root."""


class Config(Section, frozen=True):
    """The whole: the machine (``machine.toml``) and the tables of ``device.toml``."""

    device: DeviceConfig
    machine: Machine
    limits: Limits
    limits_at: list[LimitsAt] = msgspec.field(default_factory=list)
    measure: list[MeasureConfig] = msgspec.field(default_factory=list)
    group: list[GroupConfig] = msgspec.field(default_factory=list)
    multiply: list[MultiplyConfig] = msgspec.field(default_factory=list)
    bus: Bus = Bus()
    sampling: Sampling = Sampling()
    authority: AuthorityConfig = AuthorityConfig()
    models: ModelsConfig = ModelsConfig()
    drive: Drive = Drive()
    zenoh: Zenoh = Zenoh()
    recorder: RecorderConfig = RecorderConfig()
    metrics: Metrics = Metrics()

    def replaced(self, **sections: Any) -> Config:
        """The same with other ``sections``, by name: tables of the machine, or of the device."""
        tables = {k: v for k, v in sections.items() if k in Machine.__struct_fields__}
        machine = msgspec.structs.replace(sections.get("machine", self.machine), **tables)
        others = {k: v for k, v in sections.items() if k not in tables}
        return msgspec.structs.replace(self, **others | {"machine": machine})

    @property
    def oil_pressure_limits_bar(self) -> tuple[float, float]:
        """Alert and danger of low supply pressure: as set, else a share of the least that the feed
        may be asked for, and where the film is no longer full."""
        alert_bar, danger_bar = (
            self.limits.oil_pressure_low_alert_bar,
            self.limits.oil_pressure_low_danger_bar,
        )
        least_bar = self.machine.feed.pressure_min_bar
        return alert_bar or OIL_ALERT_SHARE * least_bar, danger_bar or full_film_bar(
            self.machine.feed
        )

    @property
    def oil_outlet_limits_C(self) -> tuple[float, float]:
        """Alert and danger of a hot outlet: as set, else the hottest film that is declared, and
        more than that."""
        alert_C, danger_C = (
            self.limits.oil_outlet_high_alert_C,
            self.limits.oil_outlet_high_danger_C,
        )
        hottest_C = self.machine.lubricant.film_max_C
        return alert_C or hottest_C, danger_C or hottest_C + OIL_DANGER_C
