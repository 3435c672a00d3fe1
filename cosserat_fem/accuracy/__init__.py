"""How far is a result from the truth, and which elements bring it near?

Rule: an error is estimated for what is reported. `estimate` and `drift` find it, `refine` chooses elements, `transfer` takes
states to them.
"""
