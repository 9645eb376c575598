"""From a stack of images to materials: data, model, search and verdict.

`stack` holds what was measured and `model` says what a material gives in every image, mostly from `tables`. `images` is
`phasemap.invert`: pixel by pixel, `search` finds the materials and `posterior` their errors. `region_fit` is
`phasemap.fit_regions`: for regions (`regions`) and unknown `zeros`, from `starts`, by the `joint` least squares;
`identifiability` says what stays open, `verdict` judges both, and `sensitivities` say beforehand what can be learnt.
"""
