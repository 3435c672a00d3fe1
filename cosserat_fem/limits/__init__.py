"""What is allowed, and is it kept? Rules and limits, the quantities they speak of, verdicts, margins.

Rule: a limit that cannot be judged counts as violated. `rules` and `allowed` say what is asked, `quantities` and `gaps` what
there is, `verdicts` holds one against the other, `margins` keeps the answer.
"""
