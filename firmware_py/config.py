"""The device's configuration: one TOML file, typed, with a unit in every name and one place per limit.

:func:`load` reads it; an unknown key, a wrong type or a value outside its own range is a
:class:`ConfigError` that names file, line, key, value, limit and next step.  Checks that need more than
one value live beside what they protect and report through :meth:`ConfigFile.error`.
"""

from __future__ import annotations

import math
import re
import tomllib
from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from firmware_py.records import CHANNELS, Mode

Positive = Annotated[float, Meta(gt=0)]
NonNegative = Annotated[float, Meta(ge=0)]
Name = Annotated[str, Meta(pattern=r"^[a-z0-9_-]{1,32}$")]

SAMPLE_FRAME_BITS = 64 * 8


class Section(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Base of every table of the file."""


class Device(Section):
    """Who this device is, and how it starts."""

    site: Name
    rig: Name
    instance: Name = "default"
    mode_at_start: Literal["monitor", "manual", "auto"] = "monitor"

    @property
    def start_mode(self) -> Mode:
        """``mode_at_start`` as the enumeration."""
        return Mode[self.mode_at_start.upper()]


class Bus(Section):
    """The CAN FD bus, or the serial port that carries the same records as MAVLink 2."""

    link: Literal["can", "serial"] = "can"
    interface: Literal["orbitd_hub", "socketcan"] = "orbitd_hub"
    channel: str = "orbitd0"
    nominal_bitrate: Annotated[int, Meta(ge=10_000, le=1_000_000)] = 1_000_000
    data_bitrate: Annotated[int, Meta(ge=10_000, le=8_000_000)] = 5_000_000
    serial_port: str = ""
    serial_baud: Annotated[int, Meta(ge=9600, le=12_000_000)] = 3_000_000


class Sampling(Section):
    """Rate of the eight channels, and how many frames make a block."""

    rate_hz: Annotated[int, Meta(ge=100, le=10_000)] = 5000
    frames_per_block: Annotated[int, Meta(ge=1, le=100)] = 10
    fresh_age_ms: Positive = 20.0

    @property
    def period_us(self) -> int:
        """Sample period in microseconds."""
        return round(1e6 / self.rate_hz)


class Channel(Section):
    """One sensor channel: SI = ``counts * scale + offset``; outside ``ok_low .. ok_high`` it is not OK.

    ``message`` and ``signal`` name another source than ``orbitd.dbc`` (then ``bus_dbc`` must be set).
    """

    name: str
    unit: str
    scale: float
    ok_low: float
    ok_high: float
    offset: float = 0.0
    angle_deg: float = 0.0
    message: str = ""
    signal: str = ""


class Bearing(Section):
    """The journal bearing; every clearance says radial or diametral."""

    journal_radius_m: Positive
    length_m: Positive
    radial_clearance_min_um: Positive
    radial_clearance_max_um: Positive
    radial_clearance_nominal_um: Positive


class Oil(Section):
    """Viscosity law ``mu = mu_40 exp(-k (T - 40))`` and the inlet range that the safe value must cover."""

    viscosity_at_40C_Pa_s: Positive
    viscosity_slope_per_K: NonNegative
    density_kg_m3: Positive
    heat_capacity_J_kgK: Positive
    inlet_min_C: float
    inlet_max_C: float
    film_max_C: float

    def viscosity_Pa_s(self, temperature_C: float) -> float:
        """Dynamic viscosity at ``temperature_C``."""
        return self.viscosity_at_40C_Pa_s * math.exp(-self.viscosity_slope_per_K * (temperature_C - 40.0))


class Feed(Section):
    """Oil supply pressure: what the actuator may set, and the pump's efficiency."""

    pressure_nominal_bar: NonNegative
    pressure_min_bar: NonNegative
    pressure_max_bar: Positive
    pump_efficiency: Annotated[float, Meta(gt=0, le=1)] = 0.6


class Rotor(Section):
    """The rotor as the film sees it."""

    mass_kg: Positive
    effective_mass_at_bearing_kg: Positive
    unbalance_normal_kg_m: NonNegative
    coupling_stiffness_N_m: Positive
    coupling_damping_N_s_m: NonNegative


class Operating(Section):
    """The declared range: protection, shield and the safe value answer for all of it."""

    speed_min_rpm: NonNegative
    speed_max_rpm: Positive
    load_min_N: Positive
    load_max_N: Positive
    speed_ramp_max_rpm_s: Positive
    load_ramp_max_N_s: Positive


class Actuator(Section):
    """The node's promises; ``safe`` must equal what the node boots with."""

    safe_radial_clearance_um: Positive
    safe_pressure_bar: NonNegative
    rate_um_s: Positive
    time_constant_s: NonNegative = 0.05
    time_to_live_ms: Annotated[int, Meta(ge=10, le=1000)] = 100
    command_period_ms: Annotated[int, Meta(ge=1, le=100)] = 20


class Limits(Section):
    """API 670 set points; peak-to-peak over at least one full turn."""

    min_film_um: Positive
    trip_film_um: Positive
    displacement_alert_um: Positive
    displacement_danger_um: Positive
    clearance_share: Annotated[float, Meta(gt=0, le=1)]
    acceleration_alert_m_s2: Positive
    acceleration_danger_m_s2: Positive
    alert_delay_s: NonNegative = 1.0
    danger_delay_s: NonNegative = 1.0
    hysteresis_share: Annotated[float, Meta(ge=0, le=0.5)] = 0.05
    min_speed_rpm: NonNegative = 300.0


class Authority(Section):
    """How the model's right to act is lost and regained."""

    good_advices: Annotated[int, Meta(ge=1)] = 10
    regain_after_s: NonNegative = 2.0
    max_regains_per_hour: Annotated[int, Meta(ge=1)] = 12
    advice_age_max_ms: Positive = 500.0
    provisional_may_act: bool = False


class Models(Section):
    """Where the ONNX files lie; empty means the ones shipped with the package."""

    directory: str = ""
    public_keys: list[str] = []


class Drive(Section):
    """What the rig's drive is told to do on a trip."""

    trip_on_danger: bool = True
    coast_down_on_lost_heartbeat: bool = True


class Zenoh(Section):
    """Local Unix-socket endpoint always; TCP stays off until endpoints are listed here."""

    listen: list[str] = []
    connect: list[str] = []
    tls_root_ca: str = ""
    tls_certificate: str = ""
    tls_private_key: str = ""


class Recorder(Section):
    """The flight recorder."""

    enabled: bool = True
    directory: str = ""
    max_megabytes: Annotated[int, Meta(ge=10)] = 2000
    raw_frames: bool = True


class Metrics(Section):
    """Prometheus text and the live page over HTTP on the loopback; port 0 is off."""

    port: Annotated[int, Meta(ge=0, le=65535)] = 0


class Config(Section):
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
    bus: Bus = Bus()
    bus_dbc: str = ""
    sampling: Sampling = Sampling()
    authority: Authority = Authority()
    models: Models = Models()
    drive: Drive = Drive()
    zenoh: Zenoh = Zenoh()
    recorder: Recorder = Recorder()
    metrics: Metrics = Metrics()


class ConfigError(ValueError):
    """The configuration cannot be used; the text names file, line, key, value, limit and next step."""


class ConfigFile:
    """The text of a configuration and where each key stands in it.

    Parameters
    ----------
    path
        Name for messages (the file itself is not read here).
    text
        TOML source.
    """

    def __init__(self, path: Path, text: str) -> None:
        self.path = path
        self._lines = _key_lines(text)

    def error(self, key: str, value: object, cause: str) -> ConfigError:
        """A :class:`ConfigError` at ``key`` (dotted, list items as ``channel[2].scale``)."""
        line = self._line(key)
        where = f"{self.path.name}:{line}" if line else self.path.name
        shown = "" if value is None else f" = {value}"
        return ConfigError(f"{where}: {key}{shown}: {cause}")

    def _line(self, key: str) -> int:
        while key and key not in self._lines:
            key = key.rpartition(".")[0]
        return self._lines.get(key, 0)


def load(path: Path) -> tuple[Config, ConfigFile]:
    """Read and check ``path``.

    Returns
    -------
    The configuration and the :class:`ConfigFile` through which later checks report.

    Raises
    ------
    ConfigError
        Missing file, TOML syntax, unknown key, wrong type, value outside its own or a related limit.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read ({error}); give the path of a readable TOML file") from error
    return parse(text, path)


def parse(text: str, path: Path = Path("<text>")) -> tuple[Config, ConfigFile]:
    """As :func:`load`, from the TOML ``text``."""
    source = ConfigFile(path, text)
    try:
        table = tomllib.loads(text)
        config = msgspec.convert(table, Config)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path.name}: not valid TOML: {error}") from error
    except msgspec.ValidationError as error:
        raise _typed_error(source, str(error), tomllib.loads(text)) from error
    _check_related(config, source)
    return config, source


def _check_related(config: Config, source: ConfigFile) -> None:
    """Refuse values that contradict each other."""
    b, a, o, lim = config.bearing, config.actuator, config.operating, config.limits
    safe = a.safe_radial_clearance_um
    diametral_um = 2 * b.radial_clearance_nominal_um
    rules: list[tuple[bool, str, object, str]] = [
        (b.radial_clearance_min_um < b.radial_clearance_max_um, "bearing.radial_clearance_max_um",
         b.radial_clearance_max_um, f"not above radial_clearance_min_um ({b.radial_clearance_min_um:g}); raise it"),
        (b.radial_clearance_min_um <= safe <= b.radial_clearance_max_um, "actuator.safe_radial_clearance_um", safe,
         f"outside the bearing's range {b.radial_clearance_min_um:g} .. {b.radial_clearance_max_um:g} um; "
         "choose a value inside it"),
        (config.feed.pressure_min_bar <= a.safe_pressure_bar <= config.feed.pressure_max_bar,
         "actuator.safe_pressure_bar", a.safe_pressure_bar,
         f"outside feed range {config.feed.pressure_min_bar:g} .. {config.feed.pressure_max_bar:g} bar"),
        (o.speed_min_rpm < o.speed_max_rpm, "operating.speed_max_rpm", o.speed_max_rpm,
         f"not above speed_min_rpm ({o.speed_min_rpm:g}); raise it"),
        (o.load_min_N <= o.load_max_N, "operating.load_max_N", o.load_max_N,
         f"below load_min_N ({o.load_min_N:g}); raise it"),
        (lim.displacement_alert_um < lim.displacement_danger_um, "limits.displacement_alert_um",
         lim.displacement_alert_um, f"not below displacement_danger_um ({lim.displacement_danger_um:g}); lower it"),
        (lim.displacement_danger_um <= 0.7 * diametral_um, "limits.displacement_danger_um",
         lim.displacement_danger_um, f"above 0.7 x diametral clearance ({diametral_um:g} um); lower it or set "
         "bearing.radial_clearance_nominal_um"),
        (lim.acceleration_alert_m_s2 < lim.acceleration_danger_m_s2, "limits.acceleration_alert_m_s2",
         lim.acceleration_alert_m_s2, f"not below acceleration_danger_m_s2 ({lim.acceleration_danger_m_s2:g})"),
        (lim.trip_film_um < lim.min_film_um, "limits.trip_film_um", lim.trip_film_um,
         f"not below min_film_um ({lim.min_film_um:g}); lower it"),
        (a.command_period_ms * 3 <= a.time_to_live_ms, "actuator.command_period_ms", a.command_period_ms,
         f"more than a third of time_to_live_ms ({a.time_to_live_ms}): two lost frames would expire the command"),
        ([c.name for c in config.channel] == list(CHANNELS), "channel", [c.name for c in config.channel],
         f"must be exactly {', '.join(CHANNELS)}, in this order"),
        (config.bus.link == "can" or bool(config.bus.serial_port), "bus.serial_port", config.bus.serial_port,
         "empty with link = \"serial\"; name the port, e.g. /dev/ttyUSB0"),
        (1_000_000 % config.sampling.rate_hz == 0, "sampling.rate_hz", config.sampling.rate_hz,
         "its period is not a whole number of microseconds; use 5000 or 10000"),
    ]
    for holds, key, value, cause in rules:
        if not holds:
            raise source.error(key, value, cause)
    _check_capacity(config, source)


def _check_capacity(config: Config, source: ConfigFile) -> None:
    """Refuse a sampling rate that the link cannot carry, with the arithmetic."""
    rate = config.sampling.rate_hz
    frames_s = rate / 3
    if config.bus.link == "serial":
        bytes_s = frames_s * SERIAL_BYTES_PER_SAMPLE_FRAME + SERIAL_OVERHEAD_BYTES_S
        room = config.bus.serial_baud / 10 * 0.95
        if bytes_s > room:
            raise source.error("sampling.rate_hz", rate, (
                f"needs {frames_s:.0f} packets/s x {SERIAL_BYTES_PER_SAMPLE_FRAME} bytes + "
                f"{SERIAL_OVERHEAD_BYTES_S} = {bytes_s:.0f} bytes/s, but {config.bus.serial_baud} baud carries "
                f"{room:.0f} (10 bits a byte, 95 %); lower the rate or raise bus.serial_baud"))
        return
    load = frames_s * can_frame_seconds(config.bus.nominal_bitrate, config.bus.data_bitrate)
    if load > 0.8:
        raise source.error("sampling.rate_hz", rate, (
            f"{frames_s:.0f} CAN FD frames/s of 64 bytes take {100 * load:.0f} % of a bus at "
            f"{config.bus.nominal_bitrate}/{config.bus.data_bitrate} bit/s (limit 80 %); "
            "lower the rate or raise bus.data_bitrate"))


SERIAL_BYTES_PER_SAMPLE_FRAME = 75
"""One MAVLink 2 sample packet: 12 bytes of frame, 63 bytes of payload at most."""

SERIAL_OVERHEAD_BYTES_S = 4000
"""Status, state, command and heartbeat packets together."""


def can_frame_seconds(nominal_bitrate: int, data_bitrate: int) -> float:
    """Longest time of one 64-byte CAN FD frame with an 11-bit identifier, stuff bits included.

    ISO 11898-1: about 30 arbitration-rate bits and 28 + 512 + CRC data-rate bits, plus one stuff bit in
    five in the worst case.
    """
    return 30 * 1.2 / nominal_bitrate + (5 + SAMPLE_FRAME_BITS + 28) * 1.2 / data_bitrate


def _typed_error(source: ConfigFile, text: str, table: object) -> ConfigError:
    """A msgspec message (``... - at `$.a.b` ``) as ours."""
    cause, _, path = text.partition(" - at `$")
    key = path.rstrip("`").lstrip(".")
    key = key.replace("[...]", "")
    unknown = re.search(r"unknown field `(\w+)`", cause)
    if unknown:
        full = f"{key}.{unknown.group(1)}".lstrip(".")
        return source.error(full, None, "unknown key; remove it or correct its spelling")
    missing = re.search(r"missing required field `(\w+)`", cause)
    if missing:
        full = f"{key}.{missing.group(1)}".lstrip(".")
        return source.error(full, None, "missing; set it")
    return source.error(key, _value_at(table, key), f"{cause[0].lower()}{cause[1:]}; correct the value")


def _value_at(table: object, key: str) -> object:
    for part in re.findall(r"\w+", key):
        if isinstance(table, dict):
            table = table.get(part)
        elif isinstance(table, list) and part.isdigit():
            table = table[int(part)]
    return None if isinstance(table, (dict, list)) else table


def _key_lines(text: str) -> dict[str, int]:
    """Line number of each dotted key; arrays of tables count as ``name[i]``."""
    lines: dict[str, int] = {}
    counts: dict[str, int] = {}
    prefix = ""
    for number, raw in enumerate(text.splitlines(), 1):
        line = raw.strip()
        if array := re.match(r"\[\[\s*([\w.-]+)\s*\]\]", line):
            name = array.group(1)
            prefix = f"{name}[{counts.get(name, 0)}]"
            counts[name] = counts.get(name, 0) + 1
            lines.setdefault(name, number)
            lines[prefix] = number
        elif table := re.match(r"\[\s*([\w.-]+)\s*\]", line):
            prefix = table.group(1)
            lines[prefix] = number
        elif entry := re.match(r"([\w.-]+)\s*=", line):
            lines[f"{prefix}.{entry.group(1)}".lstrip(".")] = number
    return lines
