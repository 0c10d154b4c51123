"""Runs a reader of files within limits; started by ``apart``.

Libraries in C and C++ may crash, print, or take gigabytes on damaged files. Neither this program
nor the readers import anything of the package. Exit code 2: the last line on standard error says
what is wrong.
"""

from __future__ import annotations

import runpy
import sys


def main(reader: str, memory: int, cpu_seconds: int, arguments: list[str]) -> int:
    """Set the limits, and run ``main`` of the reader."""
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
        resource.setrlimit(resource.RLIMIT_CPU, (cpu_seconds, cpu_seconds))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    except (ImportError, ValueError, OSError):
        pass  # no such limits on this system; the caller's time limit remains
    try:
        runpy.run_path(reader)["main"](*arguments)
    except BaseException as error:
        kind = "" if isinstance(error, ValueError) else f"{type(error).__name__}: "
        print(f"{kind}{error}".replace("\n", " "), file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), sys.argv[4:]))
