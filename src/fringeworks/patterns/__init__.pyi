"""What the projector shows: plans of shifted fringes and Gray code, and their pictures."""

from ..types import (
    Axis as Axis,
)
from .plan import (
    Block as Block,
)
from .gray_code import (
    GrayCode as GrayCode,
)
from .plan import (
    PhaseSteps as PhaseSteps,
    Uniform as Uniform,
    equal_steps as equal_steps,
)
from .order_chain import (
    OrderChain as OrderChain,
)
from .propose import (
    Proposal as Proposal,
)
from ..rig.depth_plan import (
    propose_for_depth as propose_for_depth,
)
