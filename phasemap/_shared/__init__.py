"""What every module may use, and what knows nothing of the physics.

First comes what is wrong (`errors`, `checks`), then what a number is: text with a unit (`quantities`, `units`), one
outside all practice (`plausible`), the field of a value object (`fields`), one of an array (`arrays`). Then what the
machine has (`memory`, `files`), how work is spread (`threads`, `processes`, `dask_arrays`) and stopped (`interrupts`),
and how all that is said (`shown`, `sentences`, `notices`). Nothing in here imports from another folder of phasemap
except the kernels.
"""
