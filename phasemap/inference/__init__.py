"""Inference: from measurements to the material, and how sure it is.

`curves` fits single sweeps, `images` stacks of images, pixel by pixel or region by region. Both first ask which
branch was measured, then for the best parameters, and last what the data leave open. `series` explains files of which
settings are missing, by draws of all that is unknown (`sampling`). `determined` says for all of them what is known
beforehand, when a model does not describe data, and what data determine.
"""
