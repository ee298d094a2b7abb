"""What a classifier of a user's own recordings says about itself, and whether it fits a device."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import msgspec
import numpy as np

from firmware_py.acquire.channel_features import VIEWS, WINDOW_S, window_samples
from firmware_py.acquire.windows import MAX_SECONDS
from firmware_py.config import Config

KIND: Final = "measured classifier"
OUTPUTS: Final = ("classes", "score")


@dataclass(frozen=True, slots=True)
class OwnOptions:
    """The settings in such a model's card.

    Attributes
    ----------
    labels
        Names of the columns of ``classes``.
    view
        Of :data:`firmware_py.acquire.channel_features.VIEWS`.
    rate_hz, window_s
        How its recordings were sampled and cut.
    recordings
        Fingerprints of what it was trained on.
    """

    labels: tuple[str, ...]
    view: str
    rate_hz: float
    window_s: float = WINDOW_S
    recordings: frozenset[str] = frozenset()

    @classmethod
    def of(cls, settings: Mapping[str, Any]) -> OwnOptions:
        """From ``settings``.

        Raises
        ------
        ValueError
            One is missing or of the wrong form.
        """
        known = {name: settings[name] for name in cls.__slots__ if name in settings}
        try:
            return msgspec.convert(known, cls)
        except msgspec.ValidationError as error:
            raise ValueError(f"settings of the card: {error}") from error


def misfits(
    settings: Mapping[str, Any],
    channels: Sequence[str],
    units: Sequence[str],
    columns: int,
    config: Config,
) -> list[str]:
    """Why a model of one's own recordings does not fit a device; every reason.

    Parameters
    ----------
    channels, units
        Of the model's recordings, in order.
    columns
        Features that its graph takes.
    """
    try:
        options = OwnOptions.of(settings)
    except ValueError as error:
        return [str(error)]
    wrong = []
    rate, here = float(config.sampling.rate_hz), {c.name: c.unit for c in config.machine.channel}
    for name, unit in zip(channels, units, strict=False):
        if name not in here:
            wrong.append(f"channel {name!r}, this rig has {', '.join(here)}")
        elif unit != here[name]:
            wrong.append(f"channel {name!r} in {unit or 'an unknown unit'}, here in {here[name]}")
    if len(units) != len(channels):
        wrong.append(f"{len(units)} units of {len(channels)} channels")
    if options.rate_hz != rate:
        wrong.append(
            f"trained at {options.rate_hz:g} Hz, this device samples at {rate:g}: say resample_hz "
            f"= {rate:g} in channels.toml and train again"
        )
    if options.window_s > MAX_SECONDS:
        wrong.append(
            f"windows of {options.window_s:g} s, this device keeps {MAX_SECONDS:g} s: train again "
            f"with --window-s {MAX_SECONDS:g}"
        )
    if options.view not in VIEWS:
        wrong.append(f"features {options.view!r}, this version has {', '.join(VIEWS)}")
    elif (size := _size(options, len(channels))) != columns:
        wrong.append(f"{columns} features, this version makes {size} of {options.view!r}")
    return wrong


def _size(options: OwnOptions, channels: int) -> int:
    """Features of one window, by making them of one that turns 16 times."""
    n = max(window_samples(options.rate_hz, options.window_s), 640)
    noise = np.sin(np.outer(np.arange(1.0, channels + 1.0), np.arange(float(n))))
    return len(VIEWS[options.view](noise, options.rate_hz, np.linspace(0.0, 16.0, n)))
