"""Messages, progress and results: to the terminal, to a log, to files or standard output."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import fringeworks as fw

STDOUT = "-"
"""Name that stands for standard output."""
TARGETS: dict[str, tuple[str, ...]] = {
    "out": (),
    "target": (),
    "folder": (),
    "figure": (),
    "report": (),
    "json_file": (".json",),
    "csv": (".csv",),
    "markdown": (".md", ".markdown", ".txt"),
    "log": (".log", ".txt", ""),
}
"""Names of the options that say what is written, with the suffixes of those that have no check of
their own."""
MOST_FINDINGS = 5
"""Findings that a command prints unless asked for all: the first causes are read, a page is not."""


@dataclass
class _Settings:
    """What the options of all commands ask for; set once, before a command runs."""

    quiet: bool = False
    verbose: bool = False
    log: Path | None = None
    json: Path | None = None
    """Where the figures of the command go that runs; None where nobody asked, and once written."""


_settings = _Settings()


def configure(*, quiet: bool, verbose: bool, log: Path | None) -> None:
    """Set the options of all commands."""
    if quiet and verbose:
        raise fw.InputError("--verbose: it cannot be combined with --quiet")
    if log is not None:
        _check_suffix("log", log)
    _settings.quiet, _settings.verbose = quiet, verbose
    _settings.log, _settings.json = log, None
    if log is not None:
        _write_log(f"fringeworks {fw.__version__}: {' '.join(sys.argv[1:])}")


def is_quiet() -> bool:
    """Whether nobody sees what a command says: neither the terminal nor a log."""
    return _settings.quiet and _settings.log is None


def want_json(path: Path | None) -> Path | None:
    """Remember where the figures of the command go, for a command that fails."""
    _settings.json = path
    return path


def fail(message: str, findings: Sequence[fw.Finding] = ()) -> int:
    """What was found and why the command fails, a line each on stderr; the exit code of bad input.

    Findings go to ``--json`` as well, where the command has not written its figures yet.
    """
    message = _one_line(message)
    # Where the log or the figures cannot be written, that is the error already.
    with suppress(fw.InputError):
        for line in (*(f.line for f in _by_effect(findings)), f"error: {message}"):
            _write_log(_one_line(line))
    for line in (*_shown(findings), f"fringeworks: {message}"):
        sys.stderr.write(f"{_one_line(line)}\n")
    if findings:
        from fringeworks.files.findings import findings_as_dicts

        with suppress(fw.InputError):
            write_json(_settings.json, {"error": message, "findings": findings_as_dicts(findings)})
    return 2


def _one_line(text: str) -> str:
    return " ".join(text.split())


def _by_effect(findings: Iterable[fw.Finding]) -> list[fw.Finding]:
    from fringeworks.types import by_effect

    return by_effect(findings)


def _shown(findings: Iterable[fw.Finding]) -> list[str]:
    """Lines of the findings that matter most, all errors among them, and how many are left out."""
    first = _by_effect(findings)
    errors = sum(finding.severity == "error" for finding in first)
    shown = len(first) if _settings.verbose else max(MOST_FINDINGS, errors)
    lines = [finding.line for finding in first[:shown]]
    if len(first) > shown:
        left = len(first) - shown
        lines.append(
            f"and {left} smaller finding{'s' * (left > 1)}; `fringeworks --verbose` shows all"
        )
    return lines


class Output:
    """The words of one command: on stdout, or on stderr where a result goes to stdout."""

    def __init__(self, *targets: Path | None) -> None:
        count = sum(is_stdout(target) for target in targets)
        if count > 1:
            raise fw.InputError(
                f"expected one result on standard output, got {count} options with '-'"
            )
        self._err = count == 1

    def say(self, text: str) -> None:
        """Print a line of text."""
        _write_log(text)
        self._echo(text)

    def _echo(self, text: str) -> None:
        if not _settings.quiet:
            print(text, file=sys.stderr if self._err else sys.stdout, flush=True)

    def wrote(self, *targets: Path | None) -> None:
        """Say which files were written."""
        for target in targets:
            if target is not None and not is_stdout(target):
                self.say(f"wrote {target}")

    def found(self, findings: Iterable[fw.Finding]) -> None:
        """Print the findings that matter most, a line each; the log gets all of them."""
        every = _by_effect(findings)
        for finding in every:
            _write_log(finding.line)
        for line in _shown(every):
            self._echo(line)

    def tell(self, result: Any, figures: dict[str, Any]) -> None:
        """Print what a result says, with its figures and what else is known."""
        from fringeworks.report.kind import Rows, words_of
        from fringeworks.types import Finding

        found: list[fw.Finding] = []
        for word in (*words_of(result, figures), ""):
            if isinstance(word, Finding):
                found.append(word)
                continue
            self.found(found)
            found.clear()
            if isinstance(word, Rows):
                self.table(word.columns, word.rows, lines=word.ruled)
            elif word:
                self.say(word)

    def table(
        self, columns: Sequence[str], rows: Sequence[Sequence[str]], *, lines: bool = False
    ) -> None:
        """Print a table; with lines between the rows where cells are sentences."""
        from rich import box
        from rich.console import Console
        from rich.table import Table

        style = box.SIMPLE_HEAD if lines else None
        table = Table(*columns, box=style, pad_edge=False, show_lines=lines)
        for row in rows:
            table.add_row(*row)
            _write_log("  ".join(row))
        if not _settings.quiet:
            Console(stderr=self._err).print(table)


def is_stdout(target: Path | None) -> bool:
    """Whether a target stands for standard output."""
    return target is not None and str(target) == STDOUT


@contextmanager
def target(path: Path, suffix: str) -> Iterator[Path]:
    """The file to write a result to; for standard output, a file with the suffix that is copied."""
    if not is_stdout(path):
        yield path
        return
    import shutil
    import tempfile

    with tempfile.TemporaryDirectory(prefix="fringeworks-") as folder:
        inside = Path(folder) / f"result{suffix}"
        yield inside
        sys.stdout.flush()
        with inside.open("rb") as file:
            shutil.copyfileobj(file, sys.stdout.buffer)
        sys.stdout.buffer.flush()


def _figure() -> Callable[[Path], None]:
    from fringeworks.report.figures import check_figure_target

    return check_figure_target


def _report() -> Callable[[Path], None]:
    from fringeworks.report.page.report import check_report_target

    return check_report_target


def _board() -> Callable[[Path], None]:
    from fringeworks.report.boards import check_board_target

    return check_board_target


DRAWN = {"figure": _figure, "report": _report, "board": _board}
"""What is drawn by Matplotlib, which is loaded only where there is a file to check."""


def check(path: Path | None, *kinds: str, content: str | None = None) -> None:
    """Refuse a target that cannot be written, before anything is computed for it.

    Parameters
    ----------
    path : Path, optional
    *kinds : str
        One of ``DRAWN``, or formats of ``fringeworks.files.formats``, one of which is written.
    content : str, optional
        What a file of points is to hold, as ``--ply`` says.
    """
    if path is None:
        return
    drawn = DRAWN.get(kinds[0])
    if drawn is not None:
        from fringeworks.report.drawing import need_plots

        need_plots(f"{path}")
    if content is not None:
        from fringeworks.files.point_writers import check_kind

        check_kind(Path("points.ply") if is_stdout(path) else path, content)
    if is_stdout(path):
        return
    if drawn is not None:
        drawn()(path)
    else:
        from fringeworks.files.formats import check_target_of

        check_target_of(path, *kinds)


def draws(words: Output, path: Path) -> bool:
    """Whether a picture that nobody asked for can be drawn; says so where it is left out."""
    try:
        check(path, "figure")
    except fw.MissingPackage as missing:
        words.say(f"left out {missing}")
        return False
    return True


def refuse_inputs(given: Mapping[str, Any]) -> None:
    """Refuse, before anything is done, to write to what the same command reads.

    Parameters
    ----------
    given : mapping
        The arguments and options of a command by their names.
    """
    targets = {name: given.get(name) for name in TARGETS} | {"log": _settings.log}
    read = [
        path
        for name, value in given.items()
        if name not in TARGETS
        for one in (value if isinstance(value, list | tuple) else (value,))
        for path in _paths_in(one)
    ]
    for name, path in targets.items():
        if not isinstance(path, Path) or is_stdout(path):
            continue
        option = _check_suffix(name, path)
        if any(_reads(source, path) for source in read):
            raise fw.FileProblem(f"{path}: {option} would replace what this command reads")
    _refuse_twice(targets)


def _refuse_twice(targets: Mapping[str, Any]) -> None:
    """Refuse two results of a command under one name: the second would replace the first."""
    named: dict[Path, str] = {}
    for name, path in targets.items():
        if isinstance(path, Path) and not is_stdout(path):
            other = named.setdefault(path.resolve(), name)
            if other != name:
                options = " and ".join(f"--{key.removesuffix('_file')}" for key in (other, name))
                raise fw.FileProblem(f"{path}: {options} would write the same file")


def _paths_in(value: Any) -> list[Path]:
    """The paths that the value of an option names: itself, or after = or :, where they exist."""
    if isinstance(value, Path):
        return [value]
    if not isinstance(value, str) or "\0" in value:
        return []
    parts = (value, value.partition("=")[2], value.partition(":")[2])
    return [Path(part) for part in parts if part and is_there(part)]


def is_there(name: str) -> bool:
    """Whether a file or folder has a name; False for a name that nothing can have."""
    try:
        return Path(name).exists()
    except (OSError, ValueError):
        return False


def _check_suffix(name: str, path: Path) -> str:
    """Refuse a file of another kind than an option writes, as ``check`` does for those that have a
    format; return the option."""
    option, kinds = f"--{name.removesuffix('_file')}", TARGETS[name]
    if kinds and path.suffix.lower() not in kinds:
        from fringeworks.files.atomic import check_target

        check_target(path, filter(None, kinds), f"{option} writes no other kind")
    return option


def _reads(source: Path, path: Path) -> bool:
    """Whether a file is a source of a command, or an image or a description in its folder."""
    here, there = source.resolve(), path.resolve()
    if here == there:
        return True
    if here not in there.parents or not there.is_file():
        return False
    from fringeworks.files.capture_writer import TRUTH_FILE
    from fringeworks.files.images import IMAGE_SUFFIXES

    return there.suffix.lower() in (*IMAGE_SUFFIXES, ".toml", ".npy") or there.name == TRUTH_FILE


def head_fields(given: Sequence[str] | None) -> dict[str, str]:
    """Return the fields of a report's head from words such as ``serial=18``."""
    fields: dict[str, str] = {}
    for one in given or ():
        name, sign, text = one.partition("=")
        if not sign or name in fields:
            raise fw.InputError(f"--head: expected each field once as serial=18, got {one!r}")
        fields[name] = text
    from fringeworks.types.report_head import checked_head  # when it is used

    return checked_head(fields)


def check_folder(path: Path) -> None:
    """Refuse standard output where a folder is written."""
    if is_stdout(path):
        raise fw.InputError("--out: expected the name of a folder, got standard output")


def write_text(path: Path | None, text: str) -> None:
    """Write text to a file or to standard output, where it is asked for."""
    if path is None:
        return
    if is_stdout(path):
        sys.stdout.write(text)
        sys.stdout.flush()
    else:
        from fringeworks.files.atomic import write_text as write

        write(path, text)


def write_json(path: Path | None, content: Any) -> None:
    """Write figures as JSON, where they are asked for."""
    _settings.json = None
    if path is not None:
        write_text(path, fw.report.to_json(content))


def draw(figure: Any, path: Path, provenance: fw.Provenance | None) -> None:
    """Write a picture to a file, or as PNG to standard output."""
    with target(path, ".png") as place:
        fw.save_figure(figure, place, provenance=provenance)


@contextmanager
def progress(total: int | None = None) -> Iterator[Callable[[object], None]]:
    """Show how work gets on, with the time left where the number of steps is known.

    A moving line on a terminal, else a line now and then; both on stderr.
    """
    from fringeworks.report.progress_bar import lines, terminal

    if _settings.quiet or not sys.stderr.isatty():
        yield lines(total, _line_of_progress)
        return
    with terminal(total) as show:
        yield show


def _line_of_progress(line: str) -> None:
    """Progress for logs and pipes."""
    _write_log(line)
    if not _settings.quiet:
        sys.stderr.write(f"{line}\n")
        sys.stderr.flush()


def _write_log(text: str) -> None:
    if _settings.log is None:
        return
    stamp = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    try:
        with _settings.log.open("a", encoding="utf-8") as file:
            file.write(f"{stamp} {text}\n")
    except OSError as error:
        path, _settings.log = _settings.log, None
        raise fw.InputError(f"{path}: could not be written: {error.strerror}") from error
