"""The tables of the configuration file: typed, a unit in every name, one place per limit."""

from __future__ import annotations

import math
from typing import Annotated, Final, Literal

import msgspec
from msgspec import Meta

from firmware_py.records import Mode

NAME_PATTERN: Final = r"^[a-z0-9][a-z0-9_-]{0,31}\Z"
_CHANNEL: Final = r"^[A-Za-z0-9_][A-Za-z0-9_.-]{0,39}\Z"
_PATH: Final = r"^(/[^\x00-\x1f\x7f]{1,250})?\Z"
_ENDPOINT: Final = r"^[\x21-\x7e]{1,250}\Z"
_KEY: Final = r"^[A-Za-z0-9+/]{1,250}={0,2}\Z"
_WORD: Final = r"^[A-Za-z0-9_/]{1,32}\Z"
WORDS: Final = {
    NAME_PATTERN: "a name of 1 to 32 small letters, digits, - and _, the first no sign",
    _CHANNEL: "a name of 1 to 40 letters, digits, - . and _, the first a letter, a digit or _",
    _PATH: "an absolute path, /.., of at most 250 characters",
    _ENDPOINT: "an endpoint of at most 250 characters without blanks",
    _KEY: "the base64 of a key",
    _WORD: "one word",
}
"""Each pattern for people."""

Name = Annotated[str, Meta(pattern=NAME_PATTERN)]
BusChannel = Annotated[str, Meta(pattern=_CHANNEL)]
FilePath = Annotated[str, Meta(pattern=_PATH)]
"""Absolute, or empty: services start in another folder than people."""
Endpoint = Annotated[str, Meta(pattern=_ENDPOINT)]
PublicKey = Annotated[str, Meta(pattern=_KEY)]
Word = Annotated[str, Meta(pattern=_WORD)]

# Every number has a least and a greatest value.  They are the ends of what any machine of this kind
# has, not what one machine should have: relations between values are in ``checks``.
ClearanceUm = Annotated[float, Meta(ge=5.0, le=600.0)]
"""Below 5 um roughness and runout are as large as the film; the wire carries up to 655.35 um."""
PressureBar = Annotated[float, Meta(ge=0.0, le=60.0)]
"""The wire carries up to 65.535 bar."""
TemperatureC = Annotated[float, Meta(ge=-40.0, le=200.0)]
"""The range of the guard's viscosity table; beyond it oil is solid or burns."""
SpeedRpm = Annotated[float, Meta(ge=60.0, le=60_000.0)]
"""Below 60 rpm one turn takes over a second: no protection by turns.  Film bearings end below 60
000 rpm."""
LoadN = Annotated[float, Meta(ge=0.1, le=1e6)]
Share = Annotated[float, Meta(ge=0.0, le=0.9)]
"""An uncertainty; at 1 nothing would be known."""
AnySI = Annotated[float, Meta(ge=-1e5, le=1e5)]
"""A value of any of the eight channels in SI."""
AngleDeg = Annotated[float, Meta(ge=-360.0, le=360.0)]
DisplacementUm = Annotated[float, Meta(ge=1.0, le=655.0)]
"""Peak-to-peak; the wire carries +-327.68 um."""
AccelerationMS2 = Annotated[float, Meta(ge=0.1, le=3000.0)]
"""Rms; no housing that shakes by 300 g stays whole."""

OIL_ALERT_SHARE: Final = 0.8
OIL_DANGER_SHARE: Final = 0.5
"""Limits of low supply pressure over ``feed.pressure_min_bar``, where they are not set: a healthy
feed stays above."""

OIL_DANGER_C: Final = 10.0
"""Danger of a hot outlet above ``oil.film_max_C``, where it is not set."""


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
    channel: BusChannel = "orbitd0"
    nominal_bitrate: Annotated[int, Meta(ge=10_000, le=1_000_000)] = 1_000_000
    data_bitrate: Annotated[int, Meta(ge=10_000, le=8_000_000)] = 5_000_000
    serial_port: FilePath = ""
    serial_baud: Annotated[int, Meta(ge=9600, le=12_000_000)] = 3_000_000


class Sampling(Section, frozen=True):
    """Rate of the eight channels, and how many frames make a block."""

    rate_hz: Annotated[int, Meta(ge=100, le=10_000)] = 5000
    frames_per_block: Annotated[int, Meta(ge=1, le=100)] = 10
    fresh_age_ms: Annotated[float, Meta(ge=1.0, le=500.0)] = 20.0
    """Older samples are no ground for a command: below the time to live in the node."""

    @property
    def period_us(self) -> int:
        """Sample period in microseconds."""
        return round(1e6 / self.rate_hz)


class Channel(Section, frozen=True):
    """One sensor channel: SI = ``counts * scale + offset``; outside ``ok_low .. ok_high`` it is not
    OK."""

    name: Word
    unit: Word
    scale: Annotated[float, Meta(ge=-1.0, le=1.0)]
    ok_low: AnySI
    ok_high: AnySI
    offset: AnySI = 0.0
    angle_deg: AngleDeg = 0.0
    slow_roll_um: Annotated[float, Meta(ge=0.0, le=100.0)] = 0.0
    """Runout: amplitude of the first order at slow roll; the predictor takes it off."""
    slow_roll_deg: AngleDeg = 0.0
    """Its phase: the argument of the complex amplitude counted from the mark."""
    zeroed: bool = False
    """The zero and slow-roll procedure was done: the smaller errors after it hold."""


class Bearing(Section, frozen=True):
    """The journal bearing; every clearance says radial or diametral."""

    journal_radius_m: Annotated[float, Meta(ge=0.001, le=0.5)]
    """Watch-sized shafts to the largest turbines."""
    length_m: Annotated[float, Meta(ge=0.001, le=1.0)]
    radial_clearance_min_um: ClearanceUm
    radial_clearance_max_um: ClearanceUm
    radial_clearance_nominal_um: ClearanceUm
    radial_clearance_offset_um: Annotated[float, Meta(ge=-100.0, le=100.0)] = 0.0
    """This bearing is so much wider than the actuator tells: from a lift check."""
    radial_clearance_error_um: Annotated[float, Meta(ge=0.05, le=50.0)] = 2.0
    """And is known within this."""
    load_error_share: Share = 0.21
    """The film carries this much less or more than the unfed Reynolds film there: rupture, inlet,
    unknown groove."""
    attitude_error_deg: Annotated[float, Meta(ge=0, le=45)] = 15.0
    """And stands this much off in direction."""
    friction_error_share: Annotated[float, Meta(ge=0, le=1)] = 1.0
    """And has this much less or more friction; 1: the shaft power says nothing about the oil."""


class Oil(Section, frozen=True):
    """Viscosity law ``mu = mu_40 exp(-k (T - 40))`` and the inlet range that the safe value must
    cover."""

    viscosity_at_40C_Pa_s: Annotated[float, Meta(ge=2e-4, le=1.5)]
    """Thinner than petrol up to ISO VG 1500."""
    viscosity_slope_per_K: Annotated[float, Meta(ge=0.0, le=0.1)]
    """Water 0.02, oils 0.02 .. 0.06."""
    inlet_min_C: TemperatureC
    inlet_max_C: TemperatureC
    film_max_C: TemperatureC
    viscosity_error_share: Share = 0.1
    """A batch of oil is this much thinner or thicker than the law."""
    film_at_outlet: bool = False
    """The film is as warm as its outlet; else it may be as cold as the coldest inlet."""
    thermal_capacity_J_K: Annotated[float, Meta(ge=0.0, le=1e6)] = 0.0
    """Of the oil node behind the outlet thermometer; 0: forecasts hold the oil's temperature."""
    cooling_W_K: Annotated[float, Meta(ge=0.0, le=1e5)] = 0.0
    """Heat that the oil carries away per kelvin above its inlet."""

    def viscosity_Pa_s(self, temperature_C: float) -> float:
        """Dynamic viscosity at ``temperature_C``."""
        return self.viscosity_at_40C_Pa_s * math.exp(
            -self.viscosity_slope_per_K * (temperature_C - 40.0)
        )


class Feed(Section, frozen=True):
    """Oil supply pressure above ambient: what the actuator may set."""

    pressure_min_bar: PressureBar
    pressure_max_bar: PressureBar
    groove_area_min_mm2: Annotated[float, Meta(ge=0.0, le=1e6)] = 0.0
    groove_area_max_mm2: Annotated[float, Meta(ge=0.0, le=1e6)] = 0.0
    """A groove opposite the load presses the shaft down like a piston of an area between these two;
    0: no groove."""


class Rotor(Section, frozen=True):
    """The rotor as the film sees it."""

    effective_mass_at_bearing_kg: Annotated[float, Meta(ge=0.001, le=1e5)]
    """Force over acceleration at the bearing; once weighed, that in forward whirl (inertia ``J_d -
    J_p / 0.515``)."""
    unbalance_normal_kg_m: Annotated[float, Meta(ge=0.0, le=100.0)]
    mass_error_share: Share = 0.05
    """The built rotor is heavier than that by at most this share."""
    unbalance_measured: bool = False
    """The normal unbalance is this rotor's own, from balancing; else it is the most that its grade
    lets any have."""
    whirl_error_share: Share = 0.05
    """The speed at which it whirls lies at most this much below that of a rigid rotor on the film:
    coupling, pedestal, gyroscopic moments."""
    shaft_power_error_W: Annotated[float, Meta(ge=0.01, le=1e6)] = 5.0
    """Of the shaft power that the rig reports; less where its zero was taken at rest."""
    windage_W_s3: Annotated[float, Meta(ge=0.0, le=1e-3)] = 0.0
    """Shaft power beside the film's, per cubed speed (rad/s): from a coast-down."""


class Contact(Section, frozen=True):
    """The contact-resistance channel: a film resistance proportional to the smallest film, behind a
    series resistor."""

    circuit_V: Annotated[float, Meta(ge=0.01, le=3.2)]
    """The wire carries up to 3.2767 V."""
    circuit_ohm: Annotated[float, Meta(ge=1.0, le=1e9)]
    film_ohm_per_m: Annotated[float, Meta(ge=1e3, le=1e15)]
    film_error_share: Annotated[float, Meta(ge=1e-3, le=1.0)]
    """Standard deviation of ``film_ohm_per_m`` as a share of it."""


class Operating(Section, frozen=True):
    """The declared range: protection, shield and the safe value answer for all of it."""

    speed_min_rpm: SpeedRpm
    speed_max_rpm: SpeedRpm
    load_min_N: LoadN
    load_max_N: LoadN
    speed_ramp_max_rpm_s: Annotated[float, Meta(ge=1.0, le=1e5)]
    speed_ramp_unannounced_rpm_s: Annotated[float, Meta(ge=1.0, le=1e5)]
    """Faster ramps of speed or load are announced before they start (command ``announce``)."""
    load_ramp_unannounced_N_s: Annotated[float, Meta(ge=0.01, le=1e6)]


class Actuator(Section, frozen=True):
    """The node's promises; ``safe`` must equal what the node boots with."""

    safe_radial_clearance_um: ClearanceUm
    safe_pressure_bar: PressureBar
    rate_um_s: Annotated[float, Meta(ge=1.0, le=6500.0)]
    """The wire carries up to 6553.5 um/s."""
    time_constant_s: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.05
    time_to_live_ms: Annotated[int, Meta(ge=10, le=1000)] = 100
    command_period_ms: Annotated[int, Meta(ge=1, le=100)] = 20
    pressure_time_constant_s: Annotated[float, Meta(ge=0.01, le=60)] = 1.0
    """Of the supply pressure behind its target, generously: three of them pass before an error
    counts."""
    following_error_um: Annotated[float, Meta(ge=0.1, le=1000)] = 5.0
    """The measured clearance may lie this far beyond where an actuator of the declared rate can
    be."""
    following_error_bar: Annotated[float, Meta(ge=0.01, le=100)] = 0.3
    """And the measured supply pressure."""
    following_time_s: Annotated[float, Meta(ge=0.5, le=30)] = 2.0
    """For this long, before it is an alarm; gross errors and slow movement are one sooner."""
    reversals_per_minute_max: Annotated[int, Meta(ge=2, le=6000)] = 300
    """The target may turn back this often within a minute; then authority goes, and a set point
    holds."""


class Limits(Section, frozen=True):
    """Alert and danger set points (vocabulary of API 670, 5th ed.); peak-to-peak over at least one
    full turn."""

    min_film_um: Annotated[float, Meta(ge=0.5, le=100.0)]
    """Below 0.5 um the roughness of the best journals touches."""
    displacement_alert_um: DisplacementUm
    displacement_danger_um: DisplacementUm
    clearance_share: Annotated[float, Meta(ge=0.05, le=1.0)]
    acceleration_alert_m_s2: AccelerationMS2
    acceleration_danger_m_s2: AccelerationMS2
    alert_delay_s: Annotated[float, Meta(ge=0.0, le=30.0)] = 1.0
    danger_delay_s: Annotated[float, Meta(ge=0.0, le=10.0)] = 1.0
    """API 670: 1 to 3 s; a rub that lasts 10 s has done its damage."""
    hysteresis_share: Annotated[float, Meta(ge=0, le=0.5)] = 0.05
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
    """Hottest outlet; 0: ``oil.film_max_C``, up to which the film is proven.  It also bars
    arming."""
    oil_outlet_high_danger_C: Annotated[float, Meta(ge=0, le=200)] = 0.0
    """Trips after ``danger_delay_s``; 0: 10 K above ``oil.film_max_C``."""


class Readings(Section, frozen=True):
    """What the slow readings of RIG_STATUS can be; one that is not so is not OK, and nothing rests
    on it."""

    age_max_ms: Annotated[float, Meta(ge=100, le=2000)] = 250.0
    """Older ones say nothing; a rig sends them every 50 ms."""
    clean_s: Annotated[float, Meta(ge=0, le=600)] = 10.0
    """A reading that was not OK is believed again after it has been plausible for so long."""
    oil_outlet_min_C: Annotated[float, Meta(ge=-100, le=200)] = -20.0
    oil_outlet_max_C: Annotated[float, Meta(ge=-100, le=300)] = 150.0
    oil_outlet_rate_C_s: Annotated[float, Meta(ge=0.01, le=1000)] = 20.0
    """Faster changes are those of a cable: the oil behind the thermometer has to be warmed."""
    shaft_power_max_W: Annotated[float, Meta(ge=0, le=1e6)] = 0.0
    """0: ten times the friction of the narrowest bearing in the thickest oil at the top speed."""
    pressure_max_bar: PressureBar = 0.0
    """0: twice ``feed.pressure_max_bar``."""
    pressure_mismatch_bar: Annotated[float, Meta(ge=0.01, le=10)] = 0.3
    """The reading and the channel ``supply_pressure`` may differ by so much."""


class Authority(Section, frozen=True):
    """How the model's right to act is lost and regained."""

    good_advices: Annotated[int, Meta(ge=1, le=1000)] = 10
    regain_after_s: Annotated[float, Meta(ge=0.0, le=3600.0)] = 2.0
    max_regains_per_hour: Annotated[int, Meta(ge=1, le=120)] = 12
    advice_age_max_ms: Annotated[float, Meta(ge=200.0, le=2000.0)] = 500.0
    """At least two periods of advice (0.1 s each), so that one may be lost; at most what a person
    takes to react."""
    provisional_may_act: bool = False


class Models(Section, frozen=True):
    """Where the ONNX files lie; empty means the ones shipped with the package."""

    directory: FilePath = ""
    public_keys: Annotated[list[PublicKey], Meta(max_length=32)] = []


class Drive(Section, frozen=True):
    """What the rig's drive is told to do on a trip."""

    trip_on_danger: bool = True
    trip_on_foreign: bool = False
    """Withdraw the run permit while the node follows commands that this device did not send."""
    coast_down_on_lost_heartbeat: bool = True
    blind_max_s: Annotated[float, Meta(ge=0.5, le=60)] = 3.0
    """The run permit is withdrawn after so long without fresh samples; on probation after a
    restart, 2 s at most."""


class Zenoh(Section, frozen=True):
    """Local Unix-socket endpoint always; TCP stays off until endpoints are listed here."""

    listen: Annotated[list[Endpoint], Meta(max_length=16)] = []
    connect: Annotated[list[Endpoint], Meta(max_length=16)] = []
    insecure_network: bool = False
    """Endpoints without TLS may reach beyond this machine: whoever is on that network reads
    everything."""
    tls_root_ca: FilePath = ""
    tls_certificate: FilePath = ""
    tls_private_key: FilePath = ""


class Recorder(Section, frozen=True):
    """The flight recorder."""

    enabled: bool = True
    directory: FilePath = ""
    max_megabytes: Annotated[int, Meta(ge=10, le=10_000_000)] = 2000
    raw_frames: bool = True


class Metrics(Section, frozen=True):
    """Prometheus text and the live page over HTTP on the loopback; port 0 is off, those below 1024
    need root."""

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
    readings: Readings = Readings()
    contact: Contact | None = None
    bus: Bus = Bus()
    sampling: Sampling = Sampling()
    authority: Authority = Authority()
    models: Models = Models()
    drive: Drive = Drive()
    zenoh: Zenoh = Zenoh()
    recorder: Recorder = Recorder()
    metrics: Metrics = Metrics()

    @property
    def oil_pressure_limits_bar(self) -> tuple[float, float]:
        """Alert and danger of low supply pressure: as set, else shares of the least that the feed
        may be asked for."""
        alert_bar, danger_bar = (
            self.limits.oil_pressure_low_alert_bar,
            self.limits.oil_pressure_low_danger_bar,
        )
        least_bar = self.feed.pressure_min_bar
        return alert_bar or OIL_ALERT_SHARE * least_bar, danger_bar or OIL_DANGER_SHARE * least_bar

    @property
    def oil_outlet_limits_C(self) -> tuple[float, float]:
        """Alert and danger of a hot outlet: as set, else the hottest film that is declared, and
        more than that."""
        alert_C, danger_C = (
            self.limits.oil_outlet_high_alert_C,
            self.limits.oil_outlet_high_danger_C,
        )
        hottest_C = self.oil.film_max_C
        return alert_C or hottest_C, danger_C or hottest_C + OIL_DANGER_C
