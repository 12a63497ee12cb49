"""Elementary functions as graph nodes: range reduction and polynomials, within 2 ulp.

Log, sine and cosine: the coefficients of fdlibm (Sun Microsystems, 1993: e_log.c, k_sin.c, k_cos.c). Exponential: the
Taylor series to degree 13, whose remainder on |r| <= ln(2)/2 is below 5e-18. Reductions by multiples of ln 2 and pi/2
follow Cody and Waite, Software Manual for the Elementary Functions (1980), with fused multiply-add. NaN and infinities
pass through; XLA runs with subnormal numbers flushed to zero, and so does this.
"""

import math
from collections.abc import Sequence

from plantfit.native.graph.arithmetic import Arithmetic
from plantfit.native.graph.nodes import F64, I64, Node

_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
_ROUND = 1.5 * 2.0**52  # adding it leaves the nearest whole number in the low bits
_ROUND_BITS = 0x4338000000000000
_LOG = (
    6.666666666666735130e-01, 3.999999999940941908e-01, 2.857142874366239149e-01, 2.222219843214978396e-01,
    1.818357216161805012e-01, 1.531383769920937332e-01, 1.479819860511658591e-01,
)  # fmt: skip
_SIN = (
    -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04,
    2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10,
)  # fmt: skip
_COS = (
    4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05,
    -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11,
)  # fmt: skip
_HALF_PI = (1.5707963267948966, 6.123233995736766e-17, -1.4973849048591833e-33)
_FAR = 2.0**20  # beyond it sine and cosine come from the C library


def _polynomial(m: Arithmetic, coefficients: Sequence[float], x: Node) -> Node:
    """sum c_i x^i by Estrin's scheme, whose dependency chains are short."""
    terms = [m.number(c) for c in coefficients]
    while len(terms) > 1:
        pairs = [m.fma(terms[i + 1], x, terms[i]) for i in range(0, len(terms) - 1, 2)]
        terms = pairs + terms[len(pairs) * 2 :]
        x = m.mul(x, x)
    return terms[0]


def _bits(m: Arithmetic, a: Node) -> Node:
    return m.graph.make("bits", (a,), I64)


def _float(m: Arithmetic, a: Node) -> Node:
    return m.graph.make("float", (a,), F64)


def _shift(m: Arithmetic, kind: str, a: Node, count: int) -> Node:
    return m.op(kind, a, m.integer(count))


def _power_of_two(m: Arithmetic, n: Node) -> Node:
    """2^n for an I64 n in -1022 .. 1023."""
    return _float(m, _shift(m, "shl", m.add(n, m.integer(1023)), 52))


def _nearest(m: Arithmetic, x: Node) -> tuple[Node, Node]:
    """The whole number nearest to x / ln 2, as I64 and as F64."""
    shifted = m.fma(x, m.number(1.0 / math.log(2.0)), m.number(_ROUND))
    return m.sub(_bits(m, shifted), m.integer(_ROUND_BITS)), m.op("sub", shifted, m.number(_ROUND))


def _exp_minus_one_near_zero(m: Arithmetic, r: Node, lost: Node | None = None) -> Node:
    """exp(r + lost) - 1 for |r| <= ln(2)/2 and a rounding error `lost`: r + (lost + r^2 (1/2 + r/6 + ...))."""
    series = _polynomial(m, [1.0 / math.factorial(k) for k in range(2, 14)], r)
    square = m.mul(r, r)
    return m.fma(square, series, r) if lost is None else m.op("add", r, m.fma(square, series, lost))


def exp(m: Arithmetic, x: Node) -> Node:
    """e^x; scaled by two powers of two, neither of which leaves the normal range."""
    x = m.minimum(m.number(710.0), m.maximum(m.number(-746.0), x))
    n, whole = _nearest(m, x)
    r = m.fma(whole, m.number(-_LN2_LOW), m.fma(whole, m.number(-_LN2_HIGH), x))
    value = m.op("add", _exp_minus_one_near_zero(m, r), m.number(1.0))
    half = _shift(m, "sra", n, 1)
    return m.mul(m.mul(value, _power_of_two(m, half)), _power_of_two(m, m.sub(n, half)))


def expm1(m: Arithmetic, x: Node) -> Node:
    """e^x - 1 = 2^n (e^r - 1) + (2^n - 1), computed at half its size, so that it overflows only with its result."""
    clipped = m.minimum(m.number(710.0), m.maximum(m.number(-40.0), x))
    shifted, n = _nearest(m, clipped)
    high, low = m.fma(n, m.number(-_LN2_HIGH), clipped), m.mul(n, m.number(_LN2_LOW))
    r = m.op("sub", high, low)
    lost = m.op("sub", m.op("sub", high, r), low)
    half = _power_of_two(m, m.sub(shifted, m.integer(1)))
    value = m.fma(half, _exp_minus_one_near_zero(m, r, lost), m.op("sub", half, m.number(0.5)))
    tiny = m.compare("lt", m.absolute(x), m.number(1e-17))
    return m.select(tiny, x, m.op("add", value, value))


def log(m: Arithmetic, x: Node) -> Node:
    """ln x = e ln 2 + ln(1 + f) with s = f / (2 + f) and a series in s^2; -inf at 0, NaN below."""
    small = m.compare("lt", x, m.number(2.2250738585072014e-308))
    scaled = m.select(small, m.mul(x, m.number(2.0**54)), x)
    bits = m.add(_bits(m, scaled), m.integer(0x3FF0000000000000 - 0x3FE6A09E667F3BCD))
    exponent = m.sub(_shift(m, "srl", bits, 52), m.integer(1023))
    fraction = m.add(m.op("and", bits, m.integer(0x000FFFFFFFFFFFFF)), m.integer(0x3FE6A09E667F3BCD))
    e = m.sub(m.convert(exponent, F64), m.select(small, m.number(54.0), m.number(0.0)))
    f = m.op("sub", _float(m, fraction), m.number(1.0))
    s = m.op("div", f, m.op("add", f, m.number(2.0)))
    z = m.mul(s, s)
    half = m.mul(m.number(0.5), m.mul(f, f))
    tail = m.fma(s, m.op("add", half, m.mul(z, _polynomial(m, _LOG, z))), m.mul(e, m.number(_LN2_LOW)))
    value = m.fma(e, m.number(_LN2_HIGH), m.op("sub", f, m.op("sub", half, tail)))
    value = m.select(m.compare("eq", x, m.number(math.inf)), x, value)
    value = m.select(m.compare("ge", x, m.number(0.0)), value, m.number(math.nan))
    return m.select(m.compare("eq", x, m.number(0.0)), m.number(-math.inf), value)


def log1p(m: Arithmetic, x: Node) -> Node:
    """ln(1 + x), compensated for the rounding of 1 + x."""
    u = m.op("add", x, m.number(1.0))
    missing = m.op("div", m.op("sub", x, m.op("sub", u, m.number(1.0))), u)
    regular = m.op("and", m.compare("gt", u, m.number(0.0)), m.compare("lt", u, m.number(math.inf)))
    value = m.op("add", log(m, u), m.select(regular, missing, m.number(0.0)))
    return m.select(m.compare("eq", x, m.number(0.0)), x, value)


def tanh(m: Arithmetic, x: Node) -> Node:
    """tanh |x| = -t / d, d = t + 2, t = exp(-2 |x|) - 1, with the sign of x; compensated for the rounding of d and
    of the quotient."""
    t = expm1(m, m.mul(m.number(-2.0), m.absolute(x)))
    d = m.op("add", t, m.number(2.0))
    lost = m.op("add", m.op("sub", m.number(2.0), d), t)
    inverse = m.op("rcp", d)
    rough = m.neg(m.mul(t, inverse))
    rest = m.neg(m.fma(rough, lost, m.fma(rough, d, t)))
    return m.op("copysign", m.fma(rest, inverse, rough), x)


def logistic(m: Arithmetic, x: Node) -> Node:
    """1 / (1 + exp(-x))."""
    return m.op("div", m.number(1.0), m.op("add", exp(m, m.neg(x)), m.number(1.0)))


def _quadrant(m: Arithmetic, x: Node) -> tuple[Node, Node, Node]:
    """(q as I64, sin r, cos r) with x = q pi/2 + r."""
    shifted = m.fma(x, m.number(2.0 / math.pi), m.number(_ROUND))
    q = m.op("sub", shifted, m.number(_ROUND))
    r = x
    for part in _HALF_PI:
        r = m.fma(q, m.number(-part), r)
    z = m.mul(r, r)
    sine = m.fma(m.mul(z, r), _polynomial(m, _SIN, z), r)
    half = m.mul(m.number(0.5), z)
    w = m.op("sub", m.number(1.0), half)
    lost = m.op("sub", m.op("sub", m.number(1.0), w), half)
    cosine = m.op("add", w, m.fma(m.mul(z, z), _polynomial(m, _COS, z), lost))
    return _bits(m, shifted), sine, cosine


def _turned(m: Arithmetic, x: Node, turn: int, name: str) -> Node:
    """sin(x + turn pi/2); from the C library where |x| is large."""
    q, sine, cosine = _quadrant(m, x)
    q = m.add(q, m.integer(turn))
    odd = m.compare("ne", m.op("and", q, m.integer(1)), m.integer(0))
    value = m.select(odd, cosine, sine)
    sign = _shift(m, "shl", m.op("and", q, m.integer(2)), 62)
    near = _float(m, m.op("xor", _bits(m, value), sign))
    far = m.compare("ge", m.absolute(x), m.number(_FAR))
    return m.graph.make("patched", (near, far, x), F64, name)


def sin(m: Arithmetic, x: Node) -> Node:
    """sin x; x = -0 and 0 keep their sign."""
    value = _turned(m, x, 0, "sin")
    return m.select(m.compare("eq", x, m.number(0.0)), x, value)


def cos(m: Arithmetic, x: Node) -> Node:
    """cos x."""
    return _turned(m, x, 1, "cos")
