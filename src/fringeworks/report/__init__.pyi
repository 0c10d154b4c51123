"""Summaries, tables and figures of results."""

from .boards import (
    board_sheet as board_sheet,
)
from .boards import (
    write_board as write_board,
)
from .figures import (
    best_map as best_map,
)
from .page.report import (
    ReportWritten as ReportWritten,
)
from .page.tolerances import (
    Tolerance as Tolerance,
)
from .page.tolerances import (
    parse_tolerance as parse_tolerance,
)
from .setup_figures import (
    setup_sheet as setup_sheet,
)
from .summary import (
    summarise as summarise,
)
from .tables import (
    format_table as format_table,
)
from .tables import (
    to_json as to_json,
)
from .viewer.pack import (
    PackedSurface as PackedSurface,
)
from .viewer.pack import (
    pack_surface as pack_surface,
)
