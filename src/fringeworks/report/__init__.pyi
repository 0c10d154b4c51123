"""Summaries, tables and figures of results."""

from .summary import (
    summarise as summarise,
)
from .citations import (
    cite as cite,
)
from .tables import (
    format_table as format_table,
)
from ..files.figures import (
    to_json as to_json,
)
from .figures import (
    best_map as best_map,
)
from .setup_figures import (
    setup_sheet as setup_sheet,
)
from .page.report import (
    ReportWritten as ReportWritten,
)
from .page.tolerances import (
    Tolerance as Tolerance,
    parse_tolerance as parse_tolerance,
)
from .boards import (
    board_sheet as board_sheet,
    write_board as write_board,
)
from .viewer.pack import (
    PackedSurface as PackedSurface,
    pack_surface as pack_surface,
)
from .progress_bar import (
    progress as progress,
)
