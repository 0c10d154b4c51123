"""Shifted frames and Gray code: from a stack of frames to projector coordinates."""

from ..types import (
    CoordinateMap as CoordinateMap,
)
from .options import (
    DecodeOptions as DecodeOptions,
)
from .decoder import (
    Decoder as Decoder,
)
from .stream import (
    StreamingDecoder as StreamingDecoder,
)
from .motion import (
    Motion as Motion,
)
from .sequence import (
    Moment as Moment,
)
from ..pipeline.sequences import (
    MeasuredMoment as MeasuredMoment,
)
from .sequence import (
    SequenceDecoder as SequenceDecoder,
    SequenceOptions as SequenceOptions,
    decode_sequence as decode_sequence,
)
from ..pipeline.sequences import (
    measure_sequence as measure_sequence,
)
from .fusing import (
    fuse as fuse,
)
from .shifts import (
    estimate_shifts as estimate_shifts,
)
from .light_separation import (
    LightSeparation as LightSeparation,
)
from ..pipeline.verbs import (
    separate_light as separate_light,
)
from .wrapped import (
    WrappedPhase as WrappedPhase,
)
from ..pipeline.verbs import (
    wrapped_phase as wrapped_phase,
)
from .grey_card import (
    white_balance as white_balance,
)
from .colour_steps import (
    unmix as unmix,
)
from .even_light import (
    texture as texture,
)
