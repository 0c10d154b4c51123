"""Damaged files that follow the branches of a reader: ``python -m tests.fuzz_guided READER``.

The fuzzer atheris sees which branches of ``fringeworks.files`` a file takes, and changes it towards
new ones. It begins with the good file of that reader. A reader that raises anything but an
``InputError`` ends the run with an error, and the file is kept as ``crash-…``. Readers that start a
process of their own are guided up to the process only.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import warnings
from pathlib import Path


def main() -> None:
    """Fuzz one reader for a time, or list the readers."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("reader", nargs="?", help="name of a reader; without one they are listed")
    parser.add_argument("--seconds", type=int, default=60)
    given = parser.parse_args()
    # The fuzzer, which few environments have, must see the package as it loads.
    import atheris

    with atheris.instrument_imports(include=["fringeworks.files"]):
        from fringeworks import InputError
        from tests import hostile
        from tests.fuzz_files import place
    warnings.simplefilter("ignore")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "good").mkdir()
        targets = {target.name: target for target in hostile.targets(folder / "good")}
        if given.reader is None:
            print(*targets, sep="\n")
            return
        target = targets[given.reader]
        (folder / "corpus").mkdir()
        (folder / "corpus" / "good").write_bytes(target.content)

        def read(content: bytes) -> None:
            path = place(folder / "read", target, content)
            try:
                target.read(path)
            except InputError as error:
                if "\n" in str(error):
                    raise ValueError("a message of several lines") from error

        words = [f"-max_total_time={given.seconds}", "-rss_limit_mb=8192", "-timeout=60"]
        atheris.Setup([sys.argv[0], *words, str(folder / "corpus")], read)
        atheris.Fuzz()


if __name__ == "__main__":
    main()
