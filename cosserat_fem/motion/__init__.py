"""Which motion follows in time?

Rule: a step is accepted or made anew; what it cost in energy is kept. `dynamics` is asked, `integrator` steps, `stepping`
chooses steps for an accuracy; `impact` knows blows, `rates` velocities.
"""
