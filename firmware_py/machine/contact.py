"""Law of the contact channel: its voltage over the smallest film, and the film that a voltage
tells.

Source: film resistance proportional to the smallest film, beside asperity contacts ``10 ohm exp(h /
roughness)`` (Greenwood and Williamson 1966), behind a series resistor.  Nobody knows the roughness
of the surfaces but within :data:`ROUGHNESS_M`: above a dozen roughnesses it does not matter, below
it rules.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.machine.schema import ContactCircuit

Floats = NDArray[np.float64]

ROUGHNESS_M: Final = (0.5e-6, 1.0e-6)
MIDDLING_M: Final = 0.5 * sum(ROUGHNESS_M)
ASPERITY_OHM: Final = 10.0
THINNEST_M: Final = 1e-9
THICKEST_M: Final = 1e-3
_KNOTS: Final = 4000


def contact_volt(
    contact: ContactCircuit, film_m: Floats, roughness_m: float = MIDDLING_M
) -> Floats:
    """Voltage of the contact channel over the smallest film (m)."""
    film = contact.film_ohm_per_m * np.maximum(film_m, THINNEST_M)
    asperity = ASPERITY_OHM * np.exp(np.minimum(film_m / roughness_m, 60.0))
    parallel = 1.0 / (1.0 / film + 1.0 / asperity)
    return np.asarray(contact.circuit_V * parallel / (parallel + contact.circuit_ohm))


def film_of(contact: ContactCircuit, volt: Floats, roughness_m: float = MIDDLING_M) -> Floats:
    """Smallest film (m) that shows ``volt``, from :data:`THINNEST_M` to :data:`THICKEST_M`."""
    volts, films = _law(contact, roughness_m)
    return np.asarray(np.interp(volt, volts, films))


def film_per_volt(contact: ContactCircuit, volt: float, roughness_m: float = MIDDLING_M) -> float:
    """Slope of :func:`film_of`, m/V, over a hundredth of the film."""
    film = float(film_of(contact, np.array(volt), roughness_m))
    thin, thick = contact_volt(contact, film * np.array([0.995, 1.005]), roughness_m)
    return 0.01 * film / float(thick - thin)


def roughness_volt(contact: ContactCircuit, volt: float) -> float:
    """Deviation of the voltage that comes from the unknown roughness of the surfaces, even within
    its range."""
    film = (
        np.array([contact.circuit_ohm * volt / max(contact.circuit_V - volt, 1e-3)])
        / contact.film_ohm_per_m
    )
    smooth, rough = (contact_volt(contact, film, sigma)[0] for sigma in ROUGHNESS_M)
    return float(abs(smooth - rough)) / (2.0 * math.sqrt(3.0))


@cache
def _law(contact: ContactCircuit, roughness_m: float) -> tuple[Floats, Floats]:
    films = np.geomspace(THINNEST_M, THICKEST_M, _KNOTS)
    return contact_volt(contact, films, roughness_m), films
