"""What an answer is called: its variables, their units and flags, its status, where it came from.

A solver's row becomes a variable by `variables`, which also writes the provenance. What is not good has a
`status`, whose value is the advice.
"""
