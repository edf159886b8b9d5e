"""Transcendental functions with the same bits on every machine.

The exp, log and pow of a C library or of numpy differ in the last bit between processors, C libraries and
versions. The functions here use only operations that IEEE 754 rounds exactly (`+ - * /`, square root,
rounding to a whole number) and integer shifts of the exponent, in a fixed order, so every machine computes
the same. Measured errors in units in the last place: exp 1, log 2, normal 5, logistic 2.3, pow 1.6 · max(1,
|y log x|).
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ibdata._numerics.compiled import compiled

# ln 2 in two parts; the first has 21 trailing zero bits, so that k·LN2_HIGH is exact for |k| < 2²¹.
LN2_HIGH = float.fromhex("0x1.62e42fee00000p-1")
LN2_LOW = float.fromhex("0x1.a39ef35793c76p-33")
LOG2_E = float.fromhex("0x1.71547652b82fep+0")
SQRT2 = float.fromhex("0x1.6a09e667f3bcdp+0")
MANTISSA = 0x000FFFFFFFFFFFFF
EXPONENT_OF_ONE = 0x3FF0000000000000
MIDDLE = 0.425  # largest |u - ½| for which AS 241 needs no logarithm
LOG_SQRT_2PI = float.fromhex("0x1.d67f1c864beb5p-1")
FAR = 3.0  # |z| from which a continued fraction replaces the series of Φ
TERMS = 60  # of either


@compiled
def clip(x: float, low: float, high: float) -> float:
    """max(low, min(high, x)).

    >>> clip(7.0, -1.0, 1.0)
    1.0
    """
    return max(low, min(high, x))


@compiled
def exp(x: float) -> float:
    """Exponential of x, which is clipped to [-708, 709], because beyond them 2ᵏ is not a normal double.

    The argument is reduced to x = k ln 2 + r with |r| <= ln 2 / 2 (Cody and Waite); the Taylor series of eʳ
    is summed to r¹³ (truncation error 5e-18).

    >>> float(exp(1.0))
    2.7182818284590455
    >>> float(exp(0.0))
    1.0
    """
    x = max(-708.0, min(709.0, x))
    k = np.rint(x * LOG2_E)
    two_to_k = np.int64((np.int64(k) + 1023) << 52).view(np.float64)
    return float((1.0 + _expm1(_reduced(x, k))) * two_to_k)


@compiled
def tanh(x: float) -> float:
    """Hyperbolic tangent, ±1 for |x| >= 20; NaN stays.

    With t = e²ˣ - 1 = (2ᵏ - 1) + 2ᵏ (eʳ - 1), reduced as in `exp`, it is t / (t + 2) of |x|.

    >>> float(tanh(0.5))
    0.46211715726000974
    >>> float(tanh(-50.0))
    -1.0
    """
    if not abs(x) < 20.0:
        return 1.0 if x > 0.0 else -1.0 if x < 0.0 else x
    y = 2.0 * abs(x)
    k = np.rint(y * LOG2_E)
    two_to_k = np.int64((np.int64(k) + 1023) << 52).view(np.float64)
    t = (two_to_k - 1.0) + two_to_k * _expm1(_reduced(y, k))
    return float(t / (t + 2.0) if x >= 0.0 else -t / (t + 2.0))


@compiled
def _reduced(x: float, k: float) -> float:
    """The argument x - k ln 2 of a series (Cody and Waite)."""
    return (x - k * LN2_HIGH) - k * LN2_LOW


@compiled
def _expm1(r: float) -> float:
    """The Taylor series of eʳ - 1 to r¹³, for |r| <= ln 2 / 2."""
    s = 1 / 6227020800.0
    s = s * r + 1 / 479001600.0
    s = s * r + 1 / 39916800.0
    s = s * r + 1 / 3628800.0
    s = s * r + 1 / 362880.0
    s = s * r + 1 / 40320.0
    s = s * r + 1 / 5040.0
    s = s * r + 1 / 720.0
    s = s * r + 1 / 120.0
    s = s * r + 1 / 24.0
    s = s * r + 1 / 6.0
    s = s * r + 0.5
    return r + r * r * s


@compiled
def log(x: float) -> float:
    """Natural logarithm of a positive normal double.

    With x = m · 2ᵏ, m in (√2/2, √2] and f = (m - 1)/(m + 1), log m = 2 artanh f is summed as a series to f²³.

    >>> float(log(2.0))
    0.6931471805599453
    >>> float(log(1.0))
    0.0
    """
    bits = np.float64(x).view(np.int64)
    k = (bits >> 52) - 1023
    m = np.int64((bits & MANTISSA) | EXPONENT_OF_ONE).view(np.float64)
    halved = m > SQRT2  # without a branch, so that loops over lanes are vectorized
    m = 0.5 * m if halved else m
    k = k + 1 if halved else k
    f = (m - 1.0) / (m + 1.0)
    q = f * f
    s = 1 / 23.0
    s = s * q + 1 / 21.0
    s = s * q + 1 / 19.0
    s = s * q + 1 / 17.0
    s = s * q + 1 / 15.0
    s = s * q + 1 / 13.0
    s = s * q + 1 / 11.0
    s = s * q + 1 / 9.0
    s = s * q + 1 / 7.0
    s = s * q + 1 / 5.0
    s = s * q + 1 / 3.0
    return float(k * LN2_HIGH + (2.0 * f + (2.0 * f * (q * s) + k * LN2_LOW)))


@compiled
def pow(x: float, y: float) -> float:
    """Power x^y for positive normal x with |y log x| <= 708.

    >>> float(pow(2.0, 0.5))
    1.414213562373095
    """
    return exp(y * log(x))


@compiled
def logistic(x: float) -> float:
    """σ(x) = 1 / (1 + e⁻ˣ), for |x| <= 708.

    >>> float(logistic(0.0))
    0.5
    """
    return 1.0 / (1.0 + exp(-x))


@compiled
def exponential(u: float) -> float:
    """The Exp(1) variate -log u of a uniform u in (0, 1).

    >>> float(exponential(0.5))
    0.6931471805599453
    """
    return -log(u)


@compiled
def normal(u: float) -> float:
    """The N(0, 1) variate Φ⁻¹(u) of a uniform u in (0, 1), relative error about 1e-15.

    Wichura 1988, Algorithm AS 241 (PPND16), Applied Statistics 37: rational functions of (u - ½)² in the
    middle and of √(-log min(u, 1 - u)) in the tails.

    >>> float(normal(0.5))
    0.0
    >>> round(float(normal(0.975)), 12)
    1.95996398454
    """
    return _middle_normal(u) if abs(u - 0.5) <= MIDDLE else _tail_normal(u)


@compiled
def normals(u: npt.NDArray[np.float64]) -> None:
    """Apply `normal` to uniforms (n,), in place.

    A vectorized loop applies the formula of the middle to all of them; then the tails are computed again.
    """
    if u.shape[0] == 1:
        u[0] = normal(u[0])
        return
    tails, lanes = np.empty(u.shape[0]), np.empty(u.shape[0], dtype=np.int64)
    count = 0
    for i in range(u.shape[0]):
        tails[count], lanes[count] = u[i], i
        count += abs(u[i] - 0.5) > MIDDLE
    for i in range(u.shape[0]):
        u[i] = _middle_normal(u[i])
    for j in range(count):
        tails[j] = _tail_normal(tails[j])
    for j in range(count):
        u[lanes[j]] = tails[j]


@compiled
def _middle_normal(u: float) -> float:
    q = u - 0.5
    return q * _middle(0.180625 - q * q)


@compiled
def _tail_normal(u: float) -> float:
    r = math.sqrt(-log(min(u, 1.0 - u)))
    x = _tail(r - 1.6) if r <= 5.0 else _far_tail(r - 5.0)
    return x if u > 0.5 else -x


@compiled
def _middle(r: float) -> float:
    """AS 241, |u - ½| <= 0.425."""
    a = 2509.0809287301226727
    a = a * r + 33430.575583588128105
    a = a * r + 67265.770927008700853
    a = a * r + 45921.953931549871457
    a = a * r + 13731.693765509461125
    a = a * r + 1971.5909503065514427
    a = a * r + 133.14166789178437745
    a = a * r + 3.387132872796366608
    b = 5226.495278852854561
    b = b * r + 28729.085735721942674
    b = b * r + 39307.89580009271061
    b = b * r + 21213.794301586595867
    b = b * r + 5394.1960214247511077
    b = b * r + 687.1870074920579083
    b = b * r + 42.313330701600911252
    b = b * r + 1.0
    return a / b


@compiled
def _tail(r: float) -> float:
    """AS 241, √(-log min(u, 1 - u)) <= 5."""
    a = 7.7454501427834140764e-4
    a = a * r + 0.0227238449892691845833
    a = a * r + 0.24178072517745061177
    a = a * r + 1.27045825245236838258
    a = a * r + 3.64784832476320460504
    a = a * r + 5.7694972214606914055
    a = a * r + 4.6303378461565452959
    a = a * r + 1.42343711074968357734
    b = 1.05075007164441684324e-9
    b = b * r + 5.475938084995344946e-4
    b = b * r + 0.0151986665636164571966
    b = b * r + 0.14810397642748007459
    b = b * r + 0.68976733498510000455
    b = b * r + 1.6763848301838038494
    b = b * r + 2.05319162663775882187
    b = b * r + 1.0
    return a / b


@compiled
def _far_tail(r: float) -> float:
    """AS 241, √(-log min(u, 1 - u)) > 5."""
    a = 2.01033439929228813265e-7
    a = a * r + 2.71155556874348757815e-5
    a = a * r + 0.0012426609473880784386
    a = a * r + 0.026532189526576123093
    a = a * r + 0.29656057182850489123
    a = a * r + 1.7848265399172913358
    a = a * r + 5.4637849111641143699
    a = a * r + 6.6579046435011037772
    b = 2.04426310338993978564e-15
    b = b * r + 1.4215117583164458887e-7
    b = b * r + 1.8463183175100546818e-5
    b = b * r + 7.868691311456132591e-4
    b = b * r + 0.0148753612908506148525
    b = b * r + 0.13692988092273580531
    b = b * r + 0.59983220655588793769
    b = b * r + 1.0
    return a / b


@compiled
def log_cdf(z: float) -> float:
    """Logarithm of the normal distribution function Φ(z), to 1e-12 relative or 1e-16 absolute.

    >>> float(log_cdf(0.0)) == float(log(0.5)), float(log_cdf(100.0))
    (True, 0.0)
    """
    x = abs(z)
    log_density = -0.5 * x * x - LOG_SQRT_2PI
    if x >= FAR:
        log_tail = log_density + log(_mills(x))
        return log_tail if z < 0.0 else log(1.0 - exp(log_tail))
    middle = exp(log_density) * _series(x)  # Φ(x) - ½
    return log(0.5 - middle) if z < 0.0 else log(0.5 + middle)


@compiled
def _series(x: float) -> float:
    """(Φ(x) - ½) / φ(x) = x + x³/3 + x⁵/(3·5) + …, for |x| <= 3."""
    term = total = x
    for k in range(1, TERMS):
        term = term * (x * x) / (2.0 * k + 1.0)
        total += term
    return total


@compiled
def _mills(x: float) -> float:
    """(1 - Φ(x)) / φ(x) = 1/(x + 1/(x + 2/(x + 3/(x + …)))), for x >= 3 (Laplace)."""
    down = x
    for k in range(TERMS, 0, -1):
        down = x + k / down
    return 1.0 / down
