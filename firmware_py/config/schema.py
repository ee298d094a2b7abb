"""The tables of the configuration file: typed, a unit in every name, one place per limit."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from firmware_py.records import Mode

Positive = Annotated[float, Meta(gt=0)]
NonNegative = Annotated[float, Meta(ge=0)]
Name = Annotated[str, Meta(pattern=r"^[a-z0-9_-]{1,32}$")]


class Section(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Base of every table of the file."""


class Device(Section, frozen=True):
    """Who this device is, and how it starts."""

    site: Name
    rig: Name
    instance: Name = "default"
    mode_at_start: Literal["monitor", "manual", "auto"] = "monitor"

    @property
    def start_mode(self) -> Mode:
        """``mode_at_start`` as the enumeration."""
        return Mode[self.mode_at_start.upper()]


class Bus(Section, frozen=True):
    """The CAN FD bus, or the serial port that carries the same records as MAVLink 2."""

    link: Literal["can", "serial"] = "can"
    interface: Literal["orbitd_hub", "socketcan"] = "orbitd_hub"
    channel: str = "orbitd0"
    nominal_bitrate: Annotated[int, Meta(ge=10_000, le=1_000_000)] = 1_000_000
    data_bitrate: Annotated[int, Meta(ge=10_000, le=8_000_000)] = 5_000_000
    serial_port: str = ""
    serial_baud: Annotated[int, Meta(ge=9600, le=12_000_000)] = 3_000_000


class Sampling(Section, frozen=True):
    """Rate of the eight channels, and how many frames make a block."""

    rate_hz: Annotated[int, Meta(ge=100, le=10_000)] = 5000
    frames_per_block: Annotated[int, Meta(ge=1, le=100)] = 10
    fresh_age_ms: Positive = 20.0

    @property
    def period_us(self) -> int:
        """Sample period in microseconds."""
        return round(1e6 / self.rate_hz)


class Channel(Section, frozen=True):
    """One sensor channel: SI = ``counts * scale + offset``; outside ``ok_low .. ok_high`` it is not OK."""

    name: str
    unit: str
    scale: float
    ok_low: float
    ok_high: float
    offset: float = 0.0
    angle_deg: float = 0.0
    slow_roll_um: float = 0.0
    """Runout: amplitude of the first order at slow roll; the predictor takes it off."""
    slow_roll_deg: float = 0.0
    """Its phase: the argument of the complex amplitude counted from the mark."""
    zeroed: bool = False
    """The zero and slow-roll procedure was done: the smaller errors after it hold."""


class Bearing(Section, frozen=True):
    """The journal bearing; every clearance says radial or diametral."""

    journal_radius_m: Positive
    length_m: Positive
    radial_clearance_min_um: Positive
    radial_clearance_max_um: Positive
    radial_clearance_nominal_um: Positive
    radial_clearance_offset_um: float = 0.0
    """This bearing is so much wider than the actuator tells: from a lift check."""
    radial_clearance_error_um: Positive = 2.0
    """And is known within this."""
    load_error_share: Annotated[float, Meta(ge=0, lt=1)] = 0.21
    """The film carries this much less or more than the unfed Reynolds film there: rupture, inlet, unknown groove."""
    attitude_error_deg: Annotated[float, Meta(ge=0, le=45)] = 15.0
    """And stands this much off in direction."""
    friction_error_share: Annotated[float, Meta(ge=0, le=1)] = 1.0
    """And has this much less or more friction; 1: the shaft power says nothing about the oil."""


class Oil(Section, frozen=True):
    """Viscosity law ``mu = mu_40 exp(-k (T - 40))`` and the inlet range that the safe value must cover."""

    viscosity_at_40C_Pa_s: Positive
    viscosity_slope_per_K: NonNegative
    inlet_min_C: float
    inlet_max_C: float
    film_max_C: float
    viscosity_error_share: Annotated[float, Meta(ge=0, lt=1)] = 0.1
    """A batch of oil is this much thinner or thicker than the law."""
    film_at_outlet: bool = False
    """The film is as warm as its outlet; else it may be as cold as the coldest inlet."""
    thermal_capacity_J_K: NonNegative = 0.0
    """Of the oil node behind the outlet thermometer; 0: forecasts hold the oil's temperature."""
    cooling_W_K: NonNegative = 0.0
    """Heat that the oil carries away per kelvin above its inlet."""

    def viscosity_Pa_s(self, temperature_C: float) -> float:
        """Dynamic viscosity at ``temperature_C``."""
        return self.viscosity_at_40C_Pa_s * math.exp(-self.viscosity_slope_per_K * (temperature_C - 40.0))


class Feed(Section, frozen=True):
    """Oil supply pressure above ambient: what the actuator may set."""

    pressure_min_bar: NonNegative
    pressure_max_bar: Positive
    groove_area_min_mm2: NonNegative = 0.0
    groove_area_max_mm2: NonNegative = 0.0
    """A groove opposite the load presses the shaft down like a piston of an area between these two; 0: no groove."""


class Rotor(Section, frozen=True):
    """The rotor as the film sees it."""

    effective_mass_at_bearing_kg: Positive
    """Force over acceleration at the bearing; once weighed, that in forward whirl (inertia ``J_d - J_p / 0.515``)."""
    unbalance_normal_kg_m: NonNegative
    mass_error_share: Annotated[float, Meta(ge=0, lt=1)] = 0.05
    """The built rotor is heavier than that by at most this share."""
    unbalance_measured: bool = False
    """The normal unbalance is this rotor's own, from balancing; else it is the most that its grade lets any have."""
    whirl_error_share: Annotated[float, Meta(ge=0, lt=1)] = 0.05
    """The speed at which it whirls lies at most this much below that of a rigid rotor on the film: coupling, pedestal,
    gyroscopic moments."""
    shaft_power_error_W: NonNegative = 5.0
    """Of the shaft power that the rig reports; less where its zero was taken at rest."""
    windage_W_s3: NonNegative = 0.0
    """Shaft power beside the film's, per cubed speed (rad/s): from a coast-down."""


class Contact(Section, frozen=True):
    """The contact-resistance channel: a film resistance proportional to the smallest film, behind a series resistor."""

    circuit_V: Positive
    circuit_ohm: Positive
    film_ohm_per_m: Positive
    film_error_share: Positive
    """Standard deviation of ``film_ohm_per_m`` as a share of it."""


class Operating(Section, frozen=True):
    """The declared range: protection, shield and the safe value answer for all of it."""

    speed_min_rpm: NonNegative
    speed_max_rpm: Positive
    load_min_N: Positive
    load_max_N: Positive
    speed_ramp_max_rpm_s: Positive
    speed_ramp_unannounced_rpm_s: Positive
    """Faster ramps of speed or load are announced before they start (command ``announce``)."""
    load_ramp_unannounced_N_s: Positive


class Actuator(Section, frozen=True):
    """The node's promises; ``safe`` must equal what the node boots with."""

    safe_radial_clearance_um: Positive
    safe_pressure_bar: NonNegative
    rate_um_s: Positive
    time_constant_s: NonNegative = 0.05
    time_to_live_ms: Annotated[int, Meta(ge=10, le=1000)] = 100
    command_period_ms: Annotated[int, Meta(ge=1, le=100)] = 20


class Limits(Section, frozen=True):
    """API 670 set points; peak-to-peak over at least one full turn."""

    min_film_um: Positive
    displacement_alert_um: Positive
    displacement_danger_um: Positive
    clearance_share: Annotated[float, Meta(gt=0, le=1)]
    acceleration_alert_m_s2: Positive
    acceleration_danger_m_s2: Positive
    alert_delay_s: NonNegative = 1.0
    danger_delay_s: NonNegative = 1.0
    hysteresis_share: Annotated[float, Meta(ge=0, le=0.5)] = 0.05
    min_speed_rpm: NonNegative = 300.0


class Authority(Section, frozen=True):
    """How the model's right to act is lost and regained."""

    good_advices: Annotated[int, Meta(ge=1)] = 10
    regain_after_s: NonNegative = 2.0
    max_regains_per_hour: Annotated[int, Meta(ge=1)] = 12
    advice_age_max_ms: Positive = 500.0
    provisional_may_act: bool = False


class Models(Section, frozen=True):
    """Where the ONNX files lie; empty means the ones shipped with the package."""

    directory: str = ""
    public_keys: list[str] = []


class Drive(Section, frozen=True):
    """What the rig's drive is told to do on a trip."""

    trip_on_danger: bool = True
    coast_down_on_lost_heartbeat: bool = True
    blind_max_s: Annotated[float, Meta(ge=0.5, le=60)] = 3.0
    """The run permit is withdrawn after so long without fresh samples; on probation after a restart, 2 s at most."""


class Zenoh(Section, frozen=True):
    """Local Unix-socket endpoint always; TCP stays off until endpoints are listed here."""

    listen: list[str] = []
    connect: list[str] = []
    tls_root_ca: str = ""
    tls_certificate: str = ""
    tls_private_key: str = ""


class Recorder(Section, frozen=True):
    """The flight recorder."""

    enabled: bool = True
    directory: str = ""
    max_megabytes: Annotated[int, Meta(ge=10)] = 2000
    raw_frames: bool = True


class Metrics(Section, frozen=True):
    """Prometheus text and the live page over HTTP on the loopback; port 0 is off."""

    port: Annotated[int, Meta(ge=0, le=65535)] = 0


class Config(Section, frozen=True):
    """The whole file."""

    device: Device
    bearing: Bearing
    oil: Oil
    feed: Feed
    rotor: Rotor
    operating: Operating
    actuator: Actuator
    limits: Limits
    channel: list[Channel]
    contact: Contact | None = None
    bus: Bus = Bus()
    sampling: Sampling = Sampling()
    authority: Authority = Authority()
    models: Models = Models()
    drive: Drive = Drive()
    zenoh: Zenoh = Zenoh()
    recorder: Recorder = Recorder()
    metrics: Metrics = Metrics()
