"""Numbers in words: as many digits as their standard deviation supports, and shares as percent.

The one place that decides digits: reports, figures, terminal and viewer (``numbers.js``) follow it.
"""

from __future__ import annotations

import math

SIGMA_DIGITS = 2
"""Significant digits of a standard deviation. They decide the last digit of its value (GUM,
JCGM 100:2008, 7.2.6)."""
PLAIN_DIGITS = 3
"""Significant digits of a value without a standard deviation: statistics of pixels are not known
better than to a per cent or so."""
MOST_DECIMALS = 9
"""Decimals of a number; smaller ones are written with a power of ten. A nanometre in metres."""
UNKNOWN = "–"
"""What stands for a number that is not known."""
SHARE = "share"
"""In place of a unit: the number is a share, which is shown as percent."""
MINUS = "−"
"""The sign of negative numbers, which is as wide as a digit."""


def number(
    value: float | None,
    sigma: float | None = None,
    unit: str = "",
    *,
    digits: int = PLAIN_DIGITS,
    signed: bool = False,
) -> str:
    """Return a value with the digits that its standard deviation supports.

    Parameters
    ----------
    value : float, optional
        None and NaN are unknown.
    sigma : float, optional
        Its standard deviation. Without one, the value has ``digits`` significant digits.
    unit : str
        Put after the value; ``SHARE`` shows it as percent.
    digits : int
        Significant digits of a value without a standard deviation.
    signed : bool
        Whether positive values have a sign.

    Examples
    --------
    >>> number(10.02337, 0.0021, "mm")
    '10.0234 mm'
    >>> number(-0.0064836, 0.00037)
    '−0.00648'
    >>> number(0.123456)
    '0.123'
    """
    if value is None or not math.isfinite(value):
        return UNKNOWN
    if unit == SHARE:
        return percent(value)
    if sigma is not None and math.isfinite(sigma) and sigma > 0:
        text = _fixed(value, decimals(sigma), signed)
    elif value == 0:
        text = "0"
    else:
        text = _fixed(value, decimals(value, digits), signed)
    return f"{text} {unit}" if unit else text


def sigma_text(sigma: float | None, unit: str = "") -> str:
    """Return a standard deviation with two significant digits.

    Examples
    --------
    >>> sigma_text(0.00996, "mm")
    '0.010 mm'
    """
    return number(sigma, sigma, unit)


def estimate(value: float | None, sigma: float | None, unit: str = "") -> str:
    """Return a value with its standard deviation behind it.

    Examples
    --------
    >>> estimate(10.02337, 0.0021, "mm")
    '10.0234 ± 0.0021 mm'
    """
    known = sigma is not None and math.isfinite(sigma)
    text = f"{number(value, sigma)} ± {sigma_text(sigma)}" if known else number(value)
    return f"{text} {unit}" if unit and text != UNKNOWN else text


def percent(share: float | None) -> str:
    """Return a share as percent, with enough digits to tell few from none and most from all.

    Examples
    --------
    >>> percent(0.175), percent(0.99997)
    ('17.5 %', '99.997 %')
    """
    if share is None or not math.isfinite(share):
        return UNKNOWN
    rest = 100.0 * min(share, 1.0 - share)
    digits = 1 if rest <= 0.0 else max(1, math.ceil(-math.log10(rest)))
    return f"{100.0 * share:.{digits}f} %"


def limit(value: float | None, unit: str = "") -> str:
    """Return a limit as somebody wrote it: all of its digits.

    Examples
    --------
    >>> limit(79.9, "mm"), limit(0.95, SHARE)
    ('79.9 mm', '95 %')
    """
    if value is None:
        return UNKNOWN
    if unit == SHARE:
        value, unit = 100.0 * value, "%"
    text = f"{value:.12g}".replace("-", MINUS)
    return f"{text} {unit}" if unit else text


def decimals(value: float, digits: int = SIGMA_DIGITS) -> int:
    """Return the decimals of a number's last significant digit; below 0 for tens and more."""
    # Rounded first: 0.00996 becomes 0.010 and has the decimals of that.
    return digits - 1 - int(f"{abs(value):.{digits - 1}e}".split("e")[1])


def _fixed(value: float, places: int, signed: bool) -> str:
    """A value rounded at a decimal, with a sign as it is printed."""
    if places > MOST_DECIMALS:
        text = f"{value:.{SIGMA_DIGITS}g}"
    else:
        text = f"{round(value, places):.{max(places, 0)}f}"
    if float(text) == 0:
        return text.lstrip("-")
    plus = "+" if signed and value > 0 else ""
    return plus + text.replace("-", MINUS)
