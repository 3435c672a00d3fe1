"""Which length, which clip? The values of a scene that make a result least while other results keep their limits.

Rule: a study. Every trial is a whole quasi-static run of a changed scene, and every answer is one of the trials: nothing is
interpolated. `trial` runs one, `search` chooses the next with published optimisers, `command` says what is written and told,
`plots` how it looks.
"""
