"""Many captures by one recipe, on the cores of this machine or on a Dask cluster."""

from .report import (
    write_batch_report as write_batch_report,
)
from .run import (
    BatchResult as BatchResult,
)
from .run import (
    run_batch as run_batch,
)
from .scans import (
    Scan as Scan,
)
from .scans import (
    find_scans as find_scans,
)
from .sequence import (
    SequenceResult as SequenceResult,
)
from .sequence import (
    run_sequence as run_sequence,
)
from .sequence_report import (
    write_sequence_report as write_sequence_report,
)
