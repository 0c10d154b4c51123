"""What the projector shows: plans of shifted fringes and Gray code, and their pictures."""

from ..rig.depth_plan import (
    propose_for_depth as propose_for_depth,
)
from ..types import (
    Axis as Axis,
)
from .gray_code import (
    GrayCode as GrayCode,
)
from .order_chain import (
    OrderChain as OrderChain,
)
from .plan import (
    Block as Block,
)
from .plan import (
    PhaseSteps as PhaseSteps,
)
from .plan import (
    Uniform as Uniform,
)
from .plan import (
    equal_steps as equal_steps,
)
from .propose import (
    Proposal as Proposal,
)
