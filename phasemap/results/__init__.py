"""Names of an answer: its variables, their units and flags, its status, and its provenance.

A solver's row becomes a variable by `variables`, which also names the flags and writes the provenance. What is not
good has a `status`, whose value is the advice; `descriptions` say it, and what lies outside the model.
Derived channels, such as the loss tangent, have their formulas in `quantities` and are offered by `channels`.
"""
