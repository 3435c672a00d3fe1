"""Which equilibria are there, and what are they like?

Rule: nothing moves by itself here; parts are led. `statics` finds states, `march` the stations on the way, `continuation`
the way past limit points; `vibration` and `stability` say what a state is like.
"""
