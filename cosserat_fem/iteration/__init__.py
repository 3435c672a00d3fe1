"""How is one nonlinear system solved?

Rule: one state in, one state out; what a state means is asked elsewhere. `newton` iterates, `compiled` does it in one call,
to which `border` hands the arrays; `linear` solves, `barrier` keeps rods out of what they touch, `easing` finds contact
from afar, `arclength` steps along a path.
"""
