"""Fringe projection profilometry: from photographs of projected fringes to heights and points.

The top level has what a first week needs, one verb for each stage: ``propose`` a plan, ``capture``
its pictures, ``calibrate`` a rig, ``measure`` points (or ``reconstruct`` heights from two frames),
``inspect`` a part. The submodules hold the rest, one for each stage: ``patterns``, ``devices``,
``scan``, ``signal``, ``pair``, ``stack``, ``rig``, ``views``, ``surface``, ``evaluate``,
``simulate``, ``files``, ``data``, ``report`` and ``batch``. ``dir()`` of each lists its public
names.
"""

import warnings as _warnings

from fringeworks import _core
from fringeworks._lazy import face as _face

__getattr__, __dir__ = _face(__name__)
__version__ = _core.version

if not _core.optimised:
    _warnings.warn(
        "fringeworks runs on a debug build of its kernels; build with `maturin develop --release`",
        RuntimeWarning,
        stacklevel=2,
    )
