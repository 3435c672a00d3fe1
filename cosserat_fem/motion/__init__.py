"""Which motion follows in time?

Rule: a step is accepted or made anew; what it cost in energy is kept. `dynamics` is asked, `integrator` steps, `stepping`
chooses steps for an accuracy; `stops` knows when something happens, `impact` blows and `ledger` their energy, `rates`
velocities, `steps` what may be asked for.
"""
