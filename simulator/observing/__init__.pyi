from simulator.observing.hole_stack import (
    HoleStacks as HoleStacks,
    hole_stackable as hole_stackable,
    hole_stacks as hole_stacks,
)
from simulator.observing.observation import Observation as Observation, Role as Role, observe as observe
from simulator.observing.sequence import (
    MAX_STACK_BYTES as MAX_STACK_BYTES,
    FrameSequence as FrameSequence,
    Truth as Truth,
    calibrate as calibrate,
)
