"""Curves of orbits: every branch by continuation, and what a slow sweep up and down visits of them.

`control` says what is swept and how the law and the lever depend on it, `pieces` follows the curves, `walk` goes along
them as an experiment does, `record` makes the Dataset.
"""
