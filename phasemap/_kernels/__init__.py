"""Compiled code. Units, names and files are unknown here: float64 arrays in, float64 arrays and status codes out.

`law`, `columns`, `quadrature`, `neck` and `lever` are what all others stand on; `orbits` says what an orbit is,
`continuation` follows one as something changes, `engagement` says which orbit a tip from far ends on. `rows` has
the loops over materials that Python calls, `scanning` the tip that moves on, `materials` what is known of
neighbours.
"""

from phasemap._kernels import loaded_sources as loaded_sources  # before any kernel, to know what is loaded
