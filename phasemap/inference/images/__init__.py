"""From a stack of images to materials: data, model, search and verdict.

`stack` holds what was measured, `model` says what a material gives in every image, and a `problem` is the least squares
of pixels or of regions with their `zeros`, from `starts`. `images` is `phasemap.invert`, with errors of `posterior`;
`region_fit` is `phasemap.fit_regions`, with errors of the draws in `joint`. `answer` makes their Datasets and
sentences, and `sensitivities` say beforehand what can be learnt.
"""
