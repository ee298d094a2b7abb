"""What a groove adds to the load: the bounds that the guard of a fed bearing declares, against the
film solver."""

import pytest

from models.control.shielded import config_of
from sim_hil.film.groove_load import PROJECTED_M2, groove_load
from sim_hil.rigs import load_rig

CONFIG = config_of(load_rig("bench"), fed=True)
LEAST = 1e-6 * CONFIG.machine.feed.groove_area_min_mm2 / PROJECTED_M2
MOST = 1e-6 * CONFIG.machine.feed.groove_area_max_mm2 / PROJECTED_M2


@pytest.mark.parametrize("pressure_share", [0.4, 0.571])
@pytest.mark.parametrize("eccentricity", [0.07, 0.25, 0.45])
def test_where_whirl_decides_the_film_carries_the_smaller_area_at_least_and_whirls_no_earlier(
    eccentricity: float, pressure_share: float
) -> None:
    """60 and 30 N at the least pressure; heavier rotors do not whirl in any clearance of this
    bearing.

    What whirls 0.7 % slower is within ``rotor.whirl_error_share`` and ``mass_error_share`` of a
    commissioned machine.
    """
    found = groove_load(eccentricity, pressure_share, LEAST)
    assert found.area_share > LEAST
    assert found.whirl_share < 1.015


@pytest.mark.parametrize(
    ("eccentricity", "pressure_share"), [(0.92, 0.12), (0.92, 0.889), (0.42, 0.889), (0.55, 0.65)]
)
def test_anywhere_it_carries_the_larger_area_at_most_and_turns_no_further_than_declared(
    eccentricity: float, pressure_share: float
) -> None:
    found = groove_load(eccentricity, pressure_share, LEAST)
    assert found.area_share < MOST
    assert abs(found.turned_deg) < CONFIG.machine.bearing.attitude_error_deg
