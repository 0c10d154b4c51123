"""Shifted frames and Gray code: from a stack of frames to projector coordinates."""

from ..pipeline.sequences import (
    MeasuredMoment as MeasuredMoment,
)
from ..pipeline.sequences import (
    measure_sequence as measure_sequence,
)
from ..pipeline.verbs import (
    separate_light as separate_light,
)
from ..pipeline.verbs import (
    wrapped_phase as wrapped_phase,
)
from ..types import (
    CoordinateMap as CoordinateMap,
)
from .decoder import (
    Decoder as Decoder,
)
from .even_light import (
    texture as texture,
)
from .fusing import (
    fuse as fuse,
)
from .light_separation import (
    LightSeparation as LightSeparation,
)
from .motion import (
    Motion as Motion,
)
from .options import (
    DecodeOptions as DecodeOptions,
)
from .sequence import (
    Moment as Moment,
)
from .sequence import (
    SequenceDecoder as SequenceDecoder,
)
from .sequence import (
    SequenceOptions as SequenceOptions,
)
from .sequence import (
    decode_sequence as decode_sequence,
)
from .shifts import (
    estimate_shifts as estimate_shifts,
)
from .stream import (
    StreamingDecoder as StreamingDecoder,
)
from .wrapped import (
    WrappedPhase as WrappedPhase,
)
