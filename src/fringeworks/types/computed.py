"""Properties that are computed once."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from functools import cached_property
else:

    class cached_property(functools.cached_property):  # noqa: N801
        """``functools.cached_property`` without a lock.

        Python 3.11 holds a lock while it computes. A process that another thread forks meanwhile
        inherits the locked lock, and waits for it without end. Without the lock, two threads may
        both compute a value; both get the same.
        """

        def __get__(self, instance, owner=None):
            if instance is None:
                return self
            return instance.__dict__.setdefault(self.attrname, self.func(instance))


__all__ = ["cached_property"]
