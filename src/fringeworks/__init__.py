"""Fringe projection profilometry: from photographs of projected fringes to heights and points.

``__init__.pyi`` lists the public names and the file that each one is loaded from on first use, so
that ``import fringeworks`` stays quick.
"""

import warnings as _warnings

import lazy_loader as _lazy

from fringeworks import _core

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
__version__ = _core.version

if not _core.optimised:
    _warnings.warn(
        "fringeworks runs on a debug build of its kernels; build with `maturin develop --release`",
        RuntimeWarning,
        stacklevel=2,
    )
