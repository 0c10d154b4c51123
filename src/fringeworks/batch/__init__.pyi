"""Many captures by one recipe, on the cores of this machine or on a Dask cluster."""

from .scans import (
    Scan as Scan,
    find_scans as find_scans,
)
from .run import (
    run_batch as run_batch,
    BatchResult as BatchResult,
)
from .report import (
    write_batch_report as write_batch_report,
)
from .sequence import (
    run_sequence as run_sequence,
    SequenceResult as SequenceResult,
)
from .sequence_report import (
    write_sequence_report as write_sequence_report,
)
