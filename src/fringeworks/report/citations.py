"""What to cite for a result: the software, and the papers of the method that made it."""

from __future__ import annotations

import inspect
import re

from fringeworks import _core
from fringeworks.pair.analyse import methods
from fringeworks.types import InputError

DOI = re.compile(r"doi:(10\.\d{4,9}/[^\s;,)\]]+[^\s;,.)\]])")
"""A DOI in a docstring."""
SOFTWARE = "The fringeworks authors: fringeworks, version {version}. {address}"
"""How the software is cited; CITATION.cff has the same."""
ADDRESS = "https://github.com/fringeworks/fringeworks"
"""Where the software is."""


def cite(result: object = None) -> str:
    """Return what to cite, a line each: the software, and papers of the method that was used.

    Parameters
    ----------
    result : any result of fringeworks, or str, optional
        A result that names its method, such as a reconstruction; or the name of a method.

    Returns
    -------
    str: one line for the software, and one for each DOI in the method's documentation.

    Raises
    ------
    InputError for a name that no method has.

    Examples
    --------
    >>> import fringeworks as fw
    >>> print(fw.report.cite("fourier").splitlines()[1])
    https://doi.org/10.1364/AO.22.003977 (method fourier)
    """
    lines = [SOFTWARE.format(version=_core.version, address=ADDRESS)]
    name = result if isinstance(result, str) else _method(result)
    known = methods()
    if isinstance(result, str) and name not in known:
        raise InputError(f"method: expected one of {', '.join(known)}, got {name!r}")
    if name in known:
        text = inspect.getdoc(known[name].function) or ""
        found = dict.fromkeys(DOI.findall(text))
        lines += [f"https://doi.org/{doi} (method {name})" for doi in found]
    return "\n".join(lines)


def _method(result: object) -> str:
    """The method that a result names; empty for none."""
    inner = getattr(result, "surface", result)
    return str(getattr(inner, "method", "") or "")
