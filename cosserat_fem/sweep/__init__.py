"""What changes when values of a scene change? Many runs of one scene, in this process or on a Dask cluster.

Rule: a study. Each case is a scene of its own with a folder of its own, named by the digest of that scene; a folder that is
there is a case that is done, because it gets its name when everything in it is written. So a sweep that is repeated, was
interrupted or lost a process does only what is missing, and where a case was run leaves no trace in its results.
`case` runs one, `cluster` many at once, `rows` says what each gave, `statistics` what all of them say together, `plots` how
that looks, `command` what is written and told.
"""
