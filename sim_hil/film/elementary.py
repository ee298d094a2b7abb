"""Elementary functions for the innermost loops: polynomials, without a call to the library.

They can be interleaved with what stands around them, and give the same bits on every machine, which
the library's do not promise.  A step of a rotor is one chain of operations that wait for one
another, so that the polynomials are summed in pairs (Estrin, 1960) and not term by term.
Coefficients: Chebyshev interpolation at 40 digits on the reduced interval (Taylor's for the turn),
lowest power first; relative error below 1e-13 (``tests/sim_hil/film/test_film_elementary.py``).
"""

import math

import numpy as np

from sim_hil.jit import inlined

_ATAN_REDUCED = math.tan(math.pi / 8)
_SQRT_HALF_BITS = np.int64(0x3FE6A09E667F3BCD)
_MANTISSA = np.int64(52)
_LN_2_HIGH, _LN_2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
_PER_LN_2 = 1 / math.log(2.0)
_PI_HIGH, _PI_LOW = 3.1415926534682512, 1.2154201013012384e-10
"""pi in two parts: the first is short, so that its multiples up to 2^20 are exact."""
_TINY = 1e-300

_L = (
    *(0.6666666666655292, 0.40000000061741614, 0.2857141602110767),
    *(0.22223434547517906, 0.18121934431215214, 0.16837659970680488),
)
_E = (
    *(1.0, 1.0000000000000067, 0.5000000000000006, 0.16666666666554406, 0.04166666666657314),
    *(0.008333333385667782, 0.0013888888932488599, 0.00019841170270440067),
    *(2.4801504346997686e-05, 2.764018079620985e-06, 2.7626357241447223e-07),
)
_A = (
    *(0.999999999999999, -0.3333333333322143, 0.19999999978392663, -0.14285712661684793),
    *(0.11111048853751296, -0.09089529956562307, 0.07673535428183285, -0.0650598296717084),
    *(0.05024762118940128, -0.025316479573776477),
)
_S = tuple((-1.0) ** k / math.factorial(2 * k + 1) for k in range(7))
_C = tuple((-1.0) ** k / math.factorial(2 * k) for k in range(8))


@inlined
def log_of(x: float) -> float:
    """Natural logarithm of a normal number above zero: ``2 artanh((m - 1) / (m + 1)) + k ln 2``.

    Finite, and without meaning, for anything else.
    """
    bits = np.float64(x).view(np.int64)
    k = (bits - _SQRT_HALF_BITS) >> _MANTISSA
    m = np.int64(bits - (k << _MANTISSA)).view(np.float64)
    z = (m - 1.0) / (m + 1.0)
    y = z * z
    y2 = y * y
    series = ((_L[0] + _L[1] * y) + (_L[2] + _L[3] * y) * y2) + (_L[4] + _L[5] * y) * (y2 * y2)
    value: float = k * _LN_2_HIGH + (2.0 * z + (z * y * series + k * _LN_2_LOW))
    return value


@inlined
def exp_of(x: float) -> float:
    """Exponential of a number within +-700: ``2^k`` times a polynomial on half an octave."""
    k = np.int64(math.floor(x * _PER_LN_2 + 0.5))
    r = (x - k * _LN_2_HIGH) - k * _LN_2_LOW
    r2 = r * r
    r4 = r2 * r2
    low = (_E[0] + _E[1] * r) + (_E[2] + _E[3] * r) * r2
    middle = (_E[4] + _E[5] * r) + (_E[6] + _E[7] * r) * r2
    high = (_E[8] + _E[9] * r) + _E[10] * r2
    scale = np.int64((k + np.int64(1023)) << _MANTISSA).view(np.float64)
    value: float = scale * ((low + middle * r4) + high * (r4 * r4))
    return value


@inlined
def angle_of(y: float, x: float) -> float:
    """``atan2(y, x)`` for y >= 0, in [0, pi]; 0 where both are 0."""
    along = abs(x)
    most, least = max(along, y), min(along, y)
    far, steep = least > _ATAN_REDUCED * most, y > along
    above, below = (least - most, least + most) if far else (least, most + _TINY)
    # the octant's place and sense stand ready before the quotient does
    start, sense = (0.25 * math.pi if far else 0.0), 1.0
    start, sense = (0.5 * math.pi - start, -1.0) if steep else (start, sense)
    start, sense = (math.pi - start, -sense) if x < 0.0 else (start, sense)
    z = sense * above / below
    s = z * z
    s2 = s * s
    s4 = s2 * s2
    low = (_A[0] + _A[1] * s) + (_A[2] + _A[3] * s) * s2
    high = (_A[4] + _A[5] * s) + (_A[6] + _A[7] * s) * s2
    return start + z * ((low + high * s4) + (_A[8] + _A[9] * s) * (s4 * s4))


@inlined
def turn_of(angle: float) -> tuple[float, float]:
    """Cosine and sine of an angle in [-pi/2, pi/2], from those of its half."""
    t = 0.5 * angle
    s = t * t
    s2 = s * s
    s4 = s2 * s2
    sine = (_S[0] + _S[1] * s) + (_S[2] + _S[3] * s) * s2
    sine += ((_S[4] + _S[5] * s) + _S[6] * s2) * s4
    cosine = (_C[0] + _C[1] * s) + (_C[2] + _C[3] * s) * s2
    cosine += ((_C[4] + _C[5] * s) + (_C[6] + _C[7] * s) * s2) * s4
    sine *= t
    return 1.0 - 2.0 * sine * sine, 2.0 * sine * cosine


@inlined
def direction_of(angle: float) -> tuple[float, float]:
    """Cosine and sine of any angle; the error grows as that of ``angle`` itself."""
    halves = math.floor(angle * (1 / math.pi) + 0.5)
    cosine, sine = turn_of((angle - halves * _PI_HIGH) - halves * _PI_LOW)
    sign = 1.0 - 2.0 * (halves - 2.0 * math.floor(0.5 * halves))
    return sign * cosine, sign * sine
