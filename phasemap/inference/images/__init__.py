"""Inversion of a stack of images: data, model, search for the materials, and verdict.

`stack` holds what was measured and the zeros that are unknown, and `least_squares` is the problem of pixels or of
regions, from `starts`. `invert` and `regions` are `phasemap.invert` and `fit_regions`, with errors, Datasets and
sentences, and `sensitivities` say beforehand what can be learnt.
"""
