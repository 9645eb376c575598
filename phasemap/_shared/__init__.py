"""What every module may use, and what knows nothing of the physics.

First comes what is wrong (`errors`, `checks`), then what a number is: text with a unit (`quantities`, `units`), one
that nobody measures (`plausible`), the field of a value object (`fields`). Then what the machine has (`memory`,
`files`), and how work is spread (`threads`, `processes`, `dask_arrays`) and stopped (`interrupts`). Nothing in here
imports from another folder of phasemap except the kernels.
"""
