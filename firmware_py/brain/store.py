"""The model store: reads each ONNX file once, checks whose it is and whether it fits, and only then
runs it.

The models that ship with the package are vouched for by their manifest (SHA-256), those of a
person by a signature of the manifest of their folder, or of each file, where signatures are
required (:mod:`~firmware_py.brain.trust`).  A device may use sets on top of its directory: the
files of the last one go first.

Hash, signature, metadata and session all see the same bytes, read once: nothing can be swapped in
between.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Literal

import msgspec

from firmware_py.acquire.features import FEATURE_NAMES, RATE_HZ
from firmware_py.acquire.windows import WINDOW_LAYOUT
from firmware_py.brain.errors import ModelError, ModelMissingError, ModelUnfitError
from firmware_py.brain.intervals import FactorsCard, IntervalFactors
from firmware_py.brain.made_for import Figures, machines_of, misfit, outside_domain
from firmware_py.brain.own_card import KIND, OUTPUTS, misfits
from firmware_py.brain.session import Session
from firmware_py.brain.trust import Vouched, packaged, vouched
from firmware_py.config import Config
from firmware_py.machine.parts import monitor_only
from firmware_py.model_sets.manifest import FACTORS, KINDS, OWN
from firmware_py.records import CHANNELS

SHIPPED: Final = Path(__file__).resolve().parents[2] / "models" / "artifacts"
"""Both top-level packages are installed side by side."""

PHYSICS_VERSIONS: Final = ("1", "2")
"""Versions of film, rotor and sensor physics whose models this brain understands."""

HEADS: Final = ("pedestal bolt A", "pedestal bolt B", "motor bolt", "unbalance")
OBSERVATION: Final = (
    "speed_rad_s",
    "eccentricity_x_m",
    "eccentricity_y_m",
    "peak_to_peak_x_m",
    "peak_to_peak_y_m",
    "clearance_m",
    "supply_pressure_bar",
    "shaft_power_W",
    "oil_outlet_C",
    "load_estimate_N",
    "subsync_share",
)
FILM_STATE: Final = (
    "x_m",
    "y_m",
    "vx_m_s",
    "vy_m_s",
    "omega_rad_s",
    "c_m",
    "mu_Pa_s",
    "R_m",
    "L_m",
)

STATUS_TEXT: Final = {
    "qualified": "passed its sealed simulation test",
    "provisional": "provisional: has not passed its sealed simulation test",
}
"""What people read of a model's status."""

_INTERFACES: Final[dict[str, tuple[tuple[str, ...], tuple[str, ...]]]] = {
    "classifier": (FEATURE_NAMES, ("heads", "score")),
    "actor": (OBSERVATION, ("clearance",)),
    "surrogate": (FILM_STATE, ("force", "friction_torque", "side_flow")),
}
"""Input columns and output tensors of each kind."""


class Card(msgspec.Struct, frozen=True):
    """What a model file says about itself (ONNX metadata; lists and maps are JSON there)."""

    kind: str
    version: str
    status: Literal["provisional", "qualified"]
    channels: list[str]
    rate_hz: list[int]
    inputs: list[str]
    outputs: list[str]
    domain: dict[str, tuple[float, float]]
    rigs: list[str]
    physics_version: str
    data_hash: str
    commit: str
    units: list[str] = []
    metrics: dict[str, object] = {}
    window: dict[str, float] | None = None
    settings: dict[str, object] = {}
    machines: dict[str, dict[str, float | str | tuple[float, float]]] | None = None
    """Figures of each machine that it was made for, by name; None: of the shipped ``rigs``."""

    @property
    def made_for(self) -> Mapping[str, Figures]:
        """Figures of each machine that the model was made for."""
        return machines_of(self.rigs) if self.machines is None else self.machines


@dataclass(frozen=True, slots=True)
class Model:
    """A trusted, fitting model."""

    card: Card
    session: Session
    sha256: str
    vouched_by: str = ""

    @property
    def label(self) -> str:
        """Kind, version, status and the start of the hash, for records."""
        return f"{self.card.kind} {self.card.version} {self.card.status} {self.sha256[:12]}"

    @property
    def described(self) -> str:
        """The same for people."""
        about = STATUS_TEXT[self.card.status]
        by = f", {self.vouched_by}" if self.vouched_by else ""
        return f"{self.card.kind} {self.card.version} ({about}) {self.sha256[:12]}{by}"

    @property
    def qualified(self) -> bool:
        """Whether it may act, not only advise."""
        return self.card.status == "qualified"

    def outside(self, values: dict[str, float]) -> list[str]:
        """The quantities in ``values`` that lie outside the model's declared domain, as
        sentences."""
        found = []
        for name, value in values.items():
            low, high = self.card.domain.get(name, (value, value))
            if not low <= value <= high:
                found.append(
                    f"{name} {value:.4g} outside the {self.card.kind}'s domain {low:.4g} .. "
                    f"{high:.4g}"
                )
        return found


@dataclass(frozen=True, slots=True)
class Models:
    """What the brain has to think with; ``refusals`` says by kind why a model is absent, ``off``
    what a machine that is monitor only has no use for, and why."""

    classifier: Model | None = None
    actor: Model | None = None
    surrogate: Model | None = None
    factors: IntervalFactors = field(default_factory=IntervalFactors)
    refusals: dict[str, str] = field(default_factory=dict)
    off: dict[str, str] = field(default_factory=dict)
    shadow: Model | None = None
    """Says what it would say beside the active classifier."""


ADVISING: Final = ("actor", "surrogate")
"""Policy and predictor: a forecast is one of what a command would do."""


def load_models(config: Config, layers: Sequence[Path] = ()) -> Models:
    """Load the models of the configured directory; a refused one is absent, with its reason.

    Parameters
    ----------
    layers
        Folders of sets (:mod:`firmware_py.model_sets.shelf`) whose files go before those of the
        directory, the last one first.
    """
    found: dict[str, Model] = {}
    refusals: dict[str, str] = {}
    why = monitor_only(config.machine)
    off = dict.fromkeys(ADVISING, f"monitor only: {why[0]}") if why else {}
    for kind in (each for each in _INTERFACES if each not in off):
        try:
            found[kind] = load_model(kind, config, layers)
        except ModelError as error:
            refusals[kind] = str(error)
    own = own_file(config, layers)
    if own is not None:
        try:
            found["shadow"] = load_shadow(config, own)
        except ModelError as error:
            refusals["shadow"] = str(error)
    factors = IntervalFactors()
    try:
        factors = factors if "surrogate" in off else load_factors(config, layers)
    except ModelError as error:
        refusals["predictor"] = str(error)
    return Models(
        found.get("classifier"),
        found.get("actor"),
        found.get("surrogate"),
        factors,
        refusals,
        off,
        found.get("shadow"),
    )


def load_factors(config: Config, layers: Sequence[Path] = ()) -> IntervalFactors:
    """``predictor.json`` of the configured directory, vouched for and matched like a model; without
    one the Gaussian factors.

    Raises
    ------
    ModelTrustError, ModelUnfitError
        Changed after packaging, unsigned, or of the wrong form.
    """
    try:
        data = _file(config, layers, FACTORS).data
    except ModelMissingError:
        return IntervalFactors()
    try:
        card = msgspec.json.decode(data, type=FactorsCard)
        factors = msgspec.json.decode(data, type=IntervalFactors)
    except msgspec.DecodeError as error:
        raise ModelUnfitError(
            f"{FACTORS}: {error}; fit it again with `orbitd train predictor`"
        ) from error
    if wrong := card.misfit(config, PHYSICS_VERSIONS):
        raise ModelUnfitError(
            f"{FACTORS}: {wrong}: the forecasts' intervals are the Gaussian's; fit it for this "
            "machine with `orbitd train predictor`"
        )
    return factors


def load_model(kind: str, config: Config, layers: Sequence[Path] = ()) -> Model:
    """Read, vouch for, and fit the model ``kind`` (``classifier``, ``actor`` or ``surrogate``).

    Raises
    ------
    ModelMissingError, ModelTrustError, ModelUnfitError
        See their docstrings.
    """
    data, by = _file(config, layers, KINDS[kind])
    return model_of(kind, data, config, by)


def model_of(kind: str, data: bytes, config: Config, by: str = "") -> Model:
    """The model ``kind`` in the bytes ``data``, for which ``by`` vouches, where it fits.

    Raises
    ------
    ModelUnfitError
        It does not; every reason.
    """
    name = KINDS[kind]
    session = Session(name, data)
    card = read_card(name, session.metadata)
    _check_fit(kind, name, card, session, config)
    session.deadline_s = 1e-3 * config.models.deadline_ms
    return Model(card, session, hashlib.sha256(data).hexdigest(), by)


def own_file(config: Config, layers: Sequence[Path] = ()) -> Path | None:
    """The classifier of one's own recordings that shall run in shadow: that of the last layer that
    has one, else ``models.shadow``."""
    for layer in reversed(layers):
        if (layer / OWN).is_file():
            return layer / OWN
    return Path(config.models.shadow) if config.models.shadow else None


def load_shadow(config: Config, path: Path) -> Model:
    """Read, vouch for, and fit the classifier of one's own recordings that shall run in shadow.

    Raises
    ------
    ModelMissingError, ModelTrustError, ModelUnfitError
        See their docstrings.
    """
    data, by = vouched(path, config.models)
    session = Session(path.name, data)
    card = read_card(path.name, session.metadata)
    wrong = misfits(card.settings, card.channels, card.units, session.columns, config)
    if card.kind != KIND or not set(OUTPUTS) <= set(session.outputs):
        wrong = [f"kind {card.kind!r} that gives {session.outputs}, expected {KIND!r}, {OUTPUTS}"]
    if wrong:
        raise ModelUnfitError(f"{path.name}: {'; '.join(wrong)}")
    return Model(card, session, hashlib.sha256(data).hexdigest(), by)


def _file(config: Config, layers: Sequence[Path], name: str) -> Vouched:
    """File ``name`` of the last layer that has it, else of the configured directory, vouched
    for."""
    for layer in reversed(layers):
        if (layer / name).is_file():
            return vouched(layer / name, config.models)
    if config.models.directory:
        return vouched(Path(config.models.directory) / name, config.models)
    return packaged(SHIPPED / name)


def read_card(name: str, metadata: dict[str, str]) -> Card:
    """The typed card in an ONNX file's metadata.

    Raises
    ------
    ModelUnfitError
        A field is missing or of the wrong form.
    """
    plain = ("kind", "version", "status", "physics_version", "data_hash", "commit")
    try:
        values = {key: text if key in plain else json.loads(text) for key, text in metadata.items()}
        values = {key: value for key, value in values.items() if value is not None}
        return msgspec.convert(values, Card)
    except (ValueError, msgspec.ValidationError) as error:
        raise ModelUnfitError(
            f"{name}: metadata: {error}; export it again with its metadata"
        ) from error


def _check_fit(kind: str, name: str, card: Card, session: Session, config: Config) -> None:
    """Refuse a model made for something else; every reason at once."""
    inputs, outputs = _INTERFACES[kind]
    rate, machine = config.sampling.rate_hz, config.machine
    sampled = kind == "classifier"
    checks: list[tuple[bool, str]] = [
        (card.kind == kind, f"kind {card.kind!r}, expected {kind!r}"),
        (tuple(card.inputs) == inputs, f"inputs {_difference(card.inputs, inputs)}"),
        (
            session.columns == len(inputs),
            f"graph takes {session.columns} columns, expected {len(inputs)}",
        ),
        (
            set(outputs) <= set(session.outputs),
            f"graph gives {session.outputs}, expected {outputs}",
        ),
        (
            not sampled or tuple(card.channels) == CHANNELS,
            f"channels {_difference(card.channels, CHANNELS)}",
        ),
        (
            not sampled or machine.contact is not None,
            "its features rest on a contact channel, whose circuit the machine does not describe",
        ),
        (
            not sampled or rate % round(RATE_HZ) == 0,
            f"features are defined at multiples of {RATE_HZ:g} Hz, the configuration samples at "
            f"{rate}",
        ),
        (
            not sampled or rate in card.rate_hz,
            f"rate_hz {card.rate_hz}, the configuration samples at {rate}",
        ),
        (
            not sampled or card.window == WINDOW_LAYOUT,
            f"window {card.window}, this brain cuts {WINDOW_LAYOUT}",
        ),
        (not sampled or "novelty_threshold" in card.settings, "settings lack novelty_threshold"),
        (
            card.physics_version in PHYSICS_VERSIONS,
            f"physics_version {card.physics_version!r}, this brain knows {PHYSICS_VERSIONS}",
        ),
    ]
    wrong = [text for holds, text in checks if not holds]
    wrong += outside_domain(card.domain, machine)
    if other := misfit(kind, card.made_for, machine):
        wrong.append(other)
    if wrong:
        raise ModelUnfitError(
            f"{name}: {'; '.join(wrong)}: use a model made for this configuration"
        )


def _difference(found: list[str], expected: tuple[str, ...]) -> str:
    """Where two lists of names first part."""
    for index, (a, b) in enumerate(zip(found, expected, strict=False)):
        if a != b:
            return f"[{index}] = {a!r}, expected {b!r}"
    return f"has {len(found)} names, expected {len(expected)}"
