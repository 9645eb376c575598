"""What every module may use, and what knows nothing of the physics.

First comes what is wrong (`errors`, `checks`, `units`), then what the machine has (`memory`, `files`), then how
work is spread (`threads`, `processes`, `dask_arrays`) and stopped (`interrupts`). Nothing in here imports from
another folder of phasemap except the kernels.
"""
