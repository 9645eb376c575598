"""From a stack of images to materials: data, model, search and verdict.

`stack` holds what was measured, `model` says what a material gives in every image, mostly from `tables`. A `problem` is
the least squares of pixels or of regions with their `zeros`; `descent` solves many at once, from a `grid` of materials.
`images` is `phasemap.invert`, with errors of `posterior`; `region_fit` is `phasemap.fit_regions`, for `regions` and
unknown zeros, from `starts`, with errors of the draws in `joint`. `sensitivities` say beforehand what can be learnt.
"""
